# SPDX-License-Identifier: BSD-3-Clause
"""Readings that are off: an encoder's zero, and a neighbour's torque in an effort sensor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.effect import PAIR, Effect, Regressor, Values, one_row, unbounded
from impedance_modules.effects.residual_kinds import EFFORT_SIGN, Residual, uses_motion
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.stepped import Stepped

Array = NDArray[np.float64]


class EncoderOffset(Stepped):
    """A joint whose reported angle is off by a constant."""

    description = Description(
        id="encoder_offset",
        sentence="The encoder's zero is off: the joint reports q + dq0, so every weight is computed at a wrong pose.",
        equation="q reported = q + dq0; tau = ID(q reported - dq0) - ID(q reported) = -(dID/dq) dq0",
        parameters=(Parameter("dq0", "rad", "angle reported too much", linear_unit="m"),),
        ports=("sensor",),
        keys=("joint",),
        signature="like weight, on the joint itself and on the joints before and after it",
        confusable_with=("base_tilt", "torque_offset", "payload"),
        excitation="poses over the whole workspace",
        reference="Khalil & Dombre 2002; PACE 2025 (bias)",
        worn="The plant: its position sensor, and the robot's own gravity compensation with it.",
    )
    shape = ("dq0",)
    nearly_linear = True

    def shows(self, port: Port, residual: Residual) -> bool:
        """Wherever the links' model is evaluated."""
        return uses_motion(residual)

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Linearises the inverse dynamics about the angle less the shape's offset, on all joints."""
        if not self.shows(port, residual):
            return None
        joint, offset, rows = signals.joint(key), float(shape["dq0"]), tuple(range(signals.n))
        if offset == 0.0:
            columns = -signals.position_derivative[:, :, joint, None]
            return Regressor(rows, columns, np.zeros(columns.shape[:2]), *unbounded(1))
        v, a = signals.velocity, signals.acceleration
        there = signals.position.copy()
        there[:, joint] -= offset
        columns = -signals.model.position_derivative(there, v, a)[:, :, joint, None]
        return Regressor(rows, columns, signals.model.torque(there, v, a) - signals.rigid, *unbounded(1))

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """Starts without one; what is found moves it."""
        return ({"dq0": 0.0},)

    def wear_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Shifts what the encoder reports."""
        builder.offset[builder.joints(parameters)] += [values["dq0"] for values in parameters.values()]


class Crosstalk(Effect):
    """One joint's torque in another's effort reading."""

    description = Description(
        id="crosstalk",
        sentence="A neighbour's torque bends this joint's effort sensor too: its reading follows the other joint.",
        equation="effort reported of JOINT = effort + c x effort of OTHER",
        parameters=(Parameter("c", "1", "share of the other joint's torque", lower=-1.0, upper=1.0),),
        ports=("sensor",),
        keys=("pair",),
        signature="the residual of one joint follows the torque of another",
        confusable_with=("payload", "link_inertia", "transmission_coupling"),
        excitation="one joint at a time",
        reference="Rethink Robotics: crosstalk_model_effort in SEAJointState",
        worn="The plant: what its effort sensors report.",
    )

    def shows(self, port: Port, residual: Residual) -> bool:
        """Wherever the effort enters."""
        return EFFORT_SIGN[residual] != 0.0

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """The other joint's reading."""
        if not self.shows(port, residual) or signals.effort is None:
            return None
        joint, other = ends(key)
        column = EFFORT_SIGN[residual] * signals.effort[:, signals.joint(other)]
        return one_row(signals.joint(joint), column[:, None], None, -np.ones(1), np.ones(1))

    def wear_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Adds shares of other joints' efforts to readings."""
        for key, values in parameters.items():
            joint, other = ends(key)
            builder.crosstalk[builder.joint(joint), builder.joint(other)] += values["c"]


def ends(key: str) -> tuple[str, str]:
    """Splits ``JOINT<-OTHER``."""
    joint, _, other = key.partition(PAIR)
    return joint, other
