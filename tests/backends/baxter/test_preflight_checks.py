# SPDX-License-Identifier: BSD-3-Clause
"""The served description, every preflight check, passed and failed with its remedy, and the contact check of a task.

On a robot with parallel springs at its shoulders, a task that waits for contact is refused until the model has them.
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from unittest import mock
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.backends.baxter.preflight_checks import checks_before_power
from impedance_modules.backends.baxter.ros.transport import PublisherInfo
from impedance_modules.backends.baxter.served_description import compare_description
from impedance_modules.backends.baxter.simulator.collision_safety import HandPush
from impedance_modules.backends.baxter.simulator.parameters import SPRINGS
from impedance_modules.backends.preflight import refuse_failed
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.contact_detection import contact_checks
from impedance_modules.effects.apply import apply_patch
from impedance_modules.errors import RobotRefused
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.locate import find_task
from impedance_modules.spec.patch_file import read_patch
from tests.support.baxter_lockstep import LockstepSimulator, run_in_lockstep
from tests.support.baxter_stub import SPEC, StubBaxter, open_session
from tests.support.in_process_transport import InProcessTransport

NOMINAL = SPEC.urdf.read_text()
BOTH = ("left", "right")
PATCH = Path("robots/baxter/patches/counterbalance-springs.yaml")


@pytest.fixture
def robot():
    return StubBaxter(SPEC)


def edited(change) -> str:
    root = ElementTree.fromstring(NOMINAL)
    change({joint.get("name"): joint for joint in root.iter("joint")})
    return ElementTree.tostring(root, encoding="unicode")


def test_our_own_description_is_our_model() -> None:
    found = compare_description(NOMINAL, SPEC)
    assert (dict(found.origins), found.problems, found.notes) == ({}, (), ())


small = st.floats(-0.008, 0.008)


@settings(max_examples=15, deadline=None)
@given(st.tuples(small, small, small), st.tuples(small, small, small))
def test_calibrated_mounts_are_taken_over_exactly(shift, turn) -> None:
    def move(joints) -> None:
        mount = joints["right_arm_mount_fixed"].find("origin")
        for key, offset in (("xyz", shift), ("rpy", turn)):
            values = [float(word) for word in mount.get(key).split()]
            mount.set(key, " ".join(repr(a + b) for a, b in zip(values, offset, strict=True)))

    text = edited(move)
    found = compare_description(text, SPEC)
    assert found.problems == ()
    ours, nominal = RobotModel(replace(SPEC, joint_origins=found.origins)), RobotModel(SPEC)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "served.urdf"
        path.write_text(text)
        served = RobotModel(replace(SPEC, urdf=path))
    q = np.linspace(-0.5, 0.9, ours.n)
    for hand in ("right_hand", "left_hand"):
        here, there = ours.pose(q, hand), served.pose(q, hand)
        assert np.allclose(here.translation, there.translation, atol=2e-6)
        assert np.allclose(here.rotation, there.rotation, atol=2e-6)
    assert np.allclose(ours.gravity(q), served.gravity(q), atol=1e-4)
    moved = np.linalg.norm(ours.pose(q, "right_hand").translation - nominal.pose(q, "right_hand").translation)
    if max(map(abs, shift)) > 1e-3 and max(map(abs, turn)) < 1e-4:
        assert moved > 5e-4


def origin(name: str, key: str, value: str):
    return lambda joints: joints[name].find("origin").set(key, value)


def limit(name: str, key: str, value: str):
    return lambda joints: joints[name].find("limit").set(key, value)


def rename(name: str):
    return lambda joints: joints[name].set("name", "other")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (origin("left_arm_mount_fixed", "xyz", "0.0646 0.2196 0.1186"), "left mount 40.0 mm"),
        (origin("right_arm_mount_fixed", "rpy", "0 0 0.7854"), "right mount"),
        (origin("left_e1", "xyz", "0.069 0 0.2724"), "'left_e1' is served 10.0 mm"),
        (limit("right_s1", "upper", "1.2"), "'right_s1' {} upper limit 1.2 rad, robot.yaml says 1.047"),
        (limit("left_w0", "effort", "10"), "'left_w0' {} effort limit 10 N.m, robot.yaml allows 15"),
        (limit("left_s0", "velocity", "1"), "velocity limit 1 rad/s, robot.yaml allows 1.5"),
        (limit("left_s0", "lower", "none"), "'left_s0' {} lower limit nan"),
        (rename("left_w2"), "no joint left_w2"),
        (origin("left_e0", "rpy", "0 zero 0"), "cannot be read"),
    ],
)
def test_another_robots_description_is_refused_by_name(change, said: str) -> None:

    problems = "; ".join(compare_description(edited(change), SPEC).problems)
    assert said.format("is served with") in problems


@pytest.mark.parametrize("text", ["", "<robot>", "<robot/>", "42"])
def test_what_is_no_description_is_refused(text: str) -> None:
    assert compare_description(text, SPEC).problems


def test_a_correct_robot_passes_every_check(robot) -> None:
    with open_session(robot) as session:
        results = session.preflight(BOTH)
        assert [result.name for result in results if result.passed is not True] == []
        assert len(results) == 17
        refuse_failed(results, commanding=True)


VERSION, SERVED = "/rethink/software_version", "/robot_description"
ENDPOINT = "/robot/limb/left/endpoint_state"
OTHER_LIMIT = {SERVED: edited(limit("left_s0", "upper", "1.0"))}
FAULTY = {
    "software": (lambda robot: robot.parameters.update({VERSION: "1.1.1"}), "1.2."),
    "wrong master": (lambda robot: robot.parameters.pop(VERSION), "no Baxter's"),
    "two robots": (lambda robot: robot.another_robot(), "which robot is meant"),
    "silent robot": (lambda robot: robot.silent.add("/robot/state"), "nobody publishes /robot/state"),
    "wrong message": (lambda robot: robot.wrong.add(ENDPOINT), f"sends {ENDPOINT} as"),
    "missing joint": (lambda robot: robot.left_out.add("left_w2"), "never reported: left_w2"),
    "not finite": (lambda robot: robot.set_effort("left_s0", float("nan")), "not finite"),
    "another robot's loop": (lambda robot: setattr(robot, "loop", "/gazebo"), "/gazebo publish"),
    "limits": (lambda robot: robot.parameters.update(OTHER_LIMIT), "robot.yaml says"),
    "no description": (lambda robot: robot.parameters.pop(SERVED), "serves no /robot_description"),
    "somebody else": (lambda robot: robot.another_controller("left"), "commanded by /somebody (left)"),
    "disabled": (lambda robot: robot.power(enabled=False), "the robot is disabled"),
    "e-stop": (lambda robot: robot.power(estop_button=1), "the e-stop is pressed"),
    "error": (lambda robot: robot.power(error=True), "reports an error"),
    "collision": (lambda robot: robot.collide("left"), "reported by left"),
    "cuff": (lambda robot: robot.squeeze("right"), "squeezed at right"),
    "tucked": (lambda robot: robot.place("left_s1", -2.175), "left_s1 at -2.175 rad"),
    "other hand": (lambda robot: robot.tip.update(left=0.01), "10.0 mm from where the robot has it"),
    "tool": (lambda robot: robot.weight.update(left=4.0), "differ by at most 4.00 N.m"),
}


@pytest.mark.parametrize("name", FAULTY)
def test_every_check_fails_with_a_reason_and_a_remedy(robot, name: str) -> None:
    change, said = FAULTY[name]
    change(robot)
    with open_session(robot) as session, pytest.raises(RobotRefused) as refusal:
        refuse_failed(session.preflight(BOTH), commanding=True)
    assert said in str(refusal.value)
    assert "(valid: " in str(refusal.value)
    assert robot.commands == []


def test_a_model_with_the_springs_at_s1_passes_every_check() -> None:
    sprung = apply_patch(SPEC, read_patch(PATCH))
    assert np.abs(RobotModel(sprung).parallel_spring_effort(np.zeros(14))).max() > 30.0
    results = results_by_name(StubBaxter(sprung))
    refuse_failed(tuple(results.values()), commanding=True)
    assert results["weight left"].passed is True
    assert results["effort left"].passed is True


def test_listening_alone_asks_for_less(robot) -> None:
    robot.power(enabled=False)
    robot.place("left_s1", -2.175)
    with open_session(robot) as session:
        refuse_failed(session.preflight(("left",)), commanding=False)
        robot.another_robot()
        with pytest.raises(RobotRefused, match="which robot is meant"):
            refuse_failed(session.preflight(("left",)), commanding=False)


NO_POWER = ["software", "two robots", "wrong message", "missing joint", "limits", "somebody else", "tucked"]


@pytest.mark.parametrize("name", NO_POWER)
def test_what_is_wrong_with_a_robot_is_found_before_it_gets_power(name: str) -> None:
    sound, faulty = StubBaxter(SPEC), StubBaxter(SPEC)

    def before_power(robot: StubBaxter, *, tucked: bool = False) -> None:
        robot.power(enabled=False)
        with open_session(robot) as session:
            refuse_failed(checks_before_power(session.preflight(BOTH), tucked=tucked), commanding=True)

    before_power(sound)
    change, said = FAULTY[name]
    change(faulty)
    with pytest.raises(RobotRefused) as refusal:
        before_power(faulty)
    assert said in str(refusal.value)
    if name == "tucked":
        before_power(faulty, tucked=True)


def results_by_name(robot: StubBaxter) -> dict:
    with open_session(robot) as session:
        return {result.name: result for result in session.preflight(BOTH)}


def test_a_spring_beside_a_joint_is_noticed_and_no_obstacle(robot) -> None:
    robot.set_effort("left_s1", 20.0)
    results = results_by_name(robot)
    assert results["effort right"].passed
    assert results["effort left"].passed is None
    assert "20.0 N.m (left_s1): a parallel spring" in results["effort left"].found
    refuse_failed(results.values(), commanding=True)


def test_nodes_that_have_ended_are_named_and_ignored(robot) -> None:
    robot.hub.dead += [("/old_simulator", "/robot/state")]
    robot.hub.dead += [("/old_run", f"/robot/limb/{limb}/joint_command") for limb in BOTH]
    results = results_by_name(robot)
    refuse_failed(results.values(), commanding=True)
    for name, node in (("one robot", "/old_simulator"), ("nobody else", "/old_run")):
        said = f"a registration of {node}, which no longer answers, is ignored; 'rosnode cleanup' removes it"
        assert results[name].passed and results[name].found.endswith(said), results[name].found


@pytest.mark.parametrize(
    ("topic", "name"), [("/robot/state", "one robot"), ("/robot/limb/left/joint_command", "nobody else")]
)
def test_a_node_that_does_not_answer_counts_as_running(robot, topic: str, name: str) -> None:
    silent = PublisherInfo("/silent", None, None, "cannot be reached: timed out")
    ask = InProcessTransport.publisher_info

    def asked(transport: InProcessTransport, where: str) -> tuple[PublisherInfo, ...]:
        return (*ask(transport, where), *([silent] if where == topic else []))

    with mock.patch.object(InProcessTransport, "publisher_info", asked):
        result = results_by_name(robot)[name]
    assert result.passed is False
    assert "/silent, which cannot be reached: timed out" in result.found
    assert "rosnode cleanup" in result.remedy


def test_the_other_arm_may_be_commanded_by_somebody_else(robot) -> None:
    robot.another_controller("right")
    with open_session(robot) as session:
        refuse_failed(session.preflight(("left",)), commanding=True)


RATE = 200.0


def contact_task(folder: Path, *, springs_known: bool) -> Assembly:
    """``touch-and-stop``, two seconds long, and nothing there to touch."""
    text = find_task("touch-and-stop").read_text()
    task = folder / "contact.yaml"
    task.write_text(text.replace("duration: 6,", "duration: 2,"))
    assert task.read_text() != text
    effects = PATCH if springs_known else None
    return assemble(str(task), effects=effects, rate=RATE, scale=1.0, arm=None)


def at_rest(assembly: Assembly, effects: Path | None = None, springs=SPRINGS) -> LockstepSimulator:
    simulator = LockstepSimulator(str(assembly.task.path), RATE, effects, 3, springs)
    for _ in range(50):
        simulator.read()
    return simulator


def test_a_robot_whose_springs_the_model_lacks_is_refused_with_the_remedy(tmp_path: Path) -> None:
    assembly = contact_task(tmp_path, springs_known=False)
    results = contact_checks(assembly, at_rest(assembly).read())
    with pytest.raises(RobotRefused, match=r"right_s1 measures .* --effects .*counterbalance-springs.yaml"):
        refuse_failed(results, commanding=True)
    # Springs of other numbers than the patch's, and exactly the patch's.
    known = contact_task(tmp_path, springs_known=True)
    for simulator in (at_rest(known), at_rest(known, effects=PATCH, springs={})):
        (result,) = contact_checks(known, simulator.read())
        assert result.passed, result


def test_a_task_that_waits_for_no_contact_is_not_asked() -> None:
    assembly = assemble("soft-hold", effects=None, rate=RATE, scale=1.0, arm=None)
    assert contact_checks(assembly, at_rest(assembly).read()) == ()


def run_task(assembly: Assembly, out: Path, push: float = 0.0) -> tuple[str, dict[str, float]]:
    """Why the run ended, and how long its phases took [s]; a person pushes the palm after half a second."""

    def prepare(simulator: LockstepSimulator) -> None:
        # The robot does not report a collision.
        simulator.robot.suppressions["right"].request("suppress_contact_safety", 60.0)
        hand = HandPush(np.array([0.0, 0.0, push]), 60.0)
        if push:
            simulator.when(0.5, lambda: simulator.robot.pushes.update(right=hand))

    result, _ = run_in_lockstep(assembly, out, prepare=prepare)
    return result.reason, {phase["name"]: phase["seconds"] for phase in result.summary["phases"]}


def test_contact_is_detected_at_the_hand_and_not_from_the_springs(tmp_path: Path) -> None:
    known = contact_task(tmp_path, springs_known=True)
    reason, _ = run_task(known, tmp_path / "nothing")
    assert "no contact within its 2 s" in reason
    _, ended = run_task(known, tmp_path / "pushed", push=9.0)
    assert 0.4 < ended["feel"] < 0.8, ended
    _, ended = run_task(contact_task(tmp_path, springs_known=False), tmp_path / "unknown")
    assert ended["feel"] < 0.2
