# SPDX-License-Identifier: BSD-3-Clause
r"""The optimum of a filter problem, found and proven in 32 digits: what every solver's answer is finished with.

The dual active-set method of Goldfarb and Idnani ("A numerically stable dual method for solving strictly convex
quadratic programs", 1983), with soft rows. A constraint r that acts on side s_r has a signed row with one coordinate
more, and a bound, in the coordinates y = L^T d' of ``exact_form``:

    g_r = (s_r L^-1 a'_r, give_r e_r),   give_r^2 = 1 / penalty_r,   b_r = s_r b'

The least (y, slack) that meets all acting bounds is a combination of an orthonormal basis of their rows, G = R^T Q:

    R^T c = b,   (y, slack) = Q^T c,   R lambda = -c

The most broken constraint p pushes with growing lambda_p; those that act answer along z, R z = Q g_p. It joins when it
is no longer broken; one whose multiplier reaches zero before that leaves. Every step raises the dual cost, so no acting
set comes twice. A constraint that depends on those that act and makes none leave proves that hard bounds contradict
each other. A solver's guess of what acts is a shorter way to the same end: what pulls in it is left out first.

Soft rows that contradict each other may push 1e15 times as much as the torque they leave: that is why 32 digits are
needed, and a basis, in which the loss is the root of that in the products of rows. The end is checked, not assumed:
every bound against the size of its own terms (`_proven`).
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, Indices, Integer, Matrix, Record, Scalar, Vector
from impedance_modules.safety.double_double import Long, add, divide, multiply, square_root, subtract_product
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers.exact_form import ExactForm, make_form
from impedance_modules.safety.solvers.stiff_rows import StiffRows, make_stiff_rows, stiff_point

PROVEN, CONTRADICTORY, UNPROVEN = range(3)
"""How a search ended: the optimum; hard bounds contradict each other; neither could be shown."""

TOLERANCE = 1e-20
"""Most that a constraint may be broken in the end, as a part of the terms of its own sum.

Far below a float's rounding: demands of 1e15 N.m must not hide that a limit of 50 N.m is broken."""

CARRIED = 1e-12
"""Most that the multipliers may miss of the change's cost, as a part of the terms of that sum."""

STEPS = 20
"""Steps before the search gives up, per constraint."""

_NOISE = 1e-28
"""What 32 digits leave of the largest coordinate: a constraint broken by less is not."""

_CANCELLING = 1e-20
"""Part of the change beyond which such a breach says too little: pushes nearly cancel, and ``stiff_rows`` is asked."""

_DEPENDENT = 1e-36
"""Square of the part of a hard unit row outside the others that is no more than their rounding."""


class ExactSearch(Record):
    """Memory of a search; N constraints, of which the first ``count`` of what is listed from ``acting`` on act.

    Attributes:
        form: The problem.
        side: (N,) guess before, answer after: 1 acts at its upper bound, -1 at its lower one, 0 does not act.
        change: (2, n) d'.
        point: (2, n) y.
        noise: A breach counts beyond this.
        count: How many act.
        steps: Made so far.
        acting: (N,) which.
        rows: (2, N, n) y-part of g.
        bound: (2, N) b.
        multiplier: (2, N) lambda.
        basis: (2, N, n + N) rows of Q; the last is not of unit length before its constraint has joined.
        triangle: (2, N, N) R.
        load: (2, N) c.
        give: (2, N) of ``form``, of those that act.
        stiff: Memory for pushes that nearly cancel.
        answer: (2, N) z.
    """

    form: ExactForm
    side: Indices
    change: Matrix
    point: Matrix
    noise: Scalar = 0.0
    count: Integer = 0
    steps: Integer = 0
    acting: Indices
    rows: Array3
    bound: Matrix
    multiplier: Matrix
    basis: Array3
    triangle: Array3
    load: Matrix
    give: Matrix
    stiff: StiffRows
    answer: Matrix


def make_search(n: int, m: int) -> ExactSearch:
    """Makes the memory for problems of n joints and m rows."""
    size = n + m
    return ExactSearch(
        form=make_form(n, m),
        side=np.zeros(size, dtype=np.int64),
        change=np.zeros((2, n)),
        point=np.zeros((2, n)),
        acting=np.zeros(size, dtype=np.int64),
        rows=np.zeros((2, size, n)),
        bound=np.zeros((2, size)),
        multiplier=np.zeros((2, size)),
        basis=np.zeros((2, size, n + size)),
        triangle=np.zeros((2, size, size)),
        load=np.zeros((2, size)),
        give=np.zeros((2, size)),
        stiff=make_stiff_rows(n, size),
        answer=np.zeros((2, size)),
    )


