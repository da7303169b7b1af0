# SPDX-License-Identifier: BSD-3-Clause
"""Random tasks: what a person may write who knows the keys and not the robot. Seeded: a task comes back.

A task is drawn from its seed and number alone: one arm or two, a posture (joints near the ends of their ranges
included), springs from soft to stiff with rotation springs, joint springs, force axes, a held object, one to three
motions of equilibria or rest postures from slow to far too fast, steps by a sine, a control rate, a scale. Most of them
``impedance check`` refuses; nothing here asks whether it will.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.robot.model import RobotModel

Array = NDArray[np.float64]
Random = np.random.Generator
Tree = dict[str, Any]

NEAR_LIMIT = 0.25
"""Chance of each joint's start to lie within `CLOSE` of an end of its range."""

CLOSE = 0.15
"""[rad]"""

TRIES = 200
"""Postures drawn until one is free of collisions."""

AXES = ("x", "y", "z", "rx", "ry", "rz")

LONGEST_RUN = 2.4
"""Of all phases together [s]."""


@dataclass(frozen=True)
class RandomTask:
    """A task file's text and how it is run: control rate [Hz] and scale."""

    text: str
    rate: float
    scale: float


class Shapes:
    """Distances of a robot's declared pairs of links, measured one by one at any posture."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._geometry = model.geometry()
        frames = [shape.parentFrame for shape in self._geometry.geometryObjects]
        for first, second in model.spec.collision.pairs:
            a, b = model.frame_id(first), model.frame_id(second)
            for i in (i for i, frame in enumerate(frames) if frame == a):
                for j in (j for j, frame in enumerate(frames) if frame == b):
                    self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        self._data, self._shape_data = model.pin_model.createData(), pin.GeometryData(self._geometry)

    def closest(self, q: Array) -> float:
        """Smallest distance of all pairs at q (n,) [m]; inf without pairs."""
        if len(self._geometry.collisionPairs) == 0:
            return math.inf
        pin.updateGeometryPlacements(self._model.pin_model, self._data, self._geometry, self._shape_data, q)
        pairs = range(len(self._geometry.collisionPairs))
        return min(
            float(pin.computeDistance(self._geometry, self._shape_data, k).min_distance) for k in pairs
        )


def draw_task(
    model: RobotModel, shapes: Shapes, robot: str | Path, seed: int, number: int
) -> RandomTask | None:
    """Draws the task of a number; None where no posture free of collisions was found.

    Args:
        model: Of the robot.
        shapes: Of the same.
        robot: As the task names it.
        seed: Of all tasks.
        number: Of this one; the task is a function of both.
    """
    random = np.random.default_rng([seed, number])
    limbs = _limbs(random, model)
    q = _posture(random, model, shapes, limbs)
    if q is None:
        return None
    near = _near_hands(model, limbs, q)
    task: Tree = {"format": 1, "name": f"random-{number}", "robot": str(robot)}
    task["arms"] = {limb: _arm(random, model, limb, q) for limb in limbs}
    held = _object(random, near, limbs)
    if held is not None:
        task["object"] = held
    initial = _log(random, 2.0, 60.0)
    task["safety"] = {"tank": {"initial": initial, "max": 2 * initial, "floor": 0.3}}
    if random.random() < 0.2:
        # Limbs that take no part are there all the same, and must not start inside the plane.
        hands = _near_hands(model, tuple(model.limbs), q).values()
        height = min(float(place[2]) for place in hands) - _uniform(random, 0.02, 0.2)
        task["environment"] = [
            {"surface": "plane", "height": height, "stiffness": 10000, "damping": 100, "friction": 0.3}
        ]
    task["phases"] = _phases(random, model, q, _starts(task["arms"], near), held is not None)
    timing = model.spec.timing
    rate = min(timing.rate_max, max(timing.rate_min, _log(random, 100.0, 1100.0)))
    scale = 1.0 if random.random() < 0.7 else _uniform(random, 0.2, 1.0)
    return RandomTask(json.dumps(_rounded(task), indent=1), round(rate, 1), round(scale, 3))


def _uniform(random: Random, low: float, high: float) -> float:
    return float(random.uniform(low, high))


def _log(random: Random, low: float, high: float) -> float:
    """Draws evenly on a logarithmic scale."""
    return float(np.exp(random.uniform(math.log(low), math.log(high))))


def _limbs(random: Random, model: RobotModel) -> tuple[str, ...]:
    names = tuple(model.limbs)
    if len(names) == 1 or random.random() < 0.5:
        return names
    return (names[int(random.integers(len(names)))],)


def _posture(random: Random, model: RobotModel, shapes: Shapes, limbs: tuple[str, ...]) -> Array | None:
    """Draws joint angles, some near the ends of their ranges; limbs that take no part stay at zero."""
    low, high = model.column("position_min"), model.column("position_max")
    for _ in range(TRIES):
        q = random.uniform(low, high)
        near = random.random(model.n) < NEAR_LIMIT
        beside = random.uniform(0.005, CLOSE, model.n)
        q = np.where(near, np.where(random.random(model.n) < 0.5, low + beside, high - beside), q)
        used = np.concatenate([model.limbs[name].joints for name in limbs])
        posture = np.zeros(model.n)
        posture[used] = np.round(q[used], 4)
        if shapes.closest(posture) > model.spec.collision.margin + 0.01:
            return posture
    return None


def _starts(arms: Tree, near: Mapping[str, Array]) -> dict[str, Array]:
    """Where the equilibria of the hands' springs start, in the axes in which each task states them."""
    world = {
        name: arm["springs"][0]["expressed_in"] == "world" for name, arm in arms.items() if "springs" in arm
    }
    return {name: near[name] if world.get(name, True) else np.zeros(3) for name in arms}


