# SPDX-License-Identifier: BSD-3-Clause
r"""Whether a point is the optimum of a filter problem: its conditions, each against the size of its own terms.

    y = -sum lambda g,   lambda >= 0,   every bound met but for a soft row's slack, and with equality where it acts

The end of a search is checked, not assumed: that is why its answer counts as proven.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.safety.double_double import Long, add, divide, multiply, subtract_product
from impedance_modules.safety.solvers.acting_set import ExactSearch, write_change, write_multipliers

TOLERANCE = 1e-20
"""Most that a constraint may be broken in the end, as a part of the terms of its own sum.

Far below a float's rounding: demands of 1e15 N.m must not hide that a limit of 50 N.m is broken."""

CARRIED = 1e-12
"""Most that the multipliers may miss of the change's cost, as a part of the terms of that sum."""


@compiled
def proven(exact: ExactSearch) -> bool:
    """Whether all optimality conditions hold, each to TOLERANCE of its own terms; not where a number is none.

    Together the multipliers must carry the change, none may pull, and every bound must hold but for a soft row's slack,
    and be met where it acts.
    """
    write_change(exact)
    write_multipliers(exact)
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
            slack = beyond(exact, c, exact.side[c])
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


@compiled
def beyond(exact: ExactSearch, constraint: int, side: int) -> Long:
    """By how much a constraint is beyond one of its bounds."""
    form, value = exact.form, _value(exact, constraint)
    if side > 0:
        return add(value, (-form.high[0, constraint], -form.high[1, constraint]))
    return add((form.low[0, constraint], form.low[1, constraint]), (-value[0], -value[1]))


@compiled
def _value(exact: ExactSearch, constraint: int) -> Long:
    """Returns a' . d' of a constraint."""
    total = (0.0, 0.0)
    for i in range(exact.form.joints):
        part = exact.form.rows[constraint, i]
        if part != 0.0:
            total = subtract_product(total, (-part, 0.0), (exact.change[0, i], exact.change[1, i]))
    return total
