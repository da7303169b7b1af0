# SPDX-License-Identifier: BSD-3-Clause
"""One arm's impedance: net stiffness, inertia by posture, and a lost support."""

from __future__ import annotations

from pathlib import Path

import pytest

from impedance_experiments import impedance_controller, one_joint
from impedance_experiments.thesis_page import Settings, Size


def test_the_hand_has_its_net_stiffness_and_a_deep_spring_holds_twice_the_energy(tmp_path: Path) -> None:
    facts = impedance_controller.reproduce(
        Settings(Size.SHORT, 0, tmp_path, lambda _share, _text: None)
    ).facts
    assert abs(facts["slope_error"]) < 0.05
    assert facts["force"] == pytest.approx(20.0, abs=0.1)
    assert facts["energy_ratio"] == pytest.approx(2.0, rel=0.02)
    assert 1.0 < facts["speed_soft"] / facts["speed_stiff"] < 2.0**0.5
    assert facts["anisotropy_arm-stretched"] > 3.0 * facts["anisotropy_elbow-out"]


def test_one_joint_follows_the_equation_of_the_one_degree_of_freedom_example(tmp_path: Path) -> None:
    facts = one_joint.reproduce(Settings(Size.SHORT, 0, tmp_path, lambda _share, _text: None)).facts
    assert facts["felt"] == pytest.approx(facts["stiffness"], rel=0.01)
    assert facts["departure"] < 0.02
    assert 0.1 < facts["overshoot"] < 0.25
