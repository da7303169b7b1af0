# SPDX-License-Identifier: BSD-3-Clause
"""Two arms on one box: what pushes on the plant find is the arms' sum."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from impedance_experiments import two_arms
from impedance_experiments.thesis_page import Settings, Size
from impedance_experiments.two_arms import PushAnswers, ratios


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
