# SPDX-License-Identifier: BSD-3-Clause
r"""Constraints that act, and an orthonormal basis of their rows, in 32 digits: the linear algebra of `exact_search`.

With the rows g and bounds b of those that act, G = R^T Q,

    R^T c = b,   (y, slack) = Q^T c,   R lambda = -c,   d' = L^-T y

A constraint joins as one more row of Q, and takes along, as a column of R, what lies in the others. Where one leaves,
the basis is made anew from there on.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, Indices, Integer, Matrix, Record, Scalar
from impedance_modules.safety.double_double import Long, add, divide, multiply, square_root, subtract_product
from impedance_modules.safety.solvers.exact_form import ExactForm, make_form
from impedance_modules.safety.solvers.stiff_rows import StiffRows, make_stiff_rows, stiff_point

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
def append(exact: ExactSearch, constraint: int, side: int) -> None:
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
def drop_last(exact: ExactSearch) -> None:
    """Takes back what ``append`` did."""
    exact.count -= 1
    exact.side[exact.acting[exact.count]] = 0


@compiled
def project(exact: ExactSearch) -> Long:
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
def extend(exact: ExactSearch, square: Long) -> bool:
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
def leave(exact: ExactSearch, which: int) -> None:
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
        extend(exact, project(exact))
    exact.count = others


@compiled
def write_load(exact: ExactSearch) -> None:
    """Solves R^T c = b."""
    load, triangle = exact.load, exact.triangle
    for k in range(exact.count):
        total = (exact.bound[0, k], exact.bound[1, k])
        for s in range(k):
            total = subtract_product(total, (triangle[0, s, k], triangle[1, s, k]), (load[0, s], load[1, s]))
        load[0, k], load[1, k] = divide(total, (triangle[0, k, k], triangle[1, k, k]))


@compiled
def write_multipliers(exact: ExactSearch) -> None:
    """Solves R lambda = -c."""
    for k in range(exact.count):
        exact.multiplier[0, k], exact.multiplier[1, k] = -exact.load[0, k], -exact.load[1, k]
    divide_triangle(exact.triangle, exact.count, exact.multiplier)


@compiled
def divide_triangle(triangle: Array3, size: int, vector: Matrix) -> None:
    """Replaces the first ``size`` numbers of a vector by R^-1 vector."""
    for k in range(size - 1, -1, -1):
        total = (vector[0, k], vector[1, k])
        for s in range(k + 1, size):
            total = subtract_product(
                total, (triangle[0, k, s], triangle[1, k, s]), (vector[0, s], vector[1, s])
            )
        vector[0, k], vector[1, k] = divide(total, (triangle[0, k, k], triangle[1, k, k]))


@compiled
def write_change(exact: ExactSearch) -> None:
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
    write_load(exact)
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
