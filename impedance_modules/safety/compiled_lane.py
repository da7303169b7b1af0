# SPDX-License-Identifier: BSD-3-Clause
r"""The filter's fast lane: the exact optimum where few limits act, found and certified inside the compiled cycle.

With d = tau - desired, W = L L^T and acting constraints a_r . d = b_r (+ lambda_r / penalty_r if soft), all rows
scaled to unit length in the metric, g_r = L^-1 a_r / |L^-1 a_r|, the multipliers of ``solution.FilterSolution``
solve a small dense system, one unknown per acting constraint:

    (g_r . g_s + \delta_rs softness_r) lambda_s = -b_r,        d = -L^-T \sum_s lambda_s g_s

The most broken constraint joins, one whose multiplier has the wrong sign leaves, until no constraint is broken
and every sign is right. Those are the optimality conditions, and the problem is strictly convex: such a point *is*
the optimum, however it was found. Where it is not found within the bounds below, nothing is claimed and the
robot's solver does the work.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.safety.compiled_dual import (
    factor_metric,
    meet,
    solve_multipliers,
    unit_row,
    write_change,
)
from impedance_modules.safety.solvers.compiled import land
from impedance_modules.safety.solvers.normal_form import HARD_TOLERANCE

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

INSIDE, CERTIFIED, UNDECIDED = 0, 1, 2
"""What ``solve`` found: the desired torque breaks nothing; the optimum; nothing that it could prove."""

MOST_ACTING = 16
"""Constraints that may act; with more a general solver is hardly slower."""

TRIALS = 40
"""Acting sets tried before the lane gives up."""

TOLERANCE = 1e-11
"""Most that a constraint may be broken, as a part of the largest demand, in the metric's units."""


@compiled
def solve(
    desired: Array,
    effort_max: Array,
    matrix: Array,
    lower: Array,
    upper: Array,
    penalty: Array,
    metric: Array,
    kappa: Array,
    reach: Indices,
    coupled: Indices,
    effort: Array,
    duals: Array,
) -> tuple[int, int]:
    """Solves one filter problem if that is easy.

    Args:
        desired: (n,) torque of the modules [N.m].
        effort_max: (n,) torque limits [N.m].
        matrix: (m, n) rows.
        lower: (m,).
        upper: (m,).
        penalty: (m,) inf for a hard row.
        metric: (n, n).
        kappa: (m,) relative penalty of each row's kind (``metric.relative_penalty``); of hard rows unused.
        reach: (2, m) first and one past the last column of each row that can be other than zero.
        coupled: (2, n) likewise of the metric.
        effort: (n,) overwritten with the filtered torque, unless undecided [N.m].
        duals: (n + m,) overwritten with the multipliers, torque limits first; zero if undecided.

    Returns:
        INSIDE, CERTIFIED or UNDECIDED, and how many acting sets were tried.
    """
    n, count = desired.size, desired.size + lower.size
    low, high, weight = np.empty(count), np.empty(count), np.empty(count)
    duals[:] = 0.0
    found = _shift(
        desired, effort_max, matrix, lower, upper, penalty, metric, kappa, reach, low, high, weight
    )
    if found != CERTIFIED:
        effort[:] = desired
        return found, 0
    factor, change = np.zeros((n, n)), np.zeros(n)
    if not factor_metric(metric, coupled, factor):
        return UNDECIDED, 0
    acting, length, multiplier = np.empty(MOST_ACTING, np.int64), np.zeros(count), np.empty(MOST_ACTING)
    tried = _search(
        matrix, penalty, reach, coupled, factor, low, high, weight, acting, length, multiplier, change
    )
    if tried == 0:
        return UNDECIDED, TRIALS
    if not land(desired, effort_max, matrix[0], high[n], change, effort) <= HARD_TOLERANCE:
        return UNDECIDED, tried
    for k in range(MOST_ACTING):
        if multiplier[k] != 0.0:
            duals[acting[k]] = multiplier[k] / length[acting[k]]
    return CERTIFIED, tried


