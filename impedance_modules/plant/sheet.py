# SPDX-License-Identifier: BSD-3-Clause
r"""A flexible sheet laid over supports: the shape in which it rests, how it gives where it is pressed, and its force.

The sheet is a beam of bending stiffness EI along its own x axis, held down on every support (x_i, h_i), free to turn
there. At rest it takes the shape of least bending energy through its supports, the natural cubic spline. Pressed by
a force f at x it gives by f c(x): between two supports, a and b away from them, L = a + b,

    EI c = a^2 b^2 / (3 L) - t^T F^-1 t,    t = (a b (L + b), a b (L + a)) / (6 L) at the two supports, else 0
    F_ii = (L_i-1 + L_i) / 3,  F_i,i+1 = L_i / 6          (three moments; no moment at the outermost supports)

which is the deflection of a simple beam less what its continuation over the supports takes back. The same F gives
the spline's curvatures: F m = jumps of the chords' slopes. With the stiffness k_0 of what touches,

    k(x) = 1 / (1 / k_0 + c(x)),    U = 1/2 k(x) d^2,    d = h(x) - z > 0
    F = -grad U = (1/2 k^2 c' d^2 - k d h', 0, k d)

U is the least energy of sheet and touch at a given place; its gradient is the force, normal to the *bent* sheet. It is
evaluated anew at every stage of a step, so that the force is the gradient of one potential wherever the point goes.
A sheet is thin: it acts only on a point that came from above it and has not left it by its edges since.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput
from impedance_modules.records import Matrix, Row, Vector, new_table
from impedance_modules.robot.rotation import turn
from impedance_modules.spec.task import SheetSpec

ABOVE = 1
"""In place of a face's number: the point came from above the sheet."""

MAX_SPANS = 16
"""Most spans of one sheet: room in its row."""

SPAN_SIZE = 9
"""Numbers per span: x, L, h and h at its ends, m and m, and F^-1 at left-left, left-right, right-right."""

SHEET = np.dtype(
    [
        ("span_count", np.int64),
        ("spans", np.float64, (MAX_SPANS, SPAN_SIZE)),
        ("half_width", np.float64),
        ("softness", np.float64),
    ],
    align=True,
)
"""One sheet: how many spans it has and which, half its width [m], and 1 / EI [1/(N.m^2)]; all 0 where there is none."""


@compiled
def sheet_point(sheet: Row, x: float, y: float, out: Vector) -> bool:
    """Writes h [m], h', c [m/N] and c' [1/N] at a place of the sheet [m]; returns whether it is on the sheet."""
    last, spans = sheet.span_count - 1, sheet.spans
    if abs(y) > sheet.half_width or x < spans[0, 0]:
        return False
    i = 0
    while i < last and x >= spans[i + 1, 0]:
        i += 1
    a = x - spans[i, 0]
    if spans[i, 1] - a < 0.0:
        return False
    _span_point(sheet, i, a, out)
    return True


@compiled
def _span_point(sheet: Row, i: int, a: float, out: Vector) -> None:
    """Writes h [m], h', c [m/N] and c' [1/N] a metres behind the start of span i."""
    spans = sheet.spans
    length = spans[i, 1]
    b = length - a
    low, high = spans[i, 2], spans[i, 3]
    m0, m1 = spans[i, 4], spans[i, 5]
    bent = (b**3 - b * length**2) * m0 + (a**3 - a * length**2) * m1
    out[0] = (low * b + high * a + bent / 6.0) / length
    turned = (length**2 - 3.0 * b**2) * m0 + (3.0 * a**2 - length**2) * m1
    out[1] = (high - low + turned / 6.0) / length
    p, r = a * b * (length + b) / (6.0 * length), a * b * (length + a) / (6.0 * length)
    dp = ((b - a) * (length + b) - a * b) / (6.0 * length)
    dr = ((b - a) * (length + a) + a * b) / (6.0 * length)
    f00, f01, f11 = spans[i, 6], spans[i, 7], spans[i, 8]
    give = a * a * b * b / (3.0 * length) - f00 * p * p - 2.0 * f01 * p * r - f11 * r * r
    change = 2.0 * a * b * (b - a) / (3.0 * length)
    change -= 2.0 * (f00 * p * dp + f01 * (p * dr + r * dp) + f11 * r * dr)
    out[2], out[3] = sheet.softness * give, sheet.softness * change


