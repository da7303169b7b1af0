# SPDX-License-Identifier: BSD-3-Clause
"""Robot folders made of descriptions: they read, stand where they were put, weigh what they weighed, and refuse."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner

from impedance_modules.cli.main import impedance
from impedance_modules.control.supervisor import Ending
from impedance_modules.errors import ImpedanceError
from impedance_modules.robot.description import rigid_model
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_reader import read_robot
from tests.support.arm_samples import random_position
from tests.support.paths import CHECKOUT, SIX_JOINT_PAIR, robot_descriptions
from tests.support.run_on_robot import run_on_robot

ONE_ARM = """<robot name="one">
  <link name="post"/>
  <joint name="j_turn_a" type="continuous"><parent link="post"/><child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0 0.2 0"/><axis xyz="0 0 1"/></joint>
  <link name="upper"><inertial><origin xyz="0.1 0.02 0"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j_lift_a" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="1.5" velocity="0" effort="0"/></joint>
  <link name="lower"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="wrist" type="fixed"><parent link="lower"/><child link="palm"/><origin xyz="0.3 0 0"/></joint>
  <link name="palm"/>
  <joint name="finger" type="prismatic"><parent link="palm"/><child link="tip"/><axis xyz="0 1 0"/>
    <limit lower="0.01" upper="0.05" velocity="1" effort="10"/></joint>
  <link name="tip"><inertial><mass value="0.2"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""


def new(folder: Path, name: str, description: Path, *options: str) -> Path:
    """Makes a robot by the command line; returns its folder."""
    arguments = ["robot", "new", name, "--urdf", str(description), "--out", str(folder), *options]
    result = CliRunner().invoke(impedance, arguments, standalone_mode=False, catch_exceptions=True)
    if result.exception is not None:
        raise result.exception
    return folder / name


def described(folder: Path, text: str = ONE_ARM) -> Path:
    path = folder / "one.urdf"
    path.write_text(text)
    return path


def refused(folder: Path, description: Path, *options: str) -> str:
    with pytest.raises(ImpedanceError) as caught:
        new(folder / "robots", "arm", description, *options)
    assert not (folder / "robots" / "arm").exists()
    return str(caught.value)


def test_what_the_description_leaves_open_is_assumed_and_said(tmp_path: Path) -> None:
    spec = read_robot(new(tmp_path, "arm", described(tmp_path)))
    assert dict(spec.limbs["right"].joints) == {"turn": "j_turn_a", "lift": "j_lift_a"}
    assert spec.limbs["right"].hand == "palm" and spec.locked == {"finger": 0.01}
    assumed = {number.key for number in spec.assumed}
    assert {"position", "velocity", "effort", "effort_rate", "reflected_inertia", "timing"} <= assumed
    lines = (spec.folder / "robot.yaml").read_text().splitlines()
    for number in spec.assumed:
        assert number.key in lines[number.line - 1]
    # The lift carries 1 kg at 0.15 m and 0.2 kg at 0.3 m; half as much again is assumed.
    weight = 9.81 * (1.0 * 0.15 + 0.2 * 0.3)
    assert spec.joints["j_lift_a"].effort_max == pytest.approx(1.5 * weight, rel=0.1)


def test_names_that_yaml_would_read_otherwise_are_quoted(tmp_path: Path) -> None:
    odd = (
        ONE_ARM.replace('"palm"', '"on: {palm}"')
        .replace('"finger"', '"1e3"')
        .replace("j_lift_a", "j_#lift_a")
    )
    spec = read_robot(new(tmp_path, "arm", described(tmp_path, odd)))
    assert spec.limbs["right"].hand == "on: {palm}" and "1e3" in spec.locked
    assert "j_#lift_a" in spec.limbs["right"].joints.values()


def test_an_assumed_number_can_be_replaced_by_a_larger_one(tmp_path: Path) -> None:
    folder = new(tmp_path, "arm", described(tmp_path))
    file = folder / "robot.yaml"
    text = file.read_text()
    assert "velocity: {turn: 1, lift: 1}" in text
    file.write_text(text.replace("velocity: {turn: 1, lift: 1}", "velocity: {turn: 3, lift: 4}"))
    assert read_robot(folder).joints["j_lift_a"].velocity_max == 4.0


