# SPDX-License-Identifier: BSD-3-Clause
r"""Signed distance of a point from a cylinder, a sphere or a saddle, in the surface's own axes: exact, for every stage.

Below zero inside. Its gradient is the outward normal n at the nearest point of the surface, of length 1, so that a
spring along n that gives k per metre of depth d has the potential k/2 d^2: pressing in, sliding along and leaving give
back what they took.

    cylinder (axis z)    a = sqrt(x^2 + y^2) - r,  b = |z| - l/2;  sqrt(a^2 + b^2) beyond both, else max(a, b)
    sphere               sqrt(x^2 + y^2 + z^2) - r
    saddle               z = x^2 / (2 R_x) - y^2 / (2 R_y) over a rectangle, matter below

The saddle's nearest point (u, v, w) lies where p - (u, v, w) = s (-u/R_x, v/R_y, 1), so u = x / (1 - s/R_x),
v = y / (1 + s/R_y), and

    g(s) = s - z + x^2 / (2 R_x (1 - s/R_x)^2) - y^2 / (2 R_y (1 + s/R_y)^2) = 0

On -R_y < s < R_x, up to the centres of curvature, g only grows: there is one root, which Newton's method finds, kept
between bounds. The distance is s sqrt(1 + u^2/R_x^2 + v^2/R_y^2).
"""

from __future__ import annotations

import math

from impedance_modules.compiled import compiled
from impedance_modules.records import Row, Vector

ROUNDS = 60
"""Most steps of the search for a saddle's nearest point; four or five are usual."""

CLOSE = 1e-15
"""Of s, where the search ends [m]: 10 times what a number of 1 m can tell."""


@compiled
def cylinder_distance(surface: Row, local: Vector, normal: Vector) -> float:
    """Writes the normal (3,) out of a cylinder nearest to a point (3,); returns its signed distance [m]."""
    across = math.hypot(local[0], local[1])
    side, end = across - surface.half[0], abs(local[2]) - surface.half[2]
    around, along = max(side, 0.0), max(end, 0.0)
    distance = math.sqrt(around * around + along * along)
    if side > 0.0 and end > 0.0:
        around, along = around / distance, along / distance
    else:
        distance = max(side, end)
        around, along = (1.0, 0.0) if side >= end else (0.0, 1.0)
    # On the axis itself every direction leads out.
    normal[0] = around * (local[0] / across if across > 0.0 else 1.0)
    normal[1] = around * (local[1] / across if across > 0.0 else 0.0)
    normal[2] = along if local[2] >= 0.0 else -along
    return float(distance)


@compiled
def sphere_distance(surface: Row, local: Vector, normal: Vector) -> float:
    """Writes the normal (3,) out of a sphere at a point (3,); returns its signed distance [m]."""
    away = math.sqrt(local[0] ** 2 + local[1] ** 2 + local[2] ** 2)
    # In the middle every direction leads out.
    normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
    if away > 0.0:
        for k in range(3):
            normal[k] = local[k] / away
    return float(away - surface.half[0])


@compiled
def saddle_distance(surface: Row, local: Vector, normal: Vector) -> float:
    """Writes the normal (3,) of a saddle nearest to a point (3,); returns its signed distance [m].

    Infinite where the nearest point is not on the saddle's rectangle; not above the true one beyond the centres of
    curvature.
    """
    up, down = surface.radii[0], surface.radii[1]
    s = _saddle_share(up, down, local)
    u, v = local[0] / (1.0 - s / up), local[1] / (1.0 + s / down)
    length = math.sqrt(1.0 + (u / up) ** 2 + (v / down) ** 2)
    normal[0], normal[1], normal[2] = -u / (up * length), v / (down * length), 1.0 / length
    if abs(u) > surface.half[0] or abs(v) > surface.half[1]:
        return math.inf
    return float(s * length)


@compiled
def _saddle_share(up: float, down: float, local: Vector) -> float:
    """Finds s [m] with g(s) = 0 for a saddle of radii R_x, R_y and a point (3,)."""
    low, high = -down, up
    s = 0.0
    for _ in range(ROUNDS):
        a, b = 1.0 - s / up, 1.0 + s / down
        x, y = local[0] / a, local[1] / b
        excess = s - local[2] + x * x / (2.0 * up) - y * y / (2.0 * down)
        if excess > 0.0:
            high = s
        else:
            low = s
        slope = 1.0 + x * x / (up * up * a) + y * y / (down * down * b)
        new = s - excess / slope
        if not low < new < high:
            new = 0.5 * (low + high)
        moved, s = abs(new - s), new
        if moved <= CLOSE:
            break
    return s
