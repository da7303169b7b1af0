# SPDX-License-Identifier: BSD-3-Clause
"""The geometry of a hinge: its angle, the object's arc and twist, loads that turn, and targets that follow the arc."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.errors import BadFile, BadInput
from impedance_modules.modules.equilibrium import phase_motion, start_equilibrium
from impedance_modules.modules.hinge import Hinge
from impedance_modules.robot.pose import Pose, carry
from impedance_modules.robot.rotation import exp3, log3
from impedance_modules.spec.hinge_spec import HingeSpec
from impedance_modules.spec.task import PhaseSpec, Sine
from tests.support.forecast_tasks import assembled, write_task
from tests.support.paths import CHECKOUT, TESTS

numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers)
axes = vectors.filter(lambda v: float(np.linalg.norm(v)) > 0.1)
angles = st.floats(-3.0, 3.0)
STEP = 1e-6


@st.composite
def hinges(draw: st.DrawFn) -> Hinge:
    spec = HingeSpec(draw(vectors), draw(axes), angle=draw(angles))
    return Hinge.of_object(spec, Pose(exp3(np.array(draw(vectors))), np.array(draw(vectors))))


@given(hinges(), angles)
@settings(max_examples=50, deadline=None)
def test_the_object_is_at_the_angle_at_which_it_was_put(hinge: Hinge, angle: float) -> None:
    pose = hinge.object_pose(angle)
    assert hinge.angle(pose) == pytest.approx(angle, abs=1e-9)
    jacobian = np.eye(6)
    rows, away = hinge.rows(pose, jacobian)
    np.testing.assert_allclose(away, 0.0, atol=1e-12)
    np.testing.assert_allclose(rows @ hinge.motion(pose.translation), 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(rows) == 5


@given(hinges(), angles, vectors)
@settings(max_examples=50, deadline=None)
def test_the_twist_is_the_derivative_of_the_arc_and_loads_turn_with_it(
    hinge: Hinge, angle: float, force
) -> None:
    """S by differences of the pose; the turning load by differences of a constant force's torque."""
    first, pose, last = (hinge.object_pose(angle + d) for d in (-STEP, 0.0, STEP))
    twist = np.concatenate([last.translation - first.translation, log3(last.rotation @ first.rotation.T)]) / (
        2.0 * STEP
    )
    np.testing.assert_allclose(hinge.motion(pose.translation), twist, atol=1e-8)
    wrench = np.concatenate([force, np.zeros(3)])
    torques = [hinge.torque(wrench, end.translation) for end in (first, last)]
    stiffness = -(torques[1] - torques[0]) / (2.0 * STEP)
    assert hinge.turning_load(np.array(force), pose.translation) == pytest.approx(stiffness, abs=1e-7)


@given(hinges(), angles, vectors, st.floats(0.1, 5.0))
@settings(max_examples=30, deadline=None)
def test_neither_the_axis_length_nor_the_point_along_it_matters(hinge, angle, turn, length) -> None:
    """The same line in space is the same hinge, whoever looks at it."""
    pose = hinge.object_pose(angle)
    start = hinge.object_pose(hinge.spec.angle)
    rotation = exp3(np.array(turn))
    point = rotation @ (hinge.point + length * hinge.axis)
    axis = length * rotation @ hinge.axis
    spec = replace(hinge.spec, point=tuple(point), axis=tuple(axis))
    other = Hinge.of_object(spec, Pose(rotation @ start.rotation, rotation @ start.translation))
    seen = other.object_pose(angle)
    np.testing.assert_allclose(seen.translation, rotation @ pose.translation, atol=1e-9)
    np.testing.assert_allclose(seen.rotation, rotation @ pose.rotation, atol=1e-9)


def a_phase(**equilibrium: object) -> PhaseSpec:
    return PhaseSpec("turn", 2.0, equilibrium, {}, {}, {}, None, "next")


@pytest.mark.parametrize("task", ["turn-lever", "turn-wheel"])
@pytest.mark.parametrize("angle", [0.6, -0.4, Sine(0.3, 0.5, None), Sine(0.2, 1.0, 0.1)])
def test_a_hinge_target_takes_every_grasp_along_the_arc(task: str, angle: float | Sine) -> None:
    """At all times object and springs are where the hinge lets them be; velocities are the derivative."""
    modules = assembled(task).modules
    held, hinge = modules.held, modules.held.hinge
    motion = phase_motion(modules, a_phase(hinge={"angle": angle}), start_equilibrium(modules))
    for clock in np.linspace(0.0, 2.0, 9):
        now = motion.at(clock)
        turned = hinge.angle(now.object)
        on_arc = hinge.object_pose(turned)
        np.testing.assert_allclose(now.object.translation, on_arc.translation, atol=1e-12)
        np.testing.assert_allclose(now.object.rotation, on_arc.rotation, atol=1e-12)
        for limb, grasp in zip(held.limbs, held.grasps, strict=True):
            expected = on_arc @ grasp
            spring = now.springs[f"{limb}.hand"]
            np.testing.assert_allclose(spring.translation, expected.translation, atol=1e-9)
            np.testing.assert_allclose(spring.rotation, expected.rotation, atol=1e-9)
    before, after = motion.at(0.7 - STEP), motion.at(0.7 + STEP)
    for name, twist in motion.velocities(0.7).items():
        moved = (after.springs[name].translation - before.springs[name].translation) / (2.0 * STEP)
        np.testing.assert_allclose(twist[:3], moved, atol=1e-7)
    if isinstance(angle, float):
        assert hinge.angle(motion.at(2.0).object) == pytest.approx(angle, abs=1e-9)


