# SPDX-License-Identifier: BSD-3-Clause
"""The compiled filter problem is the clear one, number by number, at random states and at special ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.safety import compiled_filter
from impedance_modules.safety.build import FilterState, build
from impedance_modules.safety.limits import FilterLimits, limits_of
from impedance_modules.safety.metric import HEAVIEST_HAND, POSTURE_WEIGHT, relative_penalty
from impedance_modules.safety.problem import FilterLayout, FilterProblem, FilterWorkspace, RowKind
from tests.support import filter_problems as fp
from tests.support.arm_samples import baxter, random_position, six_joint_pair

ARRAYS = ("metric", "matrix", "lower", "upper", "penalty")
SOFT = (RowKind.RATE, RowKind.DISTANCE, RowKind.POSITION, RowKind.VELOCITY)
KAPPA = np.array([relative_penalty(kind) for kind in SOFT])


def joint_limits(limits: FilterLimits) -> np.ndarray:
    return np.array(
        [
            limits.effort_max,
            limits.effort_rate_max,
            limits.position_min,
            limits.position_max,
            limits.velocity_max,
            limits.deceleration,
            limits.return_speed,
        ]
    )


def scalar_limits(limits: FilterLimits) -> np.ndarray:
    return np.array(
        [
            limits.power_horizon,
            limits.horizon,
            limits.period,
            limits.margin,
            limits.approach_time,
            limits.separation_speed,
            limits.separation_acceleration,
        ]
    )


def spans_of(inverse_inertia: np.ndarray) -> np.ndarray:
    """First and one past the last joint that each joint is coupled with."""
    coupled = inverse_inertia != 0.0
    n = len(coupled)
    return np.array([np.argmax(coupled, axis=1), n - np.argmax(coupled[:, ::-1], axis=1)]).astype(np.int64)


def compiled(workspace: FilterWorkspace, limits: FilterLimits, state: FilterState) -> FilterProblem:
    problem = workspace.problem
    jacobian = np.array(state.jacobians)
    mass, inertia = HEAVIEST_HAND
    spans = spans_of(state.inverse_inertia)
    moved_by = spans[:, [int(np.argmax(np.any(row != 0.0, axis=0))) for row in jacobian]]
    compiled_filter.metric(
        state.inverse_inertia, jacobian, moved_by, POSTURE_WEIGHT, 1.0 / mass, 1.0 / inertia, problem.metric
    )
    compiled_filter.fill(
        problem.matrix,
        problem.lower,
        problem.upper,
        problem.penalty,
        joint_limits(limits),
        scalar_limits(limits),
        KAPPA,
        spans,
        state.position,
        state.velocity,
        state.motor_velocity,
        state.inverse_inertia,
        state.bias,
        state.previous,
        state.available,
        state.distances,
        state.distance_jacobians,
    )
    return problem


def agree(workspace: FilterWorkspace, limits: FilterLimits, state: FilterState) -> FilterProblem:
    n = state.position.size
    clear = build(FilterWorkspace(workspace.layout), limits, state, np.zeros(n))
    found = compiled(workspace, limits, state)
    for name in ARRAYS:
        expected, actual = getattr(clear, name), getattr(found, name)
        size = np.max(np.abs(expected[np.isfinite(expected)]), initial=1.0)
        np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-13 * size, err_msg=name)
    return found


def without_drift(state: FilterState) -> FilterState:
    """The loop leaves out how a distance accelerates by itself: 5 m/s^2 at most, at full speed."""
    return replace(state, distance_drift=np.zeros_like(state.distances))


@pytest.mark.parametrize("spread", [0.8, 1.0, 1.6])
def test_random_problems_agree(spread: float) -> None:
    random = np.random.default_rng(int(10 * spread))
    workspace = FilterWorkspace(fp.LAYOUT)
    for _ in range(60):
        agree(workspace, fp.limits(random), without_drift(fp.state(random, spread)))


def test_rows_absent_in_a_cycle_come_back_in_the_next() -> None:
    """At rest there is no power row, with no direction no distance row; nothing of the last cycle stays."""
    random = np.random.default_rng(3)
    workspace = FilterWorkspace(fp.LAYOUT)
    for k in range(40):
        state = without_drift(fp.state(random, 1.0, moving=bool(k % 2)))
        far = random.random(len(fp.LAYOUT.pairs)) < 0.5
        rows = np.where(far[:, None], 0.0, state.distance_jacobians)
        distances = np.where(far & (random.random(far.size) < 0.5), np.inf, state.distances)
        found = agree(
            workspace, fp.limits(random), replace(state, distance_jacobians=rows, distances=distances)
        )
        assert np.all(found.lower[fp.LAYOUT.distance][far] == -np.inf)
        assert (found.upper[0] == np.inf) == (k % 2 == 0)


def test_joints_exactly_at_their_limits_agree() -> None:
    random = np.random.default_rng(4)
    workspace = FilterWorkspace(fp.LAYOUT)
    for _ in range(40):
        limits = fp.limits(random)
        state = without_drift(fp.state(random, 1.0))
        edge = random.choice([-1.0, 1.0], fp.N)
        q = np.where(edge > 0, limits.position_max, limits.position_min)
        v = random.choice([0.0, 1.0, -1.0, 1.5], fp.N) * limits.velocity_max
        agree(workspace, limits, replace(state, position=q, velocity=v, available=0.0))


@pytest.mark.parametrize("model", [baxter, six_joint_pair])
def test_problems_of_both_robots_agree(model) -> None:
    robot: RobotModel = model()
    random = np.random.default_rng(7)
    pairs = 3
    layout = FilterLayout(robot.joint_names, tuple(f"pair{i}" for i in range(pairs)))
    workspace = FilterWorkspace(layout)
    hands = [limb.hand for limb in robot.limbs.values()]
    kinematics = Kinematics(robot, hands)
    limits = limits_of(
        robot.joints, robot.spec.timing, rate=1000.0, deceleration=np.full(robot.n, 20.0), margin=0.03
    )
    for _ in range(40):
        q = random_position(random, robot)
        v = random.uniform(-1.0, 1.0, robot.n) * limits.velocity_max
        kinematics.update(q, v)
        state = FilterState(
            position=q,
            velocity=v,
            motor_velocity=v + 0.1 * random.normal(size=robot.n),
            inverse_inertia=kinematics.inverse_inertia,
            bias=kinematics.bias,
            jacobians=[kinematics.jacobian_of(hand) for hand in hands],
            previous=random.uniform(-1.2, 1.2, robot.n) * limits.effort_max,
            available=float(random.uniform(0.0, 3.0)),
            distances=random.uniform(-0.02, 0.5, pairs),
            distance_jacobians=random.normal(size=(pairs, robot.n)),
            distance_drift=np.zeros(pairs),
        )
        agree(workspace, limits, state)
