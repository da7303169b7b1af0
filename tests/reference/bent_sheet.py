# SPDX-License-Identifier: BSD-3-Clause
"""The force of a flexible sheet by other means: its shape by a borrowed spline, its compliance by the force method."""

import numpy as np
from scipy.interpolate import CubicSpline

from impedance_modules.records import Row, Vector


def bent_sheet_force(sheet: Row, local: Vector, stiffness: float) -> Vector:
    """Computes -dU/d(x, y, z) (3,) at a point in the sheet's axes [N]; zero where it is not pressed."""
    spans = sheet["spans"][: sheet["span_count"]]
    at = np.append(spans[:, 0], spans[-1, 0] + spans[-1, 1])
    shape = CubicSpline(at, np.append(spans[:, 2], spans[-1, 3]), bc_type="natural")
    x, y, z = local
    depth = float(shape(x)) - z
    if not at[0] <= x <= at[-1] or abs(y) > sheet["half_width"] or depth <= 0.0:
        return np.zeros(3)
    give, change = (sheet["softness"] * value for value in compliance(at, x))
    net = 1.0 / (1.0 / stiffness + give)
    return np.array([0.5 * net**2 * change * depth**2 - net * depth * float(shape(x, 1)), 0.0, net * depth])


def compliance(at: Vector, x: float) -> tuple[float, float]:
    """Deflection times EI of a continuous beam on rigid supports under a unit force at x, and its change along x.

    The beam on its two outermost supports bends by Macaulay's formula; the inner supports push it back to zero.
    """
    inner = at[1:-1]
    under = np.array([_simple(at, i, x)[0] for i in inner])
    turned = np.array([_simple(at, i, x)[1] for i in inner])
    a, b = x - at[0], at[-1] - x
    give, change = _simple(at, x, x)[0], 2.0 * a * b * (b - a) / (3.0 * (a + b))
    if inner.size == 0:
        return give, change
    back = np.linalg.solve(np.array([[_simple(at, j, i)[0] for j in inner] for i in inner]), under)
    return give - float(under @ back), change - 2.0 * float(turned @ back)


def _simple(at: Vector, load: float, x: float) -> tuple[float, float]:
    """Deflection times EI at x of a beam on its two outermost supports under a unit force, and its slope."""
    length, b, s, sign = at[-1] - at[0], at[-1] - load, x - at[0], 1.0
    if x > load:
        b, s, sign = load - at[0], at[-1] - x, -1.0
    return (
        float(b * s * (length**2 - b**2 - s**2) / (6.0 * length)),
        float(sign * b * (length**2 - b**2 - 3.0 * s**2) / (6.0 * length)),
    )
