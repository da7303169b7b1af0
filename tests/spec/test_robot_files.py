# SPDX-License-Identifier: BSD-3-Clause
"""A wrong robot file is refused: everything wrong at once, each at its place, with what would be right."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec.locate import find_schema
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.urdf import read_urdf
from tests.support.paths import TESTS

SOURCE = TESTS / "robots" / "six_joint_pair"
YAML, URDF = "robot.yaml", "six_joint_pair.urdf"


def broken(tmp_path: Path, file: str, old: str, new: str, count: int = 1) -> BadFile:
    """Reads a copy of the robot in which one piece of text is another; returns the refusal."""
    folder = tmp_path / "robot"
    if not folder.exists():
        shutil.copytree(SOURCE, folder)
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, count))
    with pytest.raises(BadFile) as caught:
        read_robot(folder)
    return caught.value


def line_of(file: Path, text: str) -> int:
    return file.read_text().split(text)[0].count("\n") + 1


CASES = [
    # file, old, new, fragments of the message
    (
        YAML,
        "turn: port_turn,",
        "turn: port_turm,",
        ("limbs.port.joints.turn", "port_turm", "did you mean 'port_turn'"),
    ),
    (YAML, "turn: port_turn,", "turn: post_fixed,", ("'post_fixed' is fixed; a limb's joints are revolute",)),
    (
        YAML,
        "turn: port_turn, lift: port_lift,",
        "lift: port_lift, turn: port_turn,",
        ("moved by port_turn, port_lift",),
    ),
    (YAML, "turn: port_turn, ", "", ("locked: the joint 'port_turn' of", "moves but is in no limb")),
    (YAML, "turn: starboard_turn", "turn: port_turn", ("'port_turn' is listed 2 times", "'starboard_turn'")),
    (YAML, "hand: port_palm", "hand: port_pam", ("limbs.port.hand", "did you mean 'port_palm'")),
    (YAML, "hand: port_palm", "hand: starboard_palm", ("is moved by starboard_turn",)),
    (
        YAML,
        "lift: [-1.2, 1.8]",
        "lift: [-1.2, 2.8]",
        ("joints.position.lift", "wider than the URDF", "-1.2 to 1.8 rad"),
    ),
    (YAML, "lift: [-1.2, 1.8]", "lift: [0.5, 0.2]", ("must be below",)),
    (YAML, "lift: [-1.2, 1.8]", "lift: [-1.2]", ("expected at least 2 values",)),
    (
        YAML,
        "    lift: [-1.2, 1.8]\n",
        "",
        ("no position is given for 'lift' (port_lift), 'lift' (starboard_lift)",),
    ),
    (YAML, "velocity: {turn: 2.0", "velocity: {turn: 2.1", ("joints.velocity.turn", "at most 2.0 rad/s")),
    (YAML, "effort: {turn: 80", "effort: {turn: 81", ("joints.effort.turn", "at most 80.0 N.m")),
    (
        YAML,
        "effort: {turn: 80",
        "effort: {trun: 80, turn: 80",
        ("no limb has a joint 'trun'", "did you mean 'turn'"),
    ),
    (YAML, "effort: {turn: 80", "effort: {turn: -80", ("joints.effort.turn", "N.m")),
    (YAML, "turn: rigid", "turn: stiff", ("a stiffness in N.m/rad, or the word 'rigid'",)),
    (YAML, "turn: rigid", "turn: 0", ("joints.spring_stiffness.turn", "N.m/rad")),
    (YAML, "roll: -1, tilt", "rol: -1, tilt", ("no sign is given for roll", "has no joint 'rol'")),
    (YAML, "roll: -1, tilt", "roll: 0, tilt", ("mirror.joint_sign.roll", "1, -1")),
    (YAML, "rate: 500", "rate: 1500", ("timing.rate", "200 to 1000 Hz")),
    (YAML, "rate_min: 200", "rate_min: 2000", ("timing.rate_min", "above rate_max")),
    (YAML, "command_timeout: 0.05", "command_timeout: 0.005", ("run out between two commands",)),
    (YAML, "[port_flange, post]", "[port_flange, mast]", ("collision.pairs[4][1]", "no link 'mast'")),
    (YAML, "[port_flange, post]", "[port_wrist, post]", ("'port_wrist' has no <collision> shape",)),
    (YAML, "[port_flange, post]", "[port_flange, port_palm]", ("no limb's joint moves",)),
    (YAML, "[port_flange, post]", "[starboard_flange, port_flange]", ("listed twice",)),
    (YAML, "solver: daqp", "solver: dapq", ("daqp, proxsuite or qpsolvers:NAME",)),
    (YAML, "solver: daqp", "solver: daqp\nsolvr: x", ("unknown key 'solvr'", "did you mean 'solver'")),
    (YAML, "gravity_compensation: robot\n", "", ("missing key 'gravity_compensation'",)),
    (YAML, "gravity_compensation: robot", "gravity_compensation: robt", ("did you mean 'robot'", "command")),
    (YAML, "collision:\n", "locked: {post_fixed: 0}\ncollision:\n", ("no movable joint 'post_fixed'",)),
    (YAML, "collision:\n", "locked: {port_turn: 0}\ncollision:\n", ("is a joint of the limb 'port'",)),
    (YAML, "collision:\n", "locked: {port_turn: 9}\ncollision:\n", ("outside the URDF's limits",)),
    (
        YAML,
        "urdf: six_joint_pair.urdf",
        "urdf: six.urdf",
        ("urdf: ", "has no file 'six.urdf' (valid: six_joint_pair.urdf)"),
    ),
    (YAML, "rate: 500", "rate: .nan", ("timing.rate",)),
    (URDF, '<mass value="3.4"/>', '<mass value="0"/>', ("'port_upper_arm'", "'port_lift'", "has no inertia")),
    (URDF, '<mass value="3.4"/>', '<mass value="x"/>', ("needs a finite number 'value'", "'x'")),
    (
        URDF,
        '<limit lower="-1.2" upper="1.8" effort="80" velocity="2.0"/>',
        "",
        ("'port_lift' has no <limit>",),
    ),
    (
        URDF,
        'name="port_lift" type="revolute"',
        'name="port_lift" type="continuous"',
        ("is continuous; describe it",),
    ),
    (
        URDF,
        'name="port_lift" type="revolute"',
        'name="port_lift" type="hinge"',
        ("the type 'hinge'", "revolute"),
    ),
    (URDF, '<child link="port_palm"/>', '<child link="port_plam"/>', ("is 'port_plam', which is no link",)),
    (URDF, '<child link="port_palm"/>', '<child link="port_wrist"/>', ("'port_wrist' hangs on 2 joints",)),
    (URDF, "</robot>", "", ("not XML",)),
    (URDF, '<robot name="six_joint_pair">', '<robot name="a"><link name="b"/>', ("exactly one root", "'b'")),
    (URDF, '<?xml version="1.0"?>', '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "b">]>', ("entities",)),
]


@pytest.mark.parametrize(
    ("file", "old", "new", "fragments"), CASES, ids=[f"{c[0][:5]}-{c[2][:40]}" for c in CASES]
)
def test_refused_with_what_would_be_valid(tmp_path, file, old, new, fragments) -> None:
    refusal = broken(tmp_path, file, old, new)
    for fragment in fragments:
        assert fragment in str(refusal)
    for problem in refusal.problems:
        assert problem.line >= 1
        assert problem.file.is_file()


def test_a_playback_watches_joints_that_are_there(tmp_path: Path) -> None:
    shutil.copytree(SOURCE.parents[2] / "robots" / "baxter", tmp_path / "baxter")
    file = tmp_path / "baxter" / YAML
    assert read_robot(tmp_path / "baxter").playback.impact["w0"] == 1.02
    file.write_text(file.read_text().replace("squish: {s0: 16", "squish: {q0: 16"))
    with pytest.raises(BadFile, match=r"playback.squish.q0: no limb has a joint 'q0'"):
        read_robot(tmp_path / "baxter")


def test_points_at_the_place(tmp_path: Path) -> None:
    refusal = broken(tmp_path, YAML, "lift: [-1.2, 1.8]", "lift: [-1.2, 2.8]")
    assert len(refusal.problems) == 2, "one for each arm"
    for problem in refusal.problems:
        assert problem.line == line_of(tmp_path / "robot" / YAML, "lift: [-1.2, 2.8]")
        assert problem.column == 11
    refusal = broken(tmp_path, URDF, '<mass value="3.4"/>', '<mass value="x"/>')
    assert refusal.problems[0].line == line_of(tmp_path / "robot" / URDF, '<mass value="x"/>')


def test_everything_at_once(tmp_path: Path) -> None:
    broken(tmp_path, YAML, "hand: port_palm", "hand: port_pam")
    broken(tmp_path, YAML, "rate: 500", "rate: 1500")
    refusal = broken(tmp_path, YAML, "effort: {turn: 80", "effort: {turn: 81")
    paths = {problem.path for problem in refusal.problems}
    assert {"limbs.port.hand", "timing.rate", "joints.effort.turn"} <= paths


def test_override_by_urdf_name(tmp_path: Path) -> None:
    shutil.copytree(SOURCE, tmp_path / "robot")
    file = tmp_path / "robot" / YAML
    file.write_text(file.read_text().replace("effort: {turn: 80", "effort: {port_turn: 33, turn: 80"))
    joints = read_robot(tmp_path / "robot").joints
    assert (joints["port_turn"].effort_max, joints["starboard_turn"].effort_max) == (33.0, 80.0)


def test_unknown_robot_and_missing_urdf(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="did you mean 'baxter'"):
        read_robot("baxtr")
    shutil.copytree(SOURCE, tmp_path / "robot")
    (tmp_path / "robot" / URDF).unlink()
    with pytest.raises(BadInput, match=re.escape(URDF)):
        read_robot(tmp_path / "robot")


def test_prismatic_joint_may_be_locked(tmp_path: Path) -> None:
    shutil.copytree(SOURCE, tmp_path / "robot")
    urdf, file = tmp_path / "robot" / URDF, tmp_path / "robot" / YAML
    rail = (
        '<joint name="post_rail" type="prismatic"><limit lower="0" upper="0.4" effort="900" velocity="0.1"/>'
    )
    urdf.write_text(urdf.read_text().replace('<joint name="post_fixed" type="fixed">', rail))
    with pytest.raises(BadFile, match="'post_rail'"):
        read_robot(tmp_path / "robot")
    file.write_text(file.read_text().replace("\nmirror:", "\nlocked: {post_rail: 0.2}\n\nmirror:"))
    assert read_robot(tmp_path / "robot").locked == {"post_rail": 0.2}


def test_welded_body_may_carry_the_inertia() -> None:
    facts = read_urdf(SOURCE / URDF)
    assert facts.welded_to("port_flange") == {"port_flange", "port_palm"}
    assert facts.moving_joints("port_elbow") == ("port_turn", "port_lift", "port_bend")
    assert facts.moving_joints("deck") == ()


def leaves(schema: dict[str, Any], name: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every property of a schema that holds a value rather than keys."""
    children = {
        **schema.get("properties", {}),
        **schema.get("patternProperties", {}),
        **schema.get("$defs", {}),
    }
    if "items" in schema:
        children["[]"] = schema["items"]
    for key, child in children.items():
        yield from leaves(child, f"{name}.{key}")
    if not children and "$ref" not in schema:
        yield name, schema


@pytest.mark.parametrize("name", ["robot", "patch"])
def test_every_leaf_of_the_schema_is_explained(name: str) -> None:
    schema = json.loads(find_schema(name).read_text())
    found = dict(leaves(schema, name))
    assert len(found) > 15
    for path, leaf in found.items():
        assert leaf["description"].endswith("."), path
        assert leaf["examples"], path
        kinds = {leaf["type"]} if isinstance(leaf.get("type"), str) else set(leaf.get("type", ["const"]))
        if kinds & {"number", "integer"}:
            assert "unit" in leaf, path
            low = {"minimum", "exclusiveMinimum"} & set(leaf)
            assert "enum" in leaf or (low and {"maximum", "exclusiveMaximum"} & set(leaf)), path
        if kinds == {"string"}:
            assert {"enum", "pattern", "maxLength"} & set(leaf), path
