# SPDX-License-Identifier: BSD-3-Clause
"""What one arm is sent: torques never leap, silence and ends lead to zero, paths begin and end at rest."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.backends.franka.commands import (
    LARGEST_STEP,
    TOP_SPEED,
    EndOfTorque,
    PathCommand,
    TorqueCommand,
)

LARGEST = (87.0,) * 4 + (12.0,) * 3
torques = st.tuples(*(st.floats(-limit, limit) for limit in LARGEST))
poses = st.tuples(*(st.floats(-2.8, 2.8) for _ in LARGEST))


def command() -> TorqueCommand:
    return TorqueCommand(LARGEST, silent=0.03, first=2.0, now=0.0)


@given(st.lists(st.one_of(torques, st.none(), st.just("end")), min_size=1, max_size=60))
def test_no_torque_leaps_whatever_is_asked_for(asked) -> None:
    arm, now, before = command(), 0.0, np.zeros(7)
    for what in asked:
        now += 0.001
        if what == "end":
            arm.end(EndOfTorque(True, "", "the run ended"))
        elif what is not None:
            arm.order(what, now)
        arm.step(now)
        assert np.abs(np.array(arm.sent) - before).max() <= LARGEST_STEP + 1e-12
        before = np.array(arm.sent)


@given(torques)
def test_a_torque_that_is_renewed_is_reached_and_kept(torque) -> None:
    arm = command()
    for k in range(100):
        arm.order(torque, 1e-3 * k)
        assert not arm.step(1e-3 * k)
    np.testing.assert_allclose(arm.sent, torque, atol=1e-12)
    assert arm.ending is None


@given(torques, st.booleans())
def test_silence_and_an_end_lead_to_zero_which_is_the_last_torque(torque, ordered) -> None:
    arm, now = command(), 0.0
    for _ in range(100):
        now += 0.001
        arm.order(torque, now)
        arm.step(now)
    if ordered:
        arm.end(EndOfTorque(True, "", "the run ended"))
    for _ in range(400):
        now += 0.001
        if arm.step(now):
            break
    else:
        raise AssertionError("torque mode never ends")
    assert not any(arm.sent)
    assert arm.ending is not None and arm.ending.by_order == ordered
    assert ordered or (arm.ending.event == "controller_silent" and "no torque for 3" in arm.ending.detail)


@given(st.integers(0, 6), st.sampled_from((np.nan, np.inf, -np.inf, 1e3, -88.0)))
def test_a_torque_that_must_not_leave_ends_torque_mode(joint, value) -> None:
    arm, wrong = command(), [0.0] * 7
    arm.order([1.0] * 7, 0.0)
    arm.step(0.0)
    wrong[joint] = value
    arm.order(wrong, 0.001)
    assert arm.ending is not None and arm.ending.event == "torque_refused"
    assert f"joint {joint + 1}" in arm.ending.detail
    arm.order([5.0] * 7, 0.002)
    arm.step(0.002)
    assert np.abs(arm.sent).max() < 1.0


@given(poses, poses, st.integers(0, 4000))
def test_a_path_is_slow_and_begins_and_ends_at_rest_at_its_goal_or_where_it_is_halted(
    start, goal, halt
) -> None:
    path, positions, last = PathCommand(start, goal), [np.array(start)], False
    while not last:
        if len(positions) == halt:
            path.halt()
        position, last = path.step(0.001)
        positions.append(np.array(position))
    speeds = np.abs(np.diff(positions, axis=0)).max(axis=1) / 0.001
    assert speeds.max() <= TOP_SPEED * 1.001
    assert speeds[0] < 0.01 and speeds[-1] < 0.01
    if not path.halted:
        np.testing.assert_allclose(positions[-1], goal, atol=1e-9)
