# SPDX-License-Identifier: BSD-3-Clause
"""Passes over small arrays around every solve, compiled: in numpy they cost more than the solve itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled

Array = NDArray[np.float64]

UNUSABLE, INSIDE, OUTSIDE = -1, 0, 1
"""What `shift` found: not a problem at all; zero change is allowed everywhere; it is not."""


@compiled
def shift(
    desired: Array,
    effort_max: Array,
    matrix: Array,
    row_lower: Array,
    row_upper: Array,
    penalty: Array,
    metric: Array,
    infinite: float,
    lower: Array,
    upper: Array,
) -> int:
    """Writes the bounds of the change d = tau - desired: torque limits first, then rows.

    Args:
        desired: (n,) [N.m].
        effort_max: (n,) [N.m].
        matrix: (m, n).
        row_lower: (m,), may be infinite.
        row_upper: (m,), may be infinite.
        penalty: (m,), looked through for numbers that are not positive.
        metric: (n, n), looked through for numbers that are not finite.
        infinite: Cap of the bounds written.
        lower: (n + m,) overwritten.
        upper: (n + m,) overwritten.

    Returns:
        UNUSABLE, INSIDE or OUTSIDE.
    """
    m, n = matrix.shape
    total = 0.0
    inside = True
    for i in range(n):
        total += desired[i]
        if not effort_max[i] >= 0.0:
            return UNUSABLE
        lower[i] = max(-effort_max[i] - desired[i], -infinite)
        upper[i] = min(effort_max[i] - desired[i], infinite)
        inside = inside and lower[i] <= 0.0 <= upper[i]
        for j in range(n):
            total += metric[i, j]
    for r in range(m):
        value = 0.0
        for j in range(n):
            value += matrix[r, j] * desired[j]
        total += value
        low, high = row_lower[r] - value, row_upper[r] - value
        if not (low <= high and penalty[r] > 0.0):
            return UNUSABLE
        lower[n + r], upper[n + r] = max(low, -infinite), min(high, infinite)
        inside = inside and low <= 0.0 <= high
    if not math.isfinite(total):
        return UNUSABLE
    return INSIDE if inside else OUTSIDE


@compiled
def unit_rows(
    matrix: Array,
    penalty: Array,
    infinite: float,
    lower: Array,
    upper: Array,
    unit_matrix: Array,
    softness: Array,
    inverse_length: Array,
) -> None:
    """Scales rows to unit length, with their shifted bounds and softness; a zero row becomes absent.

    Args:
        matrix: (m, n).
        penalty: (m,).
        infinite: What an absent bound is, and the cap of a scaled one.
        lower: (n + m,) shifted bounds; those of the rows are scaled in place.
        upper: Likewise.
        unit_matrix: (m, n) overwritten.
        softness: (n + m,) overwritten from n on: 1 / penalty of the scaled row.
        inverse_length: (m,) overwritten: 1 / |a_r|, 0 for a zero row.
    """
    m, n = matrix.shape
    for r in range(m):
        square = 0.0
        for j in range(n):
            square += matrix[r, j] * matrix[r, j]
        inverse = 1.0 / math.sqrt(square) if square > 0.0 else 0.0
        inverse_length[r] = inverse
        softness[n + r] = inverse * inverse / penalty[r]
        for j in range(n):
            unit_matrix[r, j] = matrix[r, j] * inverse
        low, high = lower[n + r], upper[n + r]
        present = square > 0.0
        lower[n + r] = max(low * inverse, -infinite) if present and low > -infinite else -infinite
        upper[n + r] = min(high * inverse, infinite) if present and high < infinite else infinite


@compiled
def land(
    desired: Array,
    effort_max: Array,
    power_row: Array,
    power_upper: float,
    change: Array,
    effort: Array,
) -> float:
    """Writes the filtered torque, inside the torque limits to the last bit.

    Args:
        desired: (n,) [N.m].
        effort_max: (n,) [N.m].
        power_row: (n,) the hard row.
        power_upper: Its bound on the change.
        change: (n,) as solved [N.m].
        effort: (n,) overwritten [N.m].

    Returns:
        By how much the change broke a hard bound [N.m]; NaN if it is not a number.
    """
    beyond, power = 0.0, 0.0
    for i in range(desired.size):
        tau = desired[i] + change[i]
        power += power_row[i] * change[i]
        effort[i] = min(max(tau, -effort_max[i]), effort_max[i])
        beyond += abs(tau - effort[i])
    return beyond + max(power - power_upper, 0.0 * power)
