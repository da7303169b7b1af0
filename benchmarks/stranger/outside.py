# SPDX-License-Identifier: BSD-3-Clause
"""Real troubles that docs/effects.md has no name for: swinging loads, stops, brakes, sensors that creep.

Each differs from its nearest neighbour in the catalogue by what the catalogue's law has not: it depends on
another variable, on time, or adds a body that moves by itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.stranger.laws import Law, State, changed, of_position
from benchmarks.stranger.planting import Planted, Scene, travel
from benchmarks.stranger.sizes import rms

Array = NDArray[np.float64]


def _end_stop(c: Scene) -> dict[str, float]:
    """Rubber that is met on the outer quarter of the joint's way, and hardens."""
    q = c.pilot.q[:, c.j]
    edge = float(np.percentile(q, 75))
    depth = np.maximum(q - edge, 0.0)
    return {"edge": edge, "k": 1.6 * c.size / float(np.percentile(depth, 98)) ** 1.5}


def _dead_zone(c: Scene) -> dict[str, float]:
    """A drive that gives nothing below a threshold, and that much less above it."""
    return {"zone": c.size}


def _iron(c: Scene) -> dict[str, float]:
    """A motor whose iron saturates: torque falls behind current, the more the larger it is."""
    peak = float(np.abs(c.pilot.tau[:, c.j]).max())
    return {"knee": peak * float(c.rng.uniform(1.3, 1.7))}


def _worn_spot(c: Scene) -> dict[str, float]:
    """Dry friction in one narrow part of the joint's range: a brinelled bearing."""
    q = c.pilot.q[:, c.j]
    return {
        "at": float(np.median(q)),
        "width": 0.18 * float(np.ptp(q)),
        "fc": 2.0 * c.size,
        "travel": travel(c, 2 * c.size),
    }


def _whip(c: Scene) -> dict[str, float]:
    """A tool on a flexible rod: a mass that swings on its spring, at two to four hertz."""
    per_kg = np.abs(c.pilot.tau[:, 1]).max() / 9.81
    return {
        "m": float(np.clip(3.0 * c.share * per_kg, 0.4, 3.0)),
        "hz": float(c.rng.uniform(1.8, 3.0)),
        "zeta": 0.02,
        "z": 0.12,
    }


def _eccentric(c: Scene) -> dict[str, float]:
    """An encoder disc that is mounted off its centre: an error that goes round once a turn, and twice."""
    slope = float(rms(c.pilot.per_radian(c.model, c.j))[c.j])
    return {
        "A": float(np.clip(1.6 * c.size / max(slope, 1e-6), 0.03, 0.15)),
        "phi": float(c.rng.uniform(-3, 3)),
    }


def _creep(c: Scene) -> dict[str, float]:
    """A torque sensor's zero that wanders off while it warms, and comes back."""
    return {"c": 2.0 * c.sign() * c.size, "period": c.seconds * float(c.rng.uniform(0.5, 0.9))}


def _guidance(c: Scene) -> dict[str, float]:
    """Somebody who holds the tool throughout, and leads it by forces that never stay the same."""
    return {"f": float(np.clip(40.0 * c.share, 3.0, 15.0)), "seed": float(c.rng.integers(1 << 30))}


def _brownout(c: Scene) -> dict[str, float]:
    """A supply that sags now and then: the motor gives less for some seconds."""
    return {
        "loss": float(np.clip(1.8 * c.size / rms(c.pilot.tau)[c.j], 0.12, 0.3)),
        "period": float(c.rng.uniform(3, 6)),
    }


def _grinder(c: Scene) -> dict[str, float]:
    """A disc that spins in the tool: its spin resists being turned, across the way it is turned."""
    return {"spin": float(c.rng.uniform(0.8, 1.6)) * float(np.clip(c.pilot.span[-2], 0.5, 6.0)) * 0.5}


