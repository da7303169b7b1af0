# SPDX-License-Identifier: BSD-3-Clause
r"""The filter's active-set solver: the exact optimum where few limits act, found and proven inside the cycle.

Second of the filter's three steps. With d = tau - desired, W = L L^T and acting constraints a_r . d = b_r
(+ lambda_r / penalty_r if soft), all rows scaled to unit length in the metric, g_r = L^-1 a_r / |L^-1 a_r|, the
multipliers of ``solvers.FilterSolution`` solve a small dense system, one unknown per acting constraint:

    (g_r . g_s + \delta_rs softness_r) lambda_s = -b_r,        d = -L^-T \sum_s lambda_s g_s

The most broken constraint joins, one whose multiplier has the wrong sign leaves, until no constraint is broken
and every sign is right. Those are the optimality conditions, and the problem is strictly convex: such a point *is*
the optimum, however it was found. They are checked of every row as it was given, each against the size of its own terms
(`_holds`), and so is what rounding can have made of the torque (`_sharp`): units of torque, of a joint or of a row
change nothing. Where the optimum is not found within the bounds below, nothing is claimed and the robot's solver
(``solvers``) does the work.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import IndexMatrix, Indices, Integer, Matrix, Record, Vector
from impedance_modules.safety.filter_problem import FilterProblem, clip
from impedance_modules.safety.solvers.exact_form import is_problem

INSIDE, CERTIFIED, UNDECIDED = 0, 1, 2
"""What ``solve`` found: the desired torque breaks nothing; the optimum; nothing that it could prove."""

MOST_ACTING = 16
"""Constraints that may act; with more a general solver is hardly slower."""

TRIALS = 40
"""Acting sets tried before the search gives up."""

TOLERANCE = 1e-11
"""Most that a constraint may be broken, as a part of the largest demand, in the metric's units."""

HOLDS = 1e-10
"""Most that a constraint may be missed in the end, as a part of the torques of its joints."""

SHARP = 1e-9
"""Most that rounding may have moved the torque of a joint, as a part of its limit or of its change."""

ROUNDING = 1e-15
"""Of a sum of some products, as a part of its terms."""

PIVOT = 1e-9
"""Acting rows closer to parallel than this are left to the robot's solver."""


class ActiveSet(Record):
    """The solver's memory and its last answer; constraints are the torque limits, then the rows: n + m.

    Attributes:
        effort: (n,) filtered torque [N.m]; the desired one if undecided.
        duals: (n + m,) multipliers; zero if undecided.
        low, high: (n + m,) bounds of the change.
        weight: (n + m,) about 1 / (a W^-1 a^T) of each constraint: what makes breaches comparable.
        values: (n + m,) a . d.
        length: (n + m,) length in the metric of those that act, 0 for all others.
        factor: (n, n) L.
        change: (n,) d [N.m].
        count: How many act.
        acting: (MOST_ACTING,) which; like the next five only the first ``count``.
        rows: (MOST_ACTING, n) g.
        gram: (MOST_ACTING, MOST_ACTING) g_r . g_s, softness added on the diagonal.
        bound: (MOST_ACTING,) b of unit rows.
        side: (MOST_ACTING,) 1 at an upper bound, -1 at a lower one.
        multiplier: (MOST_ACTING,) of unit rows, 0 beyond the acting ones.
        half: (MOST_ACTING, MOST_ACTING) Cholesky factor of ``gram``.
    """

    effort: Vector
    duals: Vector
    low: Vector
    high: Vector
    weight: Vector
    values: Vector
    length: Vector
    factor: Matrix
    change: Vector
    count: Integer = 0
    acting: Indices
    rows: Matrix
    gram: Matrix
    bound: Vector
    side: Vector
    multiplier: Vector
    half: Matrix


def make_active_set(n: int, m: int) -> ActiveSet:
    """Makes the memory for problems of n joints and m rows."""
    return ActiveSet(
        effort=np.zeros(n),
        duals=np.zeros(n + m),
        low=np.zeros(n + m),
        high=np.zeros(n + m),
        weight=np.zeros(n + m),
        values=np.zeros(n + m),
        length=np.zeros(n + m),
        factor=np.zeros((n, n)),
        change=np.zeros(n),
        acting=np.zeros(MOST_ACTING, dtype=np.int64),
        rows=np.zeros((MOST_ACTING, n)),
        gram=np.zeros((MOST_ACTING, MOST_ACTING)),
        bound=np.zeros(MOST_ACTING),
        side=np.zeros(MOST_ACTING),
        multiplier=np.zeros(MOST_ACTING),
        half=np.zeros((MOST_ACTING, MOST_ACTING)),
    )


