# SPDX-License-Identifier: BSD-3-Clause
"""What the efforts of an arm at rest hold: its weight, what is left without it, or currents."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.backends.ros2.ros2_checks import effort_word

arms = (
    st.lists(st.floats(-60.0, 60.0), min_size=6, max_size=7)
    .map(np.array)
    .filter(lambda g: np.linalg.norm(g) > 2.0)
)
directions = st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7).map(np.array)


@given(weight=arms, direction=directions, share=st.floats(0.0, 0.04))
def test_efforts_of_an_arm_at_rest_say_what_they_hold(weight, direction, share) -> None:
    """Whatever the gears hold of it, up to a share; and currents of drives of 2 to 18 N.m/A are neither."""
    friction = share * np.linalg.norm(weight) * direction[: weight.size] / max(np.linalg.norm(direction), 1.0)
    assert effort_word(weight + friction, weight) == "with_weight"
    assert effort_word(friction, weight) == "without_weight"
    for drive in (2.0, 6.0, 12.0, 18.0):
        assert effort_word(weight / drive, weight) == "unknown"
    assert effort_word(-weight, weight) == "unknown"


def test_gears_may_hold_a_third_of_the_weight_and_what_is_no_multiple_of_it() -> None:
    weight = np.array([40.0, 30.0, 0.0])
    across = np.array([3.0, -4.0, 12.0])
    assert effort_word(0.75 * weight, weight) == "with_weight"
    assert effort_word(0.65 * weight, weight) == "unknown"
    assert effort_word(across, weight) == "without_weight"
    assert effort_word(1.3 * across, weight) == "unknown"
    assert effort_word(0.04 * weight, weight) == "without_weight"
    assert effort_word(0.06 * weight, weight) == "unknown"
    assert effort_word(0.06 * weight + 0.5 * across, weight) == "without_weight"
