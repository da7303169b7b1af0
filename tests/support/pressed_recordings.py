# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of a Baxter arm that presses on a floor: any motion, and the torque that it needs, by pinocchio alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml
from scipy.interpolate import CubicSpline

from tests.support.paths import CHECKOUT
from tests.support.recordings import columns_of, save

URDF = CHECKOUT / "robots" / "baxter" / "baxter.urdf"
HAND = "right_hand"
JOINTS = tuple(f"right_{name}" for name in ("s0", "s1", "e0", "e1", "w0", "w1", "w2"))
POSTURE = np.array([0.5, -0.6, 0.3, 1.5, -0.4, 0.75, 0.2])
RATE, SECONDS = 100.0, 16.0
GRID, NOISE = 2e-4, 0.02
"""Of the encoders [rad], and of the torque sensors [N.m]."""


FORCE = 20.0
"""With which the hand presses at most [N]."""


@dataclass(frozen=True)
class Floor:
    """A horizontal floor: height [m], stiffness [N/m], damping [N.s/m], friction."""

    height: float
    k: float
    c: float
    mu: float

    def force(self, place: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """On points (N, 3) with velocities (N, 3), (N, 3)."""
        depth = self.height - place[:, 2]
        normal = np.where(depth > 0.0, np.maximum(0.0, self.k * depth - self.c * velocity[:, 2]), 0.0)
        along = velocity * [1.0, 1.0, 0.0]
        speed = np.linalg.norm(along, axis=1)
        drag = -(self.mu * normal * np.tanh(speed / 0.001) / np.maximum(speed, 1e-9))[:, None] * along
        return drag + normal[:, None] * [0.0, 0.0, 1.0]

    def task(self) -> str:
        """A task that has this floor."""
        stiffness = dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 10)
        spring = {"name": "hand", "frame": HAND, "expressed_in": "world", "stiffness": stiffness}
        floor = {"surface": "plane", "height": self.height, "stiffness": self.k, "damping": self.c}
        return yaml.safe_dump(
            {
                "format": 1,
                "name": "lean",
                "robot": "baxter",
                "arms": {"right": {"posture": {"s0": 0.0}, "springs": [{**spring, "damping_ratio": 0.7}]}},
                "safety": {"tank": {"initial": 5.0, "max": 10.0, "floor": 0.5}},
                "environment": [{**floor, "friction": self.mu}],
                "phases": [{"name": "free", "duration": 12}, {"name": "contact", "duration": 12}],
            },
            sort_keys=False,
        )


@cache
def arm() -> tuple[pin.Model, pin.Data]:
    whole = pin.buildModelFromUrdf(str(URDF))
    locked = [i for i, name in enumerate(whole.names) if i and name not in JOINTS]
    model = pin.buildReducedModel(whole, locked, pin.neutral(whole))
    return model, model.createData()


@cache
def motion(seed: int, height: float | None = None, sink: float = 0.0) -> tuple[np.ndarray, ...]:
    """Time (N,), and position, velocity and acceleration (N, 7) of tones in all joints.

    Where the hand would come below a height it sinks no deeper than some metres.
    """
    dice = np.random.default_rng(seed)
    t = np.arange(round(SECONDS * RATE)) / RATE
    q = np.tile(POSTURE, (len(t), 1))
    for tone in dice.uniform(0.08, 0.45, (3, 7)):
        size, phase = dice.uniform(0.02, 0.08, 7), dice.uniform(0.0, 2.0 * np.pi, 7)
        q += size * np.sin(2.0 * np.pi * tone * t[:, None] + phase)
    if height is not None:
        above = hand_motion(q, 0.0 * q)[0][:, 2] - height
        wanted = height + np.where(above < 0.0, sink * np.expm1(np.minimum(above, 0.0) / sink), above)
        for _ in range(4):
            place, _, J = hand_motion(q, 0.0 * q)
            up = J[:, 2]
            q += up * ((wanted - place[:, 2]) / np.sum(up**2, axis=1))[:, None]
    path = CubicSpline(t, q)
    return t, q, path(t, 1), path(t, 2)


def hand_motion(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place (N, 3), velocity (N, 3) and Jacobian (N, 3, 7) of the hand, world axes."""
    model, data = arm()
    frame = model.getFrameId(HAND)
    place, J = np.empty((len(q), 3)), np.empty((len(q), 3, 7))
    for i, x in enumerate(q):
        pin.computeJointJacobians(model, data, x)
        place[i] = pin.updateFramePlacement(model, data, frame).translation
        J[i] = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]
    return place, np.einsum("ijk,ik->ij", J, v), J


def middle_height() -> float:
    """A height that the hand passes in every motion [m]."""
    return float(hand_motion(POSTURE[None], np.zeros((1, 7)))[0][0, 2])


def pressed(folder: Path, name: str, seed: int, mapped: Floor, true: Floor, mass: float = 0.0) -> Path:
    """Writes a recording on the true floor, whose task has the mapped one; the hand carries a mass at its origin."""
    model, data = arm()
    t, q, v, a = motion(seed, true.height, FORCE / true.k)
    place, speed, J = hand_motion(q, v)
    force = true.force(place, speed)
    torque = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    acceleration = CubicSpline(t, speed)(t, 1)
    carried = mass * (acceleration + np.array([0.0, 0.0, 9.81]))
    torque -= np.einsum("ijk,ij->ik", J, force - carried)
    dice = np.random.default_rng(seed + 1000)
    columns = columns_of(
        t,
        JOINTS,
        position=np.round(q / GRID) * GRID,
        effort=torque + dice.normal(scale=NOISE, size=q.shape),
    )
    columns["phase"] = np.where(np.linalg.norm(force, axis=1) > 0.5, "contact", "free").astype(object)
    return save(folder, name, columns, robot="baxter", task=mapped.task())


def changed(floor: Floor, symbol: str, value: float) -> Floor:
    """The floor with one number as the effect of that symbol gives it."""
    return (
        replace(floor, height=floor.height + value) if symbol == "dh" else replace(floor, **{symbol: value})
    )
