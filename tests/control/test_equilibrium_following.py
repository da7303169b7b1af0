# SPDX-License-Identifier: BSD-3-Clause
"""Equilibria, stiffness and forces that follow set-points: bounded speed, no overshoot, stiffness that stays one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.compiled import use_machine_code
from impedance_modules.control.equilibrium_following import (
    WHOLE_CHANGE,
    place_step,
    prepare_step,
    take_step,
)
from impedance_modules.robot.rotation import exp3, rotation_angle, write_quaternion, write_rotation
from impedance_modules.robot.state import RobotState
from tests.support.led_arms import led_assembly, quaternion, started

SEEDS = st.integers(0, 2**32 - 1)
H, LAG, SPEED, TURN_SPEED = 1e-3, 0.04, 0.3, 0.8


@pytest.fixture(scope="module")
def assembly(tmp_path_factory):
    return led_assembly(tmp_path_factory.mktemp("led"))


def step(controller, part: float = 1.0, *, blended: bool = True) -> None:
    """One cycle of the law without the rest of the controller."""
    following, motion = controller.following, controller._points.motion
    prepare_step(following, blended)
    place_step(following, motion, controller.cycle.modules, part)
    take_step(following, motion, part)


def ask(following, random, *, far: float = 0.1) -> None:
    """Gives every target a goal in its neighbourhood."""
    for k in range(following.fresh.size):
        turned = exp3(random.uniform(-0.4, 0.4, 3)) @ following.rotation[k]
        following.goal[k, :3] = following.translation[k] + random.uniform(-far, far, 3)
        write_quaternion(turned, following.goal[k, 3:])
        following.stiffness[k] = random.uniform(0.0, 1.0, 6) * np.diag(following.stated_stiffness[k])
        following.force[k] = random.uniform(0.0, 1.0, 6) * following.stated_force[k]
        following.fresh[k] = 1


@given(seed=SEEDS)
@settings(max_examples=20)
def test_speed_and_its_change_stay_within_the_limits(assembly, seed):
    random, controller = np.random.default_rng(seed), started(assembly)
    following = controller.following
    before = following.velocity.copy()
    for _ in range(300):
        if random.random() < 0.1:
            ask(following, random)
            following.fresh[:] = random.random(2) < 0.7
        place = following.translation.copy()
        step(controller)
        for half, most in ((slice(0, 3), SPEED), (slice(3, 6), TURN_SPEED)):
            speed = np.linalg.norm(following.velocity[:, half], axis=1)
            change = np.linalg.norm(following.velocity[:, half] - before[:, half], axis=1)
            assert (speed <= most * (1 + 1e-12)).all() and (change <= most * H / LAG * (1 + 1e-9)).all()
        moved = np.linalg.norm(following.translation - place, axis=1)
        assert (moved <= SPEED * H * (1 + 1e-12)).all()
        before = following.velocity.copy()


@given(seed=SEEDS)
@settings(max_examples=20)
def test_a_goal_at_rest_is_reached_and_never_overshot(assembly, seed):
    random, controller = np.random.default_rng(seed), started(assembly)
    following, goal = controller.following, np.empty((3, 3))
    ask(following, random)
    away, angle = [], []
    for _ in range(1200):
        step(controller)
        write_rotation(following.goal[0, 3:], goal)
        away.append(np.linalg.norm(following.goal[0, :3] - following.translation[0]))
        angle.append(float(rotation_angle(goal @ following.rotation[0].T)))
    assert (np.diff(away) <= 1e-12).all() and away[-1] < 1e-5
    assert (np.diff(angle) <= 1e-9).all() and angle[-1] < 1e-5


@given(seed=SEEDS)
@settings(max_examples=20)
def test_without_a_fresh_set_point_it_comes_to_rest_within_the_lag(assembly, seed):
    random, controller = np.random.default_rng(seed), started(assembly)
    following = controller.following
    for _ in range(200):
        if random.random() < 0.05:
            ask(following, random)
        step(controller)
    following.fresh[:] = 0
    for _ in range(round(LAG / H) + 1):
        step(controller)
    assert not following.velocity.any()
    place = following.translation.copy()
    step(controller)
    assert np.array_equal(place, following.translation)


@given(seed=SEEDS)
@settings(max_examples=20)
def test_what_is_not_granted_costs_speed_and_the_rest_stays_within_the_limits(assembly, seed):
    random, controller = np.random.default_rng(seed), started(assembly)
    following = controller.following
    ask(following, random)
    for _ in range(100):
        place = following.translation.copy()
        step(controller, part=float(random.choice([0.0, random.random(), 1.0])))
        moved = (following.translation - place) / H
        np.testing.assert_allclose(moved, following.velocity[:, :3], atol=1e-9)
        assert (np.linalg.norm(moved, axis=1) <= SPEED * (1 + 1e-9)).all()


@given(seed=SEEDS)
@settings(max_examples=20)
def test_a_stiffness_stays_symmetric_and_no_stiffer_than_stated(assembly, seed):
    """0 <= K' and K' <= the stated matrix on every axis; what is asked is in force after a whole change."""
    random, controller = np.random.default_rng(seed), started(assembly)
    following, springs = controller.following, controller.cycle.modules.springs
    ask(following, random)
    for cycle in range(round(WHOLE_CHANGE / H) + 1):
        step(controller)
        if cycle % 50:
            continue
        for s in following.spring:
            K = springs.stiffness[s]
            np.testing.assert_allclose(K, K.T, atol=1e-9)
            assert np.linalg.eigvalsh(K)[0] > -1e-9
    for k, s in enumerate(following.spring):
        turn = np.kron(np.eye(2), following.axes[k])
        local = turn.T @ springs.stiffness[s] @ turn
        np.testing.assert_allclose(np.diag(local), following.stiffness[k], atol=1e-9)
        np.testing.assert_allclose(turn.T @ springs.force[s], following.force[k], atol=1e-9)


def test_gains_wait_until_the_phase_has_blended_in(assembly):
    controller = started(assembly)
    following, before = controller.following, controller.cycle.modules.springs.stiffness.copy()
    ask(following, np.random.default_rng(0))
    step(controller, blended=False)
    assert np.array_equal(before, controller.cycle.modules.springs.stiffness)
    step(controller)
    assert not np.array_equal(before, controller.cycle.modules.springs.stiffness)


def test_an_object_takes_its_grasps_along(tmp_path):
    """Every grasp keeps its pose on the object, however the object's target moves and turns."""
    controller = started(led_assembly(tmp_path, held=True))
    following, springs = controller.following, controller.cycle.modules.springs
    state, tick = controller.assembly.modules.posture, np.zeros(14)

    def grasps() -> np.ndarray:
        turn, place = following.rotation[0], following.translation[0]
        return np.array([turn.T @ (p - place) for p in springs.target_translation])

    first = grasps()
    following.goal[0, :3] = following.translation[0] + [0.05, -0.02, 0.04]
    following.goal[0, 3:] = quaternion(np.array([0.1, 0.2, -0.15]))
    following.fresh[0] = 1
    for k in range(200):
        assert controller.tick(RobotState(H * (k + 1), state, tick, tick)) == 0
    assert np.linalg.norm(following.velocity[0]) > 0.0
    np.testing.assert_allclose(grasps(), first, atol=1e-12)


def test_it_is_the_same_as_python_and_as_machine_code(assembly):
    found = []
    for fast in (False, True):
        use_machine_code(fast)
        random, controller = np.random.default_rng(3), started(assembly)
        for k in range(150):
            if k % 20 == 0:
                ask(controller.following, random)
            step(controller, part=0.7 if k % 7 == 0 else 1.0)
        following, springs = controller.following, controller.cycle.modules.springs
        found.append(
            np.concatenate(
                [following.translation.ravel(), following.rotation.ravel(), springs.stiffness.ravel()]
            )
        )
    np.testing.assert_allclose(*found, rtol=1e-9, atol=1e-12)
