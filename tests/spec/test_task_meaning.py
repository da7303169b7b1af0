# SPDX-License-Identifier: BSD-3-Clause
"""The rules of meaning of a task file as laws: matrices, mirror images, undamped axes."""

import dataclasses
import functools
import json
import pickle

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.errors import BadFile
from impedance_modules.spec.document import parse_document
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.task import AXES, HybridAxis, SpringSpec
from impedance_modules.spec.task_draft import mirrored_posture, mirrored_spring, twist_signs
from impedance_modules.spec.task_reader import check_task, read_task
from tests.support.arm_samples import baxter, six_joint_pair
from tests.support.paths import EVERY_KEY, PRESS_BOX, TESTS

cached_robot = functools.lru_cache(read_robot)


def check(text, at=PRESS_BOX):
    return check_task(parse_document(at, text), cached_robot)


def problems_of(text):
    with pytest.raises(BadFile) as caught:
        check(text)
    return caught.value.problems


DATA = yaml.safe_load(PRESS_BOX.read_text())


def with_spring(**changes):
    data = json.loads(json.dumps(DATA))
    data["arms"]["right"]["springs"][0].update(changes)
    return json.dumps(data)


eigenvalues = st.lists(st.floats(-100, 500).map(lambda v: round(v, 2)), min_size=6, max_size=6)


@settings(max_examples=60, deadline=None)
@given(eigenvalues, st.integers(0, 2**32 - 1), st.sampled_from(["stiffness", "damping"]))
def test_a_matrix_is_accepted_exactly_when_no_eigenvalue_is_negative(values, seed, key):
    basis, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(6, 6)))
    matrix = basis @ np.diag(values) @ basis.T
    matrix = np.round((matrix + matrix.T) / 2, 12)
    text = with_spring(**{key: matrix.tolist()})
    if min(values) < 0:
        assert any("smallest eigenvalue" in p.message and key in p.path for p in problems_of(text))
    else:
        task, _ = check(text)
        spring = task.arms["right"].springs[0]
        np.testing.assert_array_equal(getattr(spring, key), matrix)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["xz", "yz", "xy"]))
def test_a_mirror_image_keeps_energy_and_returns_to_itself(seed, plane):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6))
    force = float(rng.normal())
    spring = SpringSpec("s", "a", "world", root @ root.T, root.T @ root, 0.7, {"rx": HybridAxis(force, 0.1)})
    there = mirrored_spring(spring, {"a": "b", "world": "world"}, plane)
    back = mirrored_spring(there, {"b": "a", "world": "world"}, plane)
    np.testing.assert_array_equal(back.stiffness, spring.stiffness)
    assert back.axes == spring.axes and there.frame == "b"
    normal = next(i for i, axis in enumerate("xyz") if axis not in plane)
    reflection = np.eye(3)
    reflection[normal, normal] = -1.0
    v, w = rng.normal(size=3), rng.normal(size=3)
    arm = rng.normal(size=3)
    np.testing.assert_allclose(twist_signs(plane)[3:] * w, np.linalg.det(reflection) * reflection @ w)
    mirrored_moment = np.cross(reflection @ arm, reflection @ v)
    np.testing.assert_allclose(twist_signs(plane)[3:] * np.cross(arm, v), mirrored_moment, atol=1e-12)
    x = np.concatenate([v, w])
    image = twist_signs(plane) * x
    assert x @ spring.stiffness @ x == pytest.approx(image @ there.stiffness @ image)
    assert spring.axes["rx"].force * x[3] == pytest.approx(there.axes["rx"].force * image[3])


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(AXES), st.sampled_from([0.0, 100.0]), st.booleans(), st.booleans(), st.booleans())
def test_a_force_axis_is_refused_exactly_when_nothing_damps_it(axis, stiffness, ratio, damping, limited):
    data = json.loads(with_spring(stiffness={"x": 1.0, axis: stiffness}, axes={axis: {"force": 3.0}}))
    spring = data["arms"]["right"]["springs"][0]
    if not ratio:
        del spring["damping_ratio"]
    if damping:
        spring["damping"] = {axis: 2.0}
    if limited:
        spring["axes"][axis]["speed_limit"] = 0.2
    if damping or limited or (ratio and stiffness > 0):
        check(json.dumps(data))
    else:
        found = problems_of(json.dumps(data))
        assert [p.path for p in found] == [f"arms.right.springs[0].axes.{axis}"]


