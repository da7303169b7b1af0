# SPDX-License-Identifier: BSD-3-Clause
"""The proposed motion answers what a diagnosis left open, keeps every limit, and is a task that passes `check`."""

import json
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.cli.probe_verb import _write
from impedance_modules.control.assembly import assemble
from impedance_modules.diagnosis.data.nominal_model import model_of_spec
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.experiment_design.motion_library import ProbeMotion, Stroke, motions
from impedance_modules.diagnosis.experiment_design.motion_limits import (
    Clearance,
    choose_start,
    limits_of_robot,
)
from impedance_modules.diagnosis.experiment_design.probe_choice import (
    CHI_SQUARE,
    SHARE_PERHAPS,
    Probe,
    ProbeSearch,
    propose_probe,
)
from impedance_modules.diagnosis.experiment_design.probe_questions import (
    general_request,
    request_of_diagnosis,
)
from impedance_modules.diagnosis.experiment_design.separation import (
    MotionPredictor,
    SeparationPredictor,
    spring_stiffness,
)
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.spec.robot_reader import read_robot
from tests.support.commands import refusal
from tests.support.paths import TESTS

ROBOT = TESTS / "robots" / "six_joint_pair"
SPEC = read_robot(ROBOT)
MODEL = model_of_spec(SPEC, list(SPEC.joints))
JOINT = "port_lift"
PAIRS = [
    ("coulomb_friction", "link", {"fc": (1.5, "N.m")}, "viscous_friction"),
    ("torque_offset", "link", {"c": (3.0, "N.m")}, "parallel_spring"),
    ("reflected_inertia", "actuator", {"Ia": (0.3, "kg.m^2")}, "parallel_spring"),
]


def answer(effect: str, port: str, numbers: dict[str, tuple[float, str]], rival: str) -> dict[str, object]:
    """An ambiguous diagnosis as `diagnose --json` writes it, reduced to what must be there."""
    residuals = ("whole",) if port == "actuator" else ("actuator", "link")
    sizes = {"before": 1.0, "after": 0.1, "noise_floor": 0.1, "unit": "N.m", "shrink": None}
    gaps = [{"joint": joint, "residual": name, **sizes} for joint in SPEC.joints for name in residuals]
    parameters = {symbol: {"value": v, "std": 0.1, "unit": unit} for symbol, (v, unit) in numbers.items()}
    cause = {
        "effect": effect,
        "joints": [JOINT],
        "port": port,
        "weight": 0.9,
        "parameters": {JOINT: parameters},
    }
    return {
        "gap": {"per_port": gaps},
        "data": {"episodes": [], "heldout": []},
        "causes": [{**cause, "equivalent": [{"effect": rival, "joints": [JOINT]}]}],
        "next_motion": {"purpose": "", "joints": [JOINT], "excitation": "", "start": {JOINT: 0.3}},
    }


def proposed(pair: int) -> Probe:
    return propose_probe(answer(*PAIRS[pair]), MODEL, SPEC.urdf, SPEC)


def predictor_of(model, rigid, start) -> MotionPredictor:
    return MotionPredictor(model, rigid, start, spring_stiffness(model, start), "joint_sensor")


@pytest.mark.parametrize("pair", range(len(PAIRS)))
def test_the_proposal_answers_and_is_safe(pair: int) -> None:
    probe = proposed(pair)
    (expected,) = probe.proposal.expected
    assert expected.separation.chi_square >= CHI_SQUARE
    assert expected.separation.share >= SHARE_PERHAPS
    assert probe.proposal.motion.duration < 80.0
    joints = probe.predictor.model.joints
    signals = probe.predictor.record(probe.proposal.motion)
    drives = [SPEC.joints[name] for name in joints]
    assert np.all(signals.position < [drive.position_max for drive in drives])
    assert np.all(signals.position > [drive.position_min for drive in drives])
    assert np.all(np.abs(signals.velocity) < [drive.velocity_max for drive in drives])
    assert np.all(np.abs(signals.drive) < [drive.effort_max for drive in drives])
    assert Clearance(SPEC, joints).nearest(signals.position[::5])[0] > SPEC.collision.margin
    assert np.allclose(signals.position[-1], probe.predictor.start, atol=0.02)


