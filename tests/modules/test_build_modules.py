# SPDX-License-Identifier: BSD-3-Clause
"""From a task file to modules at the start posture, and everything the geometry refuses, all at once."""

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.errors import BadFile
from impedance_modules.modules.arms import TaskModules, build_modules
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.modules.held_object import distance_to_surface, moments_of_inertia
from impedance_modules.modules.sum import lay_out
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task_reader import read_task
from tests.support.forecast_tasks import write_task
from tests.support.module_samples import module_sum
from tests.support.paths import TESTS

PRESS_BOX = TESTS / "data" / "press-box.yaml"

GAINS = "expressed_in: world, stiffness: {x: 50, y: 50, z: 50, rx: 1, ry: 1, rz: 1}, damping_ratio: 0.7"
AXES = "axes: {z: {force: -12, speed_limit: 0.1}} # N, m/s"
MORE_SPRINGS = (
    AXES,
    f"{AXES}\n      - {{name: wrist, frame: right_wrist, {GAINS}}}"
    f"\n      - {{name: elbow, frame: right_lower_elbow, {GAINS}}}",
)


def build(tmp_path: Path, *changes: tuple[str, str]) -> TaskModules:
    task, robot = read_task(write_task(tmp_path, PRESS_BOX.read_text(), *changes))
    return build_modules(task, RobotModel(robot))


def test_modules_start_relaxed_between_the_hands(tmp_path: Path) -> None:
    modules = build(tmp_path)
    assert [arm.limb.name for arm in modules.arms] == ["right", "left"]
    assert modules.frames == ("right_hand", "left_hand")
    assert set(modules.held.springs) == {"left.hand", "right.hand"}
    model = RobotModel(read_task(PRESS_BOX)[1])
    right, left = (model.pose(modules.posture, hand).translation for hand in modules.frames)
    np.testing.assert_allclose(modules.held.start.translation, 0.5 * (right + left))
    kinematics = Kinematics(model, modules.frames)
    kinematics.update(modules.posture, np.zeros(model.n))
    still, start = np.zeros(model.n), start_equilibrium(modules)
    damping = phase_damping(modules, kinematics)
    found, energy = module_sum(modules, kinematics, start, modules.posture, still, damping)
    assert energy == pytest.approx(0.0, abs=1e-20)
    np.testing.assert_allclose(found.loads.squeeze[:, :3].sum(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found.loads.squeeze[:, :3], axis=1), 15.0)
    assert found.loads.squeeze_effort.any() and not found.loads.weight_effort.any()
    np.testing.assert_allclose(found.springs.wrench, [[0, 0, -12.0, 0, 0, 0]] * 2, atol=1e-12)


def test_a_carried_weight_is_on_the_hands(tmp_path: Path) -> None:
    modules = build(tmp_path, ("grasp: weld", "grasp: weld, carry_weight: true"))
    loads = lay_out(modules, modules.posture.size).loads
    # With the object's axes along the world's, each hand's part of the lift, up to the object's weight.
    assert loads.lift * loads.weight[:, 2, 2].sum() == pytest.approx(1.2 * 9.81)


def test_every_geometric_problem_is_told_at_once_with_its_place(tmp_path: Path) -> None:
    smaller = ("size: [0.3, 0.2, 0.2]", "size: [0.3, 0.1, 0.2]")
    moved = ("{object: {z: -0.05}}", "{object: {z: -0.05}, right.wrist: {x: 0.8}}")
    with pytest.raises(BadFile) as caught:
        build(tmp_path, smaller, MORE_SPRINGS, moved)
    text = str(caught.value)
    assert len(caught.value.problems) == 3
    assert "'left' is 50 mm away from the object's surface" in text
    assert "'right' is 50 mm away from the object's surface" in text
    assert "phases[0].equilibrium.right.wrist: 'right.wrist' holds the object" in text
    assert all(problem.line > 1 for problem in caught.value.problems)


def test_hands_inside_the_object_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="mm inside the object's surface"):
        build(tmp_path, ("size: [0.3, 0.2, 0.2]", "size: [0.3, 0.4, 0.4]"))


def test_any_spring_on_the_hands_body_holds_the_object(tmp_path: Path) -> None:
    """The wrist link is bolted to the hand: its springs move with the object, an elbow's do not."""
    held = build(tmp_path, MORE_SPRINGS).held
    assert set(held.springs) == {"left.hand", "left.wrist", "right.hand", "right.wrist"}


def test_a_hand_may_be_a_centimetre_off(tmp_path: Path) -> None:
    build(tmp_path, ("size: [0.3, 0.2, 0.2]", "size: [0.3, 0.182, 0.2]"))
    with pytest.raises(BadFile):
        build(tmp_path, ("size: [0.3, 0.2, 0.2]", "size: [0.3, 0.178, 0.2]"))


def test_a_stated_position_moves_the_grasps_not_the_hands(tmp_path: Path) -> None:
    there = build(tmp_path)
    place = (there.held.start.translation + np.array([0.02, 0.0, 0.03])).tolist()
    here = build(tmp_path, ("shape: box", f"shape: box, position: {place}"))
    poses = tuple(here.held.start @ grasp for grasp in here.held.grasps)
    for pose, grasp in zip(poses, there.held.grasps, strict=True):
        np.testing.assert_allclose(pose.translation, (there.held.start @ grasp).translation, atol=1e-12)
    found = here.held.pose_from(poses)
    np.testing.assert_allclose(found.translation, place, atol=1e-12)
    np.testing.assert_allclose(found.rotation, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    "shape, size", [("box", (0.3, 0.2, 0.1)), ("cylinder", (0.2, 0.4)), ("sphere", (0.3,))]
)
def test_shapes_agree_with_points_thrown_into_them(shape: str, size: tuple[float, ...]) -> None:
    """Moments by Monte Carlo over the inside, where the distance is negative; distances along a normal."""
    random = np.random.default_rng(0)
    points = random.uniform(-0.25, 0.25, size=(60000, 3))
    inside = np.array([point for point in points if distance_to_surface(shape, size, point) < 0.0])
    squares = np.mean(inside**2, axis=0)
    moments = moments_of_inertia(shape, 2.0, size)
    np.testing.assert_allclose(moments, 2.0 * (squares.sum() - squares), rtol=0.03)
    top = {"box": 0.05, "cylinder": 0.2, "sphere": 0.15}[shape]
    for height in (top - 0.01, top + 0.02):
        assert distance_to_surface(shape, size, np.array([0.0, 0.0, height])) == pytest.approx(height - top)


def test_the_objects_inertia_turns_with_it(tmp_path: Path) -> None:
    held = build(tmp_path).held
    turn = exp3(np.array([0.3, -0.2, 0.5]))
    at_rest, turned = held.inertia(np.eye(3)), held.inertia(turn)
    np.testing.assert_allclose(turned[3:, 3:], turn @ at_rest[3:, 3:] @ turn.T, atol=1e-12)
    np.testing.assert_array_equal(turned[:3, :3], 1.2 * np.eye(3))
