# SPDX-License-Identifier: BSD-3-Clause
"""Torque that is off by a constant or by a factor, or is only reported so."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.effect import Effect, JointLaw, Regressor, Values, one_row, unbounded
from impedance_modules.effects.residual_kinds import EFFORT_SIGN, Residual, Stage
from impedance_modules.effects.joint_motion import Sample, Shape
from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]


class TorqueOffset(JointLaw):
    """A constant torque, consumed or only reported."""

    description = Description(
        id="torque_offset",
        sentence="A constant torque, at rest too: a cable that pulls, or an effort sensor with a wrong zero.",
        equation="tau = c; at the sensor: effort reported = effort + c",
        parameters=(Parameter("c", "N.m", "torque consumed, or added to the reading", linear_unit="N"),),
        ports=("actuator", "link", "sensor"),
        keys=("joint",),
        signature="constant, in holds as in moves",
        confusable_with=("encoder_offset", "base_tilt", "asymmetric_friction", "parallel_spring"),
        excitation="static poses with different weight on the joint",
        reference="Khalil & Dombre 2002",
        worn="The plant: as a torque at the motor or link, or in what its effort sensor reports.",
    )

    def shows(self, port: Port, residual: Residual) -> bool:
        """A reading shows wherever the effort enters."""
        return EFFORT_SIGN[residual] != 0.0 if port == "sensor" else super().shows(port, residual)

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes 1."""
        return np.ones((*sample.velocity.shape, 1))

    def bounds(self) -> tuple[Array, Array]:
        """Either sign."""
        return unbounded(1)

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """A column of ones, with the sign of the effort if only the reading is off."""
        if not self.shows(port, residual):
            return None
        sign = EFFORT_SIGN[residual] if port == "sensor" else 1.0
        return one_row(signals.joint(key), np.full((signals.samples, 1), sign), None, *self.bounds())

    def wear_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Torque on the joint, or error of its sensor."""
        if port == "sensor":
            builder.effort_bias[builder.joints(parameters)] += [values["c"] for values in parameters.values()]
        else:
            super().wear_plant(builder, port, parameters)


class TorqueGain(Effect):
    """A factor on the motor's torque or on the reported effort."""

    description = Description(
        id="torque_gain",
        sentence="A wrong torque constant or gear ratio: the motor gives, or the sensor reports, s times the torque.",
        equation="actuator: motor torque = s x torque asked for; sensor: effort reported = s x effort",
        parameters=(Parameter("s", "1", "factor; 1 is nominal", lower=0.0, positive=True),),
        ports=("actuator", "sensor"),
        keys=("joint",),
        signature="in proportion to the joint's own torque, in every regime",
        confusable_with=("payload", "link_inertia", "load_dependent_friction", "torque_saturation"),
        excitation="a known added mass; other joints' rows tell it from a payload",
        reference="Gautier & Briot 2014",
        worn="The plant: in the drive of the motor, or in what its effort sensor reports.",
    )

    def stage(self, port: Port) -> Stage | None:
        """The drive; a sensor consumes nothing."""
        return "drive" if port == "actuator" else None

    def shows(self, port: Port, residual: Residual) -> bool:
        """A reading shows wherever the effort enters."""
        return EFFORT_SIGN[residual] != 0.0 if port == "sensor" else super().shows(port, residual)

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Drive: -u with coefficient s - 1. Sensor: the reading e with coefficient 1 - 1/s, which is exact."""
        torque = signals.effort if port == "sensor" else signals.drive
        if not self.shows(port, residual) or torque is None:
            return None
        joint = signals.joint(key)
        if port == "sensor":
            column = EFFORT_SIGN[residual] * torque[:, joint]
            return one_row(joint, column[:, None], None, np.full(1, -np.inf), np.array([1.0 - 1e-6]))
        return one_row(joint, -torque[:, joint, None], None, np.array([-1.0 + 1e-6]), np.full(1, np.inf))

    def coefficients(
        self, values: Values, signals: Signals, key: str, port: Port
    ) -> tuple[Array, dict[str, float]]:
        """Drive: s - 1. Sensor: 1 - 1/s."""
        s = values["s"]
        return np.array([1.0 - 1.0 / s if port == "sensor" else s - 1.0]), {}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """The inverse of ``coefficients``."""
        found = float(coefficients[0])
        return {"s": 1.0 / (1.0 - found) if port == "sensor" else 1.0 + found}

    def wear_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Scales the drive or the sensor."""
        gains = builder.effort_gain if port == "sensor" else builder.drive_gain
        gains[builder.joints(parameters)] *= [values["s"] for values in parameters.values()]
