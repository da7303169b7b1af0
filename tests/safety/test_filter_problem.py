# SPDX-License-Identifier: BSD-3-Clause
"""From one cycle's numbers to the quadratic program: every row says what it should of the motion a torque causes."""

from typing import Any

import numpy as np
import pytest

from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.safety.filter_problem import (
    LOWEST_PENALTY,
    RANK_FACTOR,
    FilterProblem,
    FilterState,
    RowKind,
    relative_penalty,
)
from impedance_modules.safety.limits import FilterLimits
from impedance_modules.safety.rows import motor_interval, position_interval, velocity_interval
from impedance_modules.safety.solvers import make_solver
from tests.support import filter_problems as fp
from tests.support.arm_samples import baxter

pytestmark = pytest.mark.usefixtures("ways")

WHERE = fp.LAYOUT
WRITTEN = ("desired", "metric", "effort_max", "matrix", "lower", "upper", "penalty")
SOFT = [kind for kind in RowKind if not kind.hard]


def test_layout_names_every_row_once() -> None:
    layout = fp.LAYOUT
    assert len(layout.labels) == len(set(layout.labels)) == len(layout.kinds) == layout.m == 67
    assert layout.labels[0] == "power"
    assert layout.labels[layout.position.start] == "position j0"
    assert layout.labels[layout.distance][3] == "distance pair3"
    for kind, where in (
        (RowKind.RATE, layout.rate),
        (RowKind.MOTOR, layout.motor),
        (RowKind.VELOCITY, layout.velocity),
    ):
        assert set(layout.kinds[where]) == {kind}


def test_build_overwrites_everything_of_the_last_cycle() -> None:
    """At rest there is no power row, without a gradient no distance row; in the next cycle they are back."""
    rng = np.random.default_rng(0)
    used = fp.blank()
    for k in range(20):
        limits, state = fp.limits(rng), fp.state(rng, 1.2, moving=bool(k % 2))
        far = rng.random(len(WHERE.pairs)) < 0.5
        state.gradient[far] = 0.0
        state.distance[far] = np.where(rng.random(far.sum()) < 0.5, np.inf, state.distance[far])
        desired = rng.normal(size=fp.N)
        fp.build(used, limits, state, desired)
        fresh = fp.build(fp.blank(), limits, state, desired)
        for name in WRITTEN:
            assert np.array_equal(getattr(used, name), getattr(fresh, name))
        assert (used.lower <= used.upper).all()
        assert np.all(used.lower[WHERE.distance][far] == -np.inf)
        assert (used.upper[0] == np.inf) == (k % 2 == 0)
        assert not np.isnan(np.concatenate([used.matrix.ravel(), used.lower, used.upper, used.penalty])).any()


