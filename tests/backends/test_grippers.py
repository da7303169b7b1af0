# SPDX-License-Identifier: BSD-3-Clause
"""Grippers: laws of orders and of the simulated gripper, whole runs with and without faults, replays bit for bit."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.backends.grippers import (
    SILENT,
    THIN,
    GripperReport,
    GripperSample,
    GripperState,
    OrderedGripper,
)
from impedance_modules.backends.sim_grippers import SimulatedGripper, SimulatedGrippers, thing_between
from impedance_modules.control.assembly import assemble
from impedance_modules.control.gripper_watch import grippers_of
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import BadInput
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.run_backends import make_backend
from impedance_modules.runs.verify import verify
from impedance_modules.spec.gripper_spec import GripperMotion, GripperOrder, GripperSpec
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.task import ObjectSpec

SPEC = GripperSpec("made-up", narrowest=0.0, widest=0.08, force=70.0, speed=0.1, time_out=2.0)
CLOSE = GripperOrder("close", force=20.0).motion(SPEC)

widths = st.floats(0.0, 0.08)
TASK = """format: 1
name: grip
robot: panda
arms:
  right:
    posture: palms-down
    joint_bias: {stiffness_per_effort: 0.02, damping_ratio: 0.7}
    springs:
      - {name: hand, frame: hand, expressed_in: world, damping_ratio: 0.7,
         stiffness: {x: 300, y: 300, z: 300, rx: 10, ry: 10, rz: 10}}
OBJECTsafety: {tank: {initial: 2, max: 4, floor: 0.3}}
phases:
  - {name: close, duration: 0.4, grippers: {right: {close: {force: 20, speed: 0.1}}}UNTIL}
  - {name: part, duration: 0.2, grippers: {right: {width: 0.075}}}
