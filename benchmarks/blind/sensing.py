# SPDX-License-Identifier: BSD-3-Clause
"""What can be wrong with the sensors and their clock."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.blind.injection import Draw, Injection, Situation, with_joint
from benchmarks.blind.plant import Arm


def encoder_offset(s: Situation) -> Injection:
    """The encoder reads q + dq0."""
    sign = float(s.rng.choice([-1, 1]))

    def wear(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, dq0=sign * a)

    return Injection(
        "encoder_offset", (s.name,), "sensor", 0.02, 0.25, wear, lambda a: {s.name: {"dq0": sign * a}}
    )


def crosstalk(s: Situation) -> Injection:
    """One torque sensor also feels a neighbour's torque."""
    n = len(s.drive.joints)
    other = s.joint - 1 if s.joint > 0 else 1 % n
    sign = float(s.rng.choice([-1, 1]))

    def wear(arm: Arm, a: float, _: int) -> Arm:
        faults = replace(arm.faults, crosstalk=arm.faults.crosstalk.copy())
        faults.crosstalk[s.joint, other] = sign * a
        return replace(arm, faults=faults)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {f"{s.name}<-{s.drive.joints[other]}": {"c": sign * a}}

    return Injection("crosstalk", (s.name,), "sensor", 0.02, 0.5, wear, truth)


def velocity_filter_lag(s: Situation) -> Injection:
    """The reported velocity lags more than believed; T is the further time constant."""

    def wear(arm: Arm, a: float, _: int) -> Arm:
        return with_joint(arm, s.joint, velocity_lag=a)

    return Injection(
        "velocity_filter_lag", (s.name,), "sensor", 0.01, 0.1, wear, lambda a: {s.name: {"T": a}}
    )


def clock_drift(s: Situation) -> Injection:
    """A clock runs fast or slow: of all stamps, or of the sensors, which then drift from the controller.

    Stamps drift as far as a rate that was believed and never measured (3 %), sensors as a poor timer does (0.5 %).
    """
    which, sign = str(s.rng.choice(["stamps", "clock"])), float(s.rng.choice([-1, 1]))

    def wear(arm: Arm, a: float, _: int) -> Arm:
        error = sign * a * 1e-6
        faults = replace(arm.faults, stamps=error) if which == "stamps" else replace(arm.faults, clock=error)
        return replace(arm, faults=faults)

    most = 30000.0 if which == "stamps" else 5000.0
    return Injection("clock_drift", (), "timing", 1000.0, most, wear, lambda a: {"log": {"ppm": sign * a}})


SENSING: dict[str, Draw] = {
    "encoder_offset": encoder_offset,
    "crosstalk": crosstalk,
    "velocity_filter_lag": velocity_filter_lag,
    "clock_drift": clock_drift,
}
