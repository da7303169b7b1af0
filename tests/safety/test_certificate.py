# SPDX-License-Identifier: BSD-3-Clause
"""What the cycle's own solver certifies is the optimum, however bad the problem's numbers are."""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.safety.active_set import INSIDE, UNDECIDED, make_active_set, solve
from impedance_modules.safety.filter_problem import FilterProblem
from tests.reference import exact_filter
from tests.reference.exact_filter import FLAT, OPTIMUM, TOUCHING
from tests.support import filter_problems as fp
from tests.support.both_ways import ways  # noqa: F401
from tests.support.degenerate_problems import FAMILIES, Spoiler, row_scales, several, small, spoiled
from tests.support.filter_answers import FIELDS, calm, check, in_other_units, scale_of, spoilt

pytestmark = pytest.mark.usefixtures("ways")

EACH = 13


def certified(problem: FilterProblem) -> tuple[np.ndarray, np.ndarray] | None:
    """Torque and multipliers, or nothing."""
    active = make_active_set(problem.desired.size, problem.lower.size)
    status, _ = solve(problem, active)
    return None if status == UNDECIDED else (active.effort, active.duals)


@pytest.mark.parametrize("family", dict.fromkeys(FAMILIES), ids=lambda family: family.__name__)
def test_a_certificate_is_the_optimum(family: Spoiler) -> None:
    for number in range(EACH):
        problem = spoiled(np.random.default_rng([2, number]), family, 4, 0.0)
        claimed, truth = certified(problem), exact_filter.solve(problem)
        assert claimed is None or truth.outcome in (OPTIMUM, FLAT, TOUCHING)
        if claimed is not None and truth.outcome != TOUCHING:
            check(problem, claimed, truth)


def test_many_degenerate_problems_are_certified() -> None:
    random = np.random.default_rng(10)
    found = [certified(spoiled(random, family, 4, 0.0)) for family in FAMILIES[:16] for _ in range(10)]
    assert sum(answer is not None for answer in found) > 0.3 * len(found)


def test_long_rows_with_small_penalties_get_no_wrong_certificate() -> None:
    """Their breach in units of the penalty says nothing."""
    random, counted = np.random.default_rng(11), 0
    for _ in range(150):
        problem = spoiled(random, row_scales if random.random() < 0.5 else several, 4, 0.0)
        claimed = certified(problem)
        if claimed is not None:
            counted += 1
            check(problem, claimed, exact_filter.solve(problem))
    assert counted > 10


def test_rows_of_zeros_neither_act_nor_hinder() -> None:
    """What they ask for cannot be had, and costs the same whatever is done."""
    random, found = np.random.default_rng(12), []
    for _ in range(40):
        problem = small(random, 3)
        before = certified(problem)
        zero = np.arange(problem.lower.size) == random.integers(1, problem.lower.size)
        matrix = np.where(zero[:, None], 0.0, problem.matrix)
        absent = fp.changed(
            problem, matrix=matrix, lower=np.where(zero, -np.inf, problem.lower),
            upper=np.where(zero, np.inf, problem.upper),
        )  # fmt: skip
        asking = fp.changed(
            problem,
            matrix=matrix,
            lower=np.where(zero, 1.0, problem.lower),
            upper=np.where(zero, 2.0, problem.upper),
        )
        one, two = certified(absent), certified(asking)
        assert (one is None) == (two is None)
        if one is not None and two is not None:
            assert np.array_equal(one[0], two[0])
        found.append(before is None or two is not None)
    assert sum(found) > 0.8 * len(found)


def test_the_same_is_certified_in_other_units_of_torque() -> None:
    random, both = np.random.default_rng(5), 0
    for _ in range(60):
        problem = small(random)
        torque = 10.0 ** random.uniform(-6.0, 8.0)
        n, m = problem.desired.size, problem.lower.size
        one, two = certified(problem), certified(in_other_units(problem, torque, np.ones(n), np.ones(m)))
        assert (one is None) == (two is None)
        if one is not None and two is not None:
            both += 1
            assert (np.abs(two[0] / torque - one[0]) <= 1e-11 * scale_of(problem, one[0])).all()
    assert both > 30


@pytest.mark.parametrize("field", FIELDS)
def test_nothing_is_certified_of_what_is_no_number(field: str) -> None:
    assert all(certified(problem) is None for problem in spoilt(field))


def test_a_calm_problem_is_inside() -> None:
    assert solve(calm(), make_active_set(fp.N, fp.LAYOUT.m))[0] == INSIDE


@pytest.mark.parametrize("hard", [True, False])
def test_a_huge_demand_does_not_hide_a_broken_row(hard: bool) -> None:
    """Two joints at their limits of 50 N.m, where a row allows 45 N.m; seen from 1e15 N.m the rest is rounding."""
    problem = fp.changed(fp.blank(), effort_max=np.full(fp.N, 50.0))
    row = 0 if hard else 1
    problem.matrix[row] = 0.0
    problem.matrix[row, 0] = 1.0
    problem.upper[row], problem.penalty[row] = 45.0, np.inf if hard else 1e25
    for demand in (60.0, 1e3, 1e6, 1e10, 1e15):
        problem.desired[:2] = demand
        claimed = certified(problem)
        assert claimed is None or claimed[0][0] == pytest.approx(45.0, rel=1e-9)
        assert claimed is not None or demand > 100.0
