# SPDX-License-Identifier: BSD-3-Clause
"""``analyze``: its JSON by the contract, and its matrices against displacements measured by the statics."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.errors import BadInput
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.prediction.analysis import FrameImpedance, analyse_task
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.prediction.statics import Loads, find_rest
from impedance_modules.robot.pose import Pose, carry
from tests.support import arm_samples
from tests.support.commands import invoke, refusal
from tests.support.forecast_tasks import BOX, HOLD_AND_LIFT, assembled, wipe, write_task
from tests.support.paths import CHECKOUT

PATCH = CHECKOUT / "robots" / "baxter" / "patches" / "without-reflected-inertia.yaml"
JOINTS = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
KEYS = {
    "frame", "position", "q", "inertia", "inertia_without_reflected", "mobility", "damping", "stiffness",
    "compliance", "stiffness_without_preload", "preload", "folds", "phase",
    "orientation", "until_rest", "friction", "wrench", "pressure", "ellipsoids", "modes",
}  # fmt: skip
OF_THE_SUM = {"summands", "squeeze", "internal", "coupling"}


def analyse(path: Path, folder: Path, *options: str) -> tuple[dict, str]:
    file = folder / "analysis.json"
    printed = invoke("analyze", path, "--json", file, *options).stdout
    return json.loads(file.read_text()), printed


def matrix(found: dict, name: str) -> np.ndarray:
    value = np.array(found[name])
    assert value.shape == (6, 6) and np.isfinite(value).all()
    return value


def test_the_json_keeps_the_contract(tmp_path: Path) -> None:
    found, printed = analyse(write_task(tmp_path, BOX), tmp_path)
    assert set(found) == {"format", "arms", "object"} and found["format"] == 1
    assert set(found["arms"]) == {"right", "left"}
    for at_frame, frame, joints in (
        (found["arms"]["right"], "right_hand", 7),
        (found["arms"]["left"], "left_hand", 7),
        (found["object"], "object", 14),
    ):
        assert set(at_frame) == KEYS | (OF_THE_SUM if frame == "object" else set())
        assert at_frame["frame"] == frame and at_frame["phase"] is None and at_frame["folds"] is False
        sizes = [len(at_frame[name]) for name in ("position", "preload", "q")]
        assert sizes == [3, 6, joints]
        for name in ("inertia", "inertia_without_reflected", "mobility", "damping", "stiffness"):
            matrix(at_frame, name)
        assert at_frame["compliance"] is None
        unit = matrix(at_frame, "inertia") @ matrix(at_frame, "mobility")
        np.testing.assert_allclose(unit, np.eye(6), atol=1e-8)
    words = "inertia of 'left', at the object; mirror plane; squeeze; ellipsoids; modes; damping"
    assert all(word in printed for word in words.split("; "))
    free, _ = analyse(write_task(tmp_path, HOLD_AND_LIFT), tmp_path, "--phase", "lift")
    assert free["object"] is None and free["arms"]["right"]["phase"] == "lift"


def test_the_object_is_the_sum_of_the_arms_carried_to_it(tmp_path: Path) -> None:
    """Eq. 4.30 from the JSON alone: inertia and damping of both arms, and the box's own inertia."""
    found, _ = analyse(write_task(tmp_path, BOX), tmp_path, "--phase", "raise")
    held = found["object"]
    total, damping = np.zeros((6, 6)), np.zeros((6, 6))
    for arm in found["arms"].values():
        X = carry(np.array(arm["position"]) - np.array(held["position"]))
        total += X.T @ matrix(arm, "inertia") @ X
        damping += X.T @ matrix(arm, "damping") @ X
    own = matrix(held, "inertia") - total
    np.testing.assert_allclose(own[:3, :3], np.eye(3), atol=1e-9)
    moments = np.sort(np.linalg.eigvalsh(own[3:, 3:]))
    np.testing.assert_allclose(moments, np.array([0.08, 0.13, 0.13]) / 12.0, atol=1e-9)
    np.testing.assert_allclose(matrix(held, "damping"), damping, atol=1e-8)


def test_the_patch_takes_the_reflected_inertia_away(tmp_path: Path) -> None:
    same = partial(np.testing.assert_allclose, rtol=1e-6, atol=1e-9)
    path = write_task(tmp_path, BOX)
    (nominal, _), (bare, _) = analyse(path, tmp_path), analyse(path, tmp_path, "--effects", str(PATCH))
    for name in ("right", "left"):
        with_rotors, without = nominal["arms"][name], bare["arms"][name]
        same(without["inertia"], with_rotors["inertia_without_reflected"])
        heavier = matrix(with_rotors, "inertia") - matrix(without, "inertia")
        assert np.linalg.eigvalsh(0.5 * (heavier + heavier.T))[0] > 0.0
        np.testing.assert_allclose(with_rotors["stiffness"], without["stiffness"], atol=1e-9)
    same(bare["object"]["inertia"], nominal["object"]["inertia_without_reflected"])


