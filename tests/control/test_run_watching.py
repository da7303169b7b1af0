# SPDX-License-Identifier: BSD-3-Clause
"""What watches a run works on blocks and stacks: each agrees with the same thing done one by one."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.contact_detection import REGULARISATION, HandWrenches
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.background import Background
from impedance_modules.episode.columns import joint_columns, pose_columns, target_columns, wrench_columns
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.rotation import exp3, log3, rotation_angle
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.recorder import SCALARS
from impedance_modules.runs.run_summary import BLOCK, Tally
from impedance_modules.runs.scene_view import INERTIA_SCALE, SceneView
from impedance_modules.superposition.operational_inertia import ellipsoid, operational_inertia
from tests.support.arm_samples import Array, random_psd, random_rotation
from tests.support.paths import TESTS


@pytest.fixture(scope="module")
def assembly() -> Assembly:
    task = str(TESTS / "data" / "press-box.yaml")
    return assemble(task, effects=None, rate=None, scale=1.0, arm=None)


def near(random: np.random.Generator, assembly: Assembly) -> Array:
    return assembly.modules.posture + 0.1 * random.normal(size=assembly.model.n)


def test_each_hand_feels_the_wrench_that_loads_its_own_joints(assembly: Assembly) -> None:
    """At rest effort = gravity - J^T w; along a direction of gain s^2 the estimate is w s^2 / (s^2 + r)."""
    random, model = np.random.default_rng(0), assembly.model
    kinematics = Kinematics(model, assembly.modules.frames)
    touch = HandWrenches(model, assembly.modules, kinematics, 0.01)
    for _ in range(20):
        q, still = near(random, assembly), np.zeros(model.n)
        kinematics.update(q, still)
        effort, expected = model.gravity(q), []
        for arm in assembly.modules.arms:
            wrench = random.normal(size=6) * np.array([20.0, 20, 20, 2, 2, 2])
            J = kinematics.jacobian_of(arm.limb.hand)
            effort = effort - J.T @ wrench
            gram = J @ J.T
            expected.append(np.linalg.solve(gram + REGULARISATION * np.eye(6), gram @ wrench))
        touch.reset(RobotState(0.0, q, still, effort))
        np.testing.assert_allclose(touch.wrench, expected, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("count", [0, 1, BLOCK - 1, BLOCK, 3 * BLOCK + 5])
def test_a_tally_is_what_all_rows_come_to(assembly: Assembly, count: int) -> None:
    random, names = np.random.default_rng(count), assembly.model.joint_names
    hands = [arm.limb.hand for arm in assembly.modules.arms]
    felt = [name for hand in hands for name in (*pose_columns(hand), *wrench_columns(hand))]
    # The first hand alone has a target.
    targets = [*target_columns(hands[0]), "phase"]
    columns = ["time", *joint_columns("effort_command", names), *SCALARS, *felt, *targets]
    rows = random.normal(size=(count, len(columns) - 1))
    rows[:, 0] = 0.5 + 0.001 * np.arange(count)
    at = {name: rows[:, index] for index, name in enumerate(columns[:-1])}
    at["late"][:] = random.random(count) < 0.1
    for name in ("granted", "paid"):
        at[name][:] = np.minimum(1.0, 1.0 + 0.2 * random.normal(size=count))
    tally = Tally(assembly, columns)
    for row in rows:
        tally.add(row.copy())
    tally.finish()
    assert (tally.cycles, tally.late) == (count, int(at["late"].sum()))
    assert tally.slowed == int(((at["granted"] < 1.0) | (at["paid"] < 1.0)).sum())
    assert tally.duration == pytest.approx(0.001 * max(0, count - 1))
    assert tally.lowest == min([assembly.tank.initial, *at["tank"]])
    assert tally.softest == min([1.0, *at["spring_scale"]])
    efforts = np.abs([[0.0] * count, *(at[name] for name in joint_columns("effort_command", names))])
    np.testing.assert_array_equal(tally.effort_peak, efforts.max(axis=1, initial=0.0)[1:])
    for hand, found in zip(hands, tally.hands, strict=True):
        force = np.linalg.norm([at[name] for name in wrench_columns(hand)[:3]], axis=0)
        assert found.force_peak == pytest.approx(force.max(initial=0.0))
    both = zip(pose_columns(hands[0])[:3], target_columns(hands[0])[:3], strict=True)
    error = np.linalg.norm([at[here] - at[there] for here, there in both], axis=0)
    assert tally.hands[0].error_peak == pytest.approx(error.max(initial=0.0))
    assert tally.hands[0].error_rms == pytest.approx(np.sqrt(np.mean(error**2)) if count else 0.0)
    assert tally.hands[1].error_peak == tally.hands[1].error_rms == 0.0


def test_angles_and_ellipsoids_of_a_stack_are_those_of_its_members() -> None:
    random = np.random.default_rng(1)
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    turns = [random_rotation(random) for _ in range(20)] + [exp3(a * axis) for a in (0.0, 1e-9, np.pi)]
    expected = [np.linalg.norm(log3(turn)) for turn in turns]
    np.testing.assert_allclose(rotation_angle(np.array(turns)), expected, rtol=1e-9, atol=1e-12)
    blocks = np.array([random_psd(random, np.ones(6))[:3, :3] for _ in range(10)])
    found = ellipsoid(blocks)
    for block, values, directions in zip(blocks, found.half_axes, found.directions, strict=True):
        np.testing.assert_allclose(directions * values @ directions.T, block, atol=1e-12)
        assert np.linalg.det(directions) == pytest.approx(1.0)
        np.testing.assert_array_equal(ellipsoid(block).half_axes, values)


def test_the_picture_of_a_state_shows_where_everything_is(assembly: Assembly, tmp_path: Path) -> None:
    random, model = np.random.default_rng(2), assembly.model
    supervisor, still = Supervisor(assembly), np.zeros(model.n)
    state = RobotState(0.0, near(random, assembly), still, model.gravity(assembly.modules.posture))
    supervisor.start(FirstState(state, still))
    controller, background = supervisor.controller, Background(1.0)
    view = SceneView(tmp_path, supervisor, background, live=False)
    moved = RobotState(0.001, near(random, assembly), still, state.effort)
    assert controller.tick(moved) == 0
    sample = view._sample(moved, controller.effort)
    for body, pose in zip(view.scene.bodies, sample.poses, strict=True):
        if body.role == "robot":
            expected = model.pose(moved.position, body.name)
            np.testing.assert_allclose(pose[:3], expected.translation, atol=1e-12)
            np.testing.assert_allclose(rotation_of(pose[3:]), expected.rotation, atol=1e-12)
    springs = [spring for arm in assembly.modules.arms for spring in arm.springs]
    targets = controller.motion.at(controller.clock).springs
    for spring, (distance, angle) in zip(springs, sample.tracking_error, strict=True):
        pose, target = model.pose(moved.position, spring.frame), targets[spring.name]
        assert distance == pytest.approx(np.linalg.norm(pose.translation - target.translation))
        assert angle == pytest.approx(np.linalg.norm(log3(pose.rotation @ target.rotation.T)))
    for row, arm in enumerate(assembly.modules.arms):
        joints = arm.limb.joints
        mobility = controller.kinematics.inverse_inertia[np.ix_(joints, joints)]
        felt = operational_inertia(controller.kinematics.jacobian[row][:, joints], mobility).inertia
        axes = rotation_of(sample.ellipsoid_poses[2 * row, 3:])
        drawn = axes * sample.half_axes[2 * row] @ axes.T
        np.testing.assert_allclose(drawn, felt[:3, :3], rtol=1e-6, atol=1e-9)
        assert view.scene.ellipsoids[2 * row].scale == INERTIA_SCALE
    background.stop()
    view.close()


def rotation_of(quaternion: Array) -> Array:
    """Rotation matrix of a unit quaternion (x, y, z, w)."""
    return Rotation.from_quat(quaternion).as_matrix()
