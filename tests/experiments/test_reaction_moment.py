# SPDX-License-Identifier: BSD-3-Clause
"""A blow along the normal (4.4, 4.5): it turns one arm's hand, and not what two mirrored arms hold."""

import numpy as np
import pytest

from impedance_experiments.reaction_moment import box_moments, moment_over_force, turn_over_way


def test_one_arm_reacts_as_eq_4_28_says_and_two_do_not(facts_of) -> None:
    facts = facts_of("reaction-moment")
    assert facts["one, predicted"] == pytest.approx(-2.5 / 9.18, abs=1e-3)
    assert facts["one, measured"] == pytest.approx(facts["one, predicted"], rel=0.03)
    assert abs(facts["two, measured"]) < 0.01 * abs(facts["one, measured"])
    assert facts["one, turn"] > 0.5 and abs(facts["two, turn"]) < 0.01
    # Both inertias as measured by three blows, in kg, kg.m and kg.m^2.
    assert facts["worst inertia"] < 1.0
    assert facts["box, two arms"] < facts["box, one arm"]
    # Baxter's box, struck on the plant: what a mirror plane cancels is gone.
    assert facts["box turn, one arm"] == pytest.approx(facts["box turn predicted, one arm"], rel=0.15)
    assert facts["box turn, two arms"] < 0.02 * facts["box turn, one arm"]


def test_the_moments_that_a_mirror_plane_cancels_are_gone_and_the_others_stay() -> None:
    box = box_moments()
    across = np.ix_([0, 2], [0, 2])  # about x and z, struck along x and z: the plane is that of x and z
    assert np.abs(box["two arms"][across]).max() < 0.02 * np.abs(box["one arm"][across]).max()
    assert np.linalg.norm(box["two arms"][:, 1]) > 0.5 * np.linalg.norm(box["one arm"][:, 1])


def test_moment_and_turn_are_read_from_an_inertia() -> None:
    inertia = np.array([[4.0, 0.0, 0.0], [0.0, 5.0, -2.0], [0.0, -2.0, 3.0]])
    assert moment_over_force(inertia) == pytest.approx(-0.4)
    velocity = np.linalg.solve(inertia, [0.0, 1.0, 0.0])
    assert turn_over_way(inertia) == pytest.approx(velocity[2] / velocity[1])
