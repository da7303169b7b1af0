# SPDX-License-Identifier: BSD-3-Clause
"""A motor that turns two joints: its inertia and friction couple them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.effect import Effect, Regressor, Values
from impedance_modules.effects.motion import JointMotion
from impedance_modules.effects.readings import ends
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.effects.joint_motion import Shape, sign
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

SYMBOLS = ("Ia", "fv", "fc")


class TransmissionCoupling(Effect):
    """Off-diagonal rotor inertia and friction of two joints."""

    description = Description(
        id="transmission_coupling",
        sentence="A shaft runs through one joint to the next: turning one of them turns the other's motor as well.",
        equation="tau_i = Ia a_j + fv v_j + fc sgn(v_i + v_j), and the same for j with i;"
        " the diagonal parts belong to reflected_inertia and viscous_friction",
        parameters=(
            Parameter("Ia", "kg.m^2", "rotor inertia that couples them", left_out="0", linear_unit="kg"),
            Parameter(
                "fv", "N.m.s/rad", "viscous friction that couples them", left_out="0", linear_unit="N.s/m"
            ),
            Parameter(
                "fc", "N.m", "dry friction of the common shaft", lower=0.0, left_out="0", linear_unit="N"
            ),
        ),
        ports=("actuator",),
        keys=("pair",),
        signature="each of two joints follows the other's acceleration and speed",
        confusable_with=("crosstalk", "link_inertia", "coulomb_friction"),
        excitation="one joint of the pair at a time, then both",
        reference="Janot, Vandanjon & Gautier 2014 (Staubli TX40 wrist)",
        worn="The plant: the two motors' equations; refused where the rotors' inertia would be no inertia.",
    )

    symmetric = True

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Three columns on the rows of both joints."""
        if not self.shows(port, residual):
            return None
        joint, other = (signals.joint(name) for name in ends(key))
        one, two = (signals.sample(i, motor_side=True) for i in (joint, other))
        rub = sign(one.velocity + two.velocity)
        columns = np.stack(
            [np.stack([far.acceleration, far.velocity, rub], axis=-1) for far in (two, one)], axis=1
        )
        lower = np.array([-np.inf, -np.inf, 0.0])
        return Regressor((joint, other), columns, np.zeros(columns.shape[:2]), lower, np.full(3, np.inf))

    def relations(self, values: Values) -> list[str]:
        """At least one number must be given."""
        return [] if values else [f"gives none of its numbers ({', '.join(SYMBOLS)})"]

    def wear_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Couples motors."""
        for key, values in parameters.items():
            i, j = (builder.joint(name) for name in ends(key))
            builder.coupling[i, j] += values.get("Ia", 0.0)
            builder.coupling[j, i] = builder.coupling[i, j]
            _check(builder, i, j)
            viscous, dry = values.get("fv", 0.0), values.get("fc", 0.0)
            if viscous or dry:
                builder.torques.append(SharedShaft(i, j, viscous, dry))


def _check(builder: PlantBuilder, i: int, j: int) -> None:
    """Refuses an off-diagonal inertia that the two rotors' own cannot carry."""
    own = builder.model.reflected_inertia
    largest = float(np.sqrt(own[i] * own[j]))
    if abs(builder.coupling[i, j]) > 0.99 * largest > 0.0 or (builder.coupling[i, j] and largest == 0.0):
        names = builder.model.joint_names
        raise BadInput(
            f"transmission_coupling on '{names[i]}<-{names[j]}': Ia {builder.coupling[i, j]:g} kg.m^2 is more than"
            f" the two rotors can couple (valid: below sqrt(I_r I_r) = {largest:g})"
        )


class SharedShaft:
    """Friction of a shaft that turns with two motors."""

    def __init__(self, joint: int, other: int, viscous: float, dry: float) -> None:
        """Takes the joints' indices and frictions [N.m.s/rad], [N.m]."""
        self._pair = np.array([joint, other], dtype=np.intp)
        self._viscous, self._dry = viscous, dry

    @property
    def port(self) -> Literal["motor", "link"]:
        """The motor's."""
        return "motor"

    def torque(self, motion: JointMotion) -> Array:
        """Gives minus the consumed torque on both joints (n,) [N.m]."""
        speeds = motion.motor_velocity[self._pair]
        out = np.zeros(motion.position.size)
        out[self._pair] = -self._viscous * speeds[::-1] - self._dry * sign(np.sum(speeds, keepdims=True))
        return out

    def settle(self, motion: JointMotion) -> None:
        """Remembers nothing."""

    def start(self, motion: JointMotion, step: float) -> None:
        """Has nothing to forget."""
