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
every bound against the size of its own terms (`optimality`).
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Vector
from impedance_modules.safety.double_double import Long, add, divide, subtract_product
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers.acting_set import (
    ExactSearch,
    append,
    divide_triangle,
    drop_last,
    extend,
    leave,
    project,
    write_change,
    write_load,
    write_multipliers,
)
from impedance_modules.safety.solvers.optimality import beyond, proven

PROVEN, CONTRADICTORY, UNPROVEN = range(3)
"""How a search ended: the optimum; hard bounds contradict each other; neither could be shown."""

STEPS = 20
"""Steps before the search gives up, per constraint."""


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
        write_change(exact)
        worst, side, breach = _most_broken(exact)
        if side == 0:
            break
        append(exact, worst, side)
        if not _let_join(exact, breach, most):
            drop_last(exact)
            # Bounds that cannot all be met may still be met to rounding.
            if exact.steps < most and not proven(exact):
                return CONTRADICTORY
            break
    return PROVEN if proven(exact) else UNPROVEN


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
            append(exact, c, side)
            if not extend(exact, project(exact)):
                drop_last(exact)
    while exact.count > 0:
        write_load(exact)
        write_multipliers(exact)
        wrong, least = 0, 0.0
        for k in range(exact.count):
            if exact.multiplier[0, k] < least:
                wrong, least = k, exact.multiplier[0, k]
        if least == 0.0:
            return
        exact.steps += 1
        leave(exact, wrong)


@compiled
def _let_join(exact: ExactSearch, breach: Long, most: int) -> bool:
    """Lets the last constraint push until it is no longer broken; False if it stays so whatever the others do."""
    while exact.steps < most:
        exact.steps += 1
        last = exact.count - 1
        square = project(exact)
        for k in range(last):
            exact.answer[0, k], exact.answer[1, k] = exact.triangle[0, k, last], exact.triangle[1, k, last]
        divide_triangle(exact.triangle, last, exact.answer)
        leaving, step = _first_to_leave(exact)
        if square[0] > 0.0:
            whole = divide(breach, square)
            if leaving == last or whole[0] <= step[0]:
                _push(exact, whole)
                return extend(exact, square)
        if leaving == last:
            return False
        _push(exact, step)
        breach = subtract_product(breach, step, square)
        leave(exact, leaving)
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
def _most_broken(exact: ExactSearch) -> tuple[int, int, Long]:
    """The constraint broken most among those that do not act, its side and by how much; side 0 if none is."""
    form = exact.form
    worst, side, most = 0, 0, (exact.noise, 0.0)
    for c in range(exact.side.size):
        if exact.side[c] == 0 and (form.low[0, c] > -np.inf or form.high[0, c] < np.inf):
            for toward in (1, -1):
                bound = form.high[0, c] if toward > 0 else form.low[0, c]
                if math.isfinite(bound):
                    breach = beyond(exact, c, toward)
                    if breach[0] > most[0]:
                        worst, side, most = c, toward, breach
    return worst, side, most
