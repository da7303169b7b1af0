# SPDX-License-Identifier: BSD-3-Clause
r"""The robot's own safety functions of the arms: collision avoidance, collision detection, and their suppression.

Collision avoidance keeps the arms away from each other and from the body by a repulsive force:

    f = k (margin - d) - c d'    where a pair of links is nearer than the margin;    tau = sum G^T max(f, 0)

with the distance d and its gradient G of ``robot.distances``. The robot's collision shapes are a little larger than its
links, so tucked arms are inside the field.

Collision detection (``plant.collision``) classifies the torque tau = J^T (F, 0) of a push. The real robot does so from
its torque sensors; the simulator uses the push itself, so that no fast motion of its own is taken for a collision.
Pushes are the only collisions it detects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter.simulator.parameters import (
    FORCE_FIELD_DAMPING,
    FORCE_FIELD_STIFFNESS,
    IMPACT_SCALERS,
    IMPACT_THRESHOLD,
    IMPACT_TIME,
    SQUISH_THRESHOLDS,
    SQUISH_TIME,
    SUPPRESSION_TIME_OUT,
    TICK,
)
from impedance_modules.errors import BadInput
from impedance_modules.plant.joint_servos import CollisionDetector, CollisionLimits
from impedance_modules.robot.distances import Distances
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel

SUPPRESSIBLE = (
    "suppress_collision_avoidance",
    "suppress_contact_safety",
    "suppress_cuff_interaction",
    "suppress_gravity_compensation",
    "suppress_hand_overwrench_safety",
)
"""Topics below /robot/limb/SIDE/ to which the real robot subscribes; it does not to suppress_body_avoidance."""


class ForceField:
    """Repulsion of links that are too near to each other.

    Attributes:
        near: Limb -> links or limbs that it is too near to.
        torque: (n,) of the field [N.m].
    """

    def __init__(self, kinematics: Kinematics, period: float) -> None:
        """Uses the pairs of the robot file; ``period`` [s] between updates."""
        model = kinematics.model
        collision = model.spec.collision
        self._margin = collision.margin
        self._distances = Distances(
            kinematics,
            collision.pairs,
            margin=self._margin,
            approach_time=period,
            horizon=period,
            period=period,
        )
        self._owner = {link: _owner(model, link) for pair in collision.pairs for link in pair}
        self.near: Mapping[str, tuple[str, ...]] = {name: () for name in model.limbs}
        self.torque: Array = np.zeros(model.n)

    def update(self, q: Array, v: Array) -> None:
        """Updates distances and torque at the state of the kinematics' last update."""
        self._distances.update(q, v)
        found: dict[str, list[str]] = {name: [] for name in self.near}
        torque = np.zeros(q.size)
        pairs = zip(self._distances.pairs, self._distances.distance, self._distances.gradient, strict=True)
        for (first, second), distance, row in pairs:
            if distance >= self._margin:
                continue
            force = FORCE_FIELD_STIFFNESS * (self._margin - distance) - FORCE_FIELD_DAMPING * float(row @ v)
            torque += row * max(force, 0.0)
            for one, other in ((first, second), (second, first)):
                limb = self._owner[one]
                if limb is not None:
                    found[limb].append(self._owner[other] or other)
        self.near = {name: tuple(dict.fromkeys(others)) for name, others in found.items()}
        self.torque = torque


def _owner(model: RobotModel, link: str) -> str | None:
    """Finds the limb that moves a link; None for the trunk."""
    try:
        return model.limb_of(link).name
    except BadInput:
        return None


@dataclass
class HandPush:
    """A force on a hand (3,) [N], base axes, until a time [s]."""

    force: Array
    end: float


def contact_sense(short_names: Sequence[str]) -> CollisionDetector:
    """Makes the collision detection of one limb, with the robot's own thresholds."""
    infinite = math.inf
    limits = CollisionLimits(
        impact=np.array([IMPACT_THRESHOLD * IMPACT_SCALERS.get(s, infinite) for s in short_names]),
        squish=np.array([SQUISH_THRESHOLDS.get(s, infinite) for s in short_names]),
        impact_time=IMPACT_TIME,
        squish_time=SQUISH_TIME,
        tick=TICK,
    )
    return CollisionDetector(limits)


class Suppressions:
    """Safety functions of one limb that a user keeps switched off by repeated requests."""

    def __init__(self) -> None:
        self._requested = dict.fromkeys(SUPPRESSIBLE, -math.inf)

    def request(self, name: str, now: float) -> None:
        """Takes a request at a time [s]."""
        self._requested[name] = now

    def active(self, name: str, now: float) -> bool:
        """Says whether a function is off."""
        return now - self._requested[name] < SUPPRESSION_TIME_OUT
