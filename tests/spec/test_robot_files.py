# SPDX-License-Identifier: BSD-3-Clause
"""A wrong robot file is refused: everything wrong at once, each at its place, with what would be right."""

import re
import shutil
from pathlib import Path

import pytest

from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.urdf import read_urdf
from tests.support.paths import CHECKOUT, SIX_JOINT_PAIR

YAML, URDF = "robot.yaml", "six_joint_pair.urdf"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(SIX_JOINT_PAIR, tmp_path / "robot"))


def change(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def refused(folder: Path, file: str, old: str, new: str) -> BadFile:
    """The refusal of a robot in which one piece of text is replaced."""
    change(folder / file, old, new)
    with pytest.raises(BadFile) as caught:
        read_robot(folder)
    return caught.value


def line_of(file: Path, text: str) -> int:
    return file.read_text().split(text)[0].count("\n") + 1


# old text, new text, parts of the refusal
YAML_CASES = [
    (
        "turn: port_turn,",
        "turn: port_turm,",
        "limbs.port.joints.turn",
        "'port_turm'; did you mean 'port_turn'",
    ),
    ("turn: port_turn,", "turn: post_fixed,", "'post_fixed' is fixed; a limb's joints are revolute"),
    ("turn: port_turn, lift: port_lift", "lift: port_lift, turn: port_turn", "moved by port_turn, port_lift"),
    ("turn: port_turn, ", "", "locked: the joint 'port_turn' of", "moves but is in no limb"),
    ("turn: starboard_turn", "turn: port_turn", "'port_turn' is listed 2 times", "'starboard_turn'"),
    ("hand: port_palm", "hand: port_pam", "limbs.port.hand", "did you mean 'port_palm'"),
    ("hand: port_palm", "hand: starboard_palm", "is moved by starboard_turn"),
    ("lift: [-1.2, 1.8]", "lift: [-1.2, 2.8]", "position.lift", "wider than the URDF", "-1.2 to 1.8 rad"),
    ("lift: [-1.2, 1.8]", "lift: [0.5, 0.2]", "must be below"),
    ("lift: [-1.2, 1.8]", "lift: [-1.2]", "expected at least 2 values"),
    ("    lift: [-1.2, 1.8]\n", "", "no position is given for 'lift' (port_lift), 'lift' (starboard_lift)"),
    ("velocity: {turn: 2.0", "velocity: {turn: 2.1", "joints.velocity.turn", "at most 2.0 rad/s"),
    ("effort: {turn: 80", "effort: {turn: 81", "joints.effort.turn", "at most 80.0 N.m"),
    ("effort: {turn: 80", "effort: {trun: 80, turn: 80", "no limb has a joint 'trun'", "did you mean 'turn'"),
    ("effort: {turn: 80", "effort: {turn: -80", "joints.effort.turn", "N.m"),
    ("turn: rigid", "turn: stiff", "a stiffness in N.m/rad, or the word 'rigid'"),
    ("turn: rigid", "turn: 0", "joints.spring_stiffness.turn", "N.m/rad"),
    ("roll: -1, tilt", "rol: -1, tilt", "no sign is given for roll", "has no joint 'rol'"),
    ("roll: -1, tilt", "roll: 0, tilt", "mirror.joint_sign.roll", "1, -1"),
    ("rate: 500", "rate: 1500", "timing.rate", "200 to 1000 Hz"),
    ("rate_min: 200", "rate_min: 2000", "timing.rate_min", "above rate_max"),
    ("command_timeout: 0.05", "command_timeout: 0.005", "run out between two commands"),
    ("[port_flange, post]", "[port_flange, mast]", "collision.pairs[4][1]", "no link 'mast'"),
    ("[port_flange, post]", "[port_wrist, post]", "'port_wrist' has no <collision> shape"),
    ("[port_flange, post]", "[port_flange, port_palm]", "no limb's joint moves"),
    ("[port_flange, post]", "[starboard_flange, port_flange]", "listed twice"),
    ("solver: daqp", "solver: dapq", "daqp, proxsuite or qpsolvers:NAME"),
    ("solver: daqp", "solver: daqp\nsolvr: x", "unknown key 'solvr'", "did you mean 'solver'"),
    (
        "solver: daqp",
        "solver: daqp\ninner_torque_loop: {gain: 1}",
        "inner_torque_loop: the joint 'port_turn' has no spring or no rotor",
        "numbers above 0 for every joint",
    ),
    ("solver: daqp", "solver: daqp\ninner_torque_loop: {gain: 0}", "inner_torque_loop.gain"),
    ("solver: daqp", "solver: daqp\ninner_torque_loop: {gain: .inf}", "inner_torque_loop.gain"),
    ("solver: daqp", "solver: daqp\ninner_torque_loop: {delay: 0}", "missing key 'gain'"),
    ("gravity_compensation: robot\n", "", "missing key 'gravity_compensation'"),
    ("gravity_compensation: robot", "gravity_compensation: robt", "did you mean 'robot'", "command"),
    ("collision:\n", "locked: {post_fixed: 0}\ncollision:\n", "no movable joint 'post_fixed'"),
    ("collision:\n", "locked: {port_turn: 0}\ncollision:\n", "is a joint of the limb 'port'"),
    ("collision:\n", "locked: {port_turn: 9}\ncollision:\n", "outside the URDF's limits"),
    (
        "urdf: six_joint_pair.urdf",
        "urdf: six.urdf",
        "urdf: ",
        "no file 'six.urdf' (valid: six_joint_pair.urdf)",
    ),
    ("rate: 500", "rate: .nan", "timing.rate"),
]
URDF_CASES = [
    ('<mass value="3.4"/>', '<mass value="0"/>', "'port_upper_arm'", "'port_lift'", "has no inertia"),
    ('<mass value="3.4"/>', '<mass value="x"/>', "needs a finite number 'value'", "'x'"),
    ('<limit lower="-1.2" upper="1.8" effort="80" velocity="2.0"/>', "", "'port_lift' has no <limit>"),
    ('name="port_lift" type="revolute"', 'name="port_lift" type="continuous"', "is continuous; describe it"),
    ('name="port_lift" type="revolute"', 'name="port_lift" type="hinge"', "the type 'hinge'", "revolute"),
    ('<child link="port_palm"/>', '<child link="port_plam"/>', "is 'port_plam', which is no link"),
    ('<child link="port_palm"/>', '<child link="port_wrist"/>', "'port_wrist' hangs on 2 joints"),
    ("</robot>", "", "not XML"),
    ('<robot name="six_joint_pair">', '<robot name="a"><link name="b"/>', "exactly one root", "'b'"),
    ('<?xml version="1.0"?>', '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "b">]>', "entities"),
]
CASES = [(YAML, *case) for case in YAML_CASES] + [(URDF, *case) for case in URDF_CASES]


@pytest.mark.parametrize("case", CASES, ids=[f"{case[0][:5]}-{case[2][:40]}" for case in CASES])
def test_refused_with_what_would_be_valid(folder: Path, case: tuple[str, ...]) -> None:
    file, old, new, *parts = case
    refusal = refused(folder, file, old, new)
    for part in parts:
        assert part in str(refusal)
    for problem in refusal.problems:
        assert problem.line >= 1
        assert problem.file.is_file()


def test_a_playback_watches_joints_that_are_there(tmp_path: Path) -> None:
    baxter = Path(shutil.copytree(CHECKOUT / "robots" / "baxter", tmp_path / "baxter"))
    assert read_robot(baxter).playback.impact["w0"] == 1.02
    refusal = refused(baxter, YAML, "squish: {s0: 16", "squish: {q0: 16")
    assert "playback.squish.q0: no limb has a joint 'q0'" in str(refusal)


def test_points_at_the_place(folder: Path) -> None:
    refusal = refused(folder, YAML, "lift: [-1.2, 1.8]", "lift: [-1.2, 2.8]")
    assert len(refusal.problems) == 2, "one for each arm"
    for problem in refusal.problems:
        assert (problem.line, problem.column) == (line_of(folder / YAML, "lift: [-1.2, 2.8]"), 11)
    refusal = refused(folder, URDF, '<mass value="3.4"/>', '<mass value="x"/>')
    assert refusal.problems[0].line == line_of(folder / URDF, '<mass value="x"/>')


def test_everything_at_once(folder: Path) -> None:
    change(folder / YAML, "hand: port_palm", "hand: port_pam")
    change(folder / YAML, "rate: 500", "rate: 1500")
    refusal = refused(folder, YAML, "effort: {turn: 80", "effort: {turn: 81")
    paths = {problem.path for problem in refusal.problems}
    assert {"limbs.port.hand", "timing.rate", "joints.effort.turn"} <= paths


def test_override_by_urdf_name(folder: Path) -> None:
    change(folder / YAML, "effort: {turn: 80", "effort: {port_turn: 33, turn: 80")
    joints = read_robot(folder).joints
    assert (joints["port_turn"].effort_max, joints["starboard_turn"].effort_max) == (33.0, 80.0)


def test_unknown_robot_and_missing_urdf(folder: Path) -> None:
    with pytest.raises(BadInput, match="did you mean 'baxter'"):
        read_robot("baxtr")
    (folder / URDF).unlink()
    with pytest.raises(BadInput, match=re.escape(URDF)):
        read_robot(folder)


def test_prismatic_joint_may_be_locked(folder: Path) -> None:
    limit = '<limit lower="0" upper="0.4" effort="900" velocity="0.1"/>'
    rail = f'<joint name="post_rail" type="prismatic">{limit}'
    assert "'post_rail'" in str(refused(folder, URDF, '<joint name="post_fixed" type="fixed">', rail))
    change(folder / YAML, "\nmirror:", "\nlocked: {post_rail: 0.2}\n\nmirror:")
    assert read_robot(folder).locked == {"post_rail": 0.2}


def test_welded_body_may_carry_the_inertia() -> None:
    facts = read_urdf(SIX_JOINT_PAIR / URDF)
    assert facts.welded_to("port_flange") == {"port_flange", "port_palm"}
    assert facts.moving_joints("port_elbow") == ("port_turn", "port_lift", "port_bend")
    assert facts.moving_joints("deck") == ()