@compiled
def search(exact: ExactSearch) -> int:
    """Finds the optimum of ``form``, beginning with the constraints that ``side`` guesses to act.

    Returns:
        PROVEN, CONTRADICTORY or UNPROVEN.
    """
    exact.count, exact.steps = 0, 0
    _begin(exact)
    most = STEPS * exact.side.size
    while exact.steps < most:
        _write_change(exact)
        worst, side, breach = _most_broken(exact)
        if side == 0:
            break
        _append(exact, worst, side)
        if not _let_join(exact, breach, most):
            _drop_last(exact)
            # Bounds that cannot all be met may still be met to rounding.
            if exact.steps < most and not _proven(exact):
                return CONTRADICTORY
            break
    return PROVEN if _proven(exact) else UNPROVEN


@compiled
def write_answer(problem: FilterProblem, exact: ExactSearch, effort: Vector, duals: Vector) -> None:
    """Writes torque and multipliers of a proven optimum.

    Args:
        problem: The one of ``form``.
        exact: After ``search``.
        effort: (n,) overwritten, inside the torque limits to the last bit [N.m].
        duals: (n + m,) overwritten; see ``solvers.FilterSolution``.
    """
    for i in range(effort.size):
        change = (exact.change[0, i] * exact.form.unit[i], exact.change[1, i] * exact.form.unit[i])
        tau = add((problem.desired[i], 0.0), change)
        effort[i] = min(max(tau[0], -problem.effort_max[i]), problem.effort_max[i])
    for c in range(duals.size):
        duals[c] = 0.0
    for k in range(exact.count):
        c = exact.acting[k]
        side = exact.side[c]
        duals[c] = side * exact.multiplier[0, k] / exact.form.row_unit[c]
        if c < effort.size:
            effort[c] = side * problem.effort_max[c]


@compiled
def _begin(exact: ExactSearch) -> None:
    """Lets those guessed constraints act that push, and forgets the others."""
    for c in range(exact.side.size):
        side = exact.side[c]
        bound = exact.form.high[0, c] if side > 0 else exact.form.low[0, c]
        exact.side[c] = 0
        if side != 0 and math.isfinite(bound):
            _append(exact, c, side)
            if not _extend(exact, _project(exact)):
                _drop_last(exact)
    while exact.count > 0:
        _write_load(exact)
        _write_multipliers(exact)
        wrong, least = 0, 0.0
        for k in range(exact.count):
            if exact.multiplier[0, k] < least:
                wrong, least = k, exact.multiplier[0, k]
        if least == 0.0:
            return
        exact.steps += 1
        _leave(exact, wrong)


@compiled
def _append(exact: ExactSearch, constraint: int, side: int) -> None:
    """Puts a constraint behind those that act, with its row and bound, and no push yet."""
    form, last = exact.form, exact.count
    exact.acting[last], exact.side[constraint] = constraint, side
    bounds = form.high if side > 0 else form.low
    exact.bound[0, last], exact.bound[1, last] = side * bounds[0, constraint], side * bounds[1, constraint]
    exact.multiplier[0, last] = exact.multiplier[1, last] = 0.0
    row = exact.rows
    for i in range(form.joints):
        total = (side * form.rows[constraint, i], 0.0)
        for k in range(i):
            if form.factor[0, i, k] != 0.0:
                known = (row[0, last, k], row[1, last, k])
                total = subtract_product(total, (form.factor[0, i, k], form.factor[1, i, k]), known)
        row[0, last, i], row[1, last, i] = divide(total, (form.factor[0, i, i], form.factor[1, i, i]))
    exact.count += 1


@compiled
def _drop_last(exact: ExactSearch) -> None:
    """Takes back what ``_append`` did."""
    exact.count -= 1
    exact.side[exact.acting[exact.count]] = 0