def _near_hands(model: RobotModel, limbs: tuple[str, ...], q: Array) -> dict[str, Array]:
    return {name: model.pose(q, model.limbs[name].hand).translation for name in limbs}


def _arm(random: Random, model: RobotModel, name: str, q: Array) -> Tree:
    limb = model.limbs[name]
    arm: Tree = {
        "posture": {s: float(q[i]) for s, i in zip(limb.short_names, limb.joints, strict=True)},
        "joint_bias": {
            "stiffness": {short: _log(random, 0.5, 40.0) for short in limb.short_names},
            "damping_ratio": _uniform(random, 0.3, 1.0),
        },
    }
    if len(limb.short_names) > 1 or random.random() < 0.5:
        arm["springs"] = [_spring(random, limb.hand)]
    return arm


def _spring(random: Random, hand: str) -> Tree:
    linear, angular = _log(random, 20.0, 2000.0), _log(random, 0.5, 40.0)
    stiffness = {axis: linear * _log(random, 0.5, 2.0) for axis in AXES[:3]}
    stiffness |= {axis: angular * _log(random, 0.5, 2.0) for axis in AXES[3:]}
    spring: Tree = {
        "name": "hand",
        "frame": hand,
        "expressed_in": "world" if random.random() < 0.7 else hand,
        "stiffness": stiffness,
        "damping_ratio": _uniform(random, 0.2, 1.0),
    }
    if random.random() < 0.3:
        axis = AXES[int(random.integers(3))]
        force = _uniform(random, -20.0, 20.0)
        spring["axes"] = {axis: {"force": force, "speed_limit": _log(random, 0.05, 0.6)}}
        if random.random() < 0.5:
            stiffness[axis] = 0
    return spring


def _object(random: Random, near: Mapping[str, Array], limbs: tuple[str, ...]) -> Tree | None:
    """A ball that touches the hands that hold it; none in most tasks."""
    if random.random() > 0.2:
        return None
    held: Tree = {
        "held_by": list(limbs),
        "shape": "sphere",
        "mass": _log(random, 0.2, 4.0),
        "grasp": "weld",
        "carry_weight": bool(random.random() < 0.7),
    }
    places = list(near.values())
    if len(places) == 2:
        apart = float(np.linalg.norm(places[0] - places[1]))
        held |= {"size": [apart], "squeeze": {"force": _uniform(random, 2.0, 20.0)}}
        return held if apart < 0.8 else None
    aside = 0.08 * _direction(random)
    return held | {"size": [0.16], "position": (places[0] + aside).tolist()}


def _direction(random: Random) -> Array:
    axis = random.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _phases(
    random: Random, model: RobotModel, q: Array, starts: Mapping[str, Array], held: bool
) -> list[Tree]:
    """One to three phases, each with motions of hands, object or rest postures."""
    count = int(random.integers(1, 4))
    phases = []
    for k in range(count):
        duration = _uniform(random, 0.2, LONGEST_RUN / count)
        phase: Tree = {"name": f"part-{k}", "duration": duration}
        if held:
            phase["equilibrium"] = {"object": _moved(random, None, duration)}
        else:
            phase["equilibrium"] = {
                f"{name}.hand": _moved(random, start, duration)
                for name, start in starts.items()
                if model.limbs[name].joints.size > 1 and random.random() < 0.7
            }
        postures = {name: _rest(random, model, name, q) for name in starts if random.random() < 0.5}
        if postures:
            phase["posture"] = postures
        if not phase["equilibrium"]:
            del phase["equilibrium"]
        phases.append(phase)
    return phases


def _moved(random: Random, place: Array | None, duration: float) -> Tree:
    """New coordinates: a minimum-jerk motion whose top speed is 0.03 to 2 m/s, or a sine of that top speed.

    Without a known ``place`` to start from it is always a sine, around where the coordinate stands.
    """
    speed, direction = _log(random, 0.03, 2.0), _direction(random)
    if place is None or random.random() < 0.25:
        frequency = _log(random, 0.3, 4.0)
        amplitude = min(0.4, speed / (2.0 * math.pi * frequency))
        axis = AXES[int(random.integers(6))]
        return {axis: {"sine": {"amplitude": amplitude, "frequency": frequency}}}
    # A minimum-jerk motion is fastest in its middle, 15/8 of its mean speed.
    step = min(0.6, speed * duration * 8.0 / 15.0) * direction
    return {axis: float(place[i] + step[i]) for i, axis in enumerate(AXES[:3])}


def _rest(random: Random, model: RobotModel, name: str, q: Array) -> Tree:
    """A new rest posture of one to all joints of a limb, up to 1 rad away and inside the ranges."""
    limb = model.limbs[name]
    low, high = model.column("position_min"), model.column("position_max")
    found: Tree = {}
    for short, i in zip(limb.short_names, limb.joints, strict=True):
        if random.random() < 0.6:
            goal = q[i] + _uniform(random, -1.0, 1.0) * _log(random, 0.1, 1.0)
            found[short] = float(np.clip(goal, low[i] + 1e-3, high[i] - 1e-3))
    return found or {limb.short_names[0]: float(q[limb.joints[0]])}


def _rounded(tree: Any) -> Any:
    """Rounds all numbers to four decimals, which JSON and YAML both read as the same number."""
    if isinstance(tree, dict):
        return {key: _rounded(value) for key, value in tree.items()}
    if isinstance(tree, list):
        return [_rounded(value) for value in tree]
    return round(tree, 4) if isinstance(tree, float) else tree
