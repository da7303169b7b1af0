# SPDX-License-Identifier: BSD-3-Clause
r"""What effects are in somebody's own simulator, whose joints are rigid and have one axis each.

    (M(q) + I) a + h(q, v) = motor torque - F sgn(v) - D v - C v|v| - k (q - q_0)

Motor and link of a rigid joint move together, so an effect at either port changes the same number. Each effect says
as an attribute which of these numbers it changes (``Exported``), and a file format which of them it has a place for
(``impedance_modules/export``). What two effects of a patch do to one number is combined here, as the plant does it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.effect_description import Port

Quantity = Literal[
    "dry friction",
    "viscous friction",
    "drag",
    "rotor inertia",
    "joint spring",
    "torque limit",
    "drive gain",
    "drive lag",
    "late command",
    "servo gains",
    "encoder zero",
    "body inertia",
    "base lean",
]
"""Numbers of a joint, a body or the base that a simulator may have."""

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)

MEANINGS: Mapping[Quantity, str] = {
    "dry friction": "F [N.m], added",
    "viscous friction": "D [N.m.s/rad], added",
    "drag": "C [N.m.s^2/rad^2], added",
    "rotor inertia": "I [kg.m^2], replaced",
    "joint spring": "k [N.m/rad] and preload k q_0 [N.m], added",
    "torque limit": "L [N.m] of the motor torque, the smaller one",
    "drive gain": "s, motor torque per torque asked for, multiplied",
    "drive lag": "T_1 [s] of the motor torque, added",
    "late command": "T [s] from command to motor torque, added",
    "servo gains": "K_p [N.m/rad] and K_d [N.m.s/rad] of the position loop, added",
    "encoder zero": "q_e [rad], reported beyond the true angle, added",
    "body inertia": "m, m c, inertia about the link's origin, added",
    "base lean": "r_x, r_y [rad], rotation vector of the base, added",
}
"""What the numbers of a quantity are, and what becomes of two."""


@dataclass(frozen=True)
class Exported:
    """One quantity that an effect changes.

    Attributes:
        quantity: Which.
        equation: Its numbers from the effect's parameters, in words.
        numbers: The same, computed; empty where the effect's parameters leave the quantity as it is.
        ports: Where the effect must act for it; empty where the port does not matter.
    """

    quantity: Quantity
    equation: str
    numbers: Callable[[Mapping[str, float]], Sequence[float] | Array]
    ports: tuple[Port, ...] = ()

    def acts_at(self, port: Port) -> bool:
        """Says whether the effect changes the quantity when it acts at a port."""
        return not self.ports or port in self.ports


@dataclass(frozen=True)
class Amount:
    """What a whole patch does to one quantity of one joint, body or base.

    Attributes:
        quantity: Which.
        key: Name of the joint or link, or ``base``.
        numbers: As ``MEANINGS`` says.
        effects: Places in the patch of the effects that it comes from.
    """

    quantity: Quantity
    key: str
    numbers: tuple[float, ...]
    effects: tuple[int, ...]

    def with_another(self, other: Amount) -> Amount:
        """Combines two amounts of the same quantity and key."""
        a, b = np.array(self.numbers), np.array(other.numbers)
        if self.quantity == "torque limit":
            both = np.minimum(a, b)
        elif self.quantity == "drive gain":
            both = a * b
        else:
            both = a + b
        effects = (*self.effects, *other.effects)
        return Amount(self.quantity, self.key, tuple(map(float, both)), effects)


def one_number(quantity: Quantity, letter: str, symbol: str, ports: tuple[Port, ...] = ()) -> Exported:
    """Makes the quantity that is one of the effect's parameters as it is."""
    return Exported(quantity, f"{letter} = {symbol}", lambda values: (values[symbol],), ports)


def combined(amounts: Sequence[Amount]) -> tuple[Amount, ...]:
    """Combines amounts of the same quantity and key, in the order of ``QUANTITIES``."""
    found: dict[tuple[Quantity, str], Amount] = {}
    for amount in amounts:
        place = (amount.quantity, amount.key)
        found[place] = found[place].with_another(amount) if place in found else amount
    return tuple(sorted(found.values(), key=lambda amount: QUANTITIES.index(amount.quantity)))
