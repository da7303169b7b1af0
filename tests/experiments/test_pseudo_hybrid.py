# SPDX-License-Identifier: BSD-3-Clause
"""Pressing by a force (4.35) and by a spring (4.37): the map's error, and a push that is stronger."""

import numpy as np
import pytest

from impedance_experiments.pseudo_hybrid import Press


def test_a_force_keeps_its_size_and_gives_way_a_spring_errs_and_holds(facts_of) -> None:
    facts = facts_of("pseudo-hybrid")
    assert facts["force, done"] == facts["spring, done"] == 1.0
    for way in ("force", "spring"):
        assert facts[f"{way}, pressed"] == pytest.approx(20.0, abs=1.0)
        # Over the map's error the force changes by the hand's net stiffness, the joint springs included.
        assert facts[f"{way}, slope"] == pytest.approx(facts[f"{way}, net"], abs=3.0)
    assert facts["force, declared"] == 0.0 and facts["spring, declared"] == 100.0
    assert facts["force, speed"] > 3.0 * facts["spring, speed"] > -0.001
    assert facts["force, lifted"] > facts["spring, lifted"] > 0.04


def test_a_press_is_read_before_the_push_and_at_its_end() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    height = np.where(time < 4.0, 0.0, 0.02 * (time - 4.0))
    force = np.where(time < 4.0, 20.0, 0.0)
    found = Press(time, height, force, 4.0, 8.0, "done")
    assert found.pressed == pytest.approx(20.0)
    assert found.lifted == pytest.approx(0.08) and found.speed == pytest.approx(0.02)
