# SPDX-License-Identifier: BSD-3-Clause
"""Every effect that the generator can put into an arm, and which of them are easily mistaken for each other."""

from __future__ import annotations

from benchmarks.blind.bodies import BODIES
from benchmarks.blind.drives import DRIVES
from benchmarks.blind.frictions import FRICTIONS
from benchmarks.blind.injection import Draw
from benchmarks.blind.sensing import SENSING

CATALOGUE: dict[str, Draw] = {**FRICTIONS, **DRIVES, **BODIES, **SENSING}
"""The 28 effects that the diagnosis promises to know."""

CONFUSABLE: tuple[tuple[str, str], ...] = (
    ("coulomb_friction", "viscous_friction"),
    ("viscous_friction", "quadratic_drag"),
    ("coulomb_friction", "load_dependent_friction"),
    ("torque_offset", "parallel_spring"),
    ("torque_offset", "base_tilt"),
    ("torque_gain", "payload"),
    ("reflected_inertia", "joint_elasticity"),
    ("command_delay", "actuator_lag"),
    ("encoder_offset", "torque_offset"),
    ("backlash", "hysteresis"),
)
"""Pairs that half of the two-cause cases are drawn from."""

SUPERSETS: dict[str, tuple[str, ...]] = {
    "coulomb_friction": ("stribeck_friction", "asymmetric_friction", "hysteresis"),
    "viscous_friction": ("friction_drift",),
    "torque_offset": ("parallel_spring",),
    "payload": ("link_inertia",),
    "link_inertia": ("payload",),
}
"""Effects that contain another as a special case: with that one withheld, naming them is no mistake of physics."""

SIMPLER: dict[str, tuple[str, ...]] = {
    "stribeck_friction": ("coulomb_friction",),
    "asymmetric_friction": ("coulomb_friction",),
    "load_dependent_friction": ("coulomb_friction",),
    "friction_drift": ("viscous_friction",),
    "hysteresis": ("coulomb_friction",),
    "parallel_spring": ("torque_offset",),
    "actuator_lag": ("command_delay",),
    "command_delay": ("actuator_lag",),
    "quadratic_drag": ("viscous_friction",),
    "viscous_friction": ("quadratic_drag",),
}
"""Effects that a small one can be as good as: where the logs hold nothing that tells them apart, both are true."""


def are_one(first: str, second: str) -> bool:
    """Tells whether two effects on the same joint may be one: either contains the other."""
    return second in SUPERSETS.get(first, ()) or first in SUPERSETS.get(second, ())
