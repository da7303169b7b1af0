# SPDX-License-Identifier: BSD-3-Clause
"""Pairs of links that are close in nearly every posture: neighbours, whose distance says nothing about a collision."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from impedance_modules.robot.model import RobotModel

POSTURES = 40
"""Random postures that are looked at."""

NEARLY_ALWAYS = 0.5
"""Share of postures from which on two links count as neighbours."""

Pair = tuple[str, str]


def neighbours(model: RobotModel, pairs: Sequence[Pair], margin: float) -> frozenset[Pair]:
    """Finds pairs that are closer than a distance in at least half of all postures.

    Args:
        model: Of the robot.
        pairs: Of links with collision shapes.
        margin: The distance [m].

    Raises:
        BadInput: A shape cannot be read.
    """
    geometry = model.geometry({link for pair in pairs for link in pair})
    frames = {link: model.frame_id(link) for pair in pairs for link in pair}
    shapes = {
        link: [i for i, shape in enumerate(geometry.geometryObjects) if shape.parentFrame == frame]
        for link, frame in frames.items()
    }
    owners = list[Pair]()
    for first, second in pairs:
        for i in shapes[first]:
            for j in shapes[second]:
                geometry.addCollisionPair(pin.CollisionPair(i, j))
                owners.append((first, second))
    close = dict.fromkeys(pairs, 0)
    random, data = np.random.default_rng(0), pin.GeometryData(geometry)
    lower, upper = model.column("position_min"), model.column("position_max")
    for _ in range(POSTURES):
        q = random.uniform(lower, upper)
        pin.computeDistances(model.pin_model, model.pin_model.createData(), geometry, data, q)
        found = {
            pair
            for pair, result in zip(owners, data.distanceResults, strict=True)
            if result.min_distance < margin
        }
        for pair in found:
            close[pair] += 1
    return frozenset(pair for pair, count in close.items() if count >= NEARLY_ALWAYS * POSTURES)