@compiled
def solve(problem: FilterProblem, active: ActiveSet) -> tuple[int, int]:
    """Solves one filter problem if that is easy.

    Args:
        problem: As ``metric.write_metric`` and ``rows.write_rows`` leave it.
        active: ``effort`` and ``duals`` are the answer.

    Returns:
        INSIDE, CERTIFIED or UNDECIDED, and how many acting sets were tried.
    """
    n = problem.desired.size
    active.duals[:] = 0.0
    active.effort[:] = problem.desired
    found = _shift_bounds(problem, active)
    if found != CERTIFIED:
        return found, 0
    if not _factor_metric(problem.metric, problem.coupled, active.factor):
        return UNDECIDED, 0
    tried = _search(problem, active)
    if tried == 0:
        return UNDECIDED, TRIALS
    clip(problem, active.change, active.effort)
    for k in range(active.count):
        c = active.acting[k]
        active.duals[c] = active.multiplier[k] / active.length[c]
        if c < n:
            active.effort[c] = active.side[k] * problem.effort_max[c]
    if _holds(problem, active) and _sharp(problem, active):
        return CERTIFIED, tried
    active.duals[:] = 0.0
    active.effort[:] = problem.desired
    return UNDECIDED, tried


@compiled
def _shift_bounds(problem: FilterProblem, active: ActiveSet) -> int:
    """Writes bounds and weights as seen from the desired torque.

    Returns:
        INSIDE, UNDECIDED where this is no problem at all, else CERTIFIED: there is one to solve.
    """
    n, inside, usable = problem.desired.size, True, is_problem(problem)
    low, high, weight = active.low, active.high, active.weight
    for i in range(n):
        low[i] = -problem.effort_max[i] - problem.desired[i]
        high[i] = problem.effort_max[i] - problem.desired[i]
        weight[i] = problem.metric[i, i]
        inside = inside and low[i] <= 0.0 <= high[i]
        usable = usable and problem.metric[i, i] > 0.0
    if not usable:
        return UNDECIDED
    for r in range(problem.lower.size):
        c, value, square, present = n + r, 0.0, 0.0, False
        hard = problem.penalty[r] == np.inf
        for j in range(problem.reach[0, r], problem.reach[1, r]):
            value += problem.matrix[r, j] * problem.desired[j]
            present = present or problem.matrix[r, j] != 0.0
            if hard:
                square += problem.matrix[r, j] * problem.matrix[r, j] / problem.metric[j, j]
        low[c], high[c] = problem.lower[r] - value, problem.upper[r] - value
        weight[c] = problem.penalty[r] / problem.kappa[r]
        if hard:
            weight[c] = 1.0 / square if square > 0.0 else 0.0
        elif not present:
            # No torque moves a row of zeros; what it asks for costs the same whatever is done.
            low[c], high[c] = -np.inf, np.inf
        inside = inside and low[c] <= 0.0 <= high[c]
        usable = usable and math.isfinite(value)
    if not usable:
        return UNDECIDED
    return INSIDE if inside else CERTIFIED


@compiled
def _search(problem: FilterProblem, active: ActiveSet) -> int:
    """Looks for the acting set and the change it makes; returns how many were tried, or 0 where it failed."""
    active.count = 0
    active.multiplier[:] = 0.0
    active.values[:] = 0.0
    active.length[:] = 0.0
    worst, breach = _most_broken(active)
    limit = TOLERANCE * math.sqrt(breach)
    for trial in range(1, TRIALS + 1):
        if breach <= limit * limit:
            return trial
        if active.count == MOST_ACTING:
            return 0
        _join(problem, active, worst)
        proper = False
        while not proper:
            if not _solve_multipliers(active):
                return 0
            wrong = _wrong_sign(active)
            proper = wrong == active.count
            if not proper:
                _leave(active, wrong)
        active.multiplier[active.count :] = 0.0
        _write_change(problem.coupled, active)
        _write_values(problem, active)
        worst, breach = _most_broken(active)
    return 0


