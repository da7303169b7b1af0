# SPDX-License-Identifier: BSD-3-Clause
"""Draws cases: which arm, which controller, what is recorded, how often, how well, and what is wrong."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from benchmarks.stranger.outside import OUTSIDE
from benchmarks.stranger.planting import COMMANDED, KINDS
from benchmarks.stranger.recorder import Sensors
from benchmarks.stranger.robots import MAKERS, Maker

COUNTS = {"A": 40, "B": 40, "C": 20, "E": 20}
SALT = {
    "real": "a stranger's recordings",
    "second": "the same stranger, a year later",
    "third": "the same stranger, two years later",
    "fourth": "the same stranger, three years later",
    "fifth": "the same stranger, four years later",
    "sixth": "the same stranger, five years later",
    "seventh": "the same stranger, six years later",
    "eighth": "the same stranger, seven years later",
    "ninth": "the same stranger, eight years later",
    "tenth": "the same stranger, nine years later",
    "eleventh": "the same stranger, ten years later",
    "twelfth": "the same stranger, eleven years later",
    "smoke": "only to see that it is read",
}

TWICE = (
    "coulomb_friction",
    "viscous_friction",
    "payload",
    "torque_offset",
    "torque_gain",
    "torque_ripple",
    "parallel_spring",
    "link_inertia",
    "encoder_offset",
    "reflected_inertia",
    "external_contact",
    "command_delay",
)
PAIRS = tuple(
    k for k in KINDS if k not in ("backlash", "friction_drift", "torque_saturation", "controller_gain")
)
CHANNELS = ("S", "M", "C", "SC", "MC")
LENGTHS = {1: (24.0, 60.0), 2: (14.0, 30.0), 3: (10.0, 20.0), 4: (9.0, 16.0), 6: (8.0, 11.0), 8: (8.0, 8.5)}


@dataclass(frozen=True)
class Plan:
    """One case, before anything is simulated."""

    name: str
    block: str
    effects: tuple[str, ...]
    maker: Maker
    controller: str
    gravity: str
    omega: float
    motions: tuple[str, ...]  # kind of each recording
    repeats: bool
    seconds: float
    rate: int
    sensors: Sensors
    holdout: bool
    said: tuple[str, ...]  # what the user says of the encoders
    seed: int


def plans(seeds: str) -> list[tuple[int, Plan]]:
    """All cases of a set of seeds, each with its number in its block."""
    out = []
    for block, count in COUNTS.items():
        for number in range(count):
            seed = int.from_bytes(
                hashlib.sha256(f"{SALT[seeds]}/{block}/{number}".encode()).digest()[:6], "big"
            )
            out.append((number, one_plan(block, number, seed)))
    return out


def _effects(block: str, number: int, rng: np.random.Generator) -> tuple[str, ...]:
    """Every kind once, the usual ones twice; pairs and outsiders by lot."""
    if block == "A":
        return ((list(KINDS) + list(TWICE))[number],)
    if block == "C":
        while True:
            one, two = (str(x) for x in rng.choice(PAIRS, 2, replace=False))
            if _channels((one, two)) and not {one, two} <= {"payload", "link_inertia"}:
                return one, two
    if block == "E":
        return (list(OUTSIDE)[number % len(OUTSIDE)],)
    return ()


def _channels(effects: tuple[str, ...]) -> list[str]:
    """What may be recorded so that all effects can be seen."""
    allowed = [KINDS[e].channels if e in KINDS else OUTSIDE[e][2] for e in effects]
    return [c for c in CHANNELS if all(c in a for a in allowed)]


def one_plan(block: str, number: int, seed: int) -> Plan:
    """One user with one arm, all drawn from one seed."""
    rng = np.random.default_rng(seed)
    effects = _effects(block, number, rng)
    needs = {n for e in effects if e in KINDS for n in KINDS[e].needs}
    maker = MAKERS[int(rng.integers(len(MAKERS)))]
    channels = str(rng.choice(_channels(effects)))
    controller, gravity, omega = _controller(channels, effects, rng)
    count = 1 if "long" in needs else int(rng.choice([1, 2, 3, 4, 6, 8], p=[0.2, 0.2, 0.2, 0.2, 0.1, 0.1]))
    seconds = 48.0 if "long" in needs else float(np.round(rng.uniform(*LENGTHS[count]), 1))
    kinds = _motions(count, effects, rng)
    repeats = count >= 2 and rng.random() < 0.5
    sensors = _sensors(maker, channels, needs, rng)
    rate = int(rng.choice([50, 100, 125, 200, 250, 500, 1000], p=[0.08, 0.2, 0.15, 0.15, 0.15, 0.15, 0.12]))
    if set(effects) & {"torque_ripple", "command_delay", "actuator_lag", "backlash"}:
        rate = max(rate, 125)
    said = (("link",), ("motor",), ())[int(rng.choice(3, p=[0.3, 0.2, 0.5]))]
    if "motor_encoder" in needs:
        said = ("motor",)
    name = "case-" + hashlib.sha256(str(seed).encode()).hexdigest()[:8]
    holdout = count >= 3 and bool(rng.random() < 0.35)
    return Plan(
        name, block, effects, maker, controller, gravity, omega, kinds,
        repeats, seconds, rate, sensors, holdout, said, seed,
    )  # fmt: skip


def _controller(channels: str, effects: tuple[str, ...], rng: np.random.Generator) -> tuple[str, str, float]:
    """Kind, who carries the weight, and how stiff [rad/s]; late drives get slower loops, as they must."""
    kinds = ["pd_gravity", "computed_torque", "impedance"] + (
        [] if channels in COMMANDED else ["servo", "servo"]
    )
    if "controller_gain" in effects:
        kinds = ["pd_gravity"]
    if set(effects) & {"command_delay", "actuator_lag"}:
        kinds = ["computed_torque"]
    if "brownout" in effects:
        kinds = ["pd_gravity", "computed_torque"]
    kind = str(rng.choice(kinds))
    low, high = {"pd_gravity": (12, 22), "computed_torque": (12, 22), "impedance": (6, 9), "servo": (22, 35)}[
        kind
    ]
    omega = float(rng.uniform(low, high))
    if "controller_gain" in effects:
        omega = min(omega, 10.0)
    if set(effects) & {"command_delay", "actuator_lag"}:
        omega = min(omega, 6.0)
    gravity = {"computed_torque": "command", "servo": "none"}.get(kind, str(rng.choice(["robot", "command"])))
    return kind, gravity, omega


def _motions(count: int, effects: tuple[str, ...], rng: np.random.Generator) -> tuple[str, ...]:
    """One habit per user, now and then two; what shows in motion alone is not recorded slowly."""
    weights = np.array([0.4, 0.25, 0.2, 0.15])
    names = np.array(["sines", "pick_place", "teleop", "slow"])
    static = {"torque_offset", "encoder_offset", "payload", "base_tilt", "parallel_spring", "torque_gain"}
    if effects and not set(effects) <= static | {"coulomb_friction", "link_inertia"}:
        weights[3] = 0.0
    habits = [str(rng.choice(names, p=weights / weights.sum())) for _ in range(1 + int(rng.random() < 0.3))]
    return tuple(habits[k % len(habits)] for k in range(count))


def _sensors(maker: Maker, channels: str, needs: set[str], rng: np.random.Generator) -> Sensors:
    """Resolutions and noises of real arms, the small ones of each with the small arms."""
    rated = np.array(maker.rated)
    noise = np.clip(rated * np.exp(rng.uniform(np.log(6e-4), np.log(3e-3))), 0.02, 0.5)
    velocity = (
        "observer" if "observer" in needs else str(rng.choice(["none", "difference", "smoothed", "observer"]))
    )
    step = float(rng.choice([0.0, 0.0, 1.0])) * float(np.round(noise.min(), 3))
    style = (
        str(rng.choice(["native", "native", "degrees", "amps"]))
        if "M" in channels
        else str(rng.choice(["native", "native", "degrees"]))
    )
    return Sensors(
        encoder=float(np.exp(rng.uniform(np.log(1e-5), np.log(4e-4)))),
        torque_noise=tuple(float(x) for x in noise),
        torque_step=step,
        velocity=velocity,
        velocity_noise=float(np.exp(rng.uniform(np.log(5e-4), np.log(5e-3)))),
        jitter=float(np.exp(rng.uniform(np.log(10e-6), np.log(300e-6)))),
        dropped=float(rng.choice([0.0, 0.0, 0.0, 0.002])),
        bursts=bool(rng.random() < 0.15),
        channels=channels,
        aim="aim" in needs or bool(rng.random() < 0.3),
        style=style,
    )