def test_copies_stand_where_they_were_put_and_weigh_the_same(tmp_path: Path) -> None:
    source = described(tmp_path)
    one = RobotModel(read_robot(new(tmp_path, "arm", source)))
    bases = {"west": (0.1, -0.4, 0.2, 0.3, -0.2, 1.0), "east": (-0.3, 0.5, 0.0, 0.0, 0.0, -0.7)}
    options = [f"--base={limb}={','.join(map(str, base))}" for limb, base in bases.items()]
    pair = RobotModel(read_robot(new(tmp_path, "pair", source, *options)))
    random = np.random.default_rng(0)
    for limb, (x, y, z, *angles) in bases.items():
        X_WB = pin.SE3(pin.rpy.rpyToMatrix(*angles), np.array([x, y, z]))
        for _ in range(5):
            q = random_position(random, one)
            X_BH = one.pose(q, "palm")
            whole = np.zeros(pair.n)
            whole[pair.limbs[limb].joints] = q[one.limbs["right"].joints]
            found = pair.pose(whole, f"{limb}_palm")
            np.testing.assert_allclose(found.translation, X_WB.act(X_BH.translation), atol=1e-12)
            np.testing.assert_allclose(found.rotation, X_WB.rotation @ X_BH.rotation, atol=1e-12)
    total = sum(inertia.mass for inertia in pair.pin_model.inertias)
    assert total == pytest.approx(2 * sum(inertia.mass for inertia in one.pin_model.inertias))


def test_a_mirrored_pair_has_mirrored_hands(tmp_path: Path) -> None:
    """Signs and offsets in the folder take a posture of one arm to its image in the plane between the bases."""
    robot = read_robot(CHECKOUT / "robots" / "fr3-pair")
    model, mirror = RobotModel(robot), robot.mirror
    assert mirror is not None
    P, random = np.diag([1.0, -1.0, 1.0]), np.random.default_rng(1)
    right, left = model.limbs["right"], model.limbs["left"]
    for _ in range(10):
        q = np.zeros(model.n)
        angles = dict(zip(right.short_names, random.uniform(-1.5, 1.5, 7), strict=True))
        for short, i, j in zip(right.short_names, right.joints, left.joints, strict=True):
            q[i] = angles[short]
            q[j] = mirror.joint_sign[short] * angles[short] + mirror.joint_offset.get(short, 0.0)
        one, other = model.pose(q, right.hand), model.pose(q, left.hand)
        np.testing.assert_allclose(other.translation, P @ one.translation, atol=1e-9)
        np.testing.assert_allclose(other.rotation, P @ one.rotation @ P, atol=1e-9)


@pytest.mark.parametrize("name", ["fr3-pair", "panda", "ur5e-pair"])
def test_shipped_robots_have_the_hands_where_their_postures_say(name: str) -> None:
    model = RobotModel(read_robot(CHECKOUT / "robots" / name))
    away = {"palms-down": 0.25, "palms-inward": 0.1}
    for posture, limbs in model.spec.postures.items():
        for limb in limbs:
            hand = model.pose(model.position({limb: limbs[limb]}), model.limbs[limb].hand)
            side = -1.0 if limb == "right" else 1.0
            wanted = [0.6, side * away[posture], 0.1]
            np.testing.assert_allclose(hand.translation, wanted, atol=5e-4)
            pointing = [0.0, 0.0, -1.0] if posture == "palms-down" else [0.0, -side, 0.0]
            np.testing.assert_allclose(hand.rotation[:, 2], pointing, atol=2e-3)


def test_grippers_that_point_at_each_other_stay_clear_of_a_table() -> None:
    """With the wide side upright they would reach 3 cm into a table at the height of the bases."""
    robot = RobotModel(read_robot(CHECKOUT / "robots" / "fr3-pair"))
    for limb in ("right", "left"):
        q = robot.position({limb: robot.spec.postures["palms-inward"][limb]})
        geometry = robot.geometry({f"{limb}_fr3_hand"})
        placed = pin.GeometryData(geometry)
        pin.updateGeometryPlacements(robot.pin_model, robot.pin_model.createData(), geometry, placed, q)
        for shape, X in zip(geometry.geometryObjects, placed.oMg, strict=True):
            half, radius = shape.geometry.halfLength, shape.geometry.radius
            assert X.translation[2] - abs(X.rotation[2, 2]) * half - radius > 0.04


STOCK: Sequence[tuple[str, str, tuple[str, ...], int]] = (
    ("panda", "panda_description/urdf/panda.urdf", ("--shapes=capsules",), 7),
    ("ur5", "ur_description/urdf/ur5_robot.urdf", ("--hand=tool0",), 6),
    ("so100", "so_arm_description/urdf/so100.urdf", ("--hand=gripper",), 5),
    (
        "tiago",
        "tiago_description/robots/tiago_dual.urdf",
        ("--hand=left=arm_left_tool_link", "--hand=right=arm_right_tool_link", "--hold=torso_lift_joint=0.2"),
        14,
    ),
)


