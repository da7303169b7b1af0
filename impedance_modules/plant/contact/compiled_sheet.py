# SPDX-License-Identifier: BSD-3-Clause
r"""A point on a flexible sheet, compiled: height, compliance and the gradient of their energy (see ``sheet``).

    F = -grad (1/2 k(x) d^2) = (1/2 k^2 c' d^2 - k d h', 0, k d)        d = h(x) - z,  k = 1 / (1/k_0 + c)

Evaluated anew at every stage of a step, so that the force is the gradient of one potential wherever the point goes.
A sheet is thin: it is felt only by a point that came from above it and has not left it by its edges since.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.plant.plant_state import Row
from impedance_modules.robot.rotation import turn

Array = NDArray[np.float64]

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