def test_a_target_that_has_left_the_arc_comes_back_to_it() -> None:
    modules = assembled("turn-lever").modules
    away = phase_motion(modules, a_phase(object={"z": 0.2, "rx": 0.1}), start_equilibrium(modules)).at(2.0)
    back = phase_motion(modules, a_phase(hinge={"angle": 0.3}), away).at(2.0)
    expected = modules.held.hinge.object_pose(0.3)
    np.testing.assert_allclose(back.object.translation, expected.translation, atol=1e-9)
    np.testing.assert_allclose(back.object.rotation, expected.rotation, atol=1e-9)


def test_a_hinge_target_needs_a_hinge() -> None:
    modules = assembled("box-hold").modules
    with pytest.raises(BadInput, match="no target 'hinge'"):
        phase_motion(modules, a_phase(hinge={"angle": 0.3}), start_equilibrium(modules))


LEVER = (CHECKOUT / "tasks" / "thesis" / "turn-lever.yaml").read_text()
POINT = "point: [0.65, 0.15, 0.05]"


@pytest.mark.parametrize(
    ("point", "words"),
    [
        ("point: [0.65, -0.1, 0.05]", "runs through the hand of 'right'"),
        ("point: [0.65, -0.1, 0.3]", "runs through the hand of 'right'"),
        ("point: [0.65, 1.5, 0.05]", "farther than the whole arm is long"),
    ],
)
def test_an_axis_in_a_hand_or_out_of_reach_is_refused_with_its_line(
    tmp_path: Path, point: str, words: str
) -> None:
    task = write_task(tmp_path, LEVER, (POINT, point))
    with pytest.raises(BadFile, match=words) as caught:
        assembled(task)
    (problem,) = caught.value.problems
    line = next(i for i, text in enumerate(task.read_text().split("\n"), 1) if "hinge: {point" in text)
    assert problem.line == line and problem.path == "object.hinge.point" and "valid:" in problem.message


def test_reach_is_never_less_than_how_far_the_hand_ever_is() -> None:
    model = assembled("turn-wheel").model
    random = np.random.default_rng(2)
    for limb in model.limbs.values():
        first = model.pin_model.joints[model.pin_model.getJointId(limb.joint_names[0])].id
        low, high = model.column("position_min"), model.column("position_max")
        for _ in range(50):
            q = random.uniform(low, high)
            origin = model.pose(np.zeros(model.n), _frame_of(model, first)).translation
            assert (
                np.linalg.norm(model.pose(q, limb.hand).translation - origin) <= model.reach(limb.name) + 1e-9
            )


def _frame_of(model, joint: int) -> str:
    """A frame fixed to the joint, at its origin."""
    frames = (f for f in model.pin_model.frames if f.parentJoint == joint and f.name in model.frames)
    return min(frames, key=lambda f: float(np.linalg.norm(f.placement.translation))).name


@given(hinges(), angles, vectors, vectors, vectors)
@settings(max_examples=30, deadline=None)
def test_the_torque_is_that_of_the_lever(hinge: Hinge, angle: float, where, force, moment) -> None:
    """Of a wrench at a hand, carried to the object's origin: a . ((p - P) x f + t)."""
    pose, place = hinge.object_pose(angle), np.array(where)
    wrench = np.concatenate([force, moment])
    at_origin = carry(place - pose.translation).T @ wrench
    expected = hinge.axis @ (np.cross(place - hinge.point, force) + np.array(moment))
    assert hinge.torque(at_origin, pose.translation) == pytest.approx(float(expected), abs=1e-9)
    assert hinge.lever(place) == pytest.approx(
        math.sqrt(max(0.0, np.sum((place - hinge.point) ** 2) - (hinge.axis @ (place - hinge.point)) ** 2)),
        abs=1e-6,
    )


def test_the_fixture_of_every_key_begins_at_its_angle() -> None:
    held = assembled(TESTS / "data" / "every-hinge-key.yaml").modules.held
    assert held.hinge.angle(held.start) == pytest.approx(0.2, abs=1e-12)