@pytest.mark.parametrize(("name", "file", "options", "joints"), STOCK, ids=[row[0] for row in STOCK])
def test_stock_descriptions_become_robots_that_weigh_the_same(
    name: str, file: str, options: tuple[str, ...], joints: int, tmp_path: Path
) -> None:
    source = robot_descriptions() / file
    model = RobotModel(read_robot(new(tmp_path, name, source, *options)))
    assert model.n == joints
    whole = rigid_model(source)
    q, full = np.zeros(model.n), pin.neutral(whole)
    for joint, angle in model.spec.locked.items():
        full[whole.joints[whole.getJointId(joint)].idx_q] = angle
    weight = pin.computeGeneralizedGravity(whole, whole.createData(), full)
    places = [whole.joints[whole.getJointId(joint)].idx_v for joint in model.joint_names]
    np.testing.assert_allclose(model.gravity(q), weight[places], atol=1e-6)


@pytest.mark.parametrize(("name", "file", "options", "joints"), STOCK, ids=[row[0] for row in STOCK])
def test_a_task_runs_on_a_stock_description_at_once(
    name: str, file: str, options: tuple[str, ...], joints: int, tmp_path: Path
) -> None:
    folder = new(tmp_path, name, robot_descriptions() / file, *options)
    assert "palms-down" in read_robot(folder).postures
    assert run_on_robot("stand-by", str(folder), tmp_path / "run", duration=0.2) is Ending.INTERRUPTED


def test_first_postures_point_where_they_say(tmp_path: Path) -> None:
    stock = robot_descriptions() / "panda_description" / "urdf" / "panda.urdf"
    model = RobotModel(read_robot(new(tmp_path, "pair", stock, "--mirror=0.7", "--shapes=none")))
    sides = {"right": -1.0, "left": 1.0}
    for limb, side in sides.items():
        for name, place, pointing in (
            ("palms-down", (0.6, side * 0.25, 0.1), (0.0, 0.0, -1.0)),
            ("palms-inward", (0.6, side * 0.1, 0.1), (0.0, -side, 0.0)),
        ):
            q = model.position({limb: model.spec.postures[name][limb]})
            hand = model.pose(q, model.limbs[limb].hand)
            np.testing.assert_allclose(hand.translation, place, atol=1e-3)
            np.testing.assert_allclose(hand.rotation[:, 2], pointing, atol=1e-3)


def test_a_srdf_gives_pairs_and_postures(tmp_path: Path) -> None:
    stock = robot_descriptions() / "panda_description"
    options = (f"--srdf={stock / 'srdf' / 'panda.srdf'}", "--shapes=capsules")
    spec = read_robot(new(tmp_path, "panda", stock / "urdf" / "panda.urdf", *options))
    pairs = {frozenset(pair) for pair in spec.collision.pairs}
    assert frozenset(("panda_link0", "panda_hand")) in pairs
    assert frozenset(("panda_hand", "panda_link6")) not in pairs
    assert spec.postures["default"]["right"]["joint4"] == pytest.approx(-2.35619)


def test_refusals_say_what_is_wrong_and_what_would_be_valid(tmp_path: Path) -> None:
    source = described(tmp_path)
    assert "no link 'plam'" in refused(tmp_path, source, "--hand=plam")
    assert "no joint 'thumb' to hold" in refused(tmp_path, source, "--hold=thumb=0")
    assert "cannot be held at 1" in refused(tmp_path, source, "--hold=finger=1")
    assert "no joint that turns moves" in refused(tmp_path, source, "--hand=post")
    weightless = described(
        tmp_path,
        ONE_ARM.replace('<mass value="1"/>', '<mass value="0"/>').replace(
            '<mass value="0.2"/>', '<mass value="0"/>'
        ),
    )
    assert "one.urdf:9:1" in refused(tmp_path, weightless)
    new(tmp_path / "twice", "arm", described(tmp_path))
    with pytest.raises(ImpedanceError, match="is there already and is not overwritten"):
        new(tmp_path / "twice", "arm", described(tmp_path))


