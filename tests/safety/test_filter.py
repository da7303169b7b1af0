# SPDX-License-Identifier: BSD-3-Clause
"""The torque filter as a whole: what passes, what yields, what is refused."""

import subprocess
import sys

import numpy as np
import pytest

from impedance_modules.errors import BadInput
from impedance_modules.safety.filter_problem import (
    POWER_ROW,
    RANK,
    RANK_FACTOR,
    FilterLayout,
    FilterProblem,
    RowKind,
    make_problem,
    relative_penalty,
)
from impedance_modules.safety.metric import write_metric
from impedance_modules.safety.solvers import make_solver
from tests.support import filter_problems as fp
from tests.support.arm_samples import baxter, random_position
from tests.support.both_ways import machine_code  # noqa: F401

pytestmark = pytest.mark.usefixtures("machine_code")

SOLVERS = ("daqp", "proxsuite", "qpsolvers:daqp")
SOFT = [kind for kind in RowKind if not kind.hard]


def single(**arrays: np.ndarray) -> FilterProblem:
    """One joint, unit metric, no limit but those given."""
    return fp.changed(make_problem(FilterLayout(("j",), ()), np.full(1, np.inf)), **arrays)


@pytest.mark.parametrize("name", SOLVERS)
def test_torque_inside_all_bounds_passes_to_the_last_bit(name: str) -> None:
    rng = np.random.default_rng(4)
    solver = make_solver(name)
    for _ in range(50):
        problem = fp.problem(rng, 0.9, 1.0)
        value = problem.matrix @ problem.desired
        free = fp.changed(
            problem,
            effort_max=np.maximum(problem.effort_max, np.abs(problem.desired)),
            lower=np.minimum(problem.lower, value - 1e-9),
            upper=np.maximum(problem.upper, value + 1e-9),
        )
        solution = solver.solve(free)
        assert solution.solved
        assert np.array_equal(solution.effort, problem.desired)
        assert not solution.active.any()
        assert not solution.row_duals.any()


@pytest.mark.parametrize("name", SOLVERS)
def test_what_a_library_answers_is_proven_as_it_stands(name: str) -> None:
    """The exact search mends wrong guesses, so a broken call of a library would only be slow."""
    rng, solver = np.random.default_rng(0), make_solver(name)
    for _ in range(40):
        solution = solver.solve(fp.problem(rng, 0.8, 0.2))
        assert solution.solved and solution.status.endswith(", proven")
        assert solver._exact.steps <= 2


@pytest.mark.parametrize("name", SOLVERS)
def test_solution_satisfies_the_optimality_conditions(name: str) -> None:
    rng = np.random.default_rng(5)
    solver = make_solver(name)
    for _ in range(40):
        p = fp.problem(rng, float(rng.choice([0.6, 1.0, 1.5])), float(rng.choice([0.2, 1.0, 5.0])))
        s = solver.solve(p)
        assert s.solved
        size = max(1.0, float(np.abs(s.row_duals).max()))
        gradient = p.metric @ (s.effort - p.desired) + p.matrix.T @ s.row_duals + s.box_duals
        assert np.abs(gradient).max() < 1e-12 * size + 1e-9
        assert (np.abs(s.effort) <= p.effort_max).all()
        value = p.matrix @ s.effort
        beyond = np.maximum(value - p.upper, 0.0) - np.maximum(p.lower - value, 0.0)
        assert value[0] <= p.upper[0] + 1e-9
        soft = fp.LAYOUT.soft
        assert beyond[soft] == pytest.approx((s.row_duals / p.penalty)[soft], abs=1e-8)
        assert s.row_duals[0] >= 0.0
        loose = np.minimum(p.effort_max - np.abs(s.effort), 1.0)
        assert np.abs(loose * s.box_duals).max() < 1e-9 * size


