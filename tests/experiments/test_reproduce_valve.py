# SPDX-License-Identifier: BSD-3-Clause
"""A valve tested by one hand and by two: its torque, the rule, the sum about the axis (thesis 1.2)."""

from pathlib import Path

import numpy as np
import pytest

from impedance_experiments.valve_reaction import reactions
from impedance_experiments.valve_runs import TASKS, ValveTest, operable


def a_test(moved: float, needed: float) -> ValveTest:
    nothing = np.zeros(1)
    return ValveTest(1.0, nothing, nothing, nothing, moved, needed, needed, 0.0, 0.0)


def test_a_valve_must_have_turned_and_needed_little() -> None:
    assert operable(a_test(0.1, 1.4), 1.5)
    assert not operable(a_test(0.1, 1.6), 1.5)
    assert not operable(a_test(0.001, 0.1), 1.5)


@pytest.mark.parametrize("task", TASKS.values())
def test_a_hinge_adds_to_the_inertia_and_stiffness_that_a_torque_meets(task: str) -> None:
    """Constraints only make heavier and stiffer: S^T A S against 1 / (a^T A^-1 a)."""
    free, hinged = reactions(task)
    assert hinged.inertia >= free.inertia > 0.0
    assert hinged.stiffness >= free.stiffness > 0.0


def test_the_recording_tells_the_torque_and_the_plant_shows_the_sum(facts_of, tmp_path: Path) -> None:
    facts = facts_of("valve")
    for hands in ("one", "two"):
        assert facts[f"{hands}_error"] < 0.04
        assert facts[f"{hands}_stuck"] == 0.0
        assert facts[f"{hands}_wrong"] == 0.0
        assert facts[f"{hands}_stiffness"] == pytest.approx(1.0, abs=0.03)
