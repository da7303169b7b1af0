# SPDX-License-Identifier: BSD-3-Clause
"""The thesis's outlook (chapter 6): links that fold, and a hand under water."""

from __future__ import annotations

from pathlib import Path

import pytest

from impedance_experiments import folding, nonlinear_damping, under_water
from impedance_experiments.thesis_page import Settings, Size


def test_a_hand_under_water_floats_up_as_stiff_as_before_and_feels_heavier(tmp_path: Path) -> None:
    facts = under_water.reproduce(Settings(Size.SHORT, 0, tmp_path, lambda _share, _text: None)).facts
    assert facts["shift"] == pytest.approx(facts["shift_predicted"], rel=0.1)
    assert facts["shift"] > 0.02
    assert facts["stiffness_ratio_y"] == pytest.approx(1.0, abs=0.06)
    assert facts["mass_ratio_y"] > 1.1
    assert facts["slower_y"] == pytest.approx(facts["slower_predicted_y"], rel=0.06)
    assert facts["slower_y"] > 1.03


def test_the_thesis_s_posture_needs_more_than_its_springs_to_carry_its_force(tmp_path: Path) -> None:
    """The plant's part, holding and folding, is in test_tune.py."""
    facts = folding.reproduce(Settings(Size.SHORT, 0, tmp_path, lambda _share, _text: None)).facts
    assert facts["sum"] == pytest.approx(41.8, rel=0.02)
    assert facts["best_sum"] <= facts["sum"]
    assert 0.0 < facts["borne"] < 1.0


def test_damping_differs_by_excitation_until_the_load_is_among_the_laws(tmp_path: Path) -> None:
    facts = nonlinear_damping.reproduce(Settings(Size.SHORT, 0, tmp_path, lambda _share, _text: None)).facts
    assert facts["dry, interactive"] > 2.0 * facts["dry, forward"]
    for excitation in ("forward", "interactive"):
        assert facts[f"load, {excitation}"] == pytest.approx(facts["truth, load"], rel=0.15)
    assert facts["quadratic"] == pytest.approx(facts["truth, quadratic"], rel=0.1)
    assert facts["swapped by load"] > 0.97 > facts["swapped by speed"]
