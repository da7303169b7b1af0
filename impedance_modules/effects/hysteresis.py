# SPDX-License-Identifier: BSD-3-Clause
r"""Friction that remembers: bristles bend before they slip (Dahl's model).

    \dot z = v (1 - (s0 z / fc) sgn(v))^i,   tau = s0 z

It depends on the path only, not on the speed (`joint_motion.bent`). The exponent says how slowly surfaces come to slip:
with i = 1 a tenth of fc lacks after 2.3 fc / s0, with i = 2 after 9 fc / s0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port, joint_parameter
from impedance_modules.effects.joint_motion import CompiledTorque, JointMotion, Shape, bent
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.regressor import Regressor, Site, one_row
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.records import Flag, Indices, Record, Vector

STRETCH = "stretch"
"""Shape: displacement fc / s0 over which the bristles bend, a presliding displacement [rad]."""

EXPONENT = "i"
"""Shape and parameter: exponent of Dahl's law."""

EXPONENTS = (1.0, 2.0)
"""Exponents that are tried; between them it is estimated. Dahl's own are 1 to 2 for metals and bearings."""

COUNTS = 6
"""Counts of the encoder over which bristles must bend to be told from dry friction, behind any filter."""

PRESLIDING_MAX = 1e-3
"""Way that every dry friction bends before it slides: up to it, no law of its own [rad or m]."""


class Hysteresis(Effect):
    """Dahl friction."""

    description = Description(
        id="hysteresis",
        sentence="Asperities bend before they slip: after a reversal the friction builds up over a short way.",
        equation="dz/dt = v (1 - (s0 z / fc) sgn(v))^i, tau = s0 z",
        parameters=(
            joint_parameter("s0", "N.m/rad", "stiffness of the bristles", lower=0.0, positive=True),
            joint_parameter("fc", "N.m", "friction once slipping", lower=0.0, positive=True),
            Parameter(
                EXPONENT,
                "1",
                "exponent: how slowly it comes to slip",
                lower=EXPONENTS[0],
                upper=EXPONENTS[-1],
                left_out="1, exponential",
                neutral=1.0,
            ),
        ),
        signature="a loop in the position after each reversal that does not depend on the speed",
        confusable_with=("coulomb_friction", "stribeck_friction", "backlash"),
        excitation="tiny reversals of several amplitudes",
        reference="Dahl 1968; Canudas de Wit et al. 1995",
    )
    shape = (STRETCH, EXPONENT)
    not_exported = "friction of a joint there does not remember where the joint came from"
    not_compensated = (
        "its torque depends on the way that the joint came, which the desired motion does not say (valid:"
        " coulomb_friction of its size, where the motion is long)"
    )

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Follows the bristles along the recorded positions, unbent where the recording began."""
        return one_row(site.joint, site.bristles(float(shape[STRETCH]), float(shape[EXPONENT])))

    def unresolved(self, shape: Shape, resolution: float) -> str | None:
        """Bristles that slip within a few counts, or as soon as those of any dry friction, are dry friction."""
        stretch = float(shape[STRETCH])
        if stretch < COUNTS * resolution:
            return (
                f"bristles slip within {COUNTS} counts of the encoder: dry friction as far as it can be seen"
            )
        if stretch < PRESLIDING_MAX:
            return f"bristles slip after {stretch:.2g}, below {PRESLIDING_MAX:g}: so does any dry friction"
        return None

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Tries lengths from a thousandth to a tenth of the joint's travel, with both exponents."""
        position = site.signals.position[:, site.joint]
        travel = max(float(np.ptp(position)), 1e-3)
        lengths = np.geomspace(1e-3 * travel, 0.1 * travel, 8)
        return tuple({STRETCH: float(x), EXPONENT: i} for i in EXPONENTS for x in lengths)

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """Coefficient fc, shape fc / s0 and i."""
        shape = {STRETCH: values["fc"] / values["s0"], EXPONENT: values.get(EXPONENT, 1.0)}
        return np.array([values["fc"]]), shape

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The coefficient is fc; s0 = fc / stretch."""
        fc = float(coefficients[0])
        return {"s0": fc / shape[STRETCH], "fc": fc, EXPONENT: float(shape[EXPONENT])}

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Puts bristles on joints."""
        friction = np.array([values["fc"] for values in parameters.values()])
        stiffness = np.array([values["s0"] for values in parameters.values()])
        exponent = np.array([values.get(EXPONENT, 1.0) for values in parameters.values()])
        side: Literal["motor", "link"] = "motor" if port == "actuator" else "link"
        joints = builder.joints(parameters)
        builder.torques.append(BristleTorque(side, joints, friction, friction / stiffness, exponent))


class BristleState(Record):
    """Bristles on k joints.

    Attributes:
        motor: Whether they are on the motors' side of the gear.
        joints: (k,) indices.
        friction: (k,) fc [N.m].
        stretch: (k,) fc / s0 [rad].
        exponent: (k,) i.
        bend: (k,) zeta at the step's start.
        place: (k,) position there [rad].
    """

    motor: Flag
    joints: Indices
    friction: Vector
    stretch: Vector
    exponent: Vector
    bend: Vector
    place: Vector


@compiled
def add_bristle_torque(bristles: BristleState, motion: JointMotion, torque: Vector) -> None:
    """Subtracts fc zeta [N.m], after the displacement since the step began."""
    position = motion.motor_position if bristles.motor else motion.position
    for k in range(bristles.joints.size):
        i = bristles.joints[k]
        moved = position[i] - bristles.place[k]
        torque[i] -= bristles.friction[k] * bent(
            bristles.bend[k], moved, bristles.stretch[k], bristles.exponent[k]
        )


@compiled
def end_bristle_step(bristles: BristleState, motion: JointMotion) -> None:
    """Keeps the bend at the step's end; a joint that has not moved keeps its bristles as they are."""
    position = motion.motor_position if bristles.motor else motion.position
    for k in range(bristles.joints.size):
        now = position[bristles.joints[k]]
        moved = now - bristles.place[k]
        bristles.bend[k] = bent(bristles.bend[k], moved, bristles.stretch[k], bristles.exponent[k])
        bristles.place[k] = now


class BristleTorque(CompiledTorque):
    """Bristles on some joints of the plant."""

    law, ending = add_bristle_torque, end_bristle_step

    def __init__(
        self,
        port: Literal["motor", "link"],
        joints: NDArray[np.int64],
        friction: Array,
        stretch: Array,
        exponent: Array,
    ) -> None:
        """Takes joint indices (k,), fc (k,) [N.m], fc / s0 (k,) [rad] and i (k,)."""
        self.port = port
        self.state: BristleState = BristleState(
            motor=port == "motor",
            joints=joints,
            friction=friction,
            stretch=stretch,
            exponent=exponent,
            bend=np.zeros(joints.size),
            place=np.zeros(joints.size),
        )

    def start(self, motion: JointMotion, step: float) -> None:
        """Unbends every bristle."""
        position = motion.motor_position if self.port == "motor" else motion.position
        self.state.bend[:], self.state.place[:] = 0.0, position[self.state.joints]