MODEL = """<mujoco model="two"><compiler angle="radian"/>
<worldbody><body name="stand"><geom type="box" size="0.1 0.1 0.1"/>
<body name="upper" pos="0 0 0.3" gravcomp="1"><joint name="turn" axis="0 0 1" range="-1 2" armature="0.05"/>
<inertial mass="2" pos="0.1 0 0" diaginertia="0.02 0.03 0.03"/>
<body name="palm" pos="0.3 0 0"><joint name="lift" axis="0 1 0" range="-1 1" damping="0.4"/>
<inertial mass="1" pos="0.1 0 0" diaginertia="0.02 0.03 0.03"/></body></body></body></worldbody>
<actuator><motor joint="turn" ctrlrange="-3 3" gear="10"/><motor joint="lift" ctrlrange="-4 4"/></actuator></mujoco>
"""


def test_a_mujoco_model_gives_rotors_damping_and_torques(tmp_path: Path) -> None:
    path = tmp_path / "two.xml"
    path.write_text(MODEL)
    spec = read_robot(new(tmp_path, "two", path))
    assert (spec.joints["turn"].effort_max, spec.joints["lift"].effort_max) == (30.0, 4.0)
    assert spec.joints["turn"].reflected_inertia == 0.05 and spec.joints["lift"].motor_damping == 0.4
    assert "taken twice" in refused(tmp_path, path, "--gravity=command")


BIAS_ONLY = """format: 1
name: hold
robot: two
arms:
  right: {posture: {turn: 0.1, lift: -0.2}, joint_bias: {stiffness_per_effort: 0.1, damping_ratio: 0.7}}
safety: {tank: {initial: 1, max: 2, floor: 0.3}}
phases: [{name: hold, duration: 1}]
"""


def test_a_task_runs_on_a_mujoco_model(tmp_path: Path) -> None:
    (tmp_path / "two.xml").write_text(MODEL)
    folder = new(tmp_path / "robots", "two", tmp_path / "two.xml")
    (tmp_path / "hold.yaml").write_text(BIAS_ONLY)
    ending = run_on_robot(str(tmp_path / "hold.yaml"), str(folder), tmp_path / "run", duration=0.2)
    assert ending is Ending.INTERRUPTED


def test_a_xacro_file_is_expanded(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc")
    opened = '<robot name="one" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    property = '<xacro:property name="reach" value="${0.1 + 0.2}"/>'
    text = ONE_ARM.replace('<robot name="one">', opened + property).replace(
        '<origin xyz="0.3 0 0"/></joint>\n  <link name="palm"/>',
        '<origin xyz="${reach} 0 0"/></joint>\n  <link name="palm"/>',
    )
    assert "${reach}" in text
    path = tmp_path / "one.urdf.xacro"
    path.write_text(text)
    model, plain = (
        RobotModel(read_robot(new(tmp_path, name, file)))
        for name, file in (("xacro", path), ("plain", described(tmp_path)))
    )
    q = np.array([0.3, -0.4])
    np.testing.assert_allclose(
        model.pose(q, "palm").translation, plain.pose(q, "palm").translation, atol=1e-12
    )


def test_a_folder_with_meshes_is_whole(tmp_path: Path) -> None:
    """Meshes are copied: the folder still reads, and its distances are asked for, when the description is gone."""
    stock = tmp_path / "stock"
    shutil.copytree(
        robot_descriptions() / "ur_description", stock / "example-robot-data" / "robots" / "ur_description"
    )
    source = stock / "example-robot-data" / "robots" / "ur_description"
    options = ("--hand=tool0", f"--srdf={source / 'srdf' / 'ur5.srdf'}")
    folder = new(tmp_path, "ur5", source / "urdf" / "ur5_robot.urdf", *options)
    shutil.rmtree(stock)
    spec = read_robot(folder)
    shapes = [str(shape.meshPath) for shape in RobotModel(spec).geometry().geometryObjects]
    assert spec.collision.pairs and sum(path.startswith(str(folder)) for path in shapes) == 7
    # The flange's box touches the last wrist in every posture, which this SRDF does not say.
    assert not {("wrist_2_link", "ee_link")} & set(spec.collision.pairs)


def test_the_pair_of_the_tests_can_be_made_anew(tmp_path: Path) -> None:
    """Its arms are joint by joint mirror images, which is found from the description alone."""
    spec = read_robot(SIX_JOINT_PAIR)
    hands = [f"--hand={name}={limb.hand}" for name, limb in spec.limbs.items()]
    made = read_robot(new(tmp_path, "anew", spec.urdf, *hands))
    assert spec.mirror is not None and made.mirror is not None
    for name, limb in spec.limbs.items():
        assert tuple(made.limbs[name].joints.values()) == tuple(limb.joints.values())
    assert tuple(made.mirror.joint_sign.values()) == tuple(spec.mirror.joint_sign.values())
    assert made.mirror.plane == spec.mirror.plane and not made.mirror.joint_offset
