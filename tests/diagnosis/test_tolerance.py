# SPDX-License-Identifier: BSD-3-Clause
"""A gap within the tolerance raises no alarm, is listed, and is told all the same by whoever asks for it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection.tolerance import DRIFT, ranges, stays_near
from impedance_modules.diagnosis.result import RolloutError
from tests.diagnosis.test_diagnosis import URDF, answer, record
from tests.support.commands import invoke


def test_little_friction_is_small_by_default_and_a_cause_without_tolerance(tmp_path: Path) -> None:
    """0.012 N.m of a joint that carries some 3 N.m; sensors of a few mN.m see it for certain."""
    paths = record(tmp_path, "little friction", noise=0.003, jitter=3e-5)
    code, found = answer(tmp_path, paths)
    assert (code, found["verdict"], found["causes"], found["patch"]) == (0, "no_gap", [], None)
    (small,) = found["small"]
    assert (small["effect"], small["joints"], found["tolerance"]) == ("coulomb_friction", ["elbow"], 0.01)
    assert small["parameters"]["elbow"]["fc"]["value"] == pytest.approx(0.012, rel=0.1)
    assert (
        "within the tolerance of 1 %" in found["remainder"]["structure"] and found["remainder"]["explained"]
    )
    code, found = answer(tmp_path, paths, "--tolerance", "0.001")
    assert (found["verdict"], found["small"]) == ("explained", [])
    assert [cause["effect"] for cause in found["causes"]] == ["coulomb_friction"]


def test_a_remainder_is_small_only_if_the_simulated_motion_is_near(tmp_path: Path) -> None:
    paths = record(tmp_path, "tone", noise=1e-5, jitter=1e-8)
    assert answer(tmp_path, paths)[1]["verdict"] == "no_gap"
    assert answer(tmp_path, paths, "--tolerance", "0.002")[1]["verdict"] == "unexplained"


def test_what_is_small_is_printed_and_in_the_report(tmp_path: Path) -> None:
    paths = record(tmp_path, "little friction", noise=0.003, jitter=3e-5)
    (tmp_path / "robot.urdf").write_text(URDF)
    report = tmp_path / "report.html"
    shown = invoke("diagnose", *paths, "--urdf", tmp_path / "robot.urdf", "--report", report).output
    assert "no_gap" in shown
    small = shown[shown.index("small, within 1 % of the joints' ranges of torque and motion:") :]
    assert "coulomb_friction on elbow" in small
    assert "<h2>Small</h2>" in report.read_text() and "coulomb_friction on elbow" in report.read_text()


def recording(torque: float, travel: float, speed: float) -> SimpleNamespace:
    one = np.array([[-0.5], [0.5]])
    tree = SimpleNamespace(joints=("hinge",))
    return SimpleNamespace(load=torque * one, position=travel * one, velocity=speed * one, tree=tree)


def test_ranges_are_over_all_recordings_and_of_the_residual_s_own_quantity() -> None:
    items = [recording(2.0, 1.0, 5.0), recording(8.0, 1.0, 3.0)]
    np.testing.assert_allclose(ranges(items, [("link", 0), ("velocity", 0)]), [8.0, 5.0])


@pytest.mark.parametrize(
    ("before", "noise", "near"),
    [(0.019, 0.0, True), (0.021, 0.0, False), (0.021, 0.021 / DRIFT + 1e-6, True), (0.021, 0.01, False)],
)
def test_motion_stays_near_within_its_range_or_its_noise(before: float, noise: float, near: bool) -> None:
    rollout = SimpleNamespace(position={"hinge": RolloutError(before, 0.0, noise, "rad")})
    assert stays_near(rollout, [recording(1.0, 2.0, 1.0)], 0.01) is near