def _rocking(c: Scene) -> dict[str, float]:
    """A base on a float: it leans to and fro."""
    return {"angle": float(c.rng.uniform(0.06, 0.12)), "hz": float(c.rng.uniform(0.15, 0.4))}


def _hum(c: Scene) -> dict[str, float]:
    """A torque that goes with time and not with the joint: a pump on the arm."""
    return {"A": 1.4 * c.size, "hz": float(c.rng.uniform(1.5, 4.0))}


def _dragging_brake(c: Scene) -> dict[str, float]:
    """A holding brake that closes a little by itself, for a second or two, at any time."""
    return {"fc": 2.0 * c.size, "travel": travel(c, 2 * c.size), "seed": float(c.rng.integers(1 << 30))}


ANY = ("S", "M", "C", "SC", "MC")
OUTSIDE: dict[str, tuple[Callable[[Scene], dict[str, float]], tuple[str, ...], tuple[str, ...], str]] = {
    "end_stop": (_end_stop, ("k",), ANY, "link"),
    "dead_zone": (_dead_zone, ("zone",), ("C", "SC", "MC"), "drive"),
    "iron_saturation": (_iron, (), ("C", "SC", "MC"), "drive"),
    "worn_spot": (_worn_spot, ("fc",), ANY, "link"),
    "whip": (_whip, ("m",), ANY, "link"),
    "eccentric_encoder": (_eccentric, ("A",), ANY, "position"),
    "sensor_creep": (_creep, ("c",), ("S", "SC", "MC"), "effort"),
    "hand_guidance": (_guidance, ("f",), ANY, "link"),
    "brownout": (_brownout, ("loss",), ("C", "SC", "MC"), "drive"),
    "spinning_disc": (_grinder, ("spin",), ANY, "link"),
    "rocking_base": (_rocking, ("angle",), ANY, "command"),
    "hum": (_hum, ("A",), ANY, "link"),
    "dragging_brake": (_dragging_brake, ("fc",), ANY, "link"),
}


def draw_outside(name: str, c: Scene) -> Planted:
    """One trouble at the scene's joint."""
    values, scaled, _, place = OUTSIDE[name]
    whole = name in ("rocking_base", "whip", "hand_guidance", "spinning_disc")
    return Planted(name, [] if whole else [c.j], values(c), scaled, place, c.maker.tip, True, c.loud)


def outside_law(p: Planted) -> Law:
    """The law of a trouble, made anew for each recording."""
    x, j = p.values, p.joints[0] if p.joints else 0
    if p.effect == "end_stop":
        return of_position(j, lambda q: x["k"] * max(q - x["edge"], 0.0) ** 1.5)
    if p.effect == "dead_zone":
        return changed(j, lambda _, u: float(np.sign(u[j]) * max(abs(u[j]) - x["zone"], 0.0)))
    if p.effect == "iron_saturation":
        return changed(j, lambda _, u: float(x["knee"] * np.tanh(u[j] / x["knee"])))
    if p.effect == "eccentric_encoder":
        return changed(
            j, lambda _, q: float(q[j] + x["A"] * (np.sin(q[j] + x["phi"]) + 0.4 * np.sin(2 * q[j])))
        )
    if p.effect == "brownout":
        return changed(
            j, lambda s, u: float(u[j] * (1.0 - x["loss"] * (s.t % x["period"] > 0.55 * x["period"])))
        )
    if p.effect == "hum":
        return changed(j, lambda s, u: float(u[j] + x["A"] * np.sin(2 * np.pi * x["hz"] * s.t)))
    if p.effect == "sensor_creep":
        return _both_readings(j, lambda s: x["c"] * (1 - np.cos(2 * np.pi * max(s.t, 0.0) / x["period"])) / 2)
    if p.effect == "rocking_base":
        return _rock(x["angle"], x["hz"])
    return {"worn_spot": _spot, "dragging_brake": _brake}[p.effect](p) if p.joints else _with_a_body(p)


