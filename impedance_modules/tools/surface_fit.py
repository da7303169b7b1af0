# SPDX-License-Identifier: BSD-3-Clause
"""From a recording to a map: how high a surface is, and how much it yields, cell by cell along the hand's stroke.

A surface that yields elastically upwards by c(s) per newton lets a hand that it carries with f_z be at

    z = h(s) - c(s) f_z,        f_z = N n_z,  N = f . n

n is the normal of the touched path, so that friction, which is tangential, drops out of f_z. In a cell around
s_i, least squares over all blocks of all strokes, z = h_i + a_i (s - s_i) - c_i f_z, gives the shape at rest h_i and
the compliance c_i with their standard errors, k_i = 1 / c_i. The force must have varied there: one stroke at one force
shows the pressed shape alone. Blocks are short averages of the samples in contact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput, nearest

FORCE_RANGE = 3.0
"""A cell whose force varied by less has no stiffness [N]."""
FEWEST_IN_CELL = 6
"""Blocks without which a cell is left out of the fit: it has three unknowns."""
SIGNIFICANT = 2.0
"""A compliance counts as different from zero if it exceeds so many standard errors."""
LEAST_STROKE = 3
"""Cells that a stroke must cover."""
BLOCK = 0.05
"""Samples are averaged over so long, to reduce the noise of the force estimate [s]."""
FEWEST = 20
"""Blocks in contact without which there is nothing to map: a second."""


@dataclass(frozen=True)
class SurfaceMap:
    """A map along the main direction of the hand's stroke; NaN where a cell has too little data.

    Attributes:
        origin: (3,) where s = 0: the middle of the touches, at height 0 [m].
        direction: (3,) unit vector of s, level.
        cell: Width of a cell [m].
        along: (M,) middle of each cell, s [m].
        place: (M, 2) mean x and y of the touches in it [m].
        pressed: (M,) mean height at which the hand was: the tactile map [m].
        rest: (M,) height without load, and ``rest_error`` its standard error [m].
        compliance: (M,) and ``compliance_error`` [m/N].
        stiffness: (M,) 1 / compliance where that is different from zero [N/m].
        force: (M, 2) least and largest upward force, friction taken out [N].
        blocks: (M,) touches in the cell.
    """

    origin: Array
    direction: Array
    cell: float
    along: Array
    place: Array
    pressed: Array
    rest: Array
    rest_error: Array
    compliance: Array
    compliance_error: Array
    stiffness: Array
    force: Array
    blocks: NDArray[np.int64]


def map_surface(touches: Touches, cell: float) -> SurfaceMap:
    """Fits shape and compliance in cells along the stroke.

    Args:
        touches: Of one hand.
        cell: Width [m].

    Raises:
        BadInput: The stroke covers hardly more than one cell.
    """
    origin, direction = _main_direction(touches.place)
    s = (touches.place - origin) @ direction
    first = np.floor(s.min() / cell)
    index = np.floor(s / cell - first).astype(np.int64)
    cells = np.unique(index)
    if cells.size < LEAST_STROKE:
        raise BadInput(
            f"'{touches.frame}' touched a stretch of {1000 * np.ptp(s):.0f} mm, which is no stroke for cells of"
            f" {1000 * cell:g} mm (valid: {LEAST_STROKE} cells or more; --cell makes them smaller)"
        )
    lift = _upward_force(touches, s, direction, cell)
    middles = (cells + first + 0.5) * cell
    rows = [
        _fit_cell(s[index == i] - middle, touches.place[index == i], lift[index == i])
        for i, middle in zip(cells, middles, strict=True)
    ]
    table = np.array(rows)
    compliance, error = table[:, 5], table[:, 6]
    known = compliance > SIGNIFICANT * error
    return SurfaceMap(
        origin=origin,
        direction=direction,
        cell=cell,
        along=middles,
        place=table[:, :2],
        pressed=table[:, 2],
        rest=table[:, 3],
        rest_error=table[:, 4],
        compliance=compliance,
        compliance_error=error,
        stiffness=np.where(known, 1.0 / np.where(known, compliance, 1.0), np.nan),
        force=table[:, 7:9],
        blocks=table[:, 9].astype(np.int64),
    )


def _main_direction(place: Array) -> tuple[Array, Array]:
    """Gives the middle of the touches on the ground, and the level direction in which they spread most."""
    middle = place[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(place[:, :2] - middle, full_matrices=False)
    axis = axes[0] * np.sign(axes[0][np.argmax(np.abs(axes[0]))])
    return np.array([*middle, 0.0]), np.array([*axis, 0.0])


def _upward_force(touches: Touches, s: Array, direction: Array, cell: float) -> Array:
    """Computes f_z without friction (N,) [N], from the slope of the path around each touch."""
    slope = np.empty(s.size)
    for i, here in enumerate(s):
        # Of one stroke: another, at another force, runs at another height.
        near = (np.abs(s - here) <= cell) & (
            np.abs(touches.time - touches.time[i]) <= _passing(touches, s, cell)
        )
        spread = s[near] - s[near].mean()
        square = float(spread @ spread)
        slope[i] = float(spread @ touches.place[near, 2]) / square if square > (0.1 * cell) ** 2 else 0.0
    normal = (np.array([0.0, 0.0, 1.0]) - slope[:, None] * direction) / np.sqrt(1.0 + slope[:, None] ** 2)
    return np.asarray(np.sum(touches.force * normal, axis=1) * normal[:, 2])


def _passing(touches: Touches, s: Array, cell: float) -> float:
    """Gives the time in which the hand usually passes two cells [s]."""
    speed = np.median(np.abs(np.diff(s)) / np.maximum(np.diff(touches.time), 1e-9))
    return float(np.clip(2.0 * cell / max(float(speed), 1e-6), 0.1, 2.0))


def _fit_cell(s: Array, place: Array, lift: Array) -> list[float]:
    """Fits one cell; its row of the map."""
    x, y, z = place.mean(axis=0)
    low, high = float(lift.min()), float(lift.max())
    unknown = [np.nan] * 4
    if s.size >= FEWEST_IN_CELL and high - low >= FORCE_RANGE:
        unknown = _least_squares(s, place[:, 2], lift)
    return [float(x), float(y), float(z), *unknown, low, high, float(s.size)]


def _least_squares(s: Array, z: Array, lift: Array) -> list[float]:
    """Gives height at rest, its standard error, compliance and its standard error."""
    columns = np.column_stack([np.ones(s.size), s, -lift])
    scale = np.linalg.norm(columns, axis=0)
    if np.linalg.matrix_rank(columns / np.where(scale > 0.0, scale, 1.0), tol=1e-6) < 3:
        return [np.nan] * 4
    solution, *_ = np.linalg.lstsq(columns, z, rcond=None)
    left = z - columns @ solution
    covariance = np.linalg.inv(columns.T @ columns) * float(left @ left) / (s.size - 3)
    return [
        float(solution[0]),
        float(np.sqrt(covariance[0, 0])),
        float(solution[2]),
        float(np.sqrt(covariance[2, 2])),
    ]


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
            f"{episode.source}: no force was recorded, so contact cannot be distinguished from free motion (missing:"
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
