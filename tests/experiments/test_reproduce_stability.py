# SPDX-License-Identifier: BSD-3-Clause
"""The limits of the endpoint stiffness: predicted by ``check``, found on the plant."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from impedance_experiments import stability_limits
from impedance_experiments.thesis_page import Settings, Size


def test_the_plant_rings_where_check_says_and_a_soft_hand_sinks(tmp_path: Path) -> None:
    facts = stability_limits.reproduce(Settings(Size.SHORT, 0, tmp_path, lambda _share, _text: None)).facts
    assert facts["worst_error"] < 0.15
    assert 300.0 < facts["limit"] < 3000.0
    assert facts["drift_10"] > 5.0 * facts["drift_100"] > 0.05
    for stiffness in (100, 10):
        np.testing.assert_allclose(
            facts[f"drift_{stiffness}"], facts[f"drift_predicted_{stiffness}"], rtol=0.15
        )