@compiled
def _shift(
    desired: Array,
    effort_max: Array,
    matrix: Array,
    lower: Array,
    upper: Array,
    penalty: Array,
    metric: Array,
    kappa: Array,
    reach: Indices,
    low: Array,
    high: Array,
    weight: Array,
) -> int:
    """Writes the bounds of the change, and about 1 / (a W^-1 a^T) of each constraint: what makes breaches comparable.

    Returns:
        INSIDE, UNDECIDED where this is no problem at all, else CERTIFIED: there is one to solve.
    """
    n, inside, usable = desired.size, True, True
    for i in range(n):
        low[i], high[i], weight[i] = (
            -effort_max[i] - desired[i],
            effort_max[i] - desired[i],
            metric[i, i],
        )
        inside = inside and low[i] <= 0.0 <= high[i]
        # A metric is a sum of squares: a number in it that is not finite shows on its diagonal.
        usable = usable and effort_max[i] >= 0.0 and 0.0 < metric[i, i] < np.inf
    for r in range(lower.size):
        c, value, square = n + r, 0.0, 0.0
        hard = penalty[r] == np.inf
        for j in range(reach[0, r], reach[1, r]):
            value += matrix[r, j] * desired[j]
            if hard:
                square += matrix[r, j] * matrix[r, j] / metric[j, j]
        low[c], high[c] = lower[r] - value, upper[r] - value
        weight[c] = penalty[r] / kappa[r]
        if hard:
            weight[c] = 1.0 / square if square > 0.0 else 0.0
        inside = inside and low[c] <= 0.0 <= high[c]
        usable = usable and low[c] <= high[c] and penalty[r] > 0.0 and math.isfinite(value)
    if not usable:
        return UNDECIDED
    return INSIDE if inside else CERTIFIED


@compiled
def _search(
    matrix: Array,
    penalty: Array,
    reach: Indices,
    coupled: Indices,
    factor: Array,
    low: Array,
    high: Array,
    weight: Array,
    acting: Indices,
    length: Array,
    multiplier: Array,
    change: Array,
) -> int:
    """Looks for the acting set; returns how many were tried, or 0 where the search failed.

    Writes ``change`` (n,), the acting constraints, their ``length`` in the metric (0 for all others) and
    ``multiplier`` (of unit rows, 0 beyond the acting ones).
    """
    n = change.size
    values = np.zeros(low.size)
    rows, gram = np.empty((MOST_ACTING, n)), np.zeros((MOST_ACTING, MOST_ACTING))
    bound, side, count = np.empty(MOST_ACTING), np.empty(MOST_ACTING), 0
    multiplier[:] = 0.0
    worst, demand = _worst(values, low, high, weight, length)
    limit, breach = TOLERANCE * max(1.0, math.sqrt(demand)), demand
    for trial in range(1, TRIALS + 1):
        if breach <= limit * limit:
            return trial
        if count == MOST_ACTING:
            return 0
        length[worst] = unit_row(worst, matrix, reach, coupled, factor, rows[count])
        inverse = 1.0 / length[worst]
        acting[count] = worst
        side[count] = 1.0 if values[worst] > high[worst] else -1.0
        bound[count] = (high[worst] if side[count] > 0.0 else low[worst]) * inverse
        softness = inverse * inverse / penalty[worst - n] if worst >= n else 0.0
        meet(rows, count, softness, gram)
        count += 1
        proper = False
        while not proper:
            if not solve_multipliers(gram, bound, count, multiplier):
                return 0
            wrong = _wrong_sign(multiplier, side, count)
            proper = wrong == count
            if not proper:
                # The last one takes the place of the one that leaves.
                length[acting[wrong]] = 0.0
                count -= 1
                acting[wrong], side[wrong], bound[wrong] = acting[count], side[count], bound[count]
                rows[wrong] = rows[count]
                own = gram[count, count]
                gram[wrong, :] = gram[count, :]
                gram[:, wrong] = gram[wrong, :]
                gram[wrong, wrong] = own
        multiplier[count:] = 0.0
        write_change(rows, multiplier, count, coupled, factor, change)
        _values(matrix, reach, change, low, high, values)
        worst, breach = _worst(values, low, high, weight, length)
    return 0


@compiled
def _worst(values: Array, low: Array, high: Array, weight: Array, length: Array) -> tuple[int, float]:
    """Finds the constraint broken most among those that do not act; its breach squared, in the metric's units."""
    worst, breach = 0, 0.0
    for c in range(values.size):
        beyond = max(low[c] - values[c], values[c] - high[c])
        if beyond > 0.0 and length[c] == 0.0 and beyond * beyond * weight[c] > breach:
            worst, breach = c, beyond * beyond * weight[c]
    return worst, breach


@compiled
def _values(matrix: Array, reach: Indices, change: Array, low: Array, high: Array, values: Array) -> None:
    """Writes a . d of every constraint that is present."""
    n = change.size
    for i in range(n):
        values[i] = change[i]
    for r in range(matrix.shape[0]):
        total = 0.0
        if low[n + r] > -np.inf or high[n + r] < np.inf:
            for j in range(reach[0, r], reach[1, r]):
                total += matrix[r, j] * change[j]
        values[n + r] = total


@compiled
def _wrong_sign(multiplier: Array, side: Array, count: int) -> int:
    """Finds the acting constraint that pulls instead of pushing most, or ``count`` if none does."""
    wrong, least = count, 0.0
    for k in range(count):
        if multiplier[k] * side[k] < least:
            wrong, least = k, multiplier[k] * side[k]
    return wrong
