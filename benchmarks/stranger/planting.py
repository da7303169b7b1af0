# SPDX-License-Identifier: BSD-3-Clause
"""Draws effects of the documented catalogue (docs/effects.md), with sizes that matter."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.stranger.engine import Arm
from benchmarks.stranger.machine import Controller
from benchmarks.stranger.robots import Maker, add_body, child_link, read_inertial, write_inertial
from benchmarks.stranger.sizes import Pilot, rms

Array = NDArray[np.float64]


MOST = {
    ("command_delay", "T"): 0.08,
    ("actuator_lag", "T"): 0.08,
    ("crosstalk", "c"): 0.4,
    ("torque_gain", "s"): 0.4,
    ("load_dependent_friction", "kl"): 0.45,
}
"""Beyond these no machine would be in use."""


@dataclass
class Planted:
    """What is wrong: the catalogue's name (or one of outside.py), joints by number, values in SI units."""

    effect: str
    joints: list[int]
    values: dict[str, float]
    scaled: tuple[str, ...]  # values that grow with its size
    place: str = "link"  # motor, link, drive, sensor
    link: str = ""
    outside: bool = False
    loud: list[int] = field(default_factory=list)  # joints whose torques stand out of their sensors' noise
    alone: dict[str, float] = field(default_factory=dict)  # the same without other effects
    shown: dict[str, float] = field(default_factory=dict)  # shares of the torque range, measured afterwards

    def grow(self, factor: float) -> None:
        """Makes it larger or smaller; a gain grows by its distance from one, a limit by coming down."""
        if self.effect == "torque_saturation":
            self.values["limit"] *= 0.9 if factor > 1.0 else 1.12
        for key in self.scaled:
            one = 1.0 if key == "s" else 0.0
            most = MOST.get((self.effect, key), np.inf)
            self.values[key] = one + float(np.clip((self.values[key] - one) * factor, -most, most))


@dataclass
class Scene:
    """What a draw may look at: arm, motion, controller, what is recorded, and a joint that was chosen."""

    maker: Maker
    root: ET.Element
    model: Arm
    pilot: Pilot
    control: Controller
    channels: str  # S, M, C, SC, MC: torque sensor, motor, command
    j: int
    share: float
    recordings: int
    seconds: float
    rate: int
    loud: list[int]
    rng: np.random.Generator

    @property
    def size(self) -> float:
        """The torque that is wanted at joint j [N.m]."""
        return self.share * float(self.pilot.span[self.j])

    def sign(self) -> float:
        """Either way."""
        return float(self.rng.choice([-1.0, 1.0]))

    def side(self) -> str:
        """Friction of the motor, or of the link where only a sensor behind the gear is read."""
        return "link" if self.channels == "S" or self.rng.random() < 0.3 else "motor"


def travel(c: Scene, level: float) -> float:
    """Over which bristles bend [rad]: half a milliradian, more where a light joint would ring."""
    return float(max(5e-4, level * 2.5e-7 / (0.2 * c.pilot.lightest[c.j])))


def _dry(c: Scene) -> dict[str, float]:
    return {"fc": c.size, "travel": travel(c, c.size)}


def _viscous(c: Scene) -> dict[str, float]:
    return {"fv": c.size / float(rms(c.pilot.v)[c.j])}


def _stribeck(c: Scene) -> dict[str, float]:
    slow = 0.35 * float(rms(c.pilot.v)[c.j])
    return {"fc": 0.7 * c.size, "fs": 1.6 * c.size, "vs": slow, "travel": travel(c, 1.6 * c.size)}


def _asymmetric(c: Scene) -> dict[str, float]:
    return {
        "fc": c.size,
        "da": c.sign() * float(c.rng.uniform(0.3, 0.6)) * c.size,
        "travel": travel(c, 1.6 * c.size),
    }


def _loaded(c: Scene) -> dict[str, float]:
    loaded = float(np.clip(c.size / rms(c.pilot.tau)[c.j], 0.04, 0.35))
    return {"kl": loaded, "travel": travel(c, loaded * float(np.abs(c.pilot.tau[:, c.j]).max()))}


