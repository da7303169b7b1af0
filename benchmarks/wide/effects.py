# SPDX-License-Identifier: BSD-3-Clause
"""Which effects a case can have, drawn by the blind benchmark's hands and scaled to the size of the arm.

An effect that no logged channel can show is not drawn: nothing of the command is seen where it was not logged, nothing
before a joint's torque sensor where only that sensor was.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.blind.bodies import with_payload
from benchmarks.blind.catalogue import CATALOGUE, OPEN_SET, SIMPLER
from benchmarks.blind.injection import Injection, Situation
from benchmarks.blind.plant import Arm
from benchmarks.wide.arms import WideArm
from benchmarks.wide.design import Values

OF_THE_COMMAND = (
    "command_delay", "actuator_lag", "torque_saturation", "controller_gain", "torque_dropouts", "driver_dead_zone",
)  # fmt: skip
BEFORE_THE_SENSOR = (
    *OF_THE_COMMAND, "torque_ripple", "reflected_inertia", "joint_elasticity", "backlash", "transmission_coupling",
    "damaged_tooth", "time_varying_torque_constant", "vibration_tone", "position_dependent_friction",
)  # fmt: skip
OF_A_SPRING = ("joint_elasticity", "backlash")
DRY = (
    "coulomb_friction", "stribeck_friction", "asymmetric_friction", "load_dependent_friction", "hysteresis",
    "position_dependent_friction",
)  # fmt: skip
"""Frictions that differ by the case's law; the others are smooth."""
TORQUES = {
    *DRY, "viscous_friction", "quadratic_drag", "friction_drift", "torque_offset", "torque_ripple", "parallel_spring",
    "controller_gain", "damaged_tooth", "cable_snag", "vibration_tone", "driver_dead_zone", "soft_stop",
    "external_contact", "transmission_coupling",
} - {"load_dependent_friction"}  # fmt: skip
"""Effects whose amplitude is a torque, or a torque per something: their bounds grow with the arm."""
TYPICAL = 20.0
"""Torque [N.m] of the joints that the blind benchmark's bounds were made for."""


def possible(effect: str, values: Values) -> bool:
    """Tells whether the logged channels can show an effect, in this arm."""
    streams, single = values["streams"], values["robot"] == "planar_1"
    if effect in OF_THE_COMMAND and "command" not in streams:
        return False
    if effect in BEFORE_THE_SENSOR and streams == "joint":
        return False
    if effect in OF_A_SPRING and values["transmission"] != "spring":
        return False
    if effect == "crosstalk" and ("joint" not in streams or single):
        return False
    if effect == "velocity_filter_lag" and values["velocity"] == "absent":
        return False
    if effect == "clock_drift" and values["stamps"] not in ("even", "jitter", "uneven"):
        return False
    if effect in ("transmission_coupling", "external_contact") and single:
        return False
    # neither of the two laws has bristles that bend
    return effect != "hysteresis" or values["friction"] not in ("regularised", "constraint")


def names_for(block: str, values: Values) -> list[str]:
    """Returns the effects that a case of a block may have."""
    return [name for name in (OPEN_SET if block == "E" else CATALOGUE) if possible(name, values)]


def draw_effect(name: str, s: Situation) -> Injection:
    """Draws an effect by name, with amplitudes of the arm's size."""
    if name == "payload":
        return payload(s)
    found = {**CATALOGUE, **OPEN_SET}[name](s)
    if name == "external_contact":
        hand = s.arm.machine.hand if isinstance(s.arm, WideArm) else ""
        found = replace(found, parameters=lambda a: {hand: {"F": a}})
    if name in TORQUES:
        scale = max(float(s.peak[s.joint]), 1e-3) / TYPICAL
        found = replace(found, first=found.first * scale, most=max(found.most, 3.0) * scale)
    if name == "reflected_inertia" and s.drive.rotor_inertia[s.joint] <= 0.0:
        return _rotor(s, found)
    return found


def visible(injection: Injection, values: Values) -> bool:
    """Tells whether the port of a drawn effect lies where a logged channel can see it."""
    return not (values["streams"] == "joint" and injection.port == "actuator")


def payload(s: Situation) -> Injection:
    """A mass held by the hand."""
    if not isinstance(s.arm, WideArm):
        raise ValueError("payloads are drawn for arms of this benchmark")
    hand, most = s.arm.machine.hand, s.arm.machine.payload
    size = 0.3 * (most / 3.0) ** (1 / 3)
    place = np.array([*s.rng.uniform(-0.1, 0.1, 2), s.rng.uniform(0.0, 0.25)]) * size

    def apply(arm: Arm, a: float, _: int) -> Arm:
        held = tuple(with_payload(link, a, place) if link.name == hand else link for link in arm.links)
        return replace(arm, links=held)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {hand: {"m": a, "cx": float(place[0]), "cy": float(place[1]), "cz": float(place[2])}}

    return Injection("payload", (s.drive.joints[-1],), "link", 0.1 * most, most, apply, truth)


def _rotor(s: Situation, drawn: Injection) -> Injection:
    """A rotor where none is stated: it can only be heavier."""
    scale = max(float(s.peak[s.joint]), 1e-3) / TYPICAL

    def apply(arm: Arm, a: float, _: int) -> Arm:
        inertia = arm.joints.rotor_inertia.copy()
        inertia[s.joint] = a
        return replace(arm, joints=replace(arm.joints, rotor_inertia=inertia))

    return replace(
        drawn, first=0.2 * scale, most=3.0 * scale, apply=apply, parameters=lambda a: {s.name: {"Ia": a}}
    )


def simpler_than(name: str) -> tuple[str, ...]:
    """Returns effects that a small one may be as good as."""
    return SIMPLER.get(name, ())


def twins(injection: Injection, values: Values) -> tuple[str, ...]:
    """Returns effects that are the same in any motion of this arm, with these channels."""
    found: list[str] = []
    single, name = values["robot"] == "planar_1", injection.effect
    sensed = "joint" in values["streams"]
    if name == "payload" or (name == "link_inertia" and single):
        found += ["link_inertia", "payload"]
    if single and not sensed and name == "torque_gain":
        found += ["link_inertia", "payload"]  # one link's torque is all that the motor gives
    if name in ("reflected_inertia", "link_inertia") and not sensed:
        found += ["reflected_inertia", "link_inertia"]
    if name in ("base_tilt", "encoder_offset") and values["robot"].startswith("planar"):
        found += ["base_tilt", "encoder_offset"]  # both turn gravity against the first link, in the plane
    return tuple(sorted(set(found) - {name}))