@compiled
def _project(exact: ExactSearch) -> Long:
    """Takes out of the last row what lies in the others' basis; returns the square of what is left.

    Twice, because the first time leaves as much of the others as rounding does.
    """
    form, basis, triangle, last = exact.form, exact.basis, exact.triangle, exact.count - 1
    n = form.joints
    for part in range(2):
        for i in range(n):
            basis[part, last, i] = exact.rows[part, last, i]
        for s in range(last):
            basis[part, last, n + s] = triangle[part, s, last] = 0.0
        basis[part, last, n + last] = form.give[part, exact.acting[last]]
    for _ in range(2):
        for s in range(last):
            share = _product(basis, s, last, n + s + 1)
            for i in range(n + s + 1):
                if basis[0, s, i] != 0.0:
                    rest = (basis[0, last, i], basis[1, last, i])
                    rest = subtract_product(rest, share, (basis[0, s, i], basis[1, s, i]))
                    basis[0, last, i], basis[1, last, i] = rest
            share = add((triangle[0, s, last], triangle[1, s, last]), share)
            triangle[0, s, last], triangle[1, s, last] = share
    give = np.inf
    for s in range(last):
        if form.give[0, exact.acting[s]] > 0.0:
            give = min(give, form.give[0, exact.acting[s]])
    return _left_over(_product(basis, last, last, n + last + 1), form.give[0, exact.acting[last]], give)


@compiled
def _product(basis: Array3, a: int, b: int, size: int) -> Long:
    """Product of two rows of the basis, over their first ``size`` coordinates."""
    total = (0.0, 0.0)
    for i in range(size):
        if basis[0, a, i] != 0.0 and basis[0, b, i] != 0.0:
            factor = (-basis[0, a, i], -basis[1, a, i])
            total = subtract_product(total, factor, (basis[0, b, i], basis[1, b, i]))
    return total


@compiled
def _left_over(square: Long, own: float, others: float) -> Long:
    """The square of what is left of a row, zero if a hard one depends on the others; a soft one keeps its own part.

    A hard row along a soft one keeps what that may give, however little it is.
    """
    if square[0] > min(_DEPENDENT, 0.1 * others * others) or square[0] > 0.5 * own * own > 0.0:
        return square
    return multiply((own, 0.0), (own, 0.0))


@compiled
def _extend(exact: ExactSearch, square: Long) -> bool:
    """Makes what is left of the last row part of the basis; False if nothing is left."""
    last = exact.count - 1
    if square[0] == 0.0:
        return False
    length = square_root(square)
    exact.triangle[0, last, last], exact.triangle[1, last, last] = length
    for i in range(exact.form.joints + last + 1):
        rest = divide((exact.basis[0, last, i], exact.basis[1, last, i]), length)
        exact.basis[0, last, i], exact.basis[1, last, i] = rest
    return True


@compiled
def _leave(exact: ExactSearch, which: int) -> None:
    """Takes one constraint out; those behind it move up, and the basis is made anew from there on."""
    exact.side[exact.acting[which]] = 0
    others = exact.count - 1
    for k in range(which, others):
        exact.acting[k] = exact.acting[k + 1]
        for part in range(2):
            exact.bound[part, k] = exact.bound[part, k + 1]
            exact.multiplier[part, k] = exact.multiplier[part, k + 1]
            for i in range(exact.form.joints):
                exact.rows[part, k, i] = exact.rows[part, k + 1, i]
    for k in range(which, others):
        exact.count = k + 1
        _extend(exact, _project(exact))
    exact.count = others


@compiled
def _write_load(exact: ExactSearch) -> None:
    """Solves R^T c = b."""
    load, triangle = exact.load, exact.triangle
    for k in range(exact.count):
        total = (exact.bound[0, k], exact.bound[1, k])
        for s in range(k):
            total = subtract_product(total, (triangle[0, s, k], triangle[1, s, k]), (load[0, s], load[1, s]))
        load[0, k], load[1, k] = divide(total, (triangle[0, k, k], triangle[1, k, k]))


@compiled
def _write_multipliers(exact: ExactSearch) -> None:
    """Solves R lambda = -c."""
    for k in range(exact.count):
        exact.multiplier[0, k], exact.multiplier[1, k] = -exact.load[0, k], -exact.load[1, k]
    _divide_triangle(exact.triangle, exact.count, exact.multiplier)


@compiled
def _divide_triangle(triangle: Array3, size: int, vector: Matrix) -> None:
    """Replaces the first ``size`` numbers of a vector by R^-1 vector."""
    for k in range(size - 1, -1, -1):
        total = (vector[0, k], vector[1, k])
        for s in range(k + 1, size):
            total = subtract_product(
                total, (triangle[0, k, s], triangle[1, k, s]), (vector[0, s], vector[1, s])
            )
        vector[0, k], vector[1, k] = divide(total, (triangle[0, k, k], triangle[1, k, k]))


