# SPDX-License-Identifier: BSD-3-Clause
"""What the ROS 2 node passes on and what it publishes, without ROS: states of any messages, torques with an end."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.backends.ros2.ros2_node import (
    DROPPED,
    RAMP,
    StateCollector,
    TorqueOutput,
    pack_numbers,
    unpack_numbers,
)

NAMES = ("a", "b", "c")
numbers = st.floats(-1e6, 1e6)


def rows(values) -> list[list[float]]:
    return [list(values), [10.0 * v for v in values], [100.0 * v for v in values]]


@given(st.lists(st.floats(allow_nan=False), max_size=60), st.integers(1, 255))
def test_numbers_arrive_as_they_were_sent(values, kind) -> None:
    message = pack_numbers(kind, values)
    assert message[0] == kind and unpack_numbers(message) == tuple(values)


@given(st.permutations([*NAMES, "other"]), st.lists(numbers, min_size=4, max_size=4))
def test_order_and_other_joints_do_not_matter(names, values) -> None:
    found = StateCollector(NAMES, 0.05).take(1.0, names, rows(values), 1.0)
    assert found is not None
    by_name = dict(zip(names, values, strict=True))
    expected = [by_name[name] for name in NAMES]
    assert found == (1.0, [v for row in rows(expected) for v in row])


@given(st.integers(1, 2), st.lists(numbers, min_size=3, max_size=3))
def test_two_messages_with_some_joints_each_make_one_state(cut, values) -> None:
    collector = StateCollector(NAMES, 0.05)
    assert collector.take(1.0, NAMES[:cut], rows(values[:cut]), 1.0) is None
    assert collector.missing == set(NAMES[cut:])
    found = collector.take(1.0, NAMES[cut:], rows(values[cut:]), 1.0)
    assert found == (1.0, [v for row in rows(values) for v in row]) and not collector.missing


@given(st.lists(st.integers(0, 30), min_size=1, max_size=80))
def test_stamps_of_states_only_grow_and_every_message_is_a_state_or_counted(stamps) -> None:
    collector = StateCollector(NAMES, 1e3)
    seen = [collector.take(1.0 + 0.001 * k, NAMES, rows((1, 2, 3)), 2.0) for k in stamps]
    passed = [found[0] for found in seen if found is not None]
    assert passed == sorted(set(passed))
    assert len(passed) + sum(collector.dropped) == len(stamps)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("row", [0, 1, 2])
def test_numbers_that_are_not_finite_are_dropped_unless_they_are_of_another_joint(bad, row) -> None:
    values = rows((1.0, 2.0, 3.0, 4.0))
    values[row][3] = bad
    assert StateCollector(NAMES, 0.05).take(1.0, (*NAMES, "other"), values, 1.0) is not None
    collector = StateCollector((*NAMES, "other"), 0.05)
    assert collector.take(1.0, (*NAMES, "other"), values, 1.0) is None
    assert collector.dropped[DROPPED.index("not finite")] == 1


def test_messages_without_velocity_or_effort_are_dropped_and_told() -> None:
    collector = StateCollector(NAMES, 0.05)
    assert collector.take(1.0, NAMES, [[1.0, 2.0, 3.0], [], []], 1.0) is None
    assert collector.empty == {"velocity", "effort"} and collector.dropped[DROPPED.index("malformed")] == 1


@given(st.floats(-1e3, 1e3))
def test_states_that_come_late_are_dropped_whatever_the_clocks_say(offset) -> None:
    collector = StateCollector(NAMES, 0.05)
    for k in range(20):
        stamp = 2000.0 + 0.01 * k
        delay = 0.2 if k == 10 else 0.002 * (k % 3)
        found = collector.take(stamp, NAMES, rows((1, 2, 3)), stamp + offset + delay)
        assert (found is None) == (k == 10)
    assert collector.dropped[DROPPED.index("too old")] == 1


@given(
    st.lists(numbers, min_size=3, max_size=3), st.lists(numbers, min_size=3, max_size=3), st.integers(0, 2)
)
def test_every_end_takes_the_torque_to_zero_and_leaves_the_weight(effort, weight, how) -> None:
    output = TorqueOutput(3, stale=0.05)
    output.begin(weight, 0.0)
    np.testing.assert_array_equal(output.torque(0.0), weight)
    assert output.order(effort, weight, 0.01)
    np.testing.assert_allclose(output.torque(0.01), np.add(effort, weight))
    if how == 0:
        output.end("the run ended", 0.02, ordered=True)
    now, sizes = 0.02, []
    for _ in range(100):
        now += 0.005
        done = output.watch(now, state_age=0.2 if how == 1 else 0.0)
        sizes.append(np.abs(np.subtract(output.torque(now), weight)).max())
        if done:
            break
    assert not output.active and output.ending and output.ordered == (how == 0)
    assert ("no state" in output.ending) == (how == 1) and ("no torque" in output.ending) == (how == 2)
    assert sizes == sorted(sizes, reverse=True)
    np.testing.assert_allclose(sizes[-1], 0.0, atol=1e-6)
    assert now <= 0.02 + 0.06 + RAMP + 0.01
    assert not output.order(effort, weight, now)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_torque_that_is_not_finite_is_never_published(bad) -> None:
    output = TorqueOutput(2, stale=0.05)
    output.begin([0.0, 0.0], 0.0)
    output.order([1.0, 1.0], [0.0, 0.0], 0.0)
    output.order([1.0, bad], [0.0, 0.0], 0.01)
    assert np.isfinite(output.torque(0.01)).all() and "not finite" in output.ending
