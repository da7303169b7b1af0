# SPDX-License-Identifier: BSD-3-Clause
"""Planar arms summed by the package, against the printed matrices and against a calculation that shares nothing."""

import numpy as np
import pytest

from impedance_experiments.planar_arms import PLANE, PRINTED, planar_inertia_of
from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.prediction.feasibility import refuse_infeasible
from tests.reference.planar_chain import planar_inertia

ANGLES = {"right": (45.0, -45.0, 90.0), "left": (-45.0, 45.0, 90.0)}
"""Of the links against the x axis [deg]."""


@pytest.fixture(scope="module")
def assembly():
    return assemble("planar-arms", effects=None, rate=None, scale=1.0, arm=None)


def test_each_arm_and_their_sum_are_what_kinetic_energy_says(assembly) -> None:
    held = analyse_task(assembly, None).sum
    assert held is not None
    hands = held.hands
    alone = {name: planar_inertia(np.radians(angles)) for name, angles in ANGLES.items()}
    for name, expected in alone.items():
        np.testing.assert_allclose(planar_inertia_of([hands[name]]), expected, rtol=1e-9, atol=1e-9)
    both = planar_inertia_of([hands["right"], hands["left"]])
    np.testing.assert_allclose(both, alone["right"] + alone["left"], rtol=1e-9, atol=1e-9)


def test_the_page_has_the_printed_digits(facts_of) -> None:
    facts = facts_of("planar-arms")
    assert facts["worst"] < 0.006 and facts["coupling"] < 1e-9
    assert set(PRINTED) == {"eq. 4.28, right arm", "eq. 4.29, left arm", "eq. 4.30, both"}


def test_arms_that_cannot_leave_their_plane_can_hold_an_object(assembly) -> None:
    """Their hands agree out of the plane whatever the joints do: no row says so, and the statics have an answer."""
    prediction = refuse_infeasible(assembly)
    assert prediction.rests[0] is not None
    mobility = analyse_task(assembly, None).object.mobility
    across = [i for i in range(6) if i not in PLANE]
    np.testing.assert_allclose(mobility[across], 0.0, atol=1e-12)
