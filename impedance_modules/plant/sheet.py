# SPDX-License-Identifier: BSD-3-Clause
r"""A flexible sheet laid over supports: the shape in which it rests, and how it gives where it is pressed.

The sheet is a beam of bending stiffness EI along its own x axis, held down on every support (x_i, h_i), free to turn
there. At rest it takes the shape of least bending energy through its supports, the natural cubic spline. Pressed by
a force f at x it gives by f c(x): between two supports, a and b away from them, L = a + b,

    EI c = a^2 b^2 / (3 L) - t^T F^-1 t,    t = (a b (L + b), a b (L + a)) / (6 L) at the two supports, else 0
    F_ii = (L_i-1 + L_i) / 3,  F_i,i+1 = L_i / 6          (three moments; no moment at the outermost supports)

which is the deflection of a simple beam less what its continuation over the supports takes back. The same F gives
the spline's curvatures: F m = jumps of the chords' slopes. With the stiffness k_0 of what touches,

    k(x) = 1 / (1 / k_0 + c(x)),    U = 1/2 k(x) d^2,    d = h(x) - z > 0

is the least energy of sheet and touch at a given place; its gradient is the force, normal to the *bent* sheet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.plant.plant_state import MAX_SPANS
from impedance_modules.spec.task import SheetSpec

Array = NDArray[np.float64]

SPAN_SIZE = 9
"""Numbers per span: x, L, h and h at its ends, m and m, and F^-1 at left-left, left-right, right-right."""


@dataclass(frozen=True)
class SheetPoint:
    """What is above one place of a sheet: height [m], slope, and compliance c [m/N] with its change along x [1/N]."""

    height: float
    slope: float
    compliance: float
    change: float


def spans_of(sheet: SheetSpec) -> Array:
    """Tabulates a sheet's spans, (spans, 9): see ``SPAN_SIZE``.

    Raises:
        BadInput: It has fewer than two supports, more than the plant keeps room for, or they do not ascend.
    """
    at, height = np.array(sheet.supports, dtype=float).reshape(-1, 2).T
    length = np.diff(at)
    if not 1 <= length.size <= MAX_SPANS or not (length > 0.0).all():
        raise BadInput(f"a sheet needs 2 to {MAX_SPANS + 1} supports in ascending order; got {at.tolist()}")
    moments, inverse = _three_moments(length, height)
    rows = np.empty((length.size, SPAN_SIZE))
    for i, row in enumerate(rows):
        ends = (inverse[i, i], inverse[i, i + 1], inverse[i + 1, i + 1])
        row[:] = (at[i], length[i], height[i], height[i + 1], moments[i], moments[i + 1], *ends)
    return rows


def _three_moments(length: Array, height: Array) -> tuple[Array, Array]:
    """Solves for the curvatures over the supports (s,), and gives F^-1 (s, s), 0 at the outermost ones."""
    count = length.size + 1
    inner = slice(1, count - 1)
    flexibility = (
        np.diag((length[:-1] + length[1:]) / 3.0)
        + np.diag(length[1:-1] / 6.0, 1)
        + np.diag(length[1:-1] / 6.0, -1)
    )
    inverse, moments = np.zeros((count, count)), np.zeros(count)
    if count > 2:
        inverse[inner, inner] = np.linalg.inv(flexibility)
        moments[inner] = inverse[inner, inner] @ np.diff(np.diff(height) / length)
    return moments, inverse


class Sheet:
    """A sheet in its own axes, in plain numpy, for forecasts, drawings, maps and tests of the compiled one."""

    def __init__(self, sheet: SheetSpec) -> None:
        self.spans = spans_of(sheet)
        self.half_width = 0.5 * sheet.width
        self.bending_stiffness = sheet.bending_stiffness

    @classmethod
    def of_spans(cls, spans: Array, half_width: float, bending_stiffness: float) -> Sheet:
        """Takes a table of spans (spans, 9) as the plant keeps it, [m] and [N.m^2]."""
        found = cls.__new__(cls)
        found.spans, found.half_width, found.bending_stiffness = spans, half_width, bending_stiffness
        return found

    def point(self, x: float) -> SheetPoint | None:
        """Gives what is at x [m] along the sheet; None beyond its ends."""
        first, last = float(self.spans[0, 0]), float(self.spans[-1, 0] + self.spans[-1, 1])
        if not first <= x <= last:
            return None
        x0, length, low, high, m0, m1, left, across, right = self.spans[
            np.count_nonzero(self.spans[1:, 0] <= x)
        ]
        a = x - x0
        b = length - a
        height = (
            low * b + high * a + ((b**3 - b * length**2) * m0 + (a**3 - a * length**2) * m1) / 6.0
        ) / length
        slope = (high - low + ((length**2 - 3.0 * b**2) * m0 + (3.0 * a**2 - length**2) * m1) / 6.0) / length
        ends = np.array([a * b * (length + b), a * b * (length + a)]) / (6.0 * length)
        turning = np.array([(b - a) * (length + b) - a * b, (b - a) * (length + a) + a * b]) / (6.0 * length)
        back = np.array([[left, across], [across, right]])
        give = a**2 * b**2 / (3.0 * length) - ends @ back @ ends
        change = 2.0 * a * b * (b - a) / (3.0 * length) - 2.0 * ends @ back @ turning
        stiff = self.bending_stiffness
        return SheetPoint(float(height), float(slope), float(give / stiff), float(change / stiff))

    def force(self, local: Array, stiffness: float) -> Array | None:
        """Computes -dU/d(x, y, z) at a point (3,) in the sheet's axes [N]; None where it is not pressed."""
        point = self.point(float(local[0]))
        if point is None or abs(local[1]) > self.half_width or local[2] >= point.height:
            return None
        depth = point.height - float(local[2])
        net = 1.0 / (1.0 / stiffness + point.compliance)
        along = 0.5 * net**2 * point.change * depth**2 - net * depth * point.slope
        return np.array([along, 0.0, net * depth])
