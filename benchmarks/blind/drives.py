# SPDX-License-Identifier: BSD-3-Clause
"""What can be wrong on the way from a command to the torque of a joint, and with its sensors and their clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.injection import Draw, Injection, Situation, with_joint
from benchmarks.blind.plant import Arm


def torque_offset(s: Situation) -> Injection:
    """Constant torque: c is consumed at the motor or on the link, or added to the sensor's reading."""
    port, sign = str(s.rng.choice(["actuator", "link", "sensor"])), float(s.rng.choice([-1, 1]))
    where = {"actuator": "offset", "link": "preload", "sensor": "effort_offset"}[port]
    given = 1.0 if port == "sensor" else -1.0

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, **{where: given * sign * a})

    return Injection("torque_offset", (s.name,), port, 0.1, 10.0, apply, lambda a: {s.name: {"c": sign * a}})


def torque_gain(s: Situation) -> Injection:
    """The motor, or the sensor, gives s times what it says."""
    port, sign = str(s.rng.choice(["actuator", "sensor"])), float(s.rng.choice([-1, 1]))
    where = "gain" if port == "actuator" else "effort_gain"

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, **{where: 1 + sign * a})

    return Injection(
        "torque_gain", (s.name,), port, 0.03, 0.6, apply, lambda a: {s.name: {"s": 1 + sign * a}}
    )


def reflected_inertia(s: Situation) -> Injection:
    """A rotor heavier or lighter than believed; Ia is the whole of it."""
    sign = float(s.rng.choice([-1, 1]))
    believed = float(s.drive.rotor_inertia[s.joint])

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return replace(
            arm, joints=replace(arm.joints, rotor_inertia=_set(arm.joints.rotor_inertia, s.joint, sign * a))
        )

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {s.name: {"Ia": believed + sign * a}}

    most = 0.8 * believed if sign < 0 else 3 * believed
    return Injection("reflected_inertia", (s.name,), "actuator", 0.1 * believed, most, apply, truth)


def backlash(s: Situation) -> Injection:
    """A gap between motor and spring."""

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return replace(arm, joints=replace(arm.joints, gap=_set(arm.joints.gap, s.joint, a)))

    return Injection("backlash", (s.name,), "actuator", 0.01, 0.1, apply, lambda a: {s.name: {"b": a}})


def joint_elasticity(s: Situation) -> Injection:
    """A spring softer than believed: K / (1 + a)."""
    believed = float(s.drive.spring_stiffness[s.joint])

    def apply(arm: Arm, a: float, _: int) -> Arm:
        stiffness = arm.joints.stiffness.copy()
        stiffness[s.joint] = believed / (1 + a)
        return replace(arm, joints=replace(arm.joints, stiffness=stiffness))

    return Injection(
        "joint_elasticity",
        (s.name,),
        "actuator",
        0.5,
        4.0,
        apply,
        lambda a: {s.name: {"K": believed / (1 + a)}},
    )


def parallel_spring(s: Situation) -> Injection:
    """A spring beside the joint: -k (q - q0)."""
    rest = float(s.centre[s.joint] + s.rng.uniform(-0.5, 0.5))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, spring=a, preload=a * rest)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {s.name: {"k": a, "q0": rest, "preload": a * rest}}

    return Injection("parallel_spring", (s.name,), "link", 1.0, 60.0, apply, truth)


def torque_ripple(s: Situation) -> Injection:
    """A sin(N theta + phase)."""
    order, phase = int(s.rng.integers(8, 50)), float(s.rng.uniform(0, 2 * np.pi))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, ripple=a, order=order, phase=phase)

    return Injection(
        "torque_ripple", (s.name,), "actuator", 0.2, 5.0, apply, lambda a: {s.name: {"A": a, "N": order}}
    )


def command_delay(s: Situation) -> Injection:
    """Commands arrive later than believed, at one joint or at all."""
    names = s.drive.joints if s.rng.random() < 0.5 else (s.name,)

    def apply(arm: Arm, a: float, _: int) -> Arm:
        for joint in names:
            arm = with_joint(arm, arm.drive.joints.index(joint), delay=a)
        return arm

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {joint: {"T": a} for joint in names}

    return Injection("command_delay", tuple(names), "timing", 0.004, 0.06, apply, truth)


def actuator_lag(s: Situation) -> Injection:
    """The motor's torque follows its command with a first-order lag."""

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, lag=a)

    return Injection("actuator_lag", (s.name,), "actuator", 0.01, 0.08, apply, lambda a: {s.name: {"T": a}})


