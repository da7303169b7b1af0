# SPDX-License-Identifier: BSD-3-Clause
"""The fast lane against the exact solver: on the hard set, on ordinary problems, and that it claims enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.safety.compiled_lane import CERTIFIED, INSIDE, UNDECIDED, solve
from impedance_modules.safety.metric import relative_penalty
from impedance_modules.safety.problem import FilterProblem
from impedance_modules.safety.solvers import make_solver
from tests.safety.test_solvers_hard_set import KINDS
from tests.support import filter_problems as fp

EXACT = make_solver("daqp")


def lane(problem: FilterProblem, *, dense: bool) -> tuple[int, np.ndarray, np.ndarray]:
    """Status, torque and multipliers; ``dense`` where a test has put other rows into a problem's places."""
    layout = problem.layout
    n, m = layout.n, layout.m
    kappa = np.array([1.0 if kind.hard else relative_penalty(kind) for kind in layout.kinds])
    half = n // 2
    first = np.where(np.arange(n) < half, 0, half)
    coupled = np.array([first, np.where(np.arange(n) < half, half, n)])
    reach = np.tile(np.array([[0], [n]]), (1, m))
    if not dense:
        for where in (layout.position, layout.velocity):
            reach[:, where] = coupled
        reach[:, layout.rate] = np.array([np.arange(n), np.arange(n) + 1])
    effort, duals = np.full(n, np.nan), np.full(n + m, np.nan)
    names = ("desired", "effort_max", "matrix", "lower", "upper", "penalty", "metric")
    # Copies: a frozen snapshot is another type to the compiler.
    status, _ = solve(
        *(getattr(problem, name).copy() for name in names),
        kappa,
        reach,
        coupled,
        effort,
        duals,
    )
    return status, effort, duals


def check(problem: FilterProblem, *, dense: bool) -> int:
    """The lane either agrees with the solver in everything or claims nothing."""
    status, effort, duals = lane(problem, dense=dense)
    if status == UNDECIDED:
        return status
    solution = EXACT.solve(problem)
    assert solution.solved
    n = problem.layout.n
    assert np.abs(effort - solution.effort).max() < 1e-8
    assert (np.abs(effort) <= problem.effort_max).all()
    size = max(1.0, np.abs(solution.row_duals).max(), np.abs(solution.box_duals).max())
    residual = problem.metric @ (effort - problem.desired) + problem.matrix.T @ duals[n:] + duals[:n]
    assert np.abs(residual).max() < 1e-9 * size
    assert (status == INSIDE) == (solution.iterations == 0)
    return status


def test_lane_is_exact_or_silent_on_the_hard_set() -> None:
    random = np.random.default_rng(11)
    found = [check(kind(random), dense=True) for kind in KINDS for _ in range(40)]
    assert found.count(CERTIFIED) > 120


def test_lane_takes_most_problems_with_a_dozen_limits_acting() -> None:
    random = np.random.default_rng(12)
    found = [check(fp.problem(random, 0.8, 0.2), dense=False) for _ in range(200)]
    assert found.count(CERTIFIED) > 140


def free(problem: FilterProblem) -> FilterProblem:
    """All limits far away; the torque asked for is allowed."""
    return replace(
        problem,
        desired=0.1 * problem.effort_max,
        lower=np.full_like(problem.lower, -np.inf),
        upper=np.full_like(problem.upper, np.inf),
    )


def test_allowed_torque_leaves_to_the_last_bit_and_one_limit_costs_one_trial_more() -> None:
    random = np.random.default_rng(16)
    for _ in range(20):
        problem = free(fp.problem(random, 0.8, 0.5))
        status, effort, duals = lane(problem, dense=False)
        assert status == INSIDE
        assert np.array_equal(effort, problem.desired)
        assert not duals.any()
        row = int(random.integers(1, problem.layout.m))
        upper = problem.upper.copy()
        upper[row] = problem.matrix[row] @ problem.desired - 0.3
        assert check(replace(problem, upper=upper), dense=False) == CERTIFIED


def test_same_problem_gives_the_same_bits() -> None:
    random = np.random.default_rng(13)
    problems = [fp.problem(random, 0.8, 0.3) for _ in range(20)]
    first = [lane(problem, dense=False) for problem in problems]
    again = [lane(problem, dense=False) for problem in reversed(problems)][::-1]
    for (_, effort, duals), (_, effort_again, duals_again) in zip(first, again, strict=True):
        assert np.array_equal(effort, effort_again, equal_nan=True)
        assert np.array_equal(duals, duals_again)


@pytest.mark.parametrize("name", ["desired", "matrix", "lower", "upper", "penalty", "metric", "effort_max"])
def test_lane_claims_nothing_about_what_is_no_problem(name: str) -> None:
    problem = fp.problem(np.random.default_rng(14), 0.8, 0.5)
    bad = getattr(problem, name).copy()
    bad.flat[0 if name != "matrix" else problem.layout.position.start * fp.N] = np.nan
    assert lane(replace(problem, **{name: bad}), dense=False)[0] == UNDECIDED


def test_contradicting_bounds_and_indefinite_metrics_are_left_to_the_solver() -> None:
    problem = fp.problem(np.random.default_rng(15), 0.8, 0.5)
    assert lane(replace(problem, lower=problem.upper + 1.0), dense=False)[0] == UNDECIDED
    metric = problem.metric.copy()
    metric[0, 1] = metric[1, 0] = 10.0 * metric[0, 0]
    assert lane(replace(problem, metric=metric), dense=False)[0] == UNDECIDED