@compiled
def _let_join(exact: ExactSearch, breach: Long, most: int) -> bool:
    """Lets the last constraint push until it is no longer broken; False if it stays so whatever the others do."""
    while exact.steps < most:
        exact.steps += 1
        last = exact.count - 1
        square = _project(exact)
        for k in range(last):
            exact.answer[0, k], exact.answer[1, k] = exact.triangle[0, k, last], exact.triangle[1, k, last]
        _divide_triangle(exact.triangle, last, exact.answer)
        leaving, step = _first_to_leave(exact)
        if square[0] > 0.0:
            whole = divide(breach, square)
            if leaving == last or whole[0] <= step[0]:
                _push(exact, whole)
                return _extend(exact, square)
        if leaving == last:
            return False
        _push(exact, step)
        breach = subtract_product(breach, step, square)
        _leave(exact, leaving)
    return False


@compiled
def _first_to_leave(exact: ExactSearch) -> tuple[int, Long]:
    """The acting constraint whose multiplier reaches zero first, and the last one's push until then; or the last."""
    last = exact.count - 1
    leaving, step = last, (np.inf, 0.0)
    for k in range(last):
        if exact.answer[0, k] > 0.0:
            multiplier = (exact.multiplier[0, k], exact.multiplier[1, k])
            until = divide(multiplier, (exact.answer[0, k], exact.answer[1, k]))
            if until[0] < step[0]:
                leaving, step = k, until
    return leaving, step


@compiled
def _push(exact: ExactSearch, step: Long) -> None:
    """The last constraint pushes more; those that act answer."""
    last = exact.count - 1
    for k in range(last):
        multiplier = (exact.multiplier[0, k], exact.multiplier[1, k])
        multiplier = subtract_product(multiplier, (exact.answer[0, k], exact.answer[1, k]), step)
        # Rounding must not make a multiplier pull.
        if multiplier[0] < 0.0:
            multiplier = (0.0, 0.0)
        exact.multiplier[0, k], exact.multiplier[1, k] = multiplier
    total = add((exact.multiplier[0, last], exact.multiplier[1, last]), step)
    exact.multiplier[0, last], exact.multiplier[1, last] = total


@compiled
def _write_change(exact: ExactSearch) -> None:
    """Writes y, d' = L^-T y, and how small a breach means nothing."""
    form, point, change = exact.form, exact.point, exact.change
    n = form.joints
    _write_point(exact)
    for i in range(n - 1, -1, -1):
        total = (point[0, i], point[1, i])
        for k in range(i + 1, n):
            if form.factor[0, k, i] != 0.0:
                known = (change[0, k], change[1, k])
                total = subtract_product(total, (form.factor[0, k, i], form.factor[1, k, i]), known)
        change[0, i], change[1, i] = divide(total, (form.factor[0, i, i], form.factor[1, i, i]))


@compiled
def _write_point(exact: ExactSearch) -> None:
    """Writes y = Q^T c, or where slacks are so much larger that they drown it, the same without them; and the noise."""
    point, largest, size = exact.point, 0.0, 0.0
    _write_load(exact)
    for k in range(exact.count):
        largest = max(largest, abs(exact.load[0, k]))
        for part in range(2):
            exact.give[part, k] = exact.form.give[part, exact.acting[k]]
    for i in range(exact.form.joints):
        total = (0.0, 0.0)
        for k in range(exact.count):
            load = (-exact.load[0, k], -exact.load[1, k])
            total = subtract_product(total, (exact.basis[0, k, i], exact.basis[1, k, i]), load)
        point[0, i], point[1, i] = total
        size = max(size, abs(total[0]))
    exact.noise = _NOISE * largest
    if exact.noise > _CANCELLING * size:
        stiff_point(exact.stiff, exact.rows, exact.bound, exact.give, exact.count, point)
        exact.noise = _CANCELLING * size


@compiled
def _value(exact: ExactSearch, constraint: int) -> Long:
    """Returns a' . d' of a constraint."""
    total = (0.0, 0.0)
    for i in range(exact.form.joints):
        part = exact.form.rows[constraint, i]
        if part != 0.0:
            total = subtract_product(total, (-part, 0.0), (exact.change[0, i], exact.change[1, i]))
    return total


