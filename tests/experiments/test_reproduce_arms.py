# SPDX-License-Identifier: BSD-3-Clause
"""Experiments on the arms: one arm, limits of stiffness, two arms on a box, folding links, water."""

from pathlib import Path

import numpy as np
import pytest

from impedance_experiments import (
    two_arms,
)
from impedance_experiments.thesis_page import Settings, Size
from impedance_experiments.two_arms import PushAnswers, ratios


def test_the_hand_has_its_net_stiffness_and_a_deep_spring_holds_twice_the_energy(facts_of) -> None:
    facts = facts_of("impedance-controller")
    assert abs(facts["slope_error"]) < 0.05
    assert facts["force"] == pytest.approx(20.0, abs=0.1)
    assert facts["energy_ratio"] == pytest.approx(2.0, rel=0.02)
    assert 1.0 < facts["speed_soft"] / facts["speed_stiff"] < 2.0**0.5
    assert facts["anisotropy_arm-stretched"] > 3.0 * facts["anisotropy_elbow-out"]


def test_one_joint_follows_the_equation_of_the_one_degree_of_freedom_example(facts_of) -> None:
    facts = facts_of("one-joint")
    assert facts["measured"] == pytest.approx(facts["stiffness"], rel=0.01)
    assert facts["departure"] < 0.02
    assert 0.1 < facts["overshoot"] < 0.25


def test_the_plant_rings_where_check_says_and_a_soft_hand_sinks(facts_of) -> None:
    facts = facts_of("stability-limits")
    assert facts["worst_error"] < 0.15
    assert 300.0 < facts["limit"] < 3000.0
    assert facts["drift_10"] > 5.0 * facts["drift_100"] > 0.05
    for stiffness in (100, 10):
        predicted = facts[f"drift_predicted_{stiffness}"]
        assert facts[f"drift_{stiffness}"] == pytest.approx(predicted, rel=0.15)


def test_a_pushed_box_answers_as_the_sum_of_its_arms(tmp_path: Path) -> None:
    page = two_arms.reproduce(Settings(Size.SHORT, 0, tmp_path, lambda _share, _text: None))
    facts = page.facts
    assert facts["done"] == 1.0
    assert facts["stiffness_error"] < 0.02 and facts["joint_error"] < 0.05
    assert facts["damping_error"] < 0.05
    assert facts["inertia_error"] < 0.05
    assert len(page.plots[0].figure.axes) == 3


def test_the_measures_see_a_wrong_prediction() -> None:
    random = np.random.default_rng(0)
    factor = random.normal(size=(6, 6))
    stiffness = factor @ factor.T + np.eye(6)
    wrench = random.normal(size=(6, 8))
    places = np.linalg.solve(stiffness, wrench)
    same = PushAnswers(wrench, places, places)
    np.testing.assert_allclose(same.matrix(), stiffness, rtol=1e-9)
    np.testing.assert_allclose(PushAnswers(wrench, places, 1.1 * places).errors(stiffness), 0.1, rtol=1e-9)
    np.testing.assert_allclose(ratios(1.2 * stiffness, stiffness), 1.2, rtol=1e-9)


@pytest.mark.long
def test_a_hand_under_water_floats_up_as_stiff_as_before_and_feels_heavier(facts_of) -> None:
    facts = facts_of("under-water")
    assert facts["shift"] == pytest.approx(facts["shift_predicted"], rel=0.1)
    assert facts["shift"] > 0.02
    assert facts["stiffness_ratio_y"] == pytest.approx(1.0, abs=0.06)
    assert facts["mass_ratio_y"] > 1.1
    assert facts["slower_y"] == pytest.approx(facts["slower_predicted_y"], rel=0.06)
    assert facts["slower_y"] > 1.03


def test_the_thesis_s_posture_needs_more_than_its_springs_to_carry_its_force(facts_of) -> None:
    """The plant's part, holding and folding, is in test_tune.py."""
    facts = facts_of("folding")
    assert facts["sum"] == pytest.approx(41.8, rel=0.02)
    assert facts["best_sum"] <= facts["sum"]
    assert 0.0 < facts["borne"] < 1.0


@pytest.mark.long
def test_damping_differs_by_excitation_until_the_load_is_among_the_laws(facts_of) -> None:
    facts = facts_of("nonlinear-damping")
    assert facts["dry, interactive"] > 2.0 * facts["dry, forward"]
    for excitation in ("forward", "interactive"):
        assert facts[f"load, {excitation}"] == pytest.approx(facts["truth, load"], rel=0.15)
    assert facts["quadratic"] == pytest.approx(facts["truth, quadratic"], rel=0.1)
    assert facts["swapped by load"] > 0.97 > facts["swapped by speed"]
