# SPDX-License-Identifier: BSD-3-Clause
"""Every effect that the generator can put into an arm, which of them are easily confused, and ten unknown ones.

The ten (`OPEN_SET`) go wrong with robots and are in no catalogue here: the right answer is "unexplained".
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.blind.bodies import BODIES
from benchmarks.blind.drives import DRIVES, SENSING
from benchmarks.blind.frictions import FRICTIONS, bristles_of
from benchmarks.blind.injection import Draw, Injection, Parameters, Situation, with_friction, with_joint
from benchmarks.blind.plant import Arm

CATALOGUE: dict[str, Draw] = {**FRICTIONS, **DRIVES, **BODIES, **SENSING}
"""The 28 effects that the diagnosis promises to know."""
SUPERSETS: dict[str, tuple[str, ...]] = {
    "coulomb_friction": ("stribeck_friction", "asymmetric_friction", "hysteresis"),
    "viscous_friction": ("friction_drift",),
    "torque_offset": ("parallel_spring",),
    "payload": ("link_inertia",),
    "link_inertia": ("payload",),
}
"""Effects that contain another as a special case: with that one withheld, naming them is no mistake of physics."""
SECONDS = 12.0


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


def soft_stop(s: Situation) -> Injection:
    """A rubber stop that the joint reaches on one side only."""
    at = float(s.centre[s.joint] + s.rng.uniform(0.02, 0.1))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, stop=a, stop_at=at)

    return Injection("soft_stop", (s.name,), "link", 10.0, 300.0, apply, _none)


def torque_dropouts(s: Situation) -> Injection:
    """The driver loses part of the command for some tens of milliseconds, at random."""
    seed = int(s.rng.integers(2**31))

    def apply(arm: Arm, a: float, episode: int) -> Arm:
        faults = replace(arm.faults, drop_times=_times(seed, episode, 0.08, 0.25))
        return with_joint(replace(arm, faults=faults), s.joint, drop=a)

    return Injection("torque_dropouts", (s.name,), "actuator", 0.5, 1.0, apply, _none)


def damaged_tooth(s: Situation) -> Injection:
    """One bad tooth of a belt pulls once per turn of its pulley."""
    at, every = float(s.rng.uniform(0, 0.3)), float(s.rng.uniform(0.25, 0.4))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, bump=a, bump_at=at, bump_every=every, bump_width=0.02)

    return Injection("damaged_tooth", (s.name,), "actuator", 0.5, 12.0, apply, _none)


def cable_snag(s: Situation) -> Injection:
    """A cable catches, is stretched, and slips off."""
    at = float(s.centre[s.joint] + s.rng.uniform(-0.05, 0.05))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, snag=a / 0.12, snag_at=at, snag_force=a)

    return Injection("cable_snag", (s.name,), "link", 0.5, 20.0, apply, _none)


def time_varying_torque_constant(s: Situation) -> Injection:
    """The motor's torque constant swings with time."""
    period = float(s.rng.uniform(2.5, 5.0))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, kt_a=a, kt_T=period)

    return Injection("time_varying_torque_constant", (s.name,), "actuator", 0.05, 0.5, apply, _none)


def vibration_tone(s: Situation) -> Injection:
    """A machine next door shakes the motor at its own frequency."""
    tone = float(2 * np.pi * s.rng.uniform(3.0, 6.0))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, vibration=a, tone=tone)

    return Injection("vibration_tone", (s.name,), "actuator", 0.2, 8.0, apply, _none)


def driver_dead_zone(s: Situation) -> Injection:
    """The driver ignores small commands."""

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, dead=a)

    return Injection("driver_dead_zone", (s.name,), "actuator", 0.2, 5.0, apply, _none)


def position_dependent_friction(s: Situation) -> Injection:
    """Friction that comes and goes along the stroke."""
    often = float(s.rng.uniform(10.0, 20.0))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_friction(
            arm, "actuator", s.joint, fc=a, pa=0.9, pn=often, **bristles_of(s, "actuator", a, 4e-4)
        )

    return Injection("position_dependent_friction", (s.name,), "actuator", 0.3, 12.0, apply, _none)


def encoder_eccentricity(s: Situation) -> Injection:
    """The encoder's disc sits off its axis."""
    phase = float(s.rng.uniform(0, 2 * np.pi))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, eccentric=a, eccentric_phase=phase)

    return Injection("encoder_eccentricity", (s.name,), "sensor", 0.02, 0.3, apply, _none)


def sensor_freeze(s: Situation) -> Injection:
    """All sensors of a joint repeat their last value for a while."""
    seed = int(s.rng.integers(2**31))

    def apply(arm: Arm, a: float, episode: int) -> Arm:
        faults = replace(arm.faults, freeze_times=_times(seed, episode, a, a))
        return with_joint(replace(arm, faults=faults), s.joint, freeze=1.0)

    return Injection("sensor_freeze", (s.name,), "sensor", 0.04, 0.25, apply, _none)


def _none(_: float) -> Parameters:
    return {}


def _times(seed: int, episode: int, shortest: float, longest: float) -> list[tuple[float, float]]:
    rng = np.random.default_rng((seed, episode))
    starts = np.sort(rng.uniform(1.0, SECONDS - 1.0, 8))
    return [(float(start), float(start + rng.uniform(shortest, longest + 1e-9))) for start in starts]


OPEN_SET: dict[str, Draw] = {
    "soft_stop": soft_stop,
    "torque_dropouts": torque_dropouts,
    "damaged_tooth": damaged_tooth,
    "cable_snag": cable_snag,
    "time_varying_torque_constant": time_varying_torque_constant,
    "vibration_tone": vibration_tone,
    "driver_dead_zone": driver_dead_zone,
    "position_dependent_friction": position_dependent_friction,
    "encoder_eccentricity": encoder_eccentricity,
    "sensor_freeze": sensor_freeze,
}
