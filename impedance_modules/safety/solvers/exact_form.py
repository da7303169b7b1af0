# SPDX-License-Identifier: BSD-3-Clause
r"""A filter problem in 32 digits and in units of its own, from which ``exact_search`` finds the optimum.

The unknown is the change of torque d = tau - desired. Joints and constraints are scaled by powers of two, which no
number notices: d' = d / u with u_i^2 about 1 / W_ii, so that W' has a diagonal near one, and every row a' to a length
near one in the metric, |L^-1 a'|, W' = L L^T. Units of torque, of a joint or of a row therefore change nothing but
units. Bounds b' = (bound - a . desired) in the units of their row are differences of large numbers: 32 digits.

A metric is known to rounding. One that is singular to rounding gets ROUNDING on its diagonal: of the torques between
which it cannot choose, the one nearest to the desired torque is taken. One that is farther from positive definite than
that is none.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, Flag, Integer, Matrix, Record, Vector
from impedance_modules.safety.double_double import Long, divide, exact_sum, square_root, subtract_product
from impedance_modules.safety.filter_problem import FilterProblem

USABLE, NO_PROBLEM, NOT_DEFINITE, CONTRADICTION = range(4)
"""What ``write_form`` found: a problem; numbers that are none; no metric; a hard row of zeros that cannot hold."""

ROUNDING = 2.0**-46
"""Smallest eigenvalue, at unit diagonal, below which a metric is singular: a hundred times a float's rounding."""

_PIVOT = 1e-26
"""Pivots below this are no more than what 32 digits leave of zero."""


class ExactForm(Record):
    """The problem in units of its own; n joints, then m rows, N = n + m constraints.

    Attributes:
        unit: (n,) u, a power of two each [N.m].
        metric: (n, n) W'.
        factor: (2, n, n) L.
        rows: (N, n) a'.
        row_unit: (N,) a constraint is this many times a', a power of two; 0 for a row of zeros, which is absent.
        low, high: (2, N) bounds of a' . d', infinite where absent.
        give: (2, N) root of 1 / penalty in these units; 0 for hard constraints.
        work: (n,) of no meaning outside ``_scale_row``.
        regular: False where ROUNDING had to be added.
        joints: n.
    """

    unit: Vector
    metric: Matrix
    factor: Array3
    rows: Matrix
    row_unit: Vector
    low: Matrix
    high: Matrix
    give: Matrix
    work: Vector
    regular: Flag = True
    joints: Integer


def make_form(n: int, m: int) -> ExactForm:
    """Makes the memory for problems of n joints and m rows."""
    size = n + m
    return ExactForm(
        unit=np.ones(n),
        metric=np.zeros((n, n)),
        factor=np.zeros((2, n, n)),
        rows=np.zeros((size, n)),
        row_unit=np.zeros(size),
        low=np.zeros((2, size)),
        high=np.zeros((2, size)),
        give=np.zeros((2, size)),
        work=np.zeros(n),
        joints=n,
    )


@compiled
def is_problem(problem: FilterProblem) -> bool:
    """Tells whether all numbers are numbers, bounds are in order and penalties positive; anywhere, used or not.

    Written so that a comparison with NaN counts as a failure.
    """
    n, metric, matrix = problem.desired.size, problem.metric, problem.matrix
    lower, upper = problem.lower, problem.upper
    for i in range(n):
        if not (abs(problem.desired[i]) < np.inf and problem.effort_max[i] >= 0.0):
            return False
        for j in range(n):
            if not abs(metric[i, j]) < np.inf:
                return False
    for r in range(lower.size):
        if not (lower[r] <= upper[r] and lower[r] < np.inf and upper[r] > -np.inf):
            return False
        if not (problem.penalty[r] > 0.0 and problem.kappa[r] > 0.0):
            return False
        for j in range(n):
            if not abs(matrix[r, j]) < np.inf:
                return False
    return True


@compiled
def write_form(problem: FilterProblem, form: ExactForm) -> int:
    """Writes a problem in units of its own.

    Returns:
        USABLE, NO_PROBLEM, NOT_DEFINITE or CONTRADICTION.
    """
    if not is_problem(problem):
        return NO_PROBLEM
    if not _write_metric(problem, form):
        return NOT_DEFINITE
    n = form.joints
    for i in range(n):
        for j in range(n):
            form.rows[i, j] = form.unit[i] if i == j else 0.0
        _scale_row(form, i)
        form.give[0, i] = form.give[1, i] = 0.0
        _write_bound(form.low, i, -problem.effort_max[i], (problem.desired[i], 0.0), form.row_unit[i])
        _write_bound(form.high, i, problem.effort_max[i], (problem.desired[i], 0.0), form.row_unit[i])
    for r in range(problem.lower.size):
        if not _write_row(problem, form, r):
            return CONTRADICTION
    return USABLE