def measured_compliance(path: Path, phase: str, frame: str) -> tuple[np.ndarray, FrameImpedance]:
    """Pushes a frame at rest in contact, the surfaces' force kept as it was, and watches it move."""
    assembly = assembled(path)
    found = analyse_task(assembly, phase)
    at_frame = found.object if frame == OBJECT else next(f for f in found.arms.values() if f.frame == frame)
    names = [spec.name for spec in assembly.task.phases]
    phase_end = predict_motion(assembly).phases[names.index(phase)]
    mechanism = Mechanism(assembly)
    frames = [f for f in (*found.arms.values(), found.object) if f is not None]
    pressed = {f.frame: f.pressure for f in frames if np.any(f.pressure)}
    assert pressed and max(np.linalg.norm(wrench[:3]) for wrench in pressed.values()) > 1.0

    def pushed(push: np.ndarray) -> Pose:
        pushes = {**pressed, frame: pressed.get(frame, np.zeros(6)) + push}
        rest = find_rest(mechanism, phase_end.setting, phase_end.q, Loads(pushes, surfaces=False))
        assert rest is not None
        mechanism.update(rest.q, np.zeros_like(rest.q))
        return mechanism.object_pose() if frame == OBJECT else mechanism.kinematics.pose(frame)

    return arm_samples.measured_compliance(pushed), at_frame


def test_a_hand_on_a_table_yields_as_printed(tmp_path: Path) -> None:
    compliance, at_frame = measured_compliance(wipe(tmp_path), "press", "right_hand")
    np.testing.assert_allclose(at_frame.stiffness @ compliance, np.eye(6), atol=2e-4)
    # Its load matters: the relaxed springs would not do.
    assert np.max(np.abs(at_frame.stiffness_without_preload @ compliance - np.eye(6))) > 1e-2


def test_a_box_on_a_table_yields_as_the_sum_says(tmp_path: Path) -> None:
    compliance, at_frame = measured_compliance(write_task(tmp_path, BOX), "lower", OBJECT)
    np.testing.assert_allclose(at_frame.stiffness @ compliance, np.eye(6), atol=2e-4)
    # At rest the modules carry what the table and the weight put on the box.
    pressure = analyse_task(assembled(tmp_path / "task.yaml"), "lower").object.pressure[2]
    assert at_frame.wrench[2] == pytest.approx(9.81 - float(pressure), abs=1e-6)


def test_singular_joint_springs_give_the_compliance_instead(tmp_path: Path) -> None:
    """A task without joint bias: the hands' springs alone hold the arms."""
    bias = next(line for line in BOX.splitlines() if "joint_bias" in line)
    found, _ = analyse(write_task(tmp_path, BOX, (bias + "\n", "")), tmp_path)
    for at_frame in (*found["arms"].values(), found["object"]):
        assert at_frame["stiffness"] is None and at_frame["damping"] is None and at_frame["folds"] is False
    hand = np.diag([1 / 200, 1 / 200, 1 / 200, 1 / 5, 1 / 5, 1 / 5])
    np.testing.assert_allclose(found["arms"]["right"]["compliance"], hand, atol=1e-9)
    held = found["object"]
    total = np.zeros((6, 6))
    for arm in found["arms"].values():
        X = carry(np.array(arm["position"]) - np.array(held["position"]))
        total += X.T @ np.linalg.inv(hand) @ X
    np.testing.assert_allclose(matrix(held, "compliance") @ total, np.eye(6), atol=1e-6)


def test_a_singular_posture_has_a_mobility_and_no_inertia(tmp_path: Path) -> None:
    """In this posture (found by search) no joint motion turns the hand about one direction."""
    posture = next(line for line in HOLD_AND_LIFT.splitlines() if "posture" in line)
    angles = (0.450101632, -1.584106238, -1.70517559, -0.005707083, 1.910251067, 2.092738563, 0.682882511)
    named = ", ".join(f"{joint}: {angle}" for joint, angle in zip(JOINTS, angles, strict=True))
    path = write_task(tmp_path, HOLD_AND_LIFT, (posture, f"    posture: {{{named}}}"))
    at_frame = analyse(path, tmp_path)[0]["arms"]["right"]
    assert at_frame["inertia"] is None and at_frame["stiffness"] is None
    assert np.linalg.cond(matrix(at_frame, "mobility")) > 1e9


def test_bad_requests_are_told_what_is_valid(tmp_path: Path) -> None:
    path = write_task(tmp_path, HOLD_AND_LIFT)
    with pytest.raises(BadInput, match=r"no such phase; did you mean 'lift'\? \(valid: hold, lift\)"):
        analyse_task(assembled(path), "lifft")
    where = tmp_path / "no" / "where.json"
    assert "cannot be written" in refusal("analyze", path, "--json", where)
