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

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant_state import MAX_SPANS, Row
from impedance_modules.robot.rotation import turn
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


ABOVE = 1
"""In place of a face's number: the point came from above the sheet."""


@compiled
def sheet_point(surface: Row, x: float, y: float, out: Array) -> bool:
    """Writes height, slope, compliance and its change at a place of the sheet; returns whether it is on the sheet."""
    last = surface.span_count - 1
    if abs(y) > surface.half[1] or x < surface.spans[0, 0]:
        return False
    i = 0
    while i < last and x >= surface.spans[i + 1, 0]:
        i += 1
    length, a = surface.spans[i, 1], x - surface.spans[i, 0]
    b = length - a
    if b < 0.0:
        return False
    low, high = surface.spans[i, 2], surface.spans[i, 3]
    m0, m1 = surface.spans[i, 4], surface.spans[i, 5]
    bent = (b**3 - b * length**2) * m0 + (a**3 - a * length**2) * m1
    out[0] = (low * b + high * a + bent / 6.0) / length
    turned = (length**2 - 3.0 * b**2) * m0 + (3.0 * a**2 - length**2) * m1
    out[1] = (high - low + turned / 6.0) / length
    p, r = a * b * (length + b) / (6.0 * length), a * b * (length + a) / (6.0 * length)
    dp = ((b - a) * (length + b) - a * b) / (6.0 * length)
    dr = ((b - a) * (length + a) + a * b) / (6.0 * length)
    f00, f01, f11 = surface.spans[i, 6], surface.spans[i, 7], surface.spans[i, 8]
    give = a * a * b * b / (3.0 * length) - f00 * p * p - 2.0 * f01 * p * r - f11 * r * r
    change = 2.0 * a * b * (b - a) / (3.0 * length)
    change -= 2.0 * (f00 * p * dp + f01 * (p * dr + r * dp) + f11 * r * dr)
    out[2], out[3] = surface.softness * give, surface.softness * change
    return True


@compiled
def find_on_sheet(surface: Row, contact: Row, local: Array, margin: float) -> None:
    """Notes whether a point is above the sheet, or in it from above, within ``margin`` [m]; no question to coal."""
    found = np.empty(4)
    contact.stale = 0
    if not sheet_point(surface, local[0], local[1], found):
        contact.near, contact.face = 0, 0
        return
    gap = local[2] - found[0] - contact.radius
    if gap >= 0.0:
        contact.face = ABOVE
    contact.near = contact.face == ABOVE and gap < margin


@compiled
def place_on_sheet(surface: Row, contact: Row) -> None:
    """Writes a near point's gap above the sheet at rest, the normal there, and the stiffness against it."""
    found, local, normal = np.empty(4), np.empty(3), np.empty(3)
    _to_sheet(surface, contact.position, local)
    if not sheet_point(surface, local[0], local[1], found):
        contact.near = 0
        return
    contact.distance = local[2] - found[0] - contact.radius
    contact.normal_stiffness = 1.0 / (1.0 / contact.stiffness + found[2])
    length = math.sqrt(1.0 + found[1] ** 2)
    normal[0], normal[1], normal[2] = -found[1] / length, 0.0, 1.0 / length
    turn(surface.rotation, normal, contact.normal)


@compiled
def press_on_sheet(surface: Row, contact: Row) -> float:
    """Writes the normal of the bent sheet under a moved point; returns the force along it, 0 in the air [N]."""
    found, local, force = np.empty(4), np.empty(3), np.empty(3)
    for k in range(3):
        force[k] = contact.position[k] + contact.move[k]
    _to_sheet(surface, force, local)
    if not sheet_point(surface, local[0], local[1], found):
        return 0.0
    depth = found[0] + contact.radius - local[2]
    if depth <= 0.0:
        return 0.0
    net = 1.0 / (1.0 / contact.stiffness + found[2])
    force[0] = 0.5 * net**2 * found[3] * depth**2 - net * depth * found[1]
    force[1], force[2] = 0.0, net * depth
    size = math.sqrt(force[0] ** 2 + force[2] ** 2)
    for k in range(3):
        force[k] /= size
    turn(surface.rotation, force, contact.normal)
    return size


@compiled
def _to_sheet(surface: Row, position: Array, local: Array) -> None:
    """Writes a point of the world in the sheet's own axes [m]."""
    for k in range(3):
        local[k] = 0.0
        for j in range(3):
            local[k] += surface.rotation[j, k] * (position[j] - surface.translation[j])