def test_one_pose_cannot_separate_an_offset_from_a_spring() -> None:
    request = request_of_diagnosis(answer(*PAIRS[1]), MODEL.tree)
    room = limits_of_robot(SPEC, MODEL.joints)
    start = 0.5 * (room.lower + room.upper)
    predictor = predictor_of(MODEL, BatchedRigidModel.of_tree(SPEC.urdf, MODEL.tree), start)
    index, shares = MODEL.joints.index(JOINT), []
    for way in (0.01, 0.5):
        there, back = start[index] + way, start[index] - way
        strokes = tuple(Stroke({index: float(place)}, 1.5) for place in (there, back, there, back))
        signals = predictor.record(ProbeMotion(start, strokes, ()))
        found = SeparationPredictor(request, MODEL).separate(signals, request.questions)
        shares.append(found[0].chi_square)
    assert shares[0] < CHI_SQUARE < shares[1]


def test_the_joints_follow_as_predicted_by_their_own_equation() -> None:
    probe = proposed(0)
    predictor, motion = probe.predictor, probe.proposal.motion
    time, q = predictor.position(motion)
    v = np.gradient(q, time, axis=0)
    a = np.gradient(v, time, axis=0)
    # At rest at the end of long waits, and pushed towards the rest posture in between.
    joint = motion.moved[0]
    pull = motion.rest(time)[:, joint] - q[:, joint]
    moving = np.abs(a[:, joint]) > 0.5 * np.abs(a[:, joint]).max()
    damped = a[:, joint] + 2.0 * 0.8 * 2.0 * np.pi * 1.2 * v[:, joint]
    assert np.corrcoef(damped[moving], pull[moving])[0, 1] > 0.9


def test_the_task_passes_check(tmp_path: Path) -> None:
    _write(proposed(0), SPEC, tmp_path)
    assembly = assemble(str(tmp_path / "probe.yaml"), effects=None, rate=None, scale=1.0, arm=None)
    refuse_infeasible(assembly)
    assert json.loads((tmp_path / "probe.json").read_text())["questions"][0]["answered"]


def test_a_wrong_diagnosis_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "d.json"
    path.write_text(json.dumps({"format": 1}))
    assert "required" in refusal("probe", path, "--robot", ROBOT, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_baxter_has_a_start_from_which_its_heaviest_joint_may_move() -> None:
    """Weights alone ask for more than half of what the shoulders may use: a start must leave room for moving."""
    spec = read_robot("baxter")
    model = model_of_spec(spec, list(spec.joints))
    room, clearance = limits_of_robot(spec, model.joints), Clearance(spec, model.joints)
    rigid = BatchedRigidModel.of_tree(spec.urdf, model.tree)
    start = choose_start(room, {}, clearance, rigid.weight)
    predictor = predictor_of(model, rigid, start)
    search = ProbeSearch(general_request(model.joints, {}), predictor, room, clearance)
    heaviest = int(np.argmax(np.abs(rigid.weight(start[None])[0]) / room.effort))
    safe = [
        motion.kinds[0].split()[0]
        for motion in motions(room, start, heaviest, 0.5, rigid.weight)
        if search.objection(predictor.record(motion)) is None
    ]
    assert {"ladder", "reversals", "chirp"} <= set(safe)


def test_joints_that_no_recording_had_are_asked_about_as_well() -> None:
    found = answer(*PAIRS[0])
    gaps = [gap for gap in found["gap"]["per_port"] if gap["joint"] == JOINT]
    nothing_open = {**found, "gap": {"per_port": gaps}, "causes": []}
    probe = propose_probe(nothing_open, model_of_spec(SPEC, [JOINT, "port_bend"]), SPEC.urdf, None)
    assert {question.joints for question in probe.request.questions} == {(JOINT,), ("port_bend",)}
    assert all(expected.separation.chi_square > 0.0 for expected in probe.proposal.expected)


def test_a_rival_of_bodies_is_a_question_about_its_link_and_minor_causes_are_none() -> None:
    open_one = answer("torque_offset", "link", {"c": (3.0, "N.m")}, "payload")
    slight = {**open_one, "causes": [{**open_one["causes"][0], "weight": 0.001}]}
    asked, minor = (request_of_diagnosis(found, MODEL.tree).questions for found in (open_one, slight))
    assert [question.second.key for question in asked] == ["port_upper_arm"]
    assert all(question.second.effect != "payload" for question in minor)
