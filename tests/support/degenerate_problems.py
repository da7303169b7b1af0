# SPDX-License-Identifier: BSD-3-Clause
"""Filter problems as bad as numbers allow, in families: each spoils an ordinary problem in one way, or in several.

Every function of ``SPOILERS`` changes a problem in place. What it makes need not have an answer; the reference
(``tests.reference.exact_filter``) says which do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from impedance_modules.safety.filter_problem import POWER_ROW, FilterLayout, FilterProblem, make_problem
from tests.support import filter_problems

Random = np.random.Generator
Spoiler = Callable[[Random, FilterProblem], None]

SMALLEST, LARGEST = -6.0, 8.0
"""Exponents of ten between which metric, rows, bounds and demands are scaled."""


def small(rng: Random, largest: int = 6) -> FilterProblem:
    """A problem of one to ``largest`` joints with the filter's rows, moderate in every number."""
    n, pairs = int(rng.integers(1, largest + 1)), int(rng.integers(0, 4))
    layout = FilterLayout(tuple(f"j{i}" for i in range(n)), tuple(f"pair{i}" for i in range(pairs)))
    effort = rng.uniform(5.0, 50.0, n)
    problem = make_problem(layout, effort)
    problem.reach[0], problem.reach[1] = 0, n
    basis = np.linalg.qr(rng.normal(size=(n, n)))[0]
    mobility = basis @ np.diag(10.0 ** rng.uniform(-0.3, 1.3, n)) @ basis.T
    problem.metric[:] = 0.5 * (mobility + mobility.T)
    problem.desired[:] = rng.normal(size=n) * effort * 10.0 ** rng.uniform(-1.0, 1.0)
    problem.matrix[POWER_ROW] = rng.normal(size=n)
    problem.upper[POWER_ROW] = rng.choice([0.0, 1.0, 10.0, 1e3])
    problem.matrix[layout.distance] = rng.normal(size=(pairs, n)) * 0.3
    problem.matrix[layout.position] = problem.matrix[layout.velocity] = problem.metric
    empty = ~problem.matrix.any(axis=1)
    problem.matrix[empty] = rng.normal(size=(int(empty.sum()), n))
    soft = slice(1, layout.m)
    room = 10.0 ** rng.uniform(-1.0, 2.0, layout.m)[soft]
    middle = problem.matrix[soft] @ (rng.uniform(-1.0, 1.0, n) * effort)
    problem.lower[soft], problem.upper[soft] = middle - room, middle + room
    inverse = np.linalg.inv(problem.metric)
    length = np.einsum("ri,ij,rj->r", problem.matrix, inverse, problem.matrix)
    problem.penalty[soft] = problem.kappa[soft] / length[soft]
    return problem


def whole(rng: Random) -> FilterProblem:
    """A problem of two limbs with seven joints each, as a control cycle builds it."""
    problem = filter_problems.problem(rng, float(rng.choice([0.6, 1.0, 1.5])), 10.0 ** rng.uniform(-1.0, 1.0))
    # Spoilers write anywhere.
    problem.reach[0], problem.reach[1] = 0, problem.desired.size
    problem.coupled[0], problem.coupled[1] = 0, problem.desired.size
    return problem


def nothing(rng: Random, p: FilterProblem) -> None:
    """Leaves the problem as it is."""


def metric_scale(rng: Random, p: FilterProblem) -> None:
    p.metric[:] *= 10.0 ** rng.uniform(SMALLEST, LARGEST)


def joint_scales(rng: Random, p: FilterProblem) -> None:
    scale = 10.0 ** rng.uniform(SMALLEST / 2, LARGEST / 2, p.desired.size)
    p.metric[:] *= scale * scale[:, None]


def row_scales(rng: Random, p: FilterProblem) -> None:
    scale = 10.0 ** rng.uniform(SMALLEST, LARGEST, p.lower.size)
    p.matrix[:] *= scale[:, None]
    p.lower[:] *= scale
    p.upper[:] *= scale