def test_hard_limits_hold_whatever_is_asked() -> None:
    rng = np.random.default_rng(6)
    solver = make_solver("daqp")
    for _ in range(300):
        p = fp.problem(rng, float(rng.choice([0.5, 1.5, 3.0])), 10.0 ** rng.uniform(-1, 5))
        s = solver.solve(p)
        assert s.solved
        assert (np.abs(s.effort) <= p.effort_max).all()
        assert p.matrix[0] @ s.effort <= p.upper[0] + 1e-9 + 1e-14 * np.abs(p.desired).max()


def test_conflicting_rows_of_one_direction_give_way_by_rank() -> None:
    """Two kinds cannot both hold: the lower one gives RANK_FACTOR^(ranks between) times more."""
    layout = FilterLayout(("j",), ("pair",))
    where = {
        RowKind.RATE: layout.rate.start,
        RowKind.MOTOR: layout.motor.start,
        RowKind.VELOCITY: layout.velocity.start,
        RowKind.DISTANCE: layout.distance.start,
        RowKind.POSITION: layout.position.start,
    }
    for high, low in ((a, b) for a in SOFT for b in SOFT if RANK[a] > RANK[b]):
        p = make_problem(layout, np.full(layout.n, np.inf))
        p.matrix[1:] = 1.0
        for kind, row in where.items():
            p.penalty[row] = relative_penalty(kind)
        p.lower[where[high]], p.upper[where[low]] = 10.0, -10.0
        s = make_solver("daqp").solve(p)
        broken_high, broken_low = 10.0 - s.effort[0], s.effort[0] + 10.0
        factor = RANK_FACTOR ** (RANK[high] - RANK[low])
        # The desired torque pulls with 1 / (1 + kappa) beside them.
        assert broken_low / broken_high == pytest.approx(factor, rel=0.05)


def test_torque_rate_yields_to_power_and_power_to_nothing() -> None:
    layout = FilterLayout(("j",), ())
    p = make_problem(layout, np.full(layout.n, np.inf))
    p.matrix[POWER_ROW] = 1.0
    p.upper[POWER_ROW] = 0.0
    p.lower[layout.rate], p.upper[layout.rate] = 30.0, 32.0
    p.penalty[layout.rate] = relative_penalty(RowKind.RATE)
    p.desired[:] = 31.0
    p.effort_max[:] = 50.0
    s = make_solver("daqp").solve(p)
    assert s.effort[0] == pytest.approx(0.0, abs=1e-10)


def test_hands_are_protected_before_the_posture() -> None:
    """Where either can keep a limit, the metric disturbs the hands less than the mobility alone."""
    rng = np.random.default_rng(7)
    solver = make_solver("daqp")
    ratios = []
    for _ in range(40):
        state = fp.state(rng)
        layout = FilterLayout(fp.LAYOUT.joints, ())
        p = make_problem(layout, np.full(layout.n, np.inf))
        p.effort_max[:] = 1e3
        p.matrix[0] = rng.normal(size=fp.N)
        p.desired[:] = rng.normal(size=fp.N)
        p.upper[0] = p.matrix[0] @ p.desired - 1.0
        felt = []
        weighted = fp.blank()
        write_metric(weighted, state)
        for w in (weighted.metric, state.inverse_inertia):
            p.metric[:] = w
            change = state.inverse_inertia @ (solver.solve(p).effort - p.desired)
            felt.append(sum(float(np.linalg.norm(j @ change)) for j in state.jacobian))
        ratios.append(felt[0] / felt[1])
    assert np.median(ratios) < 0.7


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("where", ["desired", "metric", "matrix", "upper", "effort_max", "penalty"])
def test_not_a_number_is_never_solved(name: str, where: str) -> None:
    rng = np.random.default_rng(8)
    solver = make_solver(name)
    p = fp.problem(rng, 0.9, 2.0)
    broken = getattr(p, where).copy()
    broken.flat[-1] = np.nan
    s = solver.solve(fp.changed(p, **{where: broken}))
    assert not s.solved
    assert s.effort is None
    assert solver.solve(p).solved


