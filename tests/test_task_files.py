# SPDX-License-Identifier: BSD-3-Clause
"""Task files: the design's example, every broken fixture, and the rules of meaning as laws."""

import functools
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec.locate import find_robot, find_schema, find_task, list_robots
from impedance_modules.spec.mirror import mirrored_spring, twist_signs
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.schema import load_schema
from impedance_modules.spec.source import parse_document
from impedance_modules.spec.task import AXES, ContactCondition, HybridAxis, ReachedCondition, Sine, SpringSpec
from impedance_modules.spec.task_reader import check_task, read_task

HERE = Path(__file__).parent
PRESS_BOX = HERE / "data" / "press-box.yaml"
EVERY_KEY = HERE / "data" / "every-key.yaml"
BROKEN = sorted((HERE / "broken_tasks").glob("*.yaml"))

cached_robot = functools.lru_cache(read_robot)


def check(text, at=PRESS_BOX):
    return check_task(parse_document(at, text), cached_robot)


def problems_of(text):
    with pytest.raises(BadFile) as caught:
        check(text)
    return caught.value.problems


# Broken fixtures -------------------------------------------------------------------------------------------

EXPECT = re.compile(r"# expect (\d+):(\d+) \| (\S+) \| (.*?)(?: \| valid: (.*))?")


def expectations(path):
    text = path.read_bytes().decode("utf-8", "replace")
    return [m.groups() for line in text.split("\n") if (m := EXPECT.fullmatch(line))]


def test_there_are_enough_broken_fixtures():
    assert len(BROKEN) >= 60


@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.stem)
def test_a_broken_task_gets_exactly_the_expected_problems(path):
    expected = expectations(path)
    assert expected, "a fixture begins with its expectations"
    with pytest.raises(BadInput) as caught:
        read_task(path, cached_robot)
    found = caught.value.problems
    for (line, column, place, fragment, valid), problem in zip(expected, found, strict=True):
        assert (problem.line, problem.column) == (int(line), int(column)), problem
        assert (problem.path or "(file)") == place
        assert fragment in problem.message
        assert set(valid.split(", ") if valid else ()) <= set(problem.valid)
        assert str(problem).startswith(f"{path}:{line}:{column}: ")


# The design's example --------------------------------------------------------------------------------------


def test_the_designs_example_reads_as_it_is_written():
    task, robot = read_task(PRESS_BOX, cached_robot)
    right, left = task.arms["right"], task.arms["left"]
    assert robot.name == task.robot == "baxter"
    assert right.springs[0].stiffness.tolist() == np.diag([300, 300, 50, 10, 10, 10]).tolist()
    assert right.springs[0].axes == {"z": HybridAxis(force=-12.0, speed_limit=0.1)}
    assert left.posture["s0"] == -right.posture["s0"] and left.posture["s1"] == right.posture["s1"]
    assert left.springs[0].frame == "left_hand" and left.springs[0].axes["z"].force == -12.0
    assert left.joint_bias == right.joint_bias
    assert task.object.held_by == ("left", "right") and task.object.grasp == "weld"
    assert (task.tank.initial, task.tank.max, task.tank.floor) == (5.0, 10.0, 0.5)
    lower, slide = task.phases
    assert lower.equilibrium == {"object": {"z": -0.05}} and lower.otherwise == "stop"
    assert lower.until == ContactCondition(present=True, force=None, time=None, target=None)
    assert slide.equilibrium["object"]["y"] == Sine(amplitude=0.1, frequency=0.3, center=None)
    assert task.text == PRESS_BOX.read_text()


def test_what_the_examples_leave_out_follows_the_stated_rules():
    task, _ = read_task(PRESS_BOX, cached_robot)
    assert task.object.position is None and task.object.friction is None and not task.object.carry_weight
    assert task.environment[0].rotation == (0.0, 0.0, 0.0)
    assert task.arms["right"].springs[0].damping is None
    assert task.phases[1].until is None and task.phases[0].posture == {}