@compiled
def power_of_two(number: float) -> float:
    """Returns the power of two next to a positive number."""
    return math.ldexp(1.0, math.frexp(number)[1] - 1)


@compiled
def _write_metric(problem: FilterProblem, form: ExactForm) -> bool:
    """Writes u, W' and L; False if there is no metric."""
    n, least = form.joints, np.inf
    for i in range(n):
        if problem.metric[i, i] < 0.0:
            return False
        if problem.metric[i, i] > 0.0:
            least = min(least, problem.metric[i, i])
    if least == np.inf:
        return False
    for i in range(n):
        form.unit[i] = 1.0 / power_of_two(math.sqrt(max(problem.metric[i, i], least)))
    for i in range(n):
        for j in range(n):
            form.metric[i, j] = problem.metric[i, j] * form.unit[i] * form.unit[j]
    form.regular = _factor(form, 0.0)
    return form.regular or _factor(form, ROUNDING)


@compiled
def _factor(form: ExactForm, added: float) -> bool:
    """Writes L of W' + added on the diagonal; False if that is not positive definite."""
    factor = form.factor
    for i in range(form.joints):
        for j in range(i + 1):
            total = exact_sum(form.metric[i, j], added if i == j else 0.0)
            for k in range(j):
                if factor[0, i, k] != 0.0:
                    total = subtract_product(
                        total, (factor[0, i, k], factor[1, i, k]), (factor[0, j, k], factor[1, j, k])
                    )
            if i != j:
                total = divide(total, (factor[0, j, j], factor[1, j, j]))
            elif total[0] > _PIVOT:
                total = square_root(total)
            else:
                return False
            factor[0, i, j], factor[1, i, j] = total
    return True


@compiled
def _scale_row(form: ExactForm, constraint: int) -> None:
    """Divides a row by about its length in the metric; one of zeros is marked absent."""
    square, row, factor, work = 0.0, form.rows[constraint], form.factor, form.work
    for i in range(form.joints):
        total = row[i]
        for k in range(i):
            total -= factor[0, i, k] * work[k]
        work[i] = total / factor[0, i, i]
        square += work[i] * work[i]
    form.row_unit[constraint] = 0.0
    if square > 0.0:
        form.row_unit[constraint] = power_of_two(math.sqrt(square))
        for i in range(form.joints):
            row[i] /= form.row_unit[constraint]


@compiled
def _write_row(problem: FilterProblem, form: ExactForm, r: int) -> bool:
    """Writes one row with bounds and softness; False for a hard row of zeros that no torque can satisfy."""
    n, c = form.joints, form.joints + r
    value = (0.0, 0.0)
    for j in range(n):
        form.rows[c, j] = problem.matrix[r, j] * form.unit[j]
        value = subtract_product(value, (-problem.matrix[r, j], 0.0), (problem.desired[j], 0.0))
    _scale_row(form, c)
    unit = form.row_unit[c]
    hard = problem.penalty[r] == np.inf
    form.give[0, c] = 0.0 if hard else 1.0
    form.give[1, c] = 0.0
    if unit == 0.0:
        form.low[0, c], form.high[0, c] = -np.inf, np.inf
        return not hard or problem.lower[r] <= 0.0 <= problem.upper[r]
    _write_bound(form.low, c, problem.lower[r], value, unit)
    _write_bound(form.high, c, problem.upper[r], value, unit)
    if not hard:
        give = square_root(divide((1.0, 0.0), (problem.penalty[r], 0.0)))
        form.give[0, c], form.give[1, c] = give[0] / unit, give[1] / unit
    return True


@compiled
def _write_bound(bounds: Matrix, constraint: int, bound: float, value: Long, unit: float) -> None:
    """Writes (bound - value) / unit."""
    bounds[0, constraint], bounds[1, constraint] = bound, 0.0
    if math.isfinite(bound):
        rest = subtract_product((bound, 0.0), value, (1.0, 0.0))
        bounds[0, constraint], bounds[1, constraint] = rest[0] / unit, rest[1] / unit