SIX_JOINTS = """
format: 1
name: hold-with-six-joints
robot: six_joint_pair
arms:
  port:
    posture: {turn: 0.13236, lift: 0.97313, bend: -1.85784, roll: -1.67345, tilt: 1.65450, spin: 0.68178}
    springs:
      - {name: palm, frame: port_palm, expressed_in: port_palm, damping_ratio: 1.0,
         stiffness: {x: 100, y: 200, z: 50, rx: 5, ry: 5, rz: 5}, axes: {x: {force: 4}, rx: {force: 1}}}
  starboard: {mirror: port}
object: {held_by: [port, starboard], shape: box, mass: 1, size: [0.2, 0.3, 0.2], squeeze: {force: 10}}
safety: {tank: {initial: 5, max: 10, floor: 0.5}}
phases: [{name: lift, duration: 2, equilibrium: {object: {z: 0.9}}}]
"""


def test_a_robot_with_other_names_and_six_joints_is_read_just_the_same():
    task, robot = check(SIX_JOINTS, at=TESTS / "task.yaml")
    assert robot.name == "six_joint_pair"
    port, starboard = task.arms["port"], task.arms["starboard"]
    assert starboard.springs[0].frame == starboard.springs[0].expressed_in == "starboard_palm"
    assert starboard.springs[0].axes == {"x": HybridAxis(4.0, None), "rx": HybridAxis(-1.0, None)}
    assert all(starboard.posture[j] == robot.mirror.joint_sign[j] * port.posture[j] for j in port.posture)


@pytest.mark.parametrize("model", [baxter, six_joint_pair])
def test_the_mirror_image_of_a_hand_has_the_axes_that_the_stiffness_assumes(model):
    """X_image = P X P at the mirrored posture, so D K D holds in the world's and in the hand's axes."""
    model, rng = model(), np.random.default_rng(7)
    mirror = model.spec.mirror
    reflection = np.diag(twist_signs(mirror.plane)[:3])
    one, other = model.limbs.values()
    low, high = model.column("position_min"), model.column("position_max")
    for _ in range(50):
        q = rng.uniform(low, high)
        posture = dict(zip(one.short_names, q[one.joints], strict=True))
        image_of = mirrored_posture(posture, mirror)
        q[other.joints] = [image_of[short] for short in other.short_names]
        pose, image = model.pose(q, one.hand), model.pose(q, other.hand)
        np.testing.assert_allclose(image.translation, reflection @ pose.translation, atol=1e-12)
        np.testing.assert_allclose(image.rotation, reflection @ pose.rotation @ reflection, atol=1e-12)


def test_a_task_can_be_sent_to_another_process():
    task, _ = read_task(EVERY_KEY, cached_robot)
    assert str(pickle.loads(pickle.dumps(task))) == str(task)


def test_a_file_with_many_faults_reports_them_in_order_and_without_repetition():
    text, faults = PRESS_BOX.read_text(), []
    for old, new, *paths in (
        (
            "rx: 10, ry: 10",
            "rx: on, ry: 1e1",
            *(f"arms.right.springs[0].stiffness.{x}" for x in ("rx", "ry")),
        ),
        ("{mirror: right}", "{mirror: rihgt}", "arms.left.mirror"),
        ("mass: 1.2", "mass: 1.2, mas: 2", "object.mas"),
        ("floor: 0.5", "floor: 50", "safety.tank.floor"),
    ):
        text = text.replace(old, new)
        faults += paths
    assert [problem.path for problem in problems_of(text)] == faults


def test_a_trap_behind_an_alias_is_reported_once_where_it_stands():
    text = EVERY_KEY.read_text()
    line = text[: text.index("s0: 0.0974")].count("\n") + 1
    found = problems_of(text.replace("s0: 0.0974", "s0: *nowhere"))
    assert [(p.line, p.path) for p in found] == [(line, "arms.right.posture.s0")]


def test_a_robot_that_takes_no_torques_carries_no_task_out():
    def without_torque(path):
        return dataclasses.replace(cached_robot(path), control_modes=("position", "velocity"))

    with pytest.raises(BadFile) as caught:
        check_task(parse_document(PRESS_BOX, PRESS_BOX.read_text()), without_torque)
    (problem,) = caught.value.problems
    assert "robot 'baxter' takes no torque commands: its control_modes are position, velocity" in str(problem)
    assert PRESS_BOX.read_text().splitlines()[problem.line - 1].startswith("robot:")