@compiled
def _most_broken(active: ActiveSet) -> tuple[int, float]:
    """Finds the constraint broken most among those that do not act; its breach squared, in the metric's units."""
    worst, breach = 0, 0.0
    for c in range(active.values.size):
        beyond = max(active.low[c] - active.values[c], active.values[c] - active.high[c])
        if beyond > 0.0 and active.length[c] == 0.0 and beyond * beyond * active.weight[c] > breach:
            worst, breach = c, beyond * beyond * active.weight[c]
    return worst, breach


@compiled
def _join(problem: FilterProblem, active: ActiveSet, constraint: int) -> None:
    """Lets a broken constraint act as the last one."""
    n, last = problem.desired.size, active.count
    active.length[constraint] = _write_unit_row(problem, active.factor, constraint, active.rows[last])
    inverse = 1.0 / active.length[constraint]
    active.acting[last] = constraint
    active.side[last] = 1.0 if active.values[constraint] > active.high[constraint] else -1.0
    broken = active.high[constraint] if active.side[last] > 0.0 else active.low[constraint]
    active.bound[last] = broken * inverse
    softness = inverse * inverse / problem.penalty[constraint - n] if constraint >= n else 0.0
    _write_gram_row(active.rows, last, softness, active.gram)
    active.count += 1


@compiled
def _leave(active: ActiveSet, which: int) -> None:
    """Takes one constraint out of the acting set; the last one takes its place."""
    active.length[active.acting[which]] = 0.0
    active.count -= 1
    last = active.count
    active.acting[which], active.side[which] = active.acting[last], active.side[last]
    active.bound[which] = active.bound[last]
    active.rows[which] = active.rows[last]
    own = active.gram[last, last]
    active.gram[which, :] = active.gram[last, :]
    active.gram[:, which] = active.gram[which, :]
    active.gram[which, which] = own


@compiled
def _wrong_sign(active: ActiveSet) -> int:
    """Finds the acting constraint that pulls instead of pushing most, or ``count`` if none does."""
    wrong, least = active.count, 0.0
    for k in range(active.count):
        if active.multiplier[k] * active.side[k] < least:
            wrong, least = k, active.multiplier[k] * active.side[k]
    return wrong


@compiled
def _write_unit_row(problem: FilterProblem, factor: Matrix, constraint: int, row: Vector) -> float:
    """Writes g = L^-1 a / |L^-1 a| of a constraint; returns the length |L^-1 a|."""
    n = row.size
    row[:] = 0.0
    first, last = constraint, constraint + 1
    if constraint < n:
        row[constraint] = 1.0
    else:
        first, last = problem.reach[0, constraint - n], problem.reach[1, constraint - n]
        for j in range(first, last):
            row[j] = problem.matrix[constraint - n, j]
    square = 0.0
    for i in range(first, n):
        total = row[i]
        for j in range(problem.coupled[0, i], i):
            total -= factor[i, j] * row[j]
        row[i] = total / factor[i, i]
        square += row[i] * row[i]
    length = math.sqrt(square)
    for i in range(first, n):
        row[i] /= length
    return length


@compiled
def _write_gram_row(rows: Matrix, last: int, softness: float, gram: Matrix) -> None:
    """Writes the products of the last row with all others, g_r . g_s, and with itself."""
    for s in range(last + 1):
        total = softness if s == last else 0.0
        for j in range(rows.shape[1]):
            total += rows[last, j] * rows[s, j]
        gram[last, s] = gram[s, last] = total


@compiled
def _solve_multipliers(active: ActiveSet) -> bool:
    """Solves gram lambda = -bound; False where rows are parallel."""
    half, multiplier, count = active.half, active.multiplier, active.count
    for r in range(count):
        multiplier[r] = -active.bound[r]
        for s in range(r + 1):
            total = active.gram[r, s]
            for k in range(s):
                total -= half[r, k] * half[s, k]
            if s < r:
                half[r, s] = total / half[s, s]
                multiplier[r] -= half[r, s] * multiplier[s]
            elif total > PIVOT:
                half[r, r] = math.sqrt(total)
                multiplier[r] /= half[r, r]
            else:
                return False
    for r in range(count - 1, -1, -1):
        for k in range(r + 1, count):
            multiplier[r] -= half[k, r] * multiplier[k]
        multiplier[r] /= half[r, r]
    return True


