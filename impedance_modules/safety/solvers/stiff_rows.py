# SPDX-License-Identifier: BSD-3-Clause
r"""The point that acting rows give where their pushes nearly cancel, in 32 digits.

    minimise |y|^2 + \sum_soft (g_r . y - b_r)^2 / give_r^2   subject to   g_r . y = b_r for hard r

Multipliers would have to be kept to more digits than there are; here they do not occur. Householder reflections of the
stacked rows, stiffest first, columns by size: a hard row is one that is stiffer by 1e18 than any soft one, and no row
loses digits to a stiffer one (Cox and Higham, "Stability of Householder QR factorization for weighted least squares
problems", 1998).
"""

from __future__ import annotations

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, Indices, Matrix, Record
from impedance_modules.safety.double_double import Long, add, divide, multiply, square_root, subtract_product

HARD = 1e18
"""Stiffness of a hard row over the stiffest soft one's."""


class StiffRows(Record):
    """Memory; n coordinates, at most N rows.

    Attributes:
        system: (2, N + n, n + 1) stacked rows, the right side last; then the reflected ones.
        reflection: (2, N + n) the vector of one reflection.
        order: (n + 1,) column that each reflection worked on; the right side last.
        taken: (N,) 1 for rows that stand in ``system``.
    """

    system: Array3
    reflection: Matrix
    order: Indices
    taken: Indices


def make_stiff_rows(n: int, size: int) -> StiffRows:
    """Makes the memory for n coordinates and at most ``size`` rows."""
    return StiffRows(
        system=np.zeros((2, size + n, n + 1)),
        reflection=np.zeros((2, size + n)),
        order=np.zeros(n + 1, dtype=np.int64),
        taken=np.zeros(size, dtype=np.int64),
    )


@compiled
def stiff_point(
    stiff: StiffRows, rows: Array3, bound: Matrix, give: Matrix, count: int, point: Matrix
) -> None:
    """Finds the point.

    Args:
        stiff: Memory.
        rows: (2, N, n) g; the first ``count`` count.
        bound: (2, N) b.
        give: (2, N) of the same rows; 0 for hard ones.
        count: Number of rows.
        point: (2, n) y, overwritten.
    """
    n = point.shape[1]
    _stack(stiff, rows, bound, give, count)
    for j in range(n + 1):
        stiff.order[j] = j
    for j in range(n):
        _choose_column(stiff, j, count + n)
        _reflect(stiff, j, count + n)
    system, order = stiff.system, stiff.order
    for j in range(n - 1, -1, -1):
        total = (system[0, j, n], system[1, j, n])
        for k in range(j + 1, n):
            c = order[k]
            total = subtract_product(total, (system[0, j, c], system[1, j, c]), (point[0, c], point[1, c]))
        c = order[j]
        point[0, c], point[1, c] = divide(total, (system[0, j, c], system[1, j, c]))


@compiled
def _stack(stiff: StiffRows, rows: Array3, bound: Matrix, give: Matrix, count: int) -> None:
    """Writes rows and right side, each times its stiffness, stiffest first; then those of |y|^2."""
    n = rows.shape[2]
    smallest = 1.0
    for k in range(count):
        stiff.taken[k] = 0
        if give[0, k] > 0.0:
            smallest = min(smallest, give[0, k])
    for place in range(count):
        stiffest, least = 0, np.inf
        for k in range(count):
            if stiff.taken[k] == 0 and give[0, k] < least:
                stiffest, least = k, give[0, k]
        stiff.taken[stiffest] = 1
        softness = (give[0, stiffest], give[1, stiffest]) if least > 0.0 else (smallest / HARD, 0.0)
        for i in range(n):
            entry = divide((rows[0, stiffest, i], rows[1, stiffest, i]), softness)
            stiff.system[0, place, i], stiff.system[1, place, i] = entry
        entry = divide((bound[0, stiffest], bound[1, stiffest]), softness)
        stiff.system[0, place, n], stiff.system[1, place, n] = entry
    for i in range(n):
        for j in range(n + 1):
            stiff.system[0, count + i, j] = 1.0 if i == j else 0.0
            stiff.system[1, count + i, j] = 0.0


@compiled
def _choose_column(stiff: StiffRows, j: int, size: int) -> None:
    """Puts the column with the largest rest at place j of the order."""
    best, most = j, -1.0
    for k in range(j, stiff.order.size - 1):
        square = 0.0
        for i in range(j, size):
            square += stiff.system[0, i, stiff.order[k]] ** 2
        if square > most:
            best, most = k, square
    stiff.order[j], stiff.order[best] = stiff.order[best], stiff.order[j]


@compiled
def _reflect(stiff: StiffRows, j: int, size: int) -> None:
    """Reflects the columns from place j on so that the j-th has nothing below its diagonal."""
    system, vector, own = stiff.system, stiff.reflection, stiff.order[j]
    square = (0.0, 0.0)
    for i in range(j, size):
        vector[0, i], vector[1, i] = system[0, i, own], system[1, i, own]
        square = _add_product(square, (vector[0, i], vector[1, i]), (vector[0, i], vector[1, i]))
    length = square_root(square)
    if vector[0, j] > 0.0:
        length = (-length[0], -length[1])
    vector[0, j], vector[1, j] = add((vector[0, j], vector[1, j]), (-length[0], -length[1]))
    # Half the square of the vector.
    half = subtract_product((0.0, 0.0), length, (vector[0, j], vector[1, j]))
    for k in range(j + 1, stiff.order.size):
        c = stiff.order[k]
        share = (0.0, 0.0)
        for i in range(j, size):
            share = _add_product(share, (vector[0, i], vector[1, i]), (system[0, i, c], system[1, i, c]))
        share = divide(share, half)
        for i in range(j, size):
            rest = subtract_product((system[0, i, c], system[1, i, c]), (vector[0, i], vector[1, i]), share)
            system[0, i, c], system[1, i, c] = rest
    system[0, j, own], system[1, j, own] = length


@compiled
def _add_product(total: Long, a: Long, b: Long) -> Long:
    """Returns total + a b."""
    return add(total, multiply(a, b))
