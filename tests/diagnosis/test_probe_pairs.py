# SPDX-License-Identifier: BSD-3-Clause
"""Confusable pairs of the catalogue: each is asked about, and the probe answers or says why no motion does.

``python -m benchmarks.probe_pairs`` records all of them on the plant; here some are.
"""

from pathlib import Path
from typing import Any

import pytest

from benchmarks.probe_pairs.course import run_case
from benchmarks.probe_pairs.pairs import JOINT, OTHER, PairCase, case_of, pair_cases, unordered_pairs
from benchmarks.probe_pairs.robot import write_robot
from impedance_modules.diagnosis.data.nominal_model import NominalModel, model_of_spec
from impedance_modules.diagnosis.experiment_design.open_reasons import open_reason
from impedance_modules.diagnosis.experiment_design.probe_choice import ExpectedAnswer, propose_probe
from impedance_modules.diagnosis.experiment_design.probe_questions import ProbeQuestion, request_of_diagnosis
from impedance_modules.diagnosis.experiment_design.separation import Separation
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import RobotSpec

EXPECTED = {
    ("coulomb_friction", "viscous_friction"): "yes",
    ("torque_offset", "buoyancy"): "yes",
    ("base_tilt", "payload"): "yes",
    ("backlash", "hysteresis"): "yes",
    ("actuator_lag", "reflected_inertia"): "yes",
    ("clock_drift", "actuator_lag"): "yes",
    ("coulomb_friction", "surface_friction"): "yes",
    ("surface_friction", "coulomb_friction"): "yes",
    ("torque_offset", "base_tilt"): "perhaps: the rival comes near",
    ("bench_spring", "parallel_spring"): "no motion of the library does",
    ("command_delay", "actuator_lag"): "no motion of the library does",
}
"""One pair of each family, and what the probe expects."""

RESOLVED = (("torque_offset", "parallel_spring"),)
"""Pairs that poor recordings of the benchmark leave open, and whose truth stands alone after the probe."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def known(robot: Path) -> tuple[RobotSpec, NominalModel]:
    spec = read_robot(robot)
    return spec, model_of_spec(spec, list(spec.joints))


def joints_of(effect: str) -> list[str]:
    kinds = set(CATALOGUE[effect].description.keys)
    return [JOINT] if kinds & {"joint", "pair"} else [OTHER] if "body" in kinds else []


def answer(case: PairCase, joints: list[str]) -> dict[str, Any]:
    """An ambiguous diagnosis of a pair, reduced to what must be there."""
    torques = ("actuator", "link") if case.torque_sensor else ("whole",)
    noise = {**dict.fromkeys(torques, 0.1), "velocity": 0.01}
    gaps = [
        {"joint": joint, "residual": name, "before": 1.0, "after": 0.1, "noise_floor": size}
        for joint in joints
        for name, size in noise.items()
    ]
    truth = case.truth
    cause = {
        "effect": truth.effect,
        "joints": joints_of(truth.effect),
        "port": truth.port,
        "weight": 0.9,
        "parameters": {truth.key: {symbol: {"value": value} for symbol, value in truth.numbers.items()}},
        "equivalent": [{"effect": case.partner, "joints": joints_of(case.partner)}],
    }
    start = {"port_turn": 0.13, JOINT: 0.5, OTHER: -1.2}
    return {
        "gap": {"per_port": gaps},
        "data": {"episodes": [], "heldout": []},
        "causes": [cause],
        "next_motion": {"start": start},
    }


def test_the_catalogue_has_both_directions_of_every_pair() -> None:
    cases = list(pair_cases())
    assert len({case.name for case in cases}) == len(cases) == 2 * len(unordered_pairs())
    for effect in CATALOGUE.values():
        for other in effect.description.confusable_with:
            assert case_of(effect.id, other) in cases


@pytest.mark.parametrize("case", list(pair_cases()), ids=lambda case: case.name)
def test_every_pair_is_asked_about(known: tuple, case: PairCase) -> None:
    """Whatever carries the numbers of the two: joints, pairs of joints, bodies, the base or the log."""
    spec, model = known
    asked = request_of_diagnosis(answer(case, list(spec.joints)), model.tree).questions
    assert asked
    assert {(q.first.effect, q.second.effect) for q in asked} == {(case.truth.effect, case.partner)}
    assert all(q.first.key == case.truth.key for q in asked)


@pytest.mark.parametrize(("truth", "partner"), EXPECTED, ids=["--".join(pair) for pair in EXPECTED])
def test_the_probe_answers_a_pair_or_says_why_no_motion_does(known: tuple, truth: str, partner: str) -> None:
    spec, model = known
    case = case_of(truth, partner)
    probe = propose_probe(answer(case, list(spec.joints)), model, spec.urdf, spec)
    for expected in probe.proposal.expected:
        assert expected.outlook == EXPECTED[truth, partner], expected.separation
        if expected.reason and CATALOGUE[truth].searched != "never":
            assert "record" in expected.reason


def test_a_reason_says_what_to_record(known: tuple) -> None:
    spec, model = known

    def question(truth: str, partner: str) -> ProbeQuestion:
        case = case_of(truth, partner)
        return request_of_diagnosis(answer(case, list(spec.joints)), model.tree).questions[0]

    gain = question("torque_gain", "payload")
    imitated = open_reason(gain, Separation(1500.0, 0.004))
    assert "99.6 %" in imitated and "a known added mass" in imitated
    assert "5 times" in open_reason(gain, Separation(41.0, 0.5))
    assert "times" not in open_reason(gain, Separation(1.0, 0.5))
    assert "neither" in open_reason(gain, Separation(0.0, 0.0))
    assert "one law" in open_reason(question("bench_spring", "parallel_spring"), Separation(5000.0, 0.9))
    assert not ExpectedAnswer(gain, Separation(500.0, 0.01)).likely
    assert ExpectedAnswer(gain, Separation(50000.0, 0.01)).likely


@pytest.mark.long
@pytest.mark.parametrize(("truth", "partner"), RESOLVED, ids=["--".join(pair) for pair in RESOLVED])
def test_an_ambiguous_pair_is_right_after_the_probe(
    robot: Path, tmp_path: Path, truth: str, partner: str
) -> None:
    found = run_case(case_of(truth, partner), robot, tmp_path)
    assert found["before"] in ("both", "set", "refused"), found
    assert found["after"] == "right", found
