# SPDX-License-Identifier: BSD-3-Clause
"""The page of the joints' own torque loop: passive below its limit, not above; light as the law says (thesis 3.2)."""

import pytest


def test_the_plant_loses_passivity_at_the_computed_gain_and_check_predicts_the_hand(facts_of) -> None:
    facts = facts_of("torque-loop")
    assert facts["worst_below"] < 0.7 and facts["worst_above"] > 1.5
    # Without the loop the same share is measured: springs of the hand press during the blow.
    assert 1.0 < facts["mass_0"] < 1.2
    assert facts["mass_1"] == pytest.approx(facts["mass_0"], abs=0.1)
    for gain in ("0", "1"):
        assert facts[f"stiffness_{gain}"] == pytest.approx(1.0, abs=0.25)
