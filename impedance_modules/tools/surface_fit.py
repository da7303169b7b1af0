# SPDX-License-Identifier: BSD-3-Clause
r"""From touches to a map: how high a surface is, and how much it gives, cell by cell along the hand's stroke.

A surface that yields elastically upwards by c(s) per newton lets a hand that it carries with f_z be at

    z = h(s) - c(s) f_z,        f_z = N n_z,  N = f . n

n is the normal of the touched path, so that friction, which is tangential, falls out of f_z. In a cell around
s_i, least squares over all blocks of all strokes, z = h_i + a_i (s - s_i) - c_i f_z, gives the shape at rest h_i and
the compliance c_i with their standard errors, k_i = 1 / c_i. The force must have varied there: one stroke at one force
shows the pressed shape alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.tools.surface_map.touches import Touches

Array = NDArray[np.float64]

FORCE_RANGE = 3.0
"""A cell whose force varied by less says nothing about stiffness [N]."""

FEWEST_IN_CELL = 6
"""Blocks without which a cell is left out of the fit: it has three unknowns."""

TELLING = 2.0
"""A compliance is told from none when it is so many standard errors above it."""

LEAST_STROKE = 3
"""Cells that a stroke must cover."""


@dataclass(frozen=True)
class SurfaceMap:
    """A map along the main direction of the hand's stroke; NaN where a cell does not tell.

    Attributes:
        origin: (3,) where s = 0: the middle of the touches, at height 0 [m].
        direction: (3,) unit vector of s, level.
        cell: Width of a cell [m].
        along: (M,) middle of each cell, s [m].
        place: (M, 2) mean x and y of the touches in it [m].
        pressed: (M,) mean height at which the hand was: the tactile map [m].
        rest: (M,) height without load, and ``rest_error`` its standard error [m].
        compliance: (M,) and ``compliance_error`` [m/N].
        stiffness: (M,) 1 / compliance where that is told from zero [N/m].
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
    told = compliance > TELLING * error
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
        stiffness=np.where(told, 1.0 / np.where(told, compliance, 1.0), np.nan),
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
