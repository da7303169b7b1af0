# SPDX-License-Identifier: BSD-3-Clause
r"""How a linear system evolves: exp(A), where importing a library's would take longer than all its uses.

exp(A) = r(A / 2^s)^(2^s) with the diagonal Padé approximant r = q(-A)^{-1} q(A) of degree 13, whose error is below
rounding while the 1-norm of A / 2^s is at most 5.4 (N. J. Higham, "The scaling and squaring method for the
matrix exponential revisited", SIAM J. Matrix Anal. Appl. 26(4), 2005, table 2.3 and eq. 2.11).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREE = 13
LARGEST_NORM = 5.371920351148152
"""1-norm up to which the approximant of that degree is exact to double precision."""


def matrix_exponential(matrix: Array) -> Array:
    """Computes exp(A) of a finite square matrix (n, n)."""
    norm = float(np.linalg.norm(matrix, 1)) if matrix.size else 0.0
    halvings = max(0, math.ceil(math.log2(norm / LARGEST_NORM))) if norm > 0.0 else 0
    scaled = matrix / 2.0**halvings
    even, odd = _even_and_odd(scaled)
    found = np.linalg.solve(even - odd, even + odd)
    for _ in range(halvings):
        found = found @ found
    return np.asarray(found)


def _even_and_odd(matrix: Array) -> tuple[Array, Array]:
    """Splits q(A) = sum c_j A^j, c_j = (2m - j)! m! / ((2m)! (m - j)! j!), into even and odd powers."""
    square = matrix @ matrix
    even, odd = np.zeros_like(matrix), np.zeros_like(matrix)
    power = np.eye(len(matrix))
    for j in range(0, DEGREE, 2):
        even += _coefficient(j) * power
        odd += _coefficient(j + 1) * power
        power = power @ square
    return even, matrix @ odd


def _coefficient(j: int) -> float:
    m = DEGREE
    return math.comb(m, j) * math.factorial(2 * m - j) / math.factorial(2 * m)