@compiled
def sheet_force(sheet: Row, local: Vector, radius: float, stiffness: float, out: Vector) -> bool:
    """Writes -grad U at a small sphere in the sheet's axes (3,) [N]; returns whether it is pressed."""
    found = np.empty(4)
    if not sheet_point(sheet, local[0], local[1], found):
        return False
    depth = found[0] + radius - local[2]
    if depth <= 0.0:
        return False
    net = 1.0 / (1.0 / stiffness + found[2])
    out[0] = 0.5 * net**2 * found[3] * depth**2 - net * depth * found[1]
    out[1], out[2] = 0.0, net * depth
    return True


@compiled
def find_on_sheet(sheet: Row, contact: Row, local: Vector, clearance: float) -> None:
    """Notes whether a point is above the sheet, or in it from above, within a clearance [m]; coal is not queried."""
    found = np.empty(4)
    contact.stale = 0
    if not sheet_point(sheet, local[0], local[1], found):
        contact.near, contact.face = 0, 0
        return
    gap = local[2] - found[0] - contact.radius
    if gap >= 0.0:
        contact.face = ABOVE
    contact.near = contact.face == ABOVE and gap < clearance


@compiled
def place_on_sheet(surface: Row, contact: Row, local: Vector) -> None:
    """Writes a near point's gap above the sheet at rest [m], the normal there, and the stiffness against it [N/m]."""
    found, normal = np.empty(4), np.empty(3)
    if not sheet_point(surface.sheet, local[0], local[1], found):
        contact.near = 0
        return
    contact.distance = local[2] - found[0] - contact.radius
    contact.normal_stiffness = 1.0 / (1.0 / contact.stiffness + found[2])
    length = math.sqrt(1.0 + found[1] ** 2)
    normal[0], normal[1], normal[2] = -found[1] / length, 0.0, 1.0 / length
    turn(surface.rotation, normal, contact.normal)


@compiled
def press_on_sheet(surface: Row, contact: Row, local: Vector) -> float:
    """Writes the normal of the bent sheet under a moved point; returns the force along it, 0 in the air [N]."""
    force = np.empty(3)
    if not sheet_force(surface.sheet, local, contact.radius, contact.stiffness, force):
        return 0.0
    size = math.sqrt(force[0] ** 2 + force[2] ** 2)
    for k in range(3):
        force[k] /= size
    turn(surface.rotation, force, contact.normal)
    return size


@dataclass(frozen=True)
class SheetPoint:
    """What is above one place of a sheet: height [m], slope, and compliance c [m/N] with its change along x [1/N]."""

    height: float
    slope: float
    compliance: float
    change: float


class Sheet:
    """A sheet in its own axes, for forecasts, drawings and maps.

    Attributes:
        spans: (spans, 9): see ``SPAN_SIZE``.
        half_width: [m].
    """

    def __init__(self, sheet: SheetSpec) -> None:
        self._row = sheet_row(sheet)
        self.spans: Matrix = self._row["spans"][: self._row["span_count"]]
        self.half_width = float(self._row["half_width"])

    def point(self, x: float) -> SheetPoint | None:
        """Gives what is at x [m] along the sheet; None beyond its ends."""
        if not self.spans[0, 0] <= x <= self.spans[-1, 0] + self.spans[-1, 1]:
            return None
        i, found = int(np.count_nonzero(self.spans[1:, 0] <= x)), np.empty(4)
        _span_point(self._row, i, x - self.spans[i, 0], found)
        return SheetPoint(*found.tolist())

    def force(self, local: Vector, stiffness: float) -> Vector | None:
        """Computes -dU/d(x, y, z) at a point (3,) in the sheet's axes [N]; None where it is not pressed."""
        force = np.empty(3)
        return force if sheet_force(self._row, local, 0.0, stiffness, force) else None


def sheet_row(sheet: SheetSpec) -> Row:
    """Makes the row of a sheet.

    Raises:
        BadInput: It has fewer than two supports, more than the plant keeps room for, or they do not ascend.
    """
    row = new_table(1, SHEET)[0]
    at, height = np.array(sheet.supports, dtype=float).reshape(-1, 2).T
    length = np.diff(at)
    if not 1 <= length.size <= MAX_SPANS or not (length > 0.0).all():
        raise BadInput(f"a sheet needs 2 to {MAX_SPANS + 1} supports in ascending order; got {at.tolist()}")
    moments, inverse = _three_moments(length, height)
    row["span_count"], row["half_width"] = length.size, 0.5 * sheet.width
    row["softness"] = 1.0 / sheet.bending_stiffness
    for i in range(length.size):
        ends = (inverse[i, i], inverse[i, i + 1], inverse[i + 1, i + 1])
        row["spans"][i] = (at[i], length[i], height[i], height[i + 1], moments[i], moments[i + 1], *ends)
    return row


def _three_moments(length: Vector, height: Vector) -> tuple[Vector, Matrix]:
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