@compiled
def _most_broken(exact: ExactSearch) -> tuple[int, int, Long]:
    """The constraint broken most among those that do not act, its side and by how much; side 0 if none is."""
    form = exact.form
    worst, side, most = 0, 0, (exact.noise, 0.0)
    for c in range(exact.side.size):
        if exact.side[c] == 0 and (form.low[0, c] > -np.inf or form.high[0, c] < np.inf):
            for toward in (1, -1):
                bound = form.high[0, c] if toward > 0 else form.low[0, c]
                if math.isfinite(bound):
                    beyond = _beyond(exact, c, toward)
                    if beyond[0] > most[0]:
                        worst, side, most = c, toward, beyond
    return worst, side, most


@compiled
def _proven(exact: ExactSearch) -> bool:
    """Whether all optimality conditions hold, each to TOLERANCE of its own terms; not where a number is none.

    Together the multipliers must carry the change, none may pull, and every bound must hold but for a soft row's slack,
    and be met where it acts.
    """
    _write_change(exact)
    _write_multipliers(exact)
    _write_soft_multipliers(exact)
    for k in range(exact.count):
        if not exact.multiplier[0, k] >= 0.0:
            return False
    if not _carried(exact):
        return False
    for c in range(exact.side.size):
        if exact.form.row_unit[c] > 0.0 and not _met(exact, c, _multiplier_of(exact, c)):
            return False
    return True


@compiled
def _write_soft_multipliers(exact: ExactSearch) -> None:
    """Takes a soft row's multiplier from its slack where the one that the basis gives does not fit it."""
    for k in range(exact.count):
        c, given = exact.acting[k], (exact.multiplier[0, k], exact.multiplier[1, k])
        if exact.give[0, k] > 0.0 and not (given[0] >= 0.0 and _met(exact, c, given)):
            give = (exact.give[0, k], exact.give[1, k])
            slack = _beyond(exact, c, exact.side[c])
            multiplier = divide(divide(slack, give), give)
            # A row that just begins to act.
            if multiplier[0] < 0.0 and -slack[0] <= exact.noise:
                multiplier = (0.0, 0.0)
            exact.multiplier[0, k], exact.multiplier[1, k] = multiplier


@compiled
def _carried(exact: ExactSearch) -> bool:
    """Whether y = -sum lambda g, each coordinate to CARRIED of its terms."""
    for i in range(exact.form.joints):
        total = (exact.point[0, i], exact.point[1, i])
        terms = abs(total[0])
        for k in range(exact.count):
            push = (-exact.multiplier[0, k], -exact.multiplier[1, k])
            total = subtract_product(total, (exact.rows[0, k, i], exact.rows[1, k, i]), push)
            terms += abs(exact.rows[0, k, i] * exact.multiplier[0, k])
        if not abs(total[0]) <= CARRIED * terms + exact.noise:
            return False
    return True


@compiled
def _beyond(exact: ExactSearch, constraint: int, side: int) -> Long:
    """By how much a constraint is beyond one of its bounds."""
    form, value = exact.form, _value(exact, constraint)
    if side > 0:
        return add(value, (-form.high[0, constraint], -form.high[1, constraint]))
    return add((form.low[0, constraint], form.low[1, constraint]), (-value[0], -value[1]))


@compiled
def _multiplier_of(exact: ExactSearch, constraint: int) -> Long:
    """The multiplier of a constraint, zero if it does not act."""
    for k in range(exact.count):
        if exact.acting[k] == constraint:
            return exact.multiplier[0, k], exact.multiplier[1, k]
    return 0.0, 0.0


@compiled
def _met(exact: ExactSearch, c: int, multiplier: Long) -> bool:
    """Whether one constraint meets its conditions."""
    form, side, terms = exact.form, exact.side[c], 0.0
    for i in range(form.joints):
        terms += abs(form.rows[c, i] * exact.change[0, i])
    give = (form.give[0, c], form.give[1, c])
    slack = multiply(multiply(multiplier, give), give)
    value = subtract_product(_value(exact, c), (float(side), 0.0), slack)
    above, below = -np.inf, -np.inf
    if form.high[0, c] < np.inf:
        above = add(value, (-form.high[0, c], -form.high[1, c]))[0]
    if form.low[0, c] > -np.inf:
        below = add((form.low[0, c], form.low[1, c]), (-value[0], -value[1]))[0]
    allowed = max(TOLERANCE * (terms + abs(slack[0])), exact.noise)
    if not (above <= allowed and below <= allowed):
        return False
    return side == 0 or (above >= -allowed if side > 0 else below >= -allowed)
