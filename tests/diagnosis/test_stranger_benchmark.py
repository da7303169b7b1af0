# SPDX-License-Identifier: BSD-3-Clause
"""The stranger's benchmark: its generator is the one that was sealed, and answers are judged as documented."""

import hashlib
from pathlib import Path

import pytest

import benchmarks.stranger
from benchmarks.stranger.scoring import judged, matches

FOLDER = Path(benchmarks.stranger.__file__).parent


def named(effect, joints=(), **more):
    return {"effect": effect, "joints": list(joints), "equivalent": [], "parameters": {}, **more}


def test_no_file_has_changed_since_it_was_sealed():
    sealed = dict(reversed(line.split()) for line in (FOLDER / "seals.txt").read_text().splitlines())
    found = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in FOLDER.glob("*.py")}
    assert found == sealed


@pytest.mark.parametrize(
    ("true", "answer", "right"),
    [
        (named("payload", ["wrist"]), named("link_inertia", ["wrist"]), True),
        (named("payload", ["wrist"]), named("payload", ["elbow"]), False),
        (named("coulomb_friction", ["wrist"]), named("hysteresis", ["wrist"]), False),
        (named("external_contact", ["wrist"]), named("external_contact", parameters={"hand": {}}), True),
        (named("crosstalk", ["a", "b"]), named("crosstalk", ["a"], parameters={"a<-b": {}}), True),
        (named("crosstalk", ["a", "b"]), named("crosstalk", ["a"], parameters={"a<-c": {}}), False),
        (
            named("crosstalk", ["a", "b"]),
            named("transmission_coupling", ["a"], parameters={"a<-b": {}}),
            False,
        ),
    ],
)
def test_a_name_is_right_at_its_joints_or_its_link(true, answer, right):
    assert matches(true, answer) is right


def test_a_clean_case_is_right_without_a_gap_and_another_by_its_first_cause():
    clean = {"block": "B", "effects": []}
    assert judged(clean, {"verdict": "no_gap", "causes": []}) == {"no gap": True, "a cause named": False}
    single = {"block": "A", "effects": [named("payload", ["wrist"])]}
    causes = [named("torque_gain", ["wrist"]), named("payload", ["wrist"])]
    found = judged(single, {"verdict": "explained", "causes": causes})
    assert found["all named as causes"] and found["explained"] and not found["first cause right"]