def _hysteresis(c: Scene) -> dict[str, float]:
    bend = float(np.clip(0.08 * np.ptp(c.pilot.q[:, c.j]), 0.015, 0.1))
    return {"fc": c.size, "travel": bend, "s0": c.size / bend}


def _drift(c: Scene) -> dict[str, float]:
    fv = 1.8 * c.size / float(rms(c.pilot.v)[c.j])
    return {"fv": fv, "k": float(c.rng.uniform(0.2, 0.4)), "T": c.seconds * float(c.rng.uniform(0.2, 0.35))}


def _rotor(c: Scene) -> dict[str, float]:
    return {"Ia": c.size / float(rms(c.pilot.a)[c.j])}


def _gain(c: Scene) -> dict[str, float]:
    off = float(np.clip(c.size / rms(c.pilot.tau)[c.j], 0.06, 0.35))
    return {"s": 1.0 + c.sign() * off}


def _encoder(c: Scene) -> dict[str, float]:
    slope = rms(c.pilot.per_radian(c.model, c.j)) / np.maximum(c.pilot.span, 1e-9)
    return {"dq0": c.sign() * float(np.clip(c.share / max(slope[c.j], 1e-6), 0.02, 0.12))}


def _elastic(c: Scene) -> dict[str, float]:
    slope = c.pilot.per_radian(c.model, c.j)[:, c.j] * c.pilot.tau[::10, c.j]
    k = float(np.clip(rms(slope) / c.size, 8.0 * np.abs(c.pilot.tau[:, c.j]).max(), 2e4))
    rotor = 0.4 * float(c.pilot.lightest[c.j])
    return {"K": k, "D": 0.06 * float(np.sqrt(k * rotor)), "rotor": rotor}


def _play(c: Scene) -> dict[str, float]:
    slope = float(rms(c.pilot.per_radian(c.model, c.j))[c.j])
    stiff = 60.0 * max(float(np.abs(c.pilot.tau[:, c.j]).max()), 1.0)
    rotor = 0.4 * float(c.pilot.lightest[c.j])
    b = float(np.clip(2.0 * c.size / max(slope, 1e-6), 0.02, 0.12))
    return {"b": b, "K": stiff, "D": 0.3 * float(np.sqrt(stiff * rotor)), "rotor": rotor}


def _tool(c: Scene) -> dict[str, float]:
    point = np.array([*c.rng.uniform(-0.05, 0.05, 2), c.rng.uniform(0.03, 0.15)])
    arm = Arm(add_body(c.root, c.maker.tip, 1.0, point))
    rows = slice(None, None, 10)
    more = arm.torque(c.pilot.q[rows], c.pilot.v[rows], c.pilot.a[rows]) - c.pilot.tau[rows]
    heavy = float(np.clip(c.share / (rms(more) / c.pilot.span)[c.loud].max(), 0.15, 6.0))
    return {"m": heavy, "cx": float(point[0]), "cy": float(point[1]), "cz": float(point[2])}


def _body(c: Scene) -> dict[str, float]:
    link = child_link(c.root, c.model.names[c.j])
    rows = slice(None, None, 10)
    more = Arm(scaled_link(c.root, link, 1.5)).torque(c.pilot.q[rows], c.pilot.v[rows], c.pilot.a[rows])
    per_half = (rms(more - c.pilot.tau[rows]) / c.pilot.span)[c.loud].max()
    part = float(np.clip(0.5 * c.share / per_half, 0.25, 1.2))
    return {"part": part if c.rng.random() < 0.6 else -min(part, 0.6)}


def _lean(c: Scene) -> dict[str, float]:
    way, size = c.rng.uniform(0, 2 * np.pi), float(c.rng.uniform(0.05, 0.13))
    return {"rx": size * float(np.cos(way)), "ry": size * float(np.sin(way))}


def _spring(c: Scene) -> dict[str, float]:
    q = c.pilot.q[:, c.j]
    q0 = float(q.mean() + 0.3 * c.sign() * np.std(q))
    return {"k": c.size / float(rms(q - q0)), "q0": q0}