def test_every_key_arrives():
    task, _ = read_task(EVERY_KEY, cached_robot)
    raw = yaml.safe_load(EVERY_KEY.read_text())
    hand, elbow = task.arms["right"].springs
    assert hand.stiffness.tolist() == raw["arms"]["right"]["springs"][0]["stiffness"]
    assert np.diag(hand.damping).tolist() == [10, 10, 25, 0.5, 0.5, 0.5]
    assert elbow.stiffness[2, 2] == 40 and np.count_nonzero(elbow.stiffness) == 1
    assert task.arms["left"].springs[1].frame == "left_upper_forearm"
    assert task.object.size == (0.2, 0.3) and task.object.friction == 0.6 and task.object.squeeze == 20
    lower, press, slide = task.phases
    assert lower.until == ContactCondition(True, 4.0, 0.1, "object") and lower.otherwise == "next"
    assert press.until == ReachedCondition(0.01, 0.05)
    assert press.stiffness["right.elbow"][2, 2] == 60
    assert press.posture["right"] == task.arms["right"].posture and press.posture["left"] == {"e0": -0.9}
    assert slide.until.present is False
    with pytest.raises(ValueError, match="read-only"):
        hand.stiffness[0, 0] = 1.0


def schema_keys(schema):
    """Every key that the task schema knows."""
    if isinstance(schema, list):
        return set().union(*map(schema_keys, schema)) if schema else set()
    if not isinstance(schema, dict):
        return set()
    own = set(schema.get("properties", {})) if isinstance(schema.get("properties"), dict) else set()
    return own.union(*(schema_keys(value) for value in schema.values()))


def document_keys(data):
    if isinstance(data, dict):
        return set(data).union(*(document_keys(value) for value in data.values()))
    return set().union(*map(document_keys, data)) if isinstance(data, list) and data else set()


def test_the_fixture_every_key_has_every_key():
    assert schema_keys(load_schema("task")) <= document_keys(yaml.safe_load(EVERY_KEY.read_text()))


# The schema ------------------------------------------------------------------------------------------------


def schema_leaves(node, path=""):
    if isinstance(node, list):
        for i, inner in enumerate(node):
            yield from schema_leaves(inner, f"{path}/{i}")
    elif isinstance(node, dict):
        kinds = node.get("type", [])
        if {"number", "string", "boolean"} & set(
            [kinds] if isinstance(kinds, str) else kinds
        ) or "enum" in node:
            yield path, node
        for key, inner in node.items():
            if key not in {"examples", "enum", "if"}:
                yield from schema_leaves(inner, f"{path}/{key}")


def test_every_leaf_of_the_schema_explains_itself():
    leaves = list(schema_leaves(load_schema("task")))
    assert len(leaves) > 50
    for path, leaf in leaves:
        assert leaf.get("description") and leaf.get("examples"), path
        if "number" in leaf.get("type", []):
            assert "unit" in leaf and "maximum" in leaf, path
            assert "minimum" in leaf or "exclusiveMinimum" in leaf, path


def test_every_object_of_the_schema_refuses_unknown_keys():
    def objects(node):
        if isinstance(node, dict):
            if "object" in node.get("type", []):
                yield node
            for inner in node.values():
                yield from objects(inner)
        elif isinstance(node, list):
            for inner in node:
                yield from objects(inner)

    assert all(node.get("additionalProperties") is False for node in objects(load_schema("task")))


def test_the_schema_is_a_schema_and_its_examples_hold():
    from jsonschema import Draft202012Validator

    schema = load_schema("task")
    Draft202012Validator.check_schema(schema)
    for path, leaf in schema_leaves(schema):
        for example in leaf["examples"]:
            validator = Draft202012Validator({**leaf, "$defs": schema["$defs"]})
            assert validator.is_valid(example), (path, example)


@pytest.mark.parametrize("path", [PRESS_BOX, EVERY_KEY], ids=lambda path: path.stem)
def test_the_modeline_leads_editors_to_the_schema(path):
    first = path.read_text().split("\n")[0]
    target = first.removeprefix("# yaml-language-server: $schema=")
    assert (path.parent / target).resolve() == find_schema("task").resolve()


