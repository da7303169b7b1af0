# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of a Baxter arm that carries a box: any motion, and the torque that it needs, by pinocchio alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml

from tests.support.pressed_recordings import GRID, HAND, JOINTS, NOISE, arm, motion
from tests.support.recordings import columns_of, save

SIZE = (0.06, 0.10, 0.14)
PLACE = np.array([0.01, -0.02, 0.05])
"""Of the box's origin in the hand's frame [m]."""

PHASES = (("down", 4.0), ("close", 1.0), ("carry", 7.0), ("release", 4.0))
CLOSED = (5.0, 12.0)
"""Between which fingers hold the box [s]."""


@dataclass(frozen=True)
class Box:
    """Mass [kg], and centre of mass in its own axes [m]."""

    mass: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def inertia(self) -> pin.Inertia:
        """About its own origin."""
        x, y, z = np.square(SIZE)
        about = np.diag([y + z, x + z, x + y]) * self.mass / 12.0
        return pin.Inertia(self.mass, np.array(self.centre), about)


def task(mapped: Box, origin: np.ndarray, *, picked: bool) -> str:
    """A task that has this box in the right hand."""
    stiffness = dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 10)
    spring = {"name": "hand", "frame": HAND, "expressed_in": "world", "stiffness": stiffness}
    box = {"held_by": ["right"], "shape": "box", "mass": mapped.mass, "size": list(SIZE), "grasp": "weld"}
    orders = (
        {"close": {"close": {"force": 20, "speed": 0.05}}, "down": "open", "release": "open"}
        if picked
        else {}
    )
    return yaml.safe_dump(
        {
            "format": 1,
            "name": "carry",
            "robot": "baxter",
            "arms": {"right": {"posture": {"s0": 0.0}, "springs": [{**spring, "damping_ratio": 0.7}]}},
            "object": {**box, "position": origin.tolist()},
            "safety": {"tank": {"initial": 5.0, "max": 10.0, "floor": 0.5}},
            "phases": [
                {"name": name, "duration": seconds}
                | ({"grippers": {"right": orders[name]}} if name in orders else {})
                for name, seconds in PHASES
            ],
        },
        sort_keys=False,
    )


def carried(
    folder: Path,
    name: str,
    seed: int,
    mapped: Box | None,
    true: Box | None,
    *,
    picked: bool = False,
    tool: float = 0.0,
) -> Path:
    """Writes a recording whose task has the mapped box, or none, and whose hand carries the true one.

    Args:
        folder: Of the file.
        name: Of the recording.
        seed: Of motion and noise.
        mapped: None for a task without an object.
        true: None for an empty hand.
        picked: Fingers hold it between ``CLOSED`` only, on a real robot.
        tool: Mass at the hand's origin all the time [kg].
    """
    t, q, v, a = motion(seed)
    held = (t > CLOSED[0]) & (t < CLOSED[1]) if picked else np.ones(len(t), dtype=bool)
    start = placement(q[0])
    inertia = pin.Inertia.Zero() if true is None else in_hand(start).act(true.inertia())
    torque = needed(q, v, a, pin.Inertia.FromSphere(tool, 1e-6) if tool else pin.Inertia.Zero())
    torque += np.where(held[:, None], needed(q, v, a, inertia) - needed(q, v, a, pin.Inertia.Zero()), 0.0)
    dice = np.random.default_rng(seed + 1000)
    read = np.round(q / GRID) * GRID
    columns = columns_of(t, JOINTS, position=read, effort=torque + dice.normal(scale=NOISE, size=q.shape))
    columns["phase"] = phases_of(t)
    text = None if mapped is None else task(mapped, start.act(PLACE), picked=picked)
    backend = {} if picked else {"backend": "sim"}
    return save(folder, name, columns, robot="baxter", task=text, **backend)


def phases_of(t: np.ndarray) -> np.ndarray:
    ends = np.cumsum([seconds for _, seconds in PHASES])[:-1]
    return np.array([name for name, _ in PHASES], dtype=object)[np.searchsorted(ends, t, side="right")]


def placement(q: np.ndarray) -> pin.SE3:
    """X_WH of the hand."""
    model, data = arm()
    pin.framesForwardKinematics(model, data, q)
    return pin.SE3(data.oMf[model.getFrameId(HAND)])


def in_hand(start: pin.SE3) -> pin.SE3:
    """X_HO: the box's axes are the world's at the start."""
    return pin.SE3(start.rotation.T, PLACE)


def needed(q: np.ndarray, v: np.ndarray, a: np.ndarray, added: pin.Inertia) -> np.ndarray:
    """Torque (N, 7) of the arm with an inertia (in the hand's frame) fixed to its hand."""
    whole = pin.Model(arm()[0])
    frame = whole.frames[whole.getFrameId(HAND)]
    if added.mass > 0.0:
        whole.appendBodyToJoint(frame.parentJoint, added, frame.placement)
    data = whole.createData()
    return np.array([pin.rnea(whole, data, *row) for row in zip(q, v, a, strict=True)])
