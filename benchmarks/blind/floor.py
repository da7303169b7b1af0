# SPDX-License-Identifier: BSD-3-Clause
r"""A floor under the hand, as it is and as the task says it is; written anew, without the package's plant.

At the hand's origin, d its depth:

    N = \max(0, k d - c \dot z),   f_t = -\mu N v_t / |v_t| \tanh(|v_t| / v_0)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import yaml
from numpy.typing import NDArray

Array = NDArray[np.float64]

CREEP = 0.005
"""Speed v_0 [m/s] below which the floor's friction falls: steps of half a millisecond bear no steeper fall."""


@dataclass(frozen=True)
class Surface:
    """A horizontal floor: height [m], stiffness [N/m] and damping [N.s/m] across it, friction along it."""

    height: float
    stiffness: float
    damping: float
    friction: float

    def force(self, place: Array, velocity: Array) -> Array:
        """Returns the force (3,) [N] on a point at a place (3,) [m] with a velocity (3,) [m/s]."""
        depth = self.height - place[2]
        pressure = max(0.0, self.stiffness * depth - self.damping * velocity[2]) if depth > 0.0 else 0.0
        along = np.array([velocity[0], velocity[1], 0.0])
        speed = float(np.linalg.norm(along))
        drag = self.friction * pressure * np.tanh(speed / CREEP) / max(speed, 1e-12)
        return np.array([0.0, 0.0, pressure]) - drag * along


class Touch:
    """The hand's point over a floor, in a MuJoCo model."""

    def __init__(self, model: mujoco.MjModel, surface: Surface) -> None:
        """Takes the floor; the model's only site is at the hand's origin."""
        self._model, self._surface = model, surface
        self._slopes = np.zeros((3, model.nv))

    def press(self, data: mujoco.MjData) -> float:
        """Adds the floor's force to the applied torques; returns its size [N]."""
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_jacSite(self._model, data, self._slopes, None, 0)
        place = np.array(data.site_xpos[0])
        force = self._surface.force(place, self._slopes @ data.qvel)
        data.qfrc_applied[:] += self._slopes.T @ force
        return float(np.linalg.norm(force))


def task_text(side: str, hand: str, mapped: Surface) -> str:
    """Returns a task file that knows the floor by the mapped numbers; its springs and phases are of no account."""
    spring = {"name": "hand", "frame": hand, "expressed_in": "world", "damping_ratio": 0.7}
    spring["stiffness"] = dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 10)
    floor = {"surface": "plane", "height": mapped.height, "stiffness": mapped.stiffness}
    task = {
        "format": 1,
        "name": "work-on-a-floor",
        "robot": "baxter",
        "arms": {side: {"posture": {"s0": 0.0}, "springs": [spring]}},
        "safety": {"tank": {"initial": 5.0, "max": 10.0, "floor": 0.5}},
        "environment": [{**floor, "damping": mapped.damping, "friction": mapped.friction}],
        "phases": [{"name": "free", "duration": 12}, {"name": "contact", "duration": 12}],
    }
    return yaml.safe_dump(task, sort_keys=False)


@dataclass(frozen=True)
class MapError:
    """An error of the map: effect id, symbol of its number, how that is drawn, and the true floor with it."""

    effect: str
    symbol: str
    draw: Callable[[Surface, np.random.Generator], float]
    apply: Callable[[Surface, float], Surface]


def _height(_: Surface, rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(0.004, 0.015))


def _stiffness(mapped: Surface, rng: np.random.Generator) -> float:
    return float(mapped.stiffness * rng.choice([rng.uniform(0.3, 0.6), rng.uniform(1.7, 3.0)]))


def _friction(mapped: Surface, rng: np.random.Generator) -> float:
    return float(mapped.friction + rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.25))


MAP_ERRORS: tuple[MapError, ...] = (
    MapError("surface_height", "dh", _height, lambda s, a: replace(s, height=s.height + a)),
    MapError("surface_stiffness", "k", _stiffness, lambda s, a: replace(s, stiffness=a)),
    MapError("surface_friction", "mu", _friction, lambda s, a: replace(s, friction=a)),
)