# Laws of meaning -------------------------------------------------------------------------------------------

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
@given(
    st.sampled_from(AXES),
    st.sampled_from([0.0, 100.0]),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)
def test_a_force_axis_is_refused_exactly_when_nothing_brakes_it(axis, stiffness, ratio, damping, limited):
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


def test_a_file_with_many_faults_reports_them_in_order_and_without_repetition():
    text = (
        PRESS_BOX.read_text()
        .replace("mass: 1.2", "mass: 1.2, mas: 2")
        .replace("rx: 10, ry: 10", "rx: on, ry: 1e1")
    )
    text = text.replace("floor: 0.5", "floor: 50").replace("{mirror: right}", "{mirror: rihgt}")
    found = problems_of(text)
    assert [p.path for p in found] == [
        "arms.right.springs[0].stiffness.rx",
        "arms.right.springs[0].stiffness.ry",
        "arms.left.mirror",
        "object.mas",
        "safety.tank.floor",
    ]


def test_a_trap_behind_an_alias_is_reported_once_where_it_stands():
    text = EVERY_KEY.read_text()
    line = text[: text.index("s0: 0.0974")].count("\n") + 1
    found = problems_of(text.replace("s0: 0.0974", "s0: *nowhere"))
    assert [(p.line, p.path) for p in found] == [(line, "arms.right.posture.s0")]


# Finding tasks and robots ----------------------------------------------------------------------------------


def test_a_robot_beside_the_task_wins_over_a_shipped_one(tmp_path):
    shutil.copytree(find_robot("baxter"), tmp_path / "robots" / "baxter")
    (tmp_path / "tasks").mkdir()
    task_file = Path(shutil.copy(PRESS_BOX, tmp_path / "tasks"))
    _, robot = read_task(task_file)
    assert robot.folder.resolve() == (tmp_path / "robots" / "baxter").resolve()
    task_file.write_text(PRESS_BOX.read_text().replace("robot: baxter", "robot: ../robots/baxter"))
    _, robot = read_task(task_file)
    assert robot.folder.resolve() == (tmp_path / "robots" / "baxter").resolve()


def test_the_faults_of_a_robot_come_with_those_of_its_task(tmp_path):
    shutil.copytree(find_robot("baxter"), tmp_path / "robots" / "baxter")
    robot_file = tmp_path / "robots" / "baxter" / "robot.yaml"
    robot_file.write_text(robot_file.read_text().replace("solver:", "slover:"))
    task_file = tmp_path / "task.yaml"
    task_file.write_text(PRESS_BOX.read_text().replace("floor: 0.5", "floor: 50"))
    with pytest.raises(BadFile) as caught:
        read_task(task_file)
    assert {Path(p.file).name for p in caught.value.problems} == {"robot.yaml", "task.yaml"}


def test_unknown_names_come_with_the_nearest_and_all_valid_ones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput, match=r"no robot 'baxtr'; did you mean 'baxter'\? \(valid: .*baxter"):
        find_robot("baxtr")
    with pytest.raises(BadInput, match=r"no task 'no-such-task'.*\(valid: "):
        find_task("no-such-task")
    with pytest.raises(BadInput, match=r"no schema 'tsk'; did you mean 'task'"):
        find_schema("tsk")
    assert "baxter" in list_robots()


def test_a_path_wins_over_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("press-box").write_text("format: 1\n")
    assert find_task("press-box") == Path("press-box")
    assert find_task("./anything") == Path("anything")
    assert find_task("other.yaml") == Path("other.yaml")


def test_checking_a_task_starts_fast():
    code = (
        "from impedance_modules.spec.task_reader import read_task; import sys; "
        "read_task(sys.argv[1]); print(*sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code, PRESS_BOX], capture_output=True, text=True, check=True)
    heavy = {"pinocchio", "coal", "numba", "scipy", "pyarrow", "rerun", "matplotlib"}
    assert not heavy & set(run.stdout.split())