def _both_readings(j: int, more: Callable[[State], float]) -> Law:
    """Adds to what is reported of joint j, by whichever sensor."""

    def law(s: State, e: Array) -> Array:
        e[j] += more(s)
        e[len(e) // 2 + j] += more(s)
        return e

    return law


def _rock(angle: float, hz: float) -> Law:
    def law(s: State, command: Array) -> Array:
        s.lean(angle * np.sin(2 * np.pi * hz * s.t), 0.5 * angle * np.sin(4.6 * hz * s.t + 1.0))
        return command

    return law


def _slip(p: Planted, share: Callable[[State], float]) -> Law:
    """Bristles whose level is switched by a share."""
    j, fc, bend = p.joints[0], p.values["fc"], p.values["travel"]
    bent = [0.0]

    def law(s: State, torque: Array) -> Array:
        v = float(s.v[j])
        limit = np.sign(v) * bend
        bent[0] = limit + (bent[0] - limit) * np.exp(-abs(v) * s.h / bend)
        torque[j] += fc * share(s) * bent[0] / bend
        return torque

    return law


def _spot(p: Planted) -> Law:
    j, x = p.joints[0], p.values
    return _slip(p, lambda s: float(np.exp(-(((s.q[j] - x["at"]) / x["width"]) ** 2) * 4.0)))


def _brake(p: Planted) -> Law:
    seed = int(p.values["seed"])

    def share(s: State) -> float:
        second = int(np.floor(max(s.t, 0.0) / 1.3))
        return float(np.random.default_rng(seed + 97 * s.recording + second).random() < 0.35)

    memory: dict[tuple[int, int], float] = {}

    def remembered(s: State) -> float:
        key = (s.recording, int(np.floor(max(s.t, 0.0) / 1.3)))
        if key not in memory:
            memory[key] = share(s)
        return memory[key]

    return _slip(p, remembered)


def _with_a_body(p: Planted) -> Law:
    if p.effect == "whip":
        return _swinging(p)
    if p.effect == "spinning_disc":
        return _spinning(p)
    rng = np.random.default_rng(int(p.values["seed"]))
    hz, phase = rng.uniform(0.1, 0.6, (3, 4)), rng.uniform(0, 2 * np.pi, (3, 4))

    def law(s: State, torque: Array) -> Array:
        shift = phase + 2.0 * s.recording
        force = p.values["f"] * np.sin(2 * np.pi * hz * s.t + shift).sum(axis=1) / np.sqrt(2.0)
        _, linear, _ = s.place(p.link, np.zeros(3))
        led: Array = torque - linear.T @ force
        return led

    return law


def _swinging(p: Planted) -> Law:
    """The mass has a motion of its own; the arm feels spring and damper of the rod."""
    x = p.values
    k = x["m"] * (2 * np.pi * x["hz"]) ** 2
    d = 2 * x["zeta"] * np.sqrt(k * x["m"])
    own: list[Array] = []

    def law(s: State, torque: Array) -> Array:
        here, linear, _ = s.place(p.link, np.array([0.0, 0.0, x["z"]]))
        if not own:
            own.extend([here - np.array([0.0, 0.0, x["m"] * 9.81 / k]), np.zeros(3)])
        force = k * (here - own[0]) + d * (linear @ s.v - own[1])
        own[1] = own[1] + s.h * (force / x["m"] - np.array([0.0, 0.0, 9.81]))
        own[0] = own[0] + s.h * own[1]
        loaded: Array = torque + linear.T @ force
        return loaded

    return law


def _spinning(p: Planted) -> Law:
    """A disc about the tool's x axis: the arm must give spin x turning."""

    def law(s: State, torque: Array) -> Array:
        here, _, angular = s.place(p.link, np.zeros(3))
        axis = s.place(p.link, np.array([1.0, 0.0, 0.0]))[0] - here
        turned: Array = torque + angular.T @ np.cross(angular @ s.v, p.values["spin"] * axis)
        return turned

    return law