@compiled
def _write_change(coupled: IndexMatrix, active: ActiveSet) -> None:
    """Writes d = -L^-T sum lambda g."""
    change, factor = active.change, active.factor
    n = change.size
    for j in range(n):
        change[j] = 0.0
    for k in range(active.count):
        for j in range(n):
            change[j] -= active.multiplier[k] * active.rows[k, j]
    for i in range(n - 1, -1, -1):
        change[i] /= factor[i, i]
        for j in range(coupled[0, i], i):
            change[j] -= factor[i, j] * change[i]


@compiled
def _write_values(problem: FilterProblem, active: ActiveSet) -> None:
    """Writes a . d of every constraint that is present."""
    n = active.change.size
    for i in range(n):
        active.values[i] = active.change[i]
    for r in range(problem.matrix.shape[0]):
        total = 0.0
        if active.low[n + r] > -np.inf or active.high[n + r] < np.inf:
            for j in range(problem.reach[0, r], problem.reach[1, r]):
                total += problem.matrix[r, j] * active.change[j]
        active.values[n + r] = total


@compiled
def _holds(problem: FilterProblem, active: ActiveSet) -> bool:
    """Whether every row holds but for its slack, and is met where it acts, to HOLDS of its joints' own torques.

    Not of the change: next to a demand of 1e15 N.m a limit of 50 N.m is nothing.
    Written so that a comparison with NaN counts as a failure.
    """
    n = active.change.size
    for c in range(active.values.size):
        if active.low[c] == -np.inf and active.high[c] == np.inf:
            continue
        size, slack = 0.0, 0.0
        if c < n:
            size = _own_torque(problem, active.effort, c)
        else:
            for j in range(problem.reach[0, c - n], problem.reach[1, c - n]):
                size += abs(problem.matrix[c - n, j]) * _own_torque(problem, active.effort, j)
            slack = active.duals[c] / problem.penalty[c - n]
        value, allowed = active.values[c] - slack, HOLDS * (size + abs(slack))
        if not active.low[c] - allowed <= value <= active.high[c] + allowed:
            return False
        met = active.high[c] if active.duals[c] > 0.0 else active.low[c]
        if active.duals[c] != 0.0 and not abs(value - met) <= allowed:
            return False
    return True


@compiled
def _own_torque(problem: FilterProblem, effort: Vector, joint: int) -> float:
    """What a joint gives, or is asked for as far as it may give it [N.m]."""
    return float(max(abs(effort[joint]), min(abs(problem.desired[joint]), problem.effort_max[joint])))


@compiled
def _sharp(problem: FilterProblem, active: ActiveSet) -> bool:
    """Whether rounding can have moved no joint's torque by more than SHARP of its scale.

    Multipliers of nearly parallel rows lose the root of what is left of a row beside the others; a metric loses what is
    left of a joint beside the others when it is divided by.
    """
    push, square, least, left = 0.0, 0.0, 1.0, 1.0
    for k in range(active.count):
        push += abs(active.multiplier[k])
        least = min(least, active.half[k, k])
    for i in range(active.change.size):
        left = min(left, active.factor[i, i] * active.factor[i, i] / problem.metric[i, i])
        square = max(square, active.change[i] * active.change[i] * problem.metric[i, i])
    change = math.sqrt(square)
    lost = ROUNDING * (push / least + change) / left
    for i in range(active.change.size):
        if problem.effort_max[i] > 0.0:
            root = math.sqrt(problem.metric[i, i])
            scale = max(abs(active.effort[i]), min(change / root, problem.effort_max[i]))
            if not lost / root + ROUNDING * abs(problem.desired[i]) <= SHARP * scale:
                return False
    return True


@compiled
def _factor_metric(metric: Matrix, coupled: IndexMatrix, factor: Matrix) -> bool:
    """Factors W = L L^T within each tree of joints; False if W is not positive definite."""
    for i in range(metric.shape[0]):
        for j in range(coupled[0, i], i + 1):
            total = metric[i, j]
            for k in range(coupled[0, i], j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return True