def bound_scales(rng: Random, p: FilterProblem) -> None:
    scale = 10.0 ** rng.uniform(SMALLEST, LARGEST, p.lower.size)
    p.lower[:] *= scale
    p.upper[:] *= scale


def demand_scale(rng: Random, p: FilterProblem) -> None:
    p.desired[:] *= 10.0 ** rng.uniform(SMALLEST, LARGEST)


def demand_scales(rng: Random, p: FilterProblem) -> None:
    p.desired[:] *= 10.0 ** rng.uniform(SMALLEST, LARGEST, p.desired.size)


def torque_limits(rng: Random, p: FilterProblem) -> None:
    some = rng.choice([0.0, 1.0, 1.0, 1.0, 1.0, np.inf], p.desired.size)
    scale = 10.0 ** rng.uniform(SMALLEST, LARGEST, p.desired.size)
    p.effort_max[:] = np.where(some > 0.0, p.effort_max * scale * np.maximum(some, 1.0), 0.0)


def penalties(rng: Random, p: FilterProblem) -> None:
    p.penalty[:] *= 10.0 ** rng.uniform(-8.0, 12.0, p.penalty.size)


def _pairs_of_rows(rng: Random, p: FilterProblem) -> tuple[np.ndarray, np.ndarray]:
    rows = 1 + rng.permutation(p.lower.size - 1)
    half = int(rng.integers(1, rows.size // 2 + 1))
    return rows[:half], rows[half : 2 * half]


def duplicates(rng: Random, p: FilterProblem) -> None:
    to, of = _pairs_of_rows(rng, p)
    for array in (p.matrix, p.lower, p.upper, p.penalty):
        array[to] = array[of]
    if rng.random() < 0.3:
        p.matrix[POWER_ROW] = p.matrix[of[0]]


def near_parallels(rng: Random, p: FilterProblem) -> None:
    to, of = _pairs_of_rows(rng, p)
    size = np.linalg.norm(p.matrix[of], axis=1)[:, None] * 10.0 ** rng.uniform(-16.0, -3.0, (to.size, 1))
    p.matrix[to] = p.matrix[of] + size * rng.normal(size=(to.size, p.desired.size))
    if rng.random() < 0.5:
        p.lower[to], p.upper[to] = p.lower[of], p.upper[of]


def zero_rows(rng: Random, p: FilterProblem) -> None:
    rows = rng.random(p.lower.size) < 0.4
    p.matrix[rows] = 0.0
    shifted = rows & (rng.random(p.lower.size) < 0.5)
    shifted[POWER_ROW] = False
    p.lower[shifted], p.upper[shifted] = 1.0, 2.0


def contradictions(rng: Random, p: FilterProblem) -> None:
    """Soft rows of one direction that ask for opposite things."""
    to, of = _pairs_of_rows(rng, p)
    p.matrix[to] = p.matrix[of]
    apart = 10.0 ** rng.uniform(-3.0, 4.0, to.size)
    value = p.matrix[of] @ p.desired
    p.lower[of], p.upper[of] = value + apart, np.inf
    p.lower[to], p.upper[to] = -np.inf, value - apart


def equal_bounds(rng: Random, p: FilterProblem) -> None:
    rows = np.flatnonzero(rng.random(p.lower.size) < 0.5)
    rows = rows[(rows != POWER_ROW) & np.isfinite(p.upper[rows])]
    p.lower[rows] = p.upper[rows]


def infinite_bounds(rng: Random, p: FilterProblem) -> None:
    p.lower[rng.random(p.lower.size) < 0.6] = -np.inf
    p.upper[rng.random(p.lower.size) < 0.6] = np.inf
    p.effort_max[rng.random(p.desired.size) < 0.6] = np.inf


def touching(rng: Random, p: FilterProblem) -> None:
    """The power row leaves one corner of the torque limits, or a little more."""
    finite = np.where(np.isfinite(p.effort_max), p.effort_max, 0.0)
    p.matrix[POWER_ROW, ~np.isfinite(p.effort_max)] = 0.0
    most = float(np.abs(p.matrix[POWER_ROW]) @ finite)
    p.upper[POWER_ROW] = -most * (1.0 - rng.choice([1e-14, 1e-9, 1e-3]))
    p.lower[POWER_ROW] = -np.inf


def contradicting_power(rng: Random, p: FilterProblem) -> None:
    """The power row asks for more than the torque limits allow."""
    finite = np.where(np.isfinite(p.effort_max), p.effort_max, 0.0)
    p.matrix[POWER_ROW, ~np.isfinite(p.effort_max)] = 0.0
    most = float(np.abs(p.matrix[POWER_ROW]) @ finite)
    p.upper[POWER_ROW] = -(most + 1e-30) * (1.0 + rng.choice([1e-6, 1e-3, 1.0, 1e3]))
    p.lower[POWER_ROW] = -np.inf


def nearly_singular(rng: Random, p: FilterProblem) -> None:
    n = p.desired.size
    basis = np.linalg.qr(rng.normal(size=(n, n)))[0]
    metric = basis @ np.diag(10.0 ** rng.uniform(-15.0, 0.0, n)) @ basis.T
    p.metric[:] = 0.5 * (metric + metric.T)


def rank_deficient(rng: Random, p: FilterProblem) -> None:
    """What some torques do costs nothing, to rounding or exactly."""
    n = p.desired.size
    half = rng.normal(size=(n, int(rng.integers(1, max(2, n)))))
    if rng.random() < 0.5:
        half = np.round(4.0 * half)
    half[0] += 1.0
    metric = half @ half.T
    p.metric[:] = 0.5 * (metric + metric.T)


def indefinite(rng: Random, p: FilterProblem) -> None:
    i = int(rng.integers(p.desired.size))
    p.metric[i, i] = rng.choice([-1.0, -1e-9, 0.0]) * p.metric[i, i]
    if p.metric[i, i] == 0.0:
        j = (i + 1) % p.desired.size
        p.metric[i, j] = p.metric[j, i] = 1.0 if i != j else -1.0


def not_numbers(rng: Random, p: FilterProblem) -> None:
    """NaN or an infinity where none may be."""
    name = str(
        rng.choice(
            ["metric", "metric", "matrix", "desired", "effort_max", "penalty", "kappa", "lower", "upper"]
        )
    )
    array = getattr(p, name)
    bad = {"lower": [np.nan, np.inf], "upper": [np.nan, -np.inf], "effort_max": [np.nan, -np.inf]}
    bad |= {"penalty": [np.nan, -np.inf], "kappa": [np.nan, -np.inf]}
    array.flat[rng.integers(array.size)] = rng.choice(bad.get(name, [np.nan, np.inf, -np.inf]))


SPOILERS: tuple[Spoiler, ...] = (
    nothing, metric_scale, joint_scales, row_scales, bound_scales, demand_scale, demand_scales, torque_limits,
    penalties, duplicates, near_parallels, zero_rows, contradictions, equal_bounds, infinite_bounds, touching,
    contradicting_power, nearly_singular, rank_deficient, indefinite, not_numbers,
)  # fmt: skip
COMBINED: tuple[Spoiler, ...] = SPOILERS[1:18]


def several(rng: Random, p: FilterProblem) -> None:
    """Two to five ways at once."""
    for k in rng.choice(len(COMBINED), int(rng.integers(2, 6)), replace=False):
        COMBINED[k](rng, p)


FAMILIES: tuple[Spoiler, ...] = (*SPOILERS, several, several)
"""``several`` twice: it holds more ways to fail than any other."""


def spoiled(rng: Random, family: Spoiler, largest: int = 6, share_whole: float = 0.25) -> FilterProblem:
    """One problem of a family, of two whole limbs or of a few joints."""
    problem = whole(rng) if rng.random() < share_whole else small(rng, largest)
    with np.errstate(invalid="ignore"):
        family(rng, problem)
    return problem
