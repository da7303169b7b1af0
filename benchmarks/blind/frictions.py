# SPDX-License-Identifier: BSD-3-Clause
"""Friction in seven shapes, each a LuGre bristle or a drag on the motor or on the link."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.injection import Draw, Injection, Situation, with_friction
from benchmarks.blind.plant import Arm

THREE_COUNTS = 3 * 2 * np.pi / 16384
"""Presliding [rad] that three counts of the encoder can show."""
WAY = 3.0
"""Presliding over bristle deflection: after a reversal, 90 % of the friction has turned by then (2 exp(-3) = 0.1)."""


def _port(s: Situation) -> str:
    return str(s.rng.choice(["actuator", "link"]))


def _presliding(s: Situation) -> tuple[float, tuple[str, ...]]:
    """Draws how far the bristles bend; what can be seen bending is hysteresis too."""
    bend = float(np.exp(s.rng.uniform(np.log(1.5e-4), np.log(2e-3))))
    return bend, ("hysteresis",) if WAY * bend > THREE_COUNTS else ()


def bristles_of(s: Situation, port: str, level: float, bend: float) -> dict[str, float]:
    """Returns stiffness and a light damping of bristles that slip at ``level`` [N.m]."""
    stiffness = max(level, 1e-6) / bend
    inertia = s.drive.rotor_inertia[s.joint] if port == "actuator" else 0.01 * s.drive.rotor_inertia[s.joint]
    return {"s0": stiffness, "s1": 0.2 * float(np.sqrt(stiffness * inertia))}


def coulomb(s: Situation) -> Injection:
    """Fc sgn v."""
    port, (bend, also) = _port(s), _presliding(s)

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_friction(arm, port, s.joint, fc=a, **bristles_of(s, port, a, bend))

    return Injection(
        "coulomb_friction", (s.name,), port, 0.2, 15.0, apply, lambda a: {s.name: {"fc": a}}, also
    )


def viscous(s: Situation) -> Injection:
    """Fv v."""
    port = _port(s)

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_friction(arm, port, s.joint, fv=a)

    return Injection("viscous_friction", (s.name,), port, 0.3, 20.0, apply, lambda a: {s.name: {"fv": a}})


def stribeck(s: Situation) -> Injection:
    """(fc + (fs - fc) exp(-(v/vs)^2)) sgn v."""
    port, (bend, also) = _port(s), _presliding(s)
    ratio, vs = float(s.rng.uniform(1.8, 3.0)), float(s.rng.uniform(0.03, 0.12))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        bristles = bristles_of(s, port, a * ratio, bend)
        return with_friction(arm, port, s.joint, fc=a, fs=a * (ratio - 1), vs=vs, **bristles)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {s.name: {"fc": a, "fs": a * ratio, "vs": vs}}

    return Injection("stribeck_friction", (s.name,), port, 0.2, 10.0, apply, truth, also)


def quadratic(s: Situation) -> Injection:
    """C v |v|."""
    port = _port(s)

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_friction(arm, port, s.joint, c=a)

    return Injection("quadratic_drag", (s.name,), port, 0.5, 40.0, apply, lambda a: {s.name: {"c": a}})


def asymmetric(s: Situation) -> Injection:
    """Fc sgn v + da |sgn v| + dv |v|."""
    port, (bend, also) = _port(s), _presliding(s)
    share = float(s.rng.uniform(0.4, 0.8) * s.rng.choice([-1, 1]))
    most = float(s.drive.motor_damping[s.joint]) if port == "actuator" else 0.0
    dv = float(np.sign(share) * s.rng.uniform(0.0, 0.3))

    def bent(a: float) -> float:
        return float(np.clip(dv * a, -most, most))  # beyond the joint's own damping it would drive the joint

    def apply(arm: Arm, a: float, _: int) -> Arm:
        bristles = bristles_of(s, port, a, bend)
        return with_friction(arm, port, s.joint, fc=a, da=share * a, dv=bent(a), **bristles)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {s.name: {"fc": a, "da": share * a, "dv": bent(a)}}

    return Injection("asymmetric_friction", (s.name,), port, 0.2, 10.0, apply, truth, also)


def load_dependent(s: Situation) -> Injection:
    """Kl |tau| sgn v."""
    port, (bend, also) = _port(s), _presliding(s)
    load = 0.5 * float(s.peak[s.joint])

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_friction(arm, port, s.joint, kl=a, **bristles_of(s, port, a * load, bend))

    return Injection(
        "load_dependent_friction", (s.name,), port, 0.03, 0.5, apply, lambda a: {s.name: {"kl": a}}, also
    )


def drift(s: Situation) -> Injection:
    """Fv (1 - k (1 - exp(-t/T))) v: thin grease, warm within a fraction of a minute; every run starts cold."""
    port = _port(s)
    k, duration = float(s.rng.uniform(0.6, 0.9)), float(s.rng.uniform(10.0, 20.0))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_friction(arm, port, s.joint, fv=a, k=k, T=duration)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {s.name: {"fv": a, "k": k, "T": duration}}

    return Injection("friction_drift", (s.name,), port, 0.5, 20.0, apply, truth)


def hysteresis(s: Situation) -> Injection:
    """Bristles that bend far before they slip."""
    port = _port(s)
    bend = float(np.exp(s.rng.uniform(np.log(0.006), np.log(0.04))))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return with_friction(arm, port, s.joint, fc=a, s0=a / bend, s1=0.0)

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {s.name: {"fc": a, "s0": a / bend}}

    return Injection("hysteresis", (s.name,), port, 0.3, 15.0, apply, truth)


FRICTIONS: dict[str, Draw] = {
    "coulomb_friction": coulomb,
    "viscous_friction": viscous,
    "stribeck_friction": stribeck,
    "quadratic_drag": quadratic,
    "asymmetric_friction": asymmetric,
    "load_dependent_friction": load_dependent,
    "friction_drift": drift,
    "hysteresis": hysteresis,
}