@pytest.mark.parametrize("name", SOLVERS)
def test_metric_that_is_not_positive_definite_is_never_solved(name: str) -> None:
    p = fp.problem(np.random.default_rng(9), 0.9, 2.0)
    s = make_solver(name).solve(fp.changed(p, metric=-p.metric))
    assert not s.solved
    assert s.effort is None
    assert "positive definite" in s.status


@pytest.mark.parametrize("name", SOLVERS)
def test_one_solver_serves_problems_of_different_shapes(name: str) -> None:
    solver = make_solver(name)
    big = fp.problem(np.random.default_rng(10), 0.9, 2.0)
    small = single(desired=np.array([9.0]), effort_max=np.array([5.0]))
    for _ in range(2):
        assert solver.solve(small).effort == pytest.approx([5.0])
        assert solver.solve(big).solved


def test_same_problem_gives_the_same_bits_whatever_came_before() -> None:
    rng = np.random.default_rng(11)
    problems = [fp.problem(rng, 0.9, 2.0) for _ in range(20)]
    for name in ("daqp", "proxsuite"):
        one, other = make_solver(name), make_solver(name)
        there = [one.solve(p).effort for p in problems]
        back = [other.solve(p).effort for p in reversed(problems)][::-1]
        assert all(np.array_equal(a, b) for a, b in zip(there, back, strict=True))


def test_unknown_solvers_are_refused_with_the_valid_ones() -> None:
    with pytest.raises(
        BadInput, match=r"no solver 'dakp' \(valid: daqp, proxsuite, qpsolvers:<name>\).*'daqp'"
    ):
        make_solver("dakp")
    with pytest.raises(BadInput, match=r"'nope' \(valid: qpsolvers:daqp"):
        make_solver("qpsolvers:nope")


def test_solver_libraries_load_only_when_asked_for() -> None:
    code = (
        "import sys; import impedance_modules.safety.solvers as s, impedance_modules.safety.rows;"
        "libraries = {'daqp', 'proxsuite', 'qpsolvers', 'numba', 'scipy'};"
        "early = libraries & set(sys.modules); s.make_solver('daqp');"
        "late = {'proxsuite', 'qpsolvers'} & set(sys.modules); print(sorted(early | late))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("seed", range(3))
def test_filtered_arm_stays_within_position_and_speed_limits(seed: int) -> None:
    """Baxter's arms, rigid, with a steady load on every joint and drives as fast as its own, pushed for two seconds.

    Each joint keeps its limits for itself; what the others do meanwhile it knows one cycle late.
    """
    rng = np.random.default_rng(seed)
    solver, problem, period = make_solver("daqp"), fp.blank(), 2e-3
    inertia = baxter().mass_matrix(random_position(rng, baxter()))
    state = fp.changed(
        fp.state(rng, moving=False), available=1e6, bias=rng.normal(size=fp.N), distance=np.full(10, 10.0)
    )
    limits = fp.changed(
        fp.limits(rng, period), effort_rate_max=40.0 * fp.EFFORT, deceleration=0.5 * fp.EFFORT / np.diag(inertia),
        horizon=0.05, compliance=np.zeros(fp.N),
    )  # fmt: skip
    state.inverse_inertia[:] = np.linalg.inv(inertia)
    state.q[:], state.previous[:] = rng.uniform(-1, 1, fp.N), 0.0
    touched = 0
    for cycle in range(1000):
        if cycle % 100 == 0:
            push = rng.normal(size=fp.N) * fp.EFFORT
        state.motor_velocity[:], state.link_velocity[:] = state.v, state.v
        solution = solver.solve(fp.build(problem, limits, state, push))
        assert solution.solved
        touched += bool(solution.active.any())
        state.previous[:] = solution.effort
        a = state.inverse_inertia @ (solution.effort - state.bias)
        state.q[:] += state.v * period + 0.5 * a * period**2
        state.v[:] += a * period
        assert (np.abs(state.q) <= 2.0 + 5e-3).all()
        assert (np.abs(state.v) <= 2.0 * 1.08).all()
    assert touched > 100