"""
BOX = (
    "object: {held_by: [right], shape: box, mass: 0.1, size: [0.06, 0.06, 0.06], position: [0.6, -0.25, 0.075],"
    " grasp: weld}\n"
)


def motion(width: float, speed: float = 0.1, force: float | None = None) -> GripperMotion:
    return GripperMotion(width, speed, force)


@given(width=widths, held=st.booleans(), waited=st.floats(0.0, 10.0), ended=st.integers(0, 2))
def test_an_order_ends_fails_or_goes_on_and_is_never_both(width, held, waited, ended) -> None:
    sent = []
    gripper = OrderedGripper(SPEC, lambda number, motion: sent.append(number))
    gripper.order(CLOSE, 0.0)
    gripper.order(CLOSE, 0.0)
    gripper.hear(GripperSample(waited, width, 5.0, ended, held))
    state = gripper.report(waited).state
    assert sent == [1, 2]
    if ended < 2:
        assert state is (GripperState.FAILED if waited > SPEC.time_out else GripperState.MOVING)
    else:
        assert state is (GripperState.HELD if held and width > THIN else GripperState.REST)


@given(after=st.floats(0.0, 5.0))
def test_a_silent_gripper_has_failed_and_stays_so(after) -> None:
    gripper = OrderedGripper(SPEC, lambda number, motion: None)
    assert gripper.report(0.0).why == "it has not reported anything"
    gripper = OrderedGripper(SPEC, lambda number, motion: None)
    gripper.hear(GripperSample(0.0, 0.08, 0.0, 0, held=False))
    assert (gripper.report(after).state is GripperState.FAILED) == (after > SILENT)
    if after > SILENT:
        gripper.hear(GripperSample(after, 0.08, 0.0, 0, held=False))
        assert gripper.report(after).why == f"no report for {after:.2f} s"


@pytest.mark.parametrize(
    ("sample", "words"),
    [
        (GripperSample(0.0, 0.08, 0.0, 0, held=False, error="motor too hot"), "motor too hot"),
        (GripperSample(0.0, float("nan"), 0.0, 0, held=False), "it reports a width of nan m"),
    ],
)
def test_an_error_of_the_gripper_is_told_in_its_words(sample, words) -> None:
    gripper = OrderedGripper(SPEC, lambda number, motion: None)
    gripper.hear(sample)
    report = gripper.report(0.0)
    assert report.state is GripperState.FAILED and report.why == words


@given(
    goals=st.lists(st.tuples(widths, st.floats(0.01, 0.1)), min_size=1, max_size=4),
    thing=st.none() | st.floats(0.005, 0.075),
    force=st.none() | st.floats(1.0, 70.0),
)
def test_fingers_keep_their_speed_and_do_not_go_through_things(goals, thing, force) -> None:
    gripper = SimulatedGripper(SPEC, thing)
    for number, (goal, speed) in enumerate(goals, start=1):
        gripper.order(number, motion(goal, speed, force))
        for _ in range(round(0.08 / speed / 0.001) + 2):
            before = gripper.width
            gripper.advance(0.001)
            assert abs(gripper.width - before) <= speed * 0.001 + 1e-12
        sample = gripper.sample(0.0)
        assert sample.ended == number
        stopped = thing is not None and goal <= thing and gripper.width == thing
        assert stopped or abs(sample.width - goal) < 1e-9
        assert thing is None or gripper.width >= thing - 1e-12
        assert sample.held == (sample.force > 0.0)
        assert not sample.held or (stopped and sample.force == force)


def test_the_tasks_object_says_what_is_between_the_fingers() -> None:
    def held(by: tuple[str, ...], size: tuple[float, ...]) -> ObjectSpec:
        return ObjectSpec(by, "box", 0.1, size, None, "weld", None, 0.0, carry_weight=False)

    assert thing_between("right", SPEC, None) is None
    assert thing_between("right", SPEC, held(("left",), (0.02, 0.1, 0.1))) is None
    assert thing_between("right", SPEC, held(("right",), (0.3, 0.2, 0.2))) is None
    assert thing_between("right", SPEC, held(("right",), (0.3, 0.02, 0.2))) == 0.02


def write(folder: Path, *, held: bool = False, until: str = "") -> Path:
    text = TASK.replace("OBJECT", BOX if held else "").replace("UNTIL", f", until: {until}" if until else "")
    path = folder / "grip.yaml"
    path.write_text(text)
    return path


def run(
    folder: Path, task: Path, *, backend: str = "sim", spoil=None, log=None, read_only=False
) -> RunResult:
    assembly = assemble(str(task), effects=None, rate=None, scale=1.0, arm=None)
    robot = make_backend(assembly, backend=backend, log=log, seed=0)
    if spoil is not None:
        spoil(robot._grippers)
    options = RunOptions(folder, 0, None, live=False, read_only=read_only, backend=backend)
    return carry_out(assembly, robot, options, lambda time, phase: None)


def column(folder: Path, part: str) -> np.ndarray:
    return read_episode(folder).extra[f"gripper.right.{part}"]


@pytest.mark.parametrize("backend", ["sim", "mujoco"])
def test_a_phase_ends_when_the_gripper_holds_and_the_replay_agrees_bit_for_bit(backend, tmp_path) -> None:
    if backend == "mujoco":
        pytest.importorskip("mujoco")
    task = write(tmp_path, held=True, until="{gripper: {right: held}}")
    result = run(tmp_path / "run", task, backend=backend)
    assert result.summary["ending"] == "done", result.reason
    # From 0.08 m to the box of 0.06 m at 0.1 m/s, looked at a hundred times a second.
    assert result.summary["phases"][0]["seconds"] == pytest.approx(0.2, abs=0.02)
    assert column(tmp_path / "run", "width").min() == pytest.approx(0.06)
    assert column(tmp_path / "run", "force").max() == 20.0
    assert set(column(tmp_path / "run", "state")) == {0.0, 1.0, 2.0}
    assert "gripper of right: close with 20 N at 0.1 m/s" in str(result.summary["messages"])
    episode = read_episode(tmp_path / "run")
    assert verify(episode, lambda part: None).samples == len(episode.time)
    again = run(tmp_path / "again", task, backend="replay", log=tmp_path / "run")
    assert again.summary["phases"][0] == result.summary["phases"][0]


def test_no_torque_depends_on_a_gripper(tmp_path) -> None:
    task = write(tmp_path)
    run(tmp_path / "with", task)
    lines = [line.split(", grippers")[0].rstrip("}") + "}" if "grippers" in line else line
             for line in task.read_text().splitlines()]  # fmt: skip
    task.write_text("\n".join(lines))
    run(tmp_path / "without", task)
    with_it, without = read_episode(tmp_path / "with"), read_episode(tmp_path / "without")
    assert "gripper.right.width" not in without.extra
    for joint, command in without.effort_command.items():
        np.testing.assert_array_equal(with_it.effort_command[joint], command)


def test_a_gripper_that_holds_nothing_does_not_meet_the_phase_and_the_run_says_what_it_reports(
    tmp_path,
) -> None:
    result = run(tmp_path / "run", write(tmp_path, until="{gripper: {right: held}}"))
    assert result.summary["ending"] == "stopped"
    assert "phase not met (phase 'close': no gripper of right 'held' within its 0.4 s" in result.reason
    assert "the gripper of right reports a motion at 4" in result.reason
    assert "'held' is asked for" in result.reason


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"error": "the hand is not homed"}, "gripper failed (gripper: the hand is not homed)"),
        ({"taken": -5.0}, "gripper failed (gripper: no report for"),
        ({"ended": 0}, "gripper failed (gripper: no end of its order within 0.3 s, the fingers"),
        ({"width": float("nan")}, "gripper failed (gripper: it reports a width of nan m)"),
    ],
)
def test_a_gripper_that_fails_stops_the_run_with_the_reason_and_the_replay_agrees(
    fault, words, tmp_path
) -> None:
    def spoil(grippers: SimulatedGrippers) -> None:
        body, ordered = grippers._bodies["right"], grippers._ordered["right"]
        ordered.spec = GripperSpec("made-up", 0.0, 0.08, 70.0, 0.1, time_out=0.3)
        sample = body.sample

        def spoilt(now: float) -> GripperSample:
            found = vars(sample(now))
            late = {} if now < 0.05 and "taken" not in fault else fault
            if "taken" in fault and now > 0.05:
                ordered._ordered, late = -9.0, {**fault, "ended": ordered._number}
            elif "taken" in fault:
                late = {}
            return GripperSample(**{**found, **late})

        body.sample = spoilt

    result = run(tmp_path / "run", write(tmp_path), spoil=spoil)
    assert result.summary["ending"] == "stopped" and words in result.reason, result.reason
    assert column(tmp_path / "run", "state")[-1] == GripperState.FAILED
    episode = read_episode(tmp_path / "run")
    assert verify(episode, lambda part: None).samples == len(episode.time)


def test_read_only_orders_nothing(tmp_path) -> None:
    run(tmp_path / "run", write(tmp_path), read_only=True)
    assert set(column(tmp_path / "run", "width")) == {0.08}


def test_a_robot_that_takes_no_orders_is_refused_before_anything_moves(tmp_path) -> None:
    assembly = assemble(str(write(tmp_path)), effects=None, rate=None, scale=1.0, arm=None)
    with pytest.raises(
        BadInput, match=r"--backend ros2 takes no orders for the gripper of right, which the phases"
    ):
        grippers_of(object(), assembly, "--backend ros2")
    with pytest.raises(BadInput, match=r"this loop takes no orders"):
        Supervisor(assembly)


def test_a_recording_without_the_gripper_cannot_be_fed_back(tmp_path) -> None:
    stand_by = assemble("stand-by", effects=None, rate=None, scale=1.0, arm=None, robot_name="panda")
    options = RunOptions(tmp_path / "still", 0, 0.1, live=False, read_only=False, backend="sim")
    carry_out(stand_by, make_backend(stand_by, backend="sim", log=None, seed=0), options, lambda *_: None)
    with pytest.raises(BadInput, match="--backend replay takes no orders for the gripper of right"):
        run(tmp_path / "run", write(tmp_path), backend="replay", log=tmp_path / "still")
    assert not (tmp_path / "run").exists()


def test_every_shipped_gripper_can_carry_out_what_it_states() -> None:
    for name in ("baxter", "fr3-pair", "panda"):
        for limb in read_robot(name).limbs.values():
            gripper = limb.gripper
            assert (
                gripper is not None
                and gripper.time_out > (gripper.widest - gripper.narrowest) / gripper.speed
            )
            assert GripperOrder("open").motion(gripper) == GripperMotion(gripper.widest, gripper.speed, None)
    assert all(limb.gripper is None for limb in read_robot("ur5e-pair").limbs.values())
    assert GripperReport(0.0, 0.0, GripperState.REST).why == ""
