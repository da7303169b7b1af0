# SPDX-License-Identifier: BSD-3-Clause
"""The thesis's chapter 3 in short form: the numbers behind the pages."""

import pytest


def test_springs_hide_in_slow_motion_and_show_in_a_blow(facts_of) -> None:
    facts = facts_of("series-elastic")
    assert facts["lowest rigid limit"] < 90.0 < facts["highest rigid limit"]
    # The headline is the joint of the plots, not the one that comes nearest to the thesis.
    assert facts["rigid limit of the drawn joint"] == pytest.approx(28.8, abs=0.1)
    assert facts["least real part, collocated"] >= 0.0 > facts["least real part, non-collocated"]
    assert facts["departure of the angle"] < 0.02 and facts["departure of the velocity"] > 0.3


@pytest.mark.long
def test_rotors_make_the_arm_heavier_but_the_springs_shield_the_peak(facts_of) -> None:
    facts = facts_of("reflected-inertia-matters")
    # Square roots of the masses are what Table 3.1 comes near; the masses themselves are not.
    printed = {"largest mass with": 2.574, "smallest mass with": 1.31, "largest mass without": 1.628}
    assert all(abs(facts[name] ** 0.5 / value - 1.0) < 0.15 for name, value in printed.items())
    assert abs(facts["contact time"] - 0.07) < 0.007
    assert abs(facts["contact time without, softer surface"] - 0.07) < 0.007
    # Measured masses are the predicted ones, within what springs and controller add during the touch.
    assert abs(facts["ratio of measured mass"] / facts["ratio of predicted mass"] - 1.0) < 0.1
    assert 1.2 < facts["ratio of measured mass"] < 1.8
    # Measured masses, change of speed and contact time together are what the mean force is.
    assert abs(facts["steps"] / facts["ratio of mean force, same contact time"] - 1.0) < 1e-9
    assert facts["ratio of peak force"] < facts["ratio of mean force, same contact time"]


@pytest.mark.long
def test_both_methods_recover_the_plants_own_reflected_inertia(facts_of) -> None:
    facts = facts_of("reflected-inertia")
    for name in ("real", "wrist"):
        assert abs(facts[name] / facts["truth, wrist"] - 1.0) < 0.03, name
    assert abs(facts["elbow"] / facts["truth, elbow"] - 1.0) < 0.03
    # Links and rotor as one body, as the thesis reads the frequency: the series spring makes it too low.
    assert -0.05 < facts["wrist, plain"] / facts["truth, wrist"] - 1.0 < 0.0
    assert -0.05 < facts["elbow, plain"] / facts["truth, elbow"] - 1.0 < 0.0
    assert facts["accounted"] > 0.96
    # What the patch torsion-spring puts on the drive: 0.15 N.m, 0.04 more one way; and the robot file's damping. Two
    # small steps tell dry friction and damping apart no better than this.
    assert abs(facts["ahead"] - 0.15) < 0.04 and abs(facts["difference"] - 0.04) < 0.02
    assert abs(facts["damping"] - 0.7) < 0.1
