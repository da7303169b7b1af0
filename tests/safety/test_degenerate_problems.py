# SPDX-License-Identifier: BSD-3-Clause
"""Problems as bad as numbers allow: every solver gives the exact optimum or, where there is none, nothing.

``python -m benchmarks.control.filter_problems`` does the same with many more, and with a second reference.
"""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.safety.filter_problem import POWER_ROW, FilterLayout, FilterProblem, make_problem
from impedance_modules.safety.solvers import Solver, make_solver
from tests.reference import exact_filter
from tests.reference.exact_filter import FLAT, OPTIMUM, TOUCHING
from tests.support import filter_problems as fp
from tests.support.both_ways import machine_code  # noqa: F401
from tests.support.degenerate_problems import FAMILIES, SPOILERS, Spoiler, contradicting_power, small, spoiled
from tests.support.filter_answers import FIELDS, check, in_other_units, scale_of, spoilt

pytestmark = pytest.mark.usefixtures("machine_code")

NAMES = ("daqp", "proxsuite", "qpsolvers:daqp")
EACH = 13
"""Problems of a family: 300 in all."""


@pytest.fixture(scope="module")
def solvers() -> dict[str, Solver]:
    return {name: make_solver(name) for name in NAMES}


def solved(solver: Solver, problem: FilterProblem) -> tuple[np.ndarray, np.ndarray] | None:
    """What a solver answers: torque and multipliers, or nothing."""
    solution = solver.solve(problem)
    assert solution.solved == (solution.effort is not None)
    if solution.effort is None:
        return None
    return solution.effort, np.concatenate([solution.box_duals, solution.row_duals])


@pytest.mark.parametrize("family", dict.fromkeys(FAMILIES), ids=lambda family: family.__name__)
def test_every_solver_gives_the_optimum_or_nothing(family: Spoiler, solvers: dict[str, Solver]) -> None:
    for number in range(EACH * FAMILIES.count(family)):
        problem = spoiled(np.random.default_rng([2, number]), family, largest=4, share_whole=0.1)
        truth = exact_filter.solve(problem)
        if truth.outcome == TOUCHING:
            continue
        answerable = truth.outcome in (OPTIMUM, FLAT)
        for name, solver in solvers.items():
            answer = solved(solver, problem)
            assert (answer is not None) == answerable, (name, number, truth.outcome)
            if answer is not None:
                check(problem, answer, truth)


def test_families_hold_what_they_are_named_for() -> None:
    """All outcomes occur, and most problems have an answer that is not the desired torque."""
    found = []
    for number in range(4 * len(SPOILERS)):
        problem = spoiled(np.random.default_rng([3, number]), SPOILERS[number % len(SPOILERS)], 3, 0.0)
        found.append(exact_filter.solve(problem))
    outcomes = [exact.outcome for exact in found]
    assert set(outcomes) == {"optimum", "contradictory", "flat", "indefinite", "no problem"}
    assert sum(exact.cost > 0.0 for exact in found) > 0.6 * len(found)


@pytest.mark.parametrize("name", NAMES)
def test_units_of_torque_joints_and_rows_change_nothing_but_units(name: str) -> None:
    random, solver = np.random.default_rng(4), make_solver(name)
    for _ in range(20):
        problem = small(random)
        n, m = problem.desired.size, problem.lower.size
        torque = 10.0 ** random.uniform(-6.0, 8.0)
        joints, rows = 10.0 ** random.uniform(-3.0, 4.0, n), 10.0 ** random.uniform(-6.0, 8.0, m)
        other = in_other_units(problem, torque, joints, rows)
        one, two = solved(solver, problem), solved(solver, other)
        back = two[0] / torque / joints
        assert (np.abs(back - one[0]) <= 1e-11 * scale_of(problem, one[0])).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_row_said_twice_with_half_the_penalty_is_the_same_row(name: str) -> None:
    """So is a hard row said again as a soft one."""
    random, solver = np.random.default_rng(6), make_solver(name)
    for _ in range(15):
        problem = small(random)
        n, m = problem.desired.size, problem.lower.size
        joints = tuple(f"j{i}" for i in range(n))
        layout = FilterLayout(joints, tuple(f"p{i}" for i in range(2 * m - FilterLayout(joints, ()).m)))
        twice = make_problem(layout, problem.effort_max)
        twice.desired[:], twice.metric[:] = problem.desired, problem.metric
        for array, of in (
            (twice.matrix, problem.matrix),
            (twice.lower, problem.lower),
            (twice.upper, problem.upper),
        ):
            array[:m], array[m:] = of, of
        twice.penalty[:m], twice.penalty[m:] = problem.penalty / 2.0, problem.penalty / 2.0
        twice.penalty[POWER_ROW], twice.penalty[m + POWER_ROW] = np.inf, 1e3
        one, two = solved(solver, problem)[0], solved(solver, twice)[0]
        assert (np.abs(one - two) <= 1e-11 * scale_of(problem, one)).all()


def test_soft_rows_that_contradict_each_other_share_as_their_penalties_say_however_stiff() -> None:
    """Two rows, x >= 1 and x <= -1, with penalties up to 1e24: x = (w1 - w2) / (1 + w1 + w2)."""
    random, solver = np.random.default_rng(7), make_solver("daqp")
    for _ in range(40):
        problem = make_problem(FilterLayout(("j",), ()), np.full(1, 10.0))
        stiff = 10.0 ** random.uniform(0.0, 24.0)
        one, two = stiff, stiff * 10.0 ** random.uniform(-3.0, 0.0)
        problem.matrix[1:3], problem.penalty[1], problem.penalty[2] = 1.0, one, two
        problem.lower[1], problem.upper[2] = 1.0, -1.0
        problem.reach[0], problem.reach[1] = 0, 1
        share = (one - two) / (1.0 + one + two)
        assert solved(solver, problem)[0][0] == pytest.approx(share, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("field", FIELDS)
def test_nothing_is_claimed_of_what_is_no_number(field: str, solvers: dict[str, Solver]) -> None:
    for problem in spoilt(field):
        assert all(solved(solver, problem) is None for solver in solvers.values())


def test_a_demand_of_a_hundred_million_is_met_by_the_limits(solvers: dict[str, Solver]) -> None:
    random = np.random.default_rng(9)
    for _ in range(10):
        problem = fp.problem(random, 0.8, 1e8)
        for solver in solvers.values():
            answer = solved(solver, problem)
            check(problem, answer, exact_filter.solve(problem))


def test_hard_limits_that_contradict_each_other_are_called_that(solvers: dict[str, Solver]) -> None:
    random = np.random.default_rng(12)
    for _ in range(10):
        problem = spoiled(random, contradicting_power, 4, 0.0)
        for solver in solvers.values():
            assert "contradict" in solver.solve(problem).status
