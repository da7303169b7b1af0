# SPDX-License-Identifier: BSD-3-Clause
"""A patch given to `diagnose`: refused whole where it does not fit, and cut to what was recorded."""

from pathlib import Path

import pytest

from impedance_modules.diagnosis.data.model_file import ComparedModel, compared_model
from impedance_modules.diagnosis.data.nominal_model import model_of_spec
from impedance_modules.diagnosis.known_effects import read_known_effects
from impedance_modules.effects.patch_check import PatchTarget
from impedance_modules.errors import BadFile
from impedance_modules.spec.robot_reader import read_robot
from tests.diagnosis.test_diagnosis import JOINTS, URDF
from tests.diagnosis.test_diagnosis_data import diagnose, good

HEAD = 'format: 1\nrobot: {robot}\nprovenance: {{origin: hand, date: "2026-11-29"}}\neffects:\n'
VISCOUS = (
    "  - effect: viscous_friction\n    joints: [{joint}]\n    port: link\n    parameters:\n"
    "      {joint}: {{fv: {{value: {value}, unit: {unit}}}}}\n"
)


def write(folder: Path, robot: str, *effects: str) -> Path:
    path = folder / "patch.yaml"
    path.write_text(HEAD.format(robot=robot) + "".join(effects))
    return path


@pytest.mark.parametrize(
    ("joint", "value", "unit", "where", "words"),
    [
        ("elbow", -1.0, "N.m.s/rad", "9:27", "fv = -1 N.m.s/rad is not physical"),
        ("elbow", 0.3, "N.s/m", "9:38", "fv is in N.m.s/rad, not in 'N.s/m'"),
        ("elbw", 0.3, "N.m.s/rad", "6:14", "has no joint 'elbw'; did you mean 'elbow'?"),
    ],
)
def test_a_patch_that_does_not_fit_is_refused_at_its_place(tmp_path, joint, value, unit, where, words):
    urdf = tmp_path / "pendulum.urdf"
    urdf.write_text(URDF)
    patch = write(tmp_path, "pendulum", VISCOUS.format(joint=joint, value=value, unit=unit))
    code, said = diagnose(urdf, *good(tmp_path), "--effects", patch, "--json", tmp_path / "answer.json")
    assert code == 2 and f"{patch}:{where}" in said and words in said, said
    assert not (tmp_path / "answer.json").exists()


def baxter_right() -> ComparedModel:
    spec = read_robot("baxter")
    joints = [name for name in spec.joints if name.startswith("right")]
    return ComparedModel(model_of_spec(spec, joints), spec.urdf, lambda: PatchTarget.of_robot(spec), ())


BOTH_ARMS = (
    "  - effect: viscous_friction\n    joints: [right_e1, left_e1]\n    port: link\n    parameters:\n"
    "      right_e1: {fv: {value: 0.3, unit: N.m.s/rad}}\n"
    "      left_e1: {fv: {value: 0.4, unit: N.m.s/rad}}\n",
    "  - effect: payload\n    joints: []\n    port: link\n    parameters:\n"
    "      left_hand: {m: {value: 0.4, unit: kg}, "
    "cx: {value: 0, unit: m}, cy: {value: 0, unit: m}, cz: {value: 0.1, unit: m}}\n",
    "  - effect: payload\n    joints: []\n    port: link\n    parameters:\n"
    "      right_hand: {m: {value: 0.2, unit: kg}, "
    "cx: {value: 0, unit: m}, cy: {value: 0, unit: m}, cz: {value: 0.1, unit: m}}\n",
    "  - effect: base_tilt\n    joints: []\n    port: link\n    parameters:\n"
    "      base: {rx: {value: 0.01, unit: rad}, ry: {value: 0.0, unit: rad}}\n",
)


def test_what_the_recordings_do_not_move_is_left_out_and_said(tmp_path):
    notes: list[str] = []
    known = read_known_effects(write(tmp_path, "baxter", *BOTH_ARMS), baxter_right(), notes.append)
    assert [(spec.effect, spec.joints, tuple(spec.parameters)) for spec in known] == [
        ("viscous_friction", ("right_e1",), ("right_e1",)),
        ("payload", (), ("right_hand",)),
        ("base_tilt", (), ("base",)),
    ]
    assert len(notes) == 2
    assert "viscous_friction of left_e1 is left out" in notes[0]
    assert "payload of left_hand is left out" in notes[1]


def test_a_joint_that_stood_may_be_named(tmp_path):
    urdf = tmp_path / "pendulum.urdf"
    urdf.write_text(URDF)
    effects = [VISCOUS.format(joint=joint, value=0.3, unit="N.m.s/rad") for joint in JOINTS]
    patch, notes = write(tmp_path, "pendulum", *effects), []
    with compared_model(urdf, {JOINTS[1]: 0.0}, {JOINTS[0]: 0.1}) as compared:
        known = read_known_effects(patch, compared, notes.append)
    assert [spec.joints for spec in known] == [(JOINTS[1],)]
    assert len(notes) == 1 and JOINTS[0] in notes[0]


def test_every_problem_is_said_at_once_and_another_robots_patch_is_refused(tmp_path):
    bad = [VISCOUS.format(joint=joint, value=-1.0, unit="N.m.s/rad") for joint in ("right_e1", "left_e1")]
    with pytest.raises(BadFile) as caught:
        read_known_effects(write(tmp_path, "baxter", *bad), baxter_right(), lambda _: None)
    assert len(caught.value.problems) == 2
    with pytest.raises(BadFile, match=r"patch\.yaml:2:8: .*robot 'crane', the model is 'baxter'"):
        read_known_effects(write(tmp_path, "crane", bad[0]), baxter_right(), lambda _: None)