def _ripple(c: Scene) -> dict[str, float]:
    fastest = float(np.percentile(np.abs(c.pilot.v[:, c.j]), 95))
    most = min(60.0, 0.12 * c.rate * 2 * np.pi / fastest)
    least = 2.5 * 2 * np.pi / float(np.ptp(c.pilot.q[:, c.j]))
    turns = float(round(c.rng.uniform(least, max(least + 1, most))))
    return {"A": 1.4 * c.size, "N": turns, "phi": float(c.rng.uniform(-3, 3))}


def _late(c: Scene) -> dict[str, float]:
    worst = c.share * c.pilot.span[c.j] / float(rms(c.pilot.rates)[c.j])
    return {"T": round(float(np.clip(worst, 0.008, 0.05)), 3)}


def _limit(c: Scene) -> dict[str, float]:
    peak = float(np.abs(c.pilot.tau[:, c.j]).max())
    return {"limit": peak * float(c.rng.uniform(0.75, 0.9))}


def _cross(c: Scene) -> dict[str, float]:
    k = max((k for k in (c.j - 1, c.j + 1) if 0 <= k < c.model.n), key=lambda k: float(rms(c.pilot.tau)[k]))
    return {"c": c.sign() * float(np.clip(c.size / rms(c.pilot.tau)[k], 0.02, 0.35)), "from": float(k)}


def _slow_speed(c: Scene) -> dict[str, float]:
    ratio = c.share * float(np.ptp(c.pilot.v[:, c.j])) / float(rms(c.pilot.a)[c.j])
    return {"T": float(np.clip(ratio, 0.01, 0.12))}


def _clock(c: Scene) -> dict[str, float]:
    if c.channels in ("SC", "MC", "S") and c.rng.random() < 0.6:
        return {"ppm": float(c.rng.uniform(50, 300)), "apart": 1.0, "T": _late(c)["T"]}
    return {"ppm": c.sign() * float(c.rng.uniform(4e4, 1e5)), "apart": 0.0, "T": 0.0}


def _push(c: Scene) -> dict[str, float]:
    way = c.rng.standard_normal(3)
    way /= np.linalg.norm(way)
    worst = 0.0
    for row in c.pilot.q[::50]:
        c.model.at(row, np.zeros_like(row))
        _, linear, _ = c.model.place(c.maker.tip, np.zeros(3))
        worst = max(worst, float((np.abs(linear.T @ way) / c.pilot.span)[c.loud].max()))
    force = way * float(np.clip(2.0 * c.share / worst, 3.0, 80.0))
    start = float(c.rng.uniform(0.3, 0.6)) * c.seconds
    which = float(c.rng.integers(c.recordings))
    keys = ("fx", "fy", "fz", "start", "end", "recording")
    return dict(
        zip(keys, (*map(float, force), start, start + float(c.rng.uniform(1, 2.5)), which), strict=True)
    )


def _loop(c: Scene) -> dict[str, float]:
    part = float(c.rng.uniform(0.5, 1.2)) if c.rng.random() < 0.6 else -float(c.rng.uniform(0.3, 0.5))
    return {"dkp": part * float(c.control.kp[c.j]), "dkd": 0.3 * part * float(c.control.kd[c.j])}


def _shaft(c: Scene) -> dict[str, float]:
    k = c.j + 1 if c.j + 1 < c.model.n else c.j - 1
    both_v, both_a = (float(rms(x[:, c.j] + x[:, k])) for x in (c.pilot.v, c.pilot.a))
    size = c.share * float(min(c.pilot.span[c.j], 3.0 * c.pilot.span[k]))
    light = float(min(c.pilot.lightest[[c.j, k]]))
    bend = float(max(5e-4, 0.5 * size * 2.5e-7 / (0.1 * light)))
    return {
        "Ia": 0.4 * size / both_a,
        "fv": 0.5 * size / both_v,
        "fc": 0.5 * size,
        "to": float(k),
        "travel": bend,
    }


@dataclass(frozen=True)
class Kind:
    """How a kind is drawn, which of its values grow with its size, and what must be recorded to see it."""

    draw: Callable[[Scene], dict[str, float]]
    scaled: tuple[str, ...]
    channels: tuple[str, ...] = ("S", "M", "C", "SC", "MC")
    place: str = "side"
    needs: tuple[str, ...] = ()  # observer, aim, motor_encoder, long


