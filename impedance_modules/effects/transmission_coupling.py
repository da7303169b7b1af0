# SPDX-License-Identifier: BSD-3-Clause
r"""Two joints that share a shaft: off-diagonal rotor inertia and friction.

tau_i = I_{ij} a_j + f_v v_j + f_c sgn(v_i + v_j)      and the same for j with i
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.effects.dry_reversals import REGULARISATION
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.effect_description import Description, Port, joint_parameter
from impedance_modules.effects.joint_motion import (
    REGULARISATION_VELOCITY,
    CompiledTorque,
    JointMotion,
    Shape,
    sign,
)
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.regressor import Regressor, Site, ends
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.errors import BadInput
from impedance_modules.records import Integer, Record, Scalar, Vector

SYMBOLS = ("Ia", "fv", "fc")


class TransmissionCoupling(Effect):
    """Off-diagonal rotor inertia and friction of two joints."""

    description = Description(
        id="transmission_coupling",
        sentence="A shaft runs through one joint to the next: turning one of them turns the other's motor as well.",
        equation="tau_i = Ia a_j + fv v_j + fc sgn(v_i + v_j), and the same for j with i;"
        " the diagonal parts belong to reflected_inertia and viscous_friction",
        parameters=(
            joint_parameter("Ia", "kg.m^2", "rotor inertia that couples them", left_out="0"),
            joint_parameter("fv", "N.m.s/rad", "viscous friction that couples them", left_out="0"),
            joint_parameter("fc", "N.m", "dry friction of the common shaft", lower=0.0, left_out="0"),
        ),
        ports=("actuator",),
        places={"actuator": "transmission"},
        keys=("pair",),
        signature="each of two joints follows the other's acceleration and speed",
        confusable_with=("crosstalk", "link_inertia", "coulomb_friction"),
        excitation="one joint of the pair at a time, then both",
        reference="Janot, Vandanjon & Gautier 2014 (Staubli TX40 wrist)",
        applied="The plant: the two motors' equations; refused where the rotors' inertia would be no inertia.",
    )

    symmetric = True
    nearly_linear = True
    not_exported = "a joint's rotor there does not turn with another joint"
    not_compensated = (
        "it asks for torque in proportion to another joint's acceleration, which nobody measures"
        " (valid: --effects)"
    )

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Three columns on the rows of both joints."""
        joint, other = (site.signals.joint(name) for name in ends(site.key))
        one, two = (site.signals.sample(i, motor_side=True) for i in (joint, other))
        slow = float(shape.get(REGULARISATION, 1.0)) * REGULARISATION_VELOCITY
        rub = sign.python(one.velocity + two.velocity, slow)
        columns = np.stack(
            [np.stack([far.acceleration, far.velocity, rub], axis=-1) for far in (two, one)], axis=1
        )
        lower = np.array([-np.inf, -np.inf, 0.0])
        return Regressor((joint, other), columns, np.zeros(columns.shape[:2]), lower, np.full(3, np.inf))

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Starts at the usual speed over which dry friction changes its sign."""
        return ({REGULARISATION: 1.0},)

    def relations(self, values: Values) -> list[str]:
        """At least one number must be given."""
        return [] if values else [f"gives none of its numbers ({', '.join(SYMBOLS)})"]

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Couples motors."""
        for key, values in parameters.items():
            i, j = (builder.joint(name) for name in ends(key))
            builder.coupling[i, j] += values.get("Ia", 0.0)
            builder.coupling[j, i] = builder.coupling[i, j]
            _check_coupled_inertia(builder, i, j)
            viscous, dry = values.get("fv", 0.0), values.get("fc", 0.0)
            if viscous or dry:
                builder.torques.append(SharedShaft(i, j, viscous, dry))


def _check_coupled_inertia(builder: PlantBuilder, i: int, j: int) -> None:
    """Refuses an off-diagonal inertia that the two rotors' own cannot carry."""
    own = builder.model.rotor_inertia
    largest = float(np.sqrt(own[i] * own[j]))
    if abs(builder.coupling[i, j]) > 0.99 * largest > 0.0 or (builder.coupling[i, j] and largest == 0.0):
        names = builder.model.joint_names
        raise BadInput(
            f"transmission_coupling on '{names[i]}<-{names[j]}': Ia {builder.coupling[i, j]:g} kg.m^2 is more than"
            f" the two rotors can couple (valid: below sqrt(I_r I_r) = {largest:g})"
        )


class ShaftState(Record):
    """Indices of two joints, and the frictions of their common shaft [N.m.s/rad], [N.m]."""

    joint: Integer
    other: Integer
    viscous: Scalar
    dry: Scalar


@compiled
def take_shaft_friction(shaft: ShaftState, motion: JointMotion, torque: Vector) -> None:
    """Subtracts fv v_j + fc sgn(v_i + v_j) from joint i, and the same from j with i [N.m]."""
    i, j, speed = shaft.joint, shaft.other, motion.motor_velocity
    rub = shaft.dry * sign(speed[i] + speed[j], REGULARISATION_VELOCITY)
    torque[i] -= shaft.viscous * speed[j] + rub
    torque[j] -= shaft.viscous * speed[i] + rub


class SharedShaft(CompiledTorque):
    """Friction of a shaft that turns with two motors."""

    port: Literal["motor", "link"] = "motor"
    law = take_shaft_friction

    def __init__(self, joint: int, other: int, viscous: float, dry: float) -> None:
        """Takes the joints' indices and frictions [N.m.s/rad], [N.m]."""
        self.state = ShaftState(joint=joint, other=other, viscous=viscous, dry=dry)
