# SPDX-License-Identifier: BSD-3-Clause
"""Problems as bad as numbers allow: every solver gives the exact optimum or, where there is none, nothing.

``python -m benchmarks.control.filter_problems`` does the same with many more, and with a second reference.
"""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.safety.active_set import CERTIFIED, INSIDE, UNDECIDED, make_active_set
from impedance_modules.safety.active_set import solve as solve_active_set
from impedance_modules.safety.filter_problem import POWER_ROW, FilterLayout, FilterProblem, make_problem
from impedance_modules.safety.solvers import Solver, make_solver
from tests.reference import exact_filter
from tests.reference.exact_filter import FLAT, OPTIMUM, TOUCHING
from tests.reference.optimality import residual
from tests.support import filter_problems as fp
from tests.support.both_ways import machine_code  # noqa: F401
from tests.support.degenerate_problems import FAMILIES, SPOILERS, Spoiler, several, small, spoiled

pytestmark = pytest.mark.usefixtures("machine_code")

NAMES = ("daqp", "proxsuite", "qpsolvers:daqp")
EACH = 13
"""Problems of a family: 300 in all."""

SHARP = 1e-9
"""Most that an answer is away from the exact one, as a part of the torque that the joint gives or may give."""


@pytest.fixture(scope="module")
def solvers() -> dict[str, Solver]:
    return {name: make_solver(name) for name in NAMES}


def scale_of(problem: FilterProblem, exact: np.ndarray) -> np.ndarray:
    """Of each joint [N.m]."""
    return np.maximum(np.abs(exact), np.minimum(problem.effort_max, np.abs(problem.desired))) + 1e-30


def certified(problem: FilterProblem) -> tuple[np.ndarray, np.ndarray] | None:
    """What the cycle's own solver claims: torque and multipliers, or nothing."""
    active = make_active_set(problem.desired.size, problem.lower.size)
    status, _ = solve_active_set(problem, active)
    return None if status == UNDECIDED else (active.effort, active.duals)


def solved(solver: Solver, problem: FilterProblem) -> tuple[np.ndarray, np.ndarray] | None:
    """What a solver answers: torque and multipliers, or nothing."""
    solution = solver.solve(problem)
    assert solution.solved == (solution.effort is not None)
    if solution.effort is None:
        return None
    return solution.effort, np.concatenate([solution.box_duals, solution.row_duals])


def check(problem: FilterProblem, answer: tuple[np.ndarray, np.ndarray], truth: exact_filter.Exact) -> None:
    """An answer is the optimum; where the metric cannot choose, it meets the optimality conditions."""
    effort, duals = answer
    assert (np.abs(effort) <= problem.effort_max).all()
    assert residual(problem, effort, duals) < 1e-7
    if truth.outcome == OPTIMUM:
        exact = np.asarray(truth.effort, dtype=float)
        assert (np.abs(effort - exact) <= SHARP * scale_of(problem, exact)).all()
    else:
        assert truth.outcome == FLAT


@pytest.mark.parametrize("family", dict.fromkeys(FAMILIES), ids=lambda family: family.__name__)
def test_every_solver_gives_the_optimum_or_nothing(family: Spoiler, solvers: dict[str, Solver]) -> None:
    for number in range(EACH * FAMILIES.count(family)):
        problem = spoiled(np.random.default_rng([2, number]), family, largest=4, share_whole=0.1)
        truth = exact_filter.solve(problem)
        if truth.outcome == TOUCHING:
            continue
        answerable = truth.outcome in (OPTIMUM, FLAT)
        claimed = certified(problem)
        assert claimed is None or answerable, truth.outcome
        if claimed is not None:
            check(problem, claimed, truth)
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


def in_other_units(
    problem: FilterProblem, torque: float, joints: np.ndarray, rows: np.ndarray
) -> FilterProblem:
    """The same problem: all torques ``torque`` times as large, each joint and each row in units of its own."""
    unit = torque * joints
    return fp.changed(
        problem,
        desired=problem.desired * unit,
        effort_max=problem.effort_max * unit,
        metric=problem.metric / joints / joints[:, None],
        matrix=problem.matrix / joints * rows[:, None],
        lower=problem.lower * torque * rows,
        upper=problem.upper * torque * rows,
        penalty=problem.penalty / rows**2,
    )


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


def test_the_cycles_own_solver_certifies_the_same_in_other_units_of_torque() -> None:
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


@pytest.mark.parametrize("name", NAMES)
def test_a_row_said_twice_with_half_the_penalty_is_the_same_row(name: str) -> None:
    """So is a hard row said again as a soft one."""
    random, solver = np.random.default_rng(6), make_solver(name)
    for _ in range(15):
        problem = small(random)
        n, m = problem.desired.size, problem.lower.size
        layout = FilterLayout(
            tuple(f"j{i}" for i in range(n)), tuple(f"p{i}" for i in range(2 * m - 1 - 3 * n))
        )
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


FIELDS = ("metric", "matrix", "desired", "effort_max", "penalty", "kappa", "lower", "upper")


@pytest.mark.parametrize("field", FIELDS)
def test_nothing_is_claimed_of_what_is_no_number(field: str, solvers: dict[str, Solver]) -> None:
    """Wherever it stands, used by the problem or not, and even where nothing else has to be solved."""
    random = np.random.default_rng(8)
    for problem in (small(random, 3), fp.problem(random, 0.8, 0.2), calm()):
        size = getattr(problem, field).size
        for place in random.choice(size, min(size, 12), replace=False):
            spoilt = getattr(problem, field).copy()
            spoilt.flat[place] = np.nan
            bad = fp.changed(problem, **{field: spoilt})
            assert certified(bad) is None
            assert all(solved(solver, bad) is None for solver in solvers.values())


def calm() -> FilterProblem:
    """A problem whose desired torque breaks nothing."""
    problem = fp.blank()
    problem.desired[:], problem.effort_max[:] = 1.0, 10.0
    status, _ = solve_active_set(problem, make_active_set(fp.N, fp.LAYOUT.m))
    assert status == INSIDE
    return problem


def test_a_demand_of_a_hundred_million_is_met_by_the_limits(solvers: dict[str, Solver]) -> None:
    random = np.random.default_rng(9)
    for _ in range(10):
        problem = fp.problem(random, 0.8, 1e8)
        for solver in solvers.values():
            answer = solved(solver, problem)
            check(problem, answer, exact_filter.solve(problem))


def test_many_of_the_degenerate_problems_are_certified_inside_the_cycle() -> None:
    random = np.random.default_rng(10)
    found = [certified(spoiled(random, family, 4, 0.0)) for family in FAMILIES[:16] for _ in range(10)]
    assert sum(answer is not None for answer in found) > 0.3 * len(found)


def test_a_wrong_certificate_of_badly_scaled_rows_is_not_given() -> None:
    """Long rows with small penalties: their breach in units of the penalty says nothing."""
    random, counted = np.random.default_rng(11), 0
    for _ in range(150):
        problem = spoiled(random, SPOILERS[3] if random.random() < 0.5 else several, 4, 0.0)
        claimed = certified(problem)
        if claimed is not None:
            counted += 1
            check(problem, claimed, exact_filter.solve(problem))
    assert counted > 20


def test_status_words_are_those_of_the_cycle() -> None:
    active = make_active_set(1, 4)
    problem = make_problem(FilterLayout(("j",), ()), np.ones(1))
    problem.desired[:] = 2.0
    assert solve_active_set(problem, active)[0] == CERTIFIED
    assert active.effort[0] == 1.0