COMMANDED = ("C", "SC", "MC")
DRIVEN = ("M", "C", "SC", "MC")

KINDS: dict[str, Kind] = {
    "coulomb_friction": Kind(_dry, ("fc",)),
    "viscous_friction": Kind(_viscous, ("fv",)),
    "stribeck_friction": Kind(_stribeck, ("fc", "fs")),
    "asymmetric_friction": Kind(_asymmetric, ("fc", "da")),
    "load_dependent_friction": Kind(_loaded, ("kl",)),
    "hysteresis": Kind(_hysteresis, ("fc", "s0")),
    "quadratic_drag": Kind(lambda c: {"c": c.size / float(rms(c.pilot.v**2)[c.j])}, ("c",)),
    "friction_drift": Kind(_drift, ("fv",), needs=("long",)),
    "torque_offset": Kind(lambda c: {"c": c.sign() * c.size}, ("c",)),
    "reflected_inertia": Kind(_rotor, ("Ia",), DRIVEN, "motor"),
    "torque_gain": Kind(_gain, ("s",), place="reading"),
    "encoder_offset": Kind(_encoder, ("dq0",), place="sensor"),
    "joint_elasticity": Kind(_elastic, (), ("S",), "motor_encoder", ("motor_encoder",)),
    "backlash": Kind(_play, ("b",), ("S",), "motor_encoder", ("motor_encoder",)),
    "payload": Kind(_tool, ("m",), place="link"),
    "link_inertia": Kind(_body, ("part",), place="link"),
    "base_tilt": Kind(_lean, ("rx", "ry"), place="base"),
    "parallel_spring": Kind(_spring, ("k",), place="link"),
    "torque_ripple": Kind(_ripple, ("A",)),
    "command_delay": Kind(_late, ("T",), COMMANDED, "command"),
    "actuator_lag": Kind(_late, ("T",), COMMANDED, "drive"),
    "torque_saturation": Kind(_limit, (), COMMANDED, "drive"),
    "crosstalk": Kind(_cross, ("c",), ("S", "SC", "MC", "C"), "reading"),
    "velocity_filter_lag": Kind(_slow_speed, (), place="sensor", needs=("observer",)),
    "clock_drift": Kind(_clock, (), place="clock", needs=("observer",)),
    "external_contact": Kind(_push, ("fx", "fy", "fz"), place="contact"),
    "controller_gain": Kind(_loop, ("dkp", "dkd"), COMMANDED, "drive", ("aim",)),
    "transmission_coupling": Kind(_shaft, ("Ia", "fv", "fc"), DRIVEN, "motor"),
}


def draw(effect: str, c: Scene) -> Planted:
    """One effect of a kind, at the scene's joint."""
    kind = KINDS[effect]
    values = kind.draw(c)
    joints, link = [c.j], ""
    if effect in ("payload", "external_contact"):
        joints, link = [c.model.n - 1], c.maker.tip
    elif effect == "link_inertia":
        link = child_link(c.root, c.model.names[c.j])
    elif effect == "base_tilt" or effect == "clock_drift":
        joints = []
    elif effect in ("crosstalk", "transmission_coupling"):
        joints = [c.j, int(values["from" if effect == "crosstalk" else "to"])]
    place = kind.place
    if place == "side":
        place = c.side()
    elif place == "reading":
        place = (
            "drive"
            if c.channels == "C" or (c.channels in ("SC", "MC") and c.rng.random() < 0.5)
            else "sensor"
        )
    return Planted(effect, joints, values, kind.scaled, place, link, loud=c.loud)


def scaled_link(root: ET.Element, link: str, factor: float) -> ET.Element:
    """A copy in which one link has a factor of its mass and its inertia, about the same centre."""
    again = ET.fromstring(ET.tostring(root))
    for element in again.findall("link"):
        inertial = element.find("inertial")
        if element.get("name") == link and inertial is not None:
            mass, centre, moments = read_inertial(inertial)
            write_inertial(inertial, mass * factor, centre, moments * factor)
    return again
