# SPDX-License-Identifier: BSD-3-Clause
"""The active-set solver against an exact solver: on the hard set, on ordinary problems, and that it claims enough."""

import numpy as np
import pytest

from impedance_modules.safety.active_set import CERTIFIED, INSIDE, UNDECIDED, make_active_set, solve
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers import make_solver
from tests.safety.test_solvers_hard_set import KINDS
from tests.support import filter_problems as fp

pytestmark = pytest.mark.usefixtures("ways")

EXACT = make_solver("daqp")


def answer(problem: FilterProblem) -> tuple[int, np.ndarray, np.ndarray]:
    """Status, torque and multipliers."""
    active = make_active_set(problem.desired.size, problem.lower.size)
    status, _ = solve(problem, active)
    return status, active.effort, active.duals


def dense(problem: FilterProblem) -> FilterProblem:
    """Says that a row may have any column: a test has put other rows into a problem's places."""
    problem.reach[0], problem.reach[1] = 0, problem.desired.size
    return problem


def check(problem: FilterProblem) -> int:
    """The solver either agrees with the solver in everything or claims nothing."""
    status, effort, duals = answer(problem)
    if status == UNDECIDED:
        return status
    solution = EXACT.solve(problem)
    assert solution.solved
    n = problem.desired.size
    assert np.abs(effort - solution.effort).max() < 1e-8
    assert (np.abs(effort) <= problem.effort_max).all()
    size = max(1.0, np.abs(solution.row_duals).max(), np.abs(solution.box_duals).max())
    residual = problem.metric @ (effort - problem.desired) + problem.matrix.T @ duals[n:] + duals[:n]
    assert np.abs(residual).max() < 1e-9 * size
    assert (status == INSIDE) == (solution.iterations == 0)
    return status


def test_it_is_exact_or_silent_on_the_hard_set(ways: str) -> None:
    random, each = np.random.default_rng(11), 40 if ways == "machine code" else 4
    found = [check(dense(kind(random))) for kind in KINDS for _ in range(each)]
    assert found.count(CERTIFIED) > 0.25 * len(found)


def test_it_solves_most_problems_with_a_dozen_limits_acting(ways: str) -> None:
    random = np.random.default_rng(12)
    found = [check(fp.problem(random, 0.8, 0.2)) for _ in range(200 if ways == "machine code" else 20)]
    assert found.count(CERTIFIED) > 0.65 * len(found)


def free(problem: FilterProblem) -> FilterProblem:
    """All limits far away; the torque asked for is allowed."""
    lower, upper = np.full_like(problem.lower, -np.inf), np.full_like(problem.upper, np.inf)
    return fp.changed(problem, desired=0.1 * problem.effort_max, lower=lower, upper=upper)


def test_allowed_torque_leaves_to_the_last_bit_and_one_limit_costs_one_trial_more() -> None:
    random = np.random.default_rng(16)
    for _ in range(20):
        problem = free(fp.problem(random, 0.8, 0.5))
        status, effort, duals = answer(problem)
        assert status == INSIDE
        assert np.array_equal(effort, problem.desired)
        assert not duals.any()
        row = int(random.integers(1, problem.lower.size))
        upper = problem.upper.copy()
        upper[row] = problem.matrix[row] @ problem.desired - 0.3
        assert check(fp.changed(problem, upper=upper)) == CERTIFIED


def test_same_problem_gives_the_same_bits() -> None:
    random = np.random.default_rng(13)
    problems = [fp.problem(random, 0.8, 0.3) for _ in range(20)]
    first = [answer(problem) for problem in problems]
    again = [answer(problem) for problem in reversed(problems)][::-1]
    for (_, effort, duals), (_, effort_again, duals_again) in zip(first, again, strict=True):
        assert np.array_equal(effort, effort_again, equal_nan=True)
        assert np.array_equal(duals, duals_again)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("share", [1.001, 1.3])
def test_a_torque_limit_alone_is_met(side: float, share: float) -> None:
    """Also where the torque asked for is only a few hundredths of a N.m beyond it."""
    random = np.random.default_rng(18)
    for joint in range(fp.N):
        problem = free(fp.problem(random, 0.8, 0.5))
        problem.desired[joint] = side * share * problem.effort_max[joint]
        assert check(problem) == CERTIFIED
        assert answer(problem)[1][joint] == pytest.approx(side * problem.effort_max[joint], rel=1e-12)


def test_nothing_of_the_last_problem_stays_in_the_memory() -> None:
    random = np.random.default_rng(17)
    problems = [fp.problem(random, 0.8, 0.2) for _ in range(8)]
    problems += [free(fp.problem(random, 0.8, 0.5)), fp.changed(problems[0], lower=problems[0].upper + 1.0)]
    used = make_active_set(fp.N, fp.LAYOUT.m)
    for k in random.permutation(np.tile(np.arange(len(problems)), 3)):
        status, effort, duals = answer(problems[k])
        assert solve(problems[k], used)[0] == status
        assert np.array_equal(used.effort, effort)
        assert np.array_equal(used.duals, duals)


@pytest.mark.parametrize("name", ["desired", "matrix", "lower", "upper", "penalty", "metric", "effort_max"])
def test_it_claims_nothing_about_what_is_no_problem(name: str) -> None:
    problem = fp.problem(np.random.default_rng(14), 0.8, 0.5)
    bad = getattr(problem, name).copy()
    bad.flat[0 if name != "matrix" else fp.LAYOUT.position.start * fp.N] = np.nan
    assert answer(fp.changed(problem, **{name: bad}))[0] == UNDECIDED


def test_contradicting_bounds_and_indefinite_metrics_are_left_to_the_solver() -> None:
    problem = fp.problem(np.random.default_rng(15), 0.8, 0.5)
    assert answer(fp.changed(problem, lower=problem.upper + 1.0))[0] == UNDECIDED
    metric = problem.metric.copy()
    metric[0, 1] = metric[1, 0] = 10.0 * metric[0, 0]
    assert answer(fp.changed(problem, metric=metric))[0] == UNDECIDED