def slack(problem: FilterProblem, where: slice, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    value = problem.matrix[where] @ tau
    return value - problem.lower[where], problem.upper[where] - value


def check_joint_rows(problem: FilterProblem, limits: FilterLimits, state: FilterState) -> None:
    """A joint's torque at a row's bound changes the acceleration that the last torques caused to that at the limit."""
    gain = np.maximum(np.diag(state.inverse_inertia), 0.5 * np.abs(state.inverse_inertia).sum(axis=1))
    before = state.inverse_inertia @ (state.previous - state.bias)
    left = [np.maximum(problem.lower[WHERE.rate], -limits.effort_max)]
    left.append(np.minimum(problem.upper[WHERE.rate], limits.effort_max))
    rows = (WHERE.velocity, WHERE.motor, WHERE.position)
    intervals: list[list[Any]] = [[], [], []]
    for i in range(fp.N):
        v, link = float(state.v[i]), float(state.link_velocity[i])
        fast = np.array(velocity_interval(limits, i, v, link, float(state.push[i])))
        far = np.array(position_interval(limits, i, float(state.q[i]), v))
        intervals[0].append(state.previous[i] + (fast - before[i]) / gain[i])
        intervals[1].append(motor_interval(limits, i, link, float(state.swing[i]), float(state.load[i])))
        intervals[2].append(state.previous[i] + (far - before[i]) / gain[i])
    for where, found in zip(rows, intervals, strict=True):
        asked = [np.clip(side, *left) for side in np.array(found).T]
        for bound, side, before in zip((problem.lower, problem.upper), asked, left, strict=True):
            tells = side != before
            assert bound[where][tells] == pytest.approx(side[tells])
            assert not np.isfinite(bound[where][~tells]).any()
        left = asked
    assert (left[0] <= left[1]).all()


@pytest.mark.parametrize("spread", [0.5, 1.0, 1.5])
def test_rows_bound_the_motion_that_the_torque_causes(spread: float) -> None:
    rng = np.random.default_rng(int(10 * spread))
    for _ in range(10):
        state, limits = fp.state(rng, spread), fp.limits(rng)
        problem = fp.build(fp.blank(), limits, state, np.zeros(fp.N))
        tau = rng.normal(size=fp.N) * 10
        check_joint_rows(problem, limits, state)
        vdot = state.inverse_inertia @ (tau - state.bias)
        rate = state.gradient @ state.v
        allowed = np.minimum((limits.margin - state.distance) / limits.approach_time, limits.separation_speed)
        needed = np.minimum(
            (allowed - rate) / limits.pair_horizon - state.drift, limits.separation_acceleration
        )
        apart = state.gradient @ state.push
        needed = np.where((apart > 0.0) & (needed < 0.0), np.maximum(needed - apart, 2.0 * needed), needed)
        below, above = slack(problem, WHERE.distance, tau)
        assert below == pytest.approx(state.gradient @ vdot - needed)
        assert np.all(above == np.inf)
        drawn = state.motor_velocity @ tau * (limits.period + limits.delay)
        speed = np.linalg.norm(state.motor_velocity) * (limits.period + limits.delay)
        below, above = slack(problem, slice(0, 1), tau)
        assert (below, above) == ([np.inf], pytest.approx([(state.available - drawn) / speed]))
        below, above = slack(problem, WHERE.rate, tau)
        step = limits.effort_rate_max * limits.period
        assert below == pytest.approx(tau - state.previous + step)
        assert above == pytest.approx(state.previous + step - tau)


def test_a_torque_beyond_its_limit_is_brought_back_within_reach_of_the_limit() -> None:
    rng = np.random.default_rng(3)
    limits, state = fp.limits(rng), fp.state(rng)
    state.previous[:] = np.where(np.arange(fp.N) % 2, 3.0, -3.0) * limits.effort_max
    problem = fp.build(fp.blank(), limits, state, np.zeros(fp.N))
    step = limits.effort_rate_max * limits.period
    edge = np.sign(state.previous) * limits.effort_max
    assert problem.lower[WHERE.rate] == pytest.approx(edge - step)
    assert problem.upper[WHERE.rate] == pytest.approx(edge + step)


def test_penalties_are_ranked_and_follow_the_mobility_of_the_row() -> None:
    kappa = {kind: relative_penalty(kind) for kind in SOFT}
    values = sorted(set(kappa.values()))
    assert values[0] == kappa[RowKind.POSITION] == LOWEST_PENALTY
    assert np.allclose(np.array(values[1:]) / values[:-1], RANK_FACTOR)
    assert values[1] == kappa[RowKind.DISTANCE]
    assert {values[2]} == {kappa[k] for k in (RowKind.RATE, RowKind.MOTOR, RowKind.VELOCITY)}
    with pytest.raises(ValueError, match="hard"):
        relative_penalty(RowKind.POWER)
    rng = np.random.default_rng(5)
    state = fp.state(rng)
    problem = fp.build(fp.blank(), fp.limits(rng), state, np.zeros(fp.N))
    mobility = np.diag(state.inverse_inertia)
    along = np.einsum("pi,ij,pj->p", state.gradient, state.inverse_inertia, state.gradient)
    assert problem.penalty[WHERE.rate] == pytest.approx(kappa[RowKind.RATE] * mobility)
    assert problem.penalty[WHERE.distance] == pytest.approx(kappa[RowKind.DISTANCE] / along)
    assert problem.penalty[WHERE.position] == pytest.approx(kappa[RowKind.POSITION] * mobility)
    assert problem.penalty[WHERE.velocity] == pytest.approx(kappa[RowKind.VELOCITY] * mobility)
    assert problem.penalty[WHERE.motor] == pytest.approx(kappa[RowKind.MOTOR] * mobility)
    assert problem.penalty[0] == np.inf


def test_pair_without_direction_or_with_infinite_distance_makes_no_row() -> None:
    rng = np.random.default_rng(2)
    state = fp.changed(fp.state(rng), distance=np.full(10, np.inf), gradient=np.zeros((10, fp.N)))
    problem = fp.build(fp.blank(), fp.limits(rng), state, np.ones(fp.N))
    assert (problem.lower[WHERE.distance] == -np.inf).all()
    assert np.isfinite(problem.penalty[WHERE.distance]).all()
    assert make_solver("daqp").solve(problem).solved


def test_rows_are_zero_beyond_their_reach_and_reach_no_farther() -> None:
    rng = np.random.default_rng(6)
    problem = fp.build(fp.blank(), fp.limits(rng), fp.state(rng), np.zeros(fp.N))
    for row, (first, last) in zip(problem.matrix, problem.reach.T, strict=True):
        assert np.flatnonzero(row).tolist() == list(range(first, last))


def test_arms_of_a_real_robot_do_not_feel_each_other() -> None:
    """Where ``make_problem`` expects zeros, the inertia has them."""
    robot = baxter()
    kinematics = Kinematics(robot, [limb.hand for limb in robot.limbs.values()])
    rng = np.random.default_rng(7)
    kinematics.update(rng.uniform(-0.5, 0.5, robot.n), np.zeros(robot.n))
    first, last = kinematics.arms.coupled
    joint = np.arange(robot.n)
    outside = (joint < first[:, None]) | (joint >= last[:, None])
    assert outside.any()
    assert not kinematics.arms.inverse_inertia[outside].any()
