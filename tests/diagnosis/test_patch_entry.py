# SPDX-License-Identifier: BSD-3-Clause
"""A spring that a robot does not carry is patched as one outside, with the same torque at every angle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.result import Cause, Estimate
from impedance_modules.diagnosis.rollout.patch_entry import patch_entry

TORQUES = st.floats(0.01, 50.0) | st.floats(-50.0, -0.01)


def spring(stiffness: float, preload: float) -> dict[str, Estimate]:
    return {"k": Estimate(stiffness, 0.1, "N.m/rad"), "preload": Estimate(preload, 0.1, "N.m")}


def cause(*springs: dict[str, Estimate], outside: bool = True) -> Cause:
    named = {f"joint_{k}": one for k, one in enumerate(springs)}
    return Cause(
        "parallel_spring", tuple(named), "link", named, 1.0, 0.9, (), (), {}, {}, None, outside=outside
    )


@settings(max_examples=50, deadline=None)
@given(stiffness=st.sampled_from([0.0, 0.3, 40.0]), preload=TORQUES, q=st.floats(-3.0, 3.0))
def test_the_torque_is_the_same_at_every_angle(stiffness: float, preload: float, q: float) -> None:
    """k q - preload, beside another spring and alone."""
    both = patch_entry(cause(spring(stiffness, preload), spring(7.0, 1.0)))
    assert (both.effect, both.port) == ("bench_spring", "contact")
    found = both.parameters["joint_0"]
    torque = found["k"].value * (q - found["q0"].value)
    assert torque == pytest.approx(stiffness * q - preload, rel=1e-5, abs=1e-3 * abs(preload))
    assert np.isfinite(found["q0"].std)


def test_a_spring_that_the_robot_carries_stays_what_it_is() -> None:
    own = cause(spring(0.0, 1.0), outside=False)
    assert patch_entry(own).parameters == own.parameters
