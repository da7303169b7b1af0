# SPDX-License-Identifier: BSD-3-Clause
"""A joint controller whose gains are not those it is said to have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.effect import Effect, Regressor, Values, one_row, unbounded
from impedance_modules.effects.motion import JointMotion
from impedance_modules.effects.residual_kinds import Residual, Stage
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]


class ControllerGain(Effect):
    """Torque from the tracking error beyond the controller's stated one."""

    description = Description(
        id="controller_gain",
        sentence="The drive's position loop is stiffer or softer than stated: it adds torque from the tracking error.",
        equation="motor torque = u + dkp (q_cmd - q) + dkd (v_cmd - v)",
        parameters=(
            Parameter("dkp", "N.m/rad", "stiffness beyond the stated one", linear_unit="N/m"),
            Parameter(
                "dkd",
                "N.m.s/rad",
                "damping beyond the stated one",
                left_out="the stated one is right",
                linear_unit="N.s/m",
            ),
        ),
        ports=("actuator",),
        keys=("joint",),
        signature="follows the tracking error, not the motion",
        confusable_with=("viscous_friction", "reflected_inertia", "parallel_spring"),
        excitation="two sets of gains, with the position command recorded",
        reference="Isaac Sim system identification (stiffness and damping gains)",
        worn="The plant: at the motor, from the joint motion that its driver aims at (Plant.aim).",
    )

    def stage(self, port: Port) -> Stage | None:
        """The drive."""
        return "drive"

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Minus the tracking error and its rate."""
        if not self.shows(port, residual) or signals.position_command is None:
            return None
        joint = signals.joint(key)
        aim = signals.position_command[:, joint]
        error = aim - signals.position[:, joint]
        rate = signals.rate_of(aim) - signals.velocity[:, joint]
        return one_row(joint, -np.stack([error, rate], axis=1), None, *unbounded(2))

    def wear_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Closes a loop around joints."""
        stiffness, damping = np.zeros(builder.model.n), np.zeros(builder.model.n)
        joints = builder.joints(parameters)
        stiffness[joints] = [values["dkp"] for values in parameters.values()]
        damping[joints] = [values.get("dkd", 0.0) for values in parameters.values()]
        builder.torques.append(TrackingTorque(stiffness, damping))


class TrackingTorque:
    """Torque from the plant's own tracking error."""

    def __init__(self, stiffness: Array, damping: Array) -> None:
        """Takes (n,) each [N.m/rad], [N.m.s/rad]."""
        self._stiffness, self._damping = stiffness, damping

    @property
    def port(self) -> Literal["motor", "link"]:
        """The motor's."""
        return "motor"

    def torque(self, motion: JointMotion) -> Array:
        """Gives dkp (q_cmd - q) + dkd (v_cmd - v), (n,) [N.m]."""
        error = motion.position_command - motion.position
        rate = motion.velocity_command - motion.velocity
        return np.asarray(self._stiffness * error + self._damping * rate)

    def settle(self, motion: JointMotion) -> None:
        """Remembers nothing."""

    def start(self, motion: JointMotion, step: float) -> None:
        """Has nothing to forget."""
