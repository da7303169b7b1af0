# SPDX-License-Identifier: BSD-3-Clause
"""The touches of a recording: where a hand was, and what pressed it, averaged over short blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput, nearest

Array = NDArray[np.float64]

BLOCK = 0.05
"""Samples are averaged over so long, to quieten the force estimate [s]."""

FEWEST = 20
"""Blocks in contact without which there is nothing to map: a second."""


@dataclass(frozen=True)
class Touches:
    """Blocks in contact.

    Attributes:
        frame: Of the hand.
        time: (N,) [s].
        place: (N, 3) of the hand's frame in world [m].
        force: (N, 3) of the surroundings on the hand [N].
        threshold: Least upward force that counted [N].
    """

    frame: str
    time: Array
    place: Array
    force: Array
    threshold: float


def touches_of(episode: Episode, frame: str | None, threshold: float) -> Touches:
    """Finds where a hand was pressed from below.

    Args:
        episode: With poses and wrenches.
        frame: Of the hand; None takes the only one that has both.
        threshold: Least upward force of a block that counts [N].

    Raises:
        BadInput: It lacks poses or forces, the hand is unknown or not the only one, or hardly anything was touched.
    """
    hand = _hand(episode, frame)
    steps = np.diff(episode.time)
    size = max(1, round(BLOCK / float(np.median(steps)))) if steps.size else 1
    count = len(episode) // size
    both = np.column_stack([episode.pose[hand][:, :3], episode.wrench[hand][:, :3]])
    keep = np.isfinite(both[: count * size]).reshape(count, both.shape[1] * size).all(axis=1)
    time, place, force = (
        values[: count * size].reshape(count, size, values.shape[1]).mean(axis=1)[keep]
        for values in (episode.time[:, None], both[:, :3], both[:, 3:])
    )
    pressed = force[:, 2] >= threshold
    if np.count_nonzero(pressed) < FEWEST:
        strongest = float(force[:, 2].max()) if force.size else 0.0
        raise BadInput(
            f"{episode.source}: '{hand}' presses on nothing: {np.count_nonzero(pressed) * BLOCK:.2f} s with"
            f" {threshold:g} N or more from below, strongest {strongest:.1f} N (valid: at least {FEWEST * BLOCK:g} s;"
            " --force lowers the threshold)"
        )
    return Touches(hand, time[pressed, 0], place[pressed], force[pressed], threshold)


def _hand(episode: Episode, frame: str | None) -> str:
    """Names the hand to map."""
    if not episode.wrench:
        raise BadInput(
            f"{episode.source}: no force was recorded, so contact cannot be told from free motion (missing:"
            " columns wrench.FRAME.fx, fy, fz; poses alone give a path, not a map)"
        )
    both = tuple(name for name in episode.wrench if name in episode.pose)
    if not both:
        raise BadInput(
            f"{episode.source}: no pose was recorded of a frame with a force (missing: columns"
            f" pose.FRAME.x, y, z for FRAME = {', '.join(episode.wrench)})"
        )
    if frame is not None and frame not in both:
        raise BadInput(
            f"{episode.source}: no pose and force of '{frame}'{nearest(frame, both)} (recorded: {', '.join(both)})"
        )
    if frame is None and len(both) > 1:
        raise BadInput(
            f"{episode.source}: several hands were recorded: {', '.join(both)} (valid: --hand NAME)"
        )
    return both[0] if frame is None else frame