def torque_saturation(s: Situation) -> Injection:
    """The motor gives no more than a limit, which every motion reaches and no weight does: else the arm would fall."""
    room = s.least / np.maximum(1.15 * s.weight, 1e-6)
    light = np.flatnonzero(room > 1.15)
    joint = int(s.rng.choice(light)) if light.size else int(np.argmax(room))
    most = float(np.clip(1 - 1 / room[joint], 0.01, 0.5))
    name, least = s.drive.joints[joint], float(s.least[joint])

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, joint, limit=least * (1 - a))

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {name: {"limit": least * (1 - a)}}

    return Injection("torque_saturation", (name,), "actuator", 0.5 * most, most, apply, truth)


def controller_gain(s: Situation) -> Injection:
    """The robot adds torque in proportion to the tracking error."""

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, dkp=a)

    return Injection(
        "controller_gain", (s.name,), "actuator", 10.0, 300.0, apply, lambda a: {s.name: {"dkp": a}}
    )


def transmission_coupling(s: Situation) -> Injection:
    """Two neighbouring motors turn one shaft, whose dry friction follows the sum of their speeds."""
    n = len(s.drive.joints)
    other = s.joint + 1 if s.joint + 1 < n else s.joint - 1
    name = s.drive.joints[other]
    most = 15.0 * float(min(s.drive.rotor_inertia[s.joint], s.drive.rotor_inertia[other]))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        faults = replace(arm.faults, coupling=arm.faults.coupling.copy())
        faults.coupling[s.joint, other] = a
        return replace(arm, faults=faults)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {f"{s.name}<-{name}": {"fc": a}}

    return Injection("transmission_coupling", (s.name, name), "actuator", 0.1, most, apply, truth)


def _set(values: NDArray[np.float64], at: int, more: float) -> NDArray[np.float64]:
    changed = values.copy()
    changed[at] += more
    return changed


DRIVES: dict[str, Draw] = {
    "torque_offset": torque_offset,
    "torque_gain": torque_gain,
    "reflected_inertia": reflected_inertia,
    "backlash": backlash,
    "joint_elasticity": joint_elasticity,
    "parallel_spring": parallel_spring,
    "torque_ripple": torque_ripple,
    "command_delay": command_delay,
    "actuator_lag": actuator_lag,
    "torque_saturation": torque_saturation,
    "controller_gain": controller_gain,
    "transmission_coupling": transmission_coupling,
}


def encoder_offset(s: Situation) -> Injection:
    """The encoder reads q + dq0."""
    sign = float(s.rng.choice([-1, 1]))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, dq0=sign * a)

    return Injection(
        "encoder_offset", (s.name,), "sensor", 0.02, 0.25, apply, lambda a: {s.name: {"dq0": sign * a}}
    )


def crosstalk(s: Situation) -> Injection:
    """One torque sensor also feels a neighbour's torque."""
    n = len(s.drive.joints)
    other = s.joint - 1 if s.joint > 0 else 1 % n
    sign = float(s.rng.choice([-1, 1]))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        faults = replace(arm.faults, crosstalk=arm.faults.crosstalk.copy())
        faults.crosstalk[s.joint, other] = sign * a
        return replace(arm, faults=faults)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {f"{s.name}<-{s.drive.joints[other]}": {"c": sign * a}}

    return Injection("crosstalk", (s.name,), "sensor", 0.02, 0.5, apply, truth)


def velocity_filter_lag(s: Situation) -> Injection:
    """The reported velocity lags more than believed; T is the further time constant."""

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, velocity_lag=a)

    return Injection(
        "velocity_filter_lag", (s.name,), "sensor", 0.01, 0.1, apply, lambda a: {s.name: {"T": a}}
    )


def clock_drift(s: Situation) -> Injection:
    """A clock runs fast or slow: of all stamps, or of the sensors, which then drift from the controller.

    Stamps drift as far as a rate that was believed and never measured (3 %), sensors as a poor timer does (0.5 %).
    """
    which, sign = str(s.rng.choice(["stamps", "clock"])), float(s.rng.choice([-1, 1]))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        error = sign * a * 1e-6
        faults = replace(arm.faults, stamps=error) if which == "stamps" else replace(arm.faults, clock=error)
        return replace(arm, faults=faults)

    most = 30000.0 if which == "stamps" else 5000.0
    return Injection("clock_drift", (), "timing", 1000.0, most, apply, lambda a: {"log": {"ppm": sign * a}})


SENSING: dict[str, Draw] = {
    "encoder_offset": encoder_offset,
    "crosstalk": crosstalk,
    "velocity_filter_lag": velocity_filter_lag,
    "clock_drift": clock_drift,
}
