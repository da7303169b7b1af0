# SPDX-License-Identifier: BSD-3-Clause
"""States merged by name, the robot's clock, and what is kept of SEAJointState."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.backends.baxter.joint_states import JointStateMerger, RobotClock
from impedance_modules.backends.baxter.robot_link import SeaColumns
from impedance_modules.backends.baxter.ros.messages import Header, JointState, SEAJointState

NAMES = ("right_a", "right_b", "left_a", "left_b")
GRIPPERS = ("l_gripper_l_finger_joint", "r_gripper_r_finger_joint")
NANO = 1_000_000_000


def message(names, stamp: int) -> JointState:
    values = np.array([float(len(name) + stamp) for name in names])
    rows = (tuple(row.tolist()) for row in (values, -values, 2 * values))
    return JointState(Header(0, stamp, ""), tuple(names), *rows)


@given(st.permutations((*NAMES, "head_nod", "head_pan", "torso_t0")), st.integers(1, 10**6))
def test_joints_are_found_by_name_wherever_they_stand(names, stamp: int) -> None:
    merge = JointStateMerger(NAMES)
    state = merge.take(message(names, stamp), 1.0).state
    expected = np.array([float(len(name) + stamp) for name in NAMES])
    assert np.array_equal([state.position, state.velocity, state.effort], np.outer([1, -1, 2], expected))


@given(st.lists(st.sampled_from(["all", "grippers", "right", "left", "nobody"]), max_size=40))
def test_a_sample_comes_when_every_joint_was_reported_since_the_last(kinds) -> None:
    merge = JointStateMerger(NAMES)
    sets = {"all": NAMES, "grippers": GRIPPERS, "right": NAMES[:2], "left": NAMES[2:], "nobody": ()}
    since: set[str] = set()
    count = 0
    for k, kind in enumerate(kinds):
        since |= set(sets[kind])
        sample = merge.take(message(sets[kind], (k + 1) * NANO), k + 1.0)
        complete = since >= set(NAMES) and kind in ("all", "right", "left")
        assert (sample is not None) == complete
        if complete:
            count += 1
            assert sample.number == count
            since.clear()
    assert merge.missing == () or not {"all"} & set(kinds)


def test_arrays_of_another_length_than_the_names_are_not_believed() -> None:
    merge = JointStateMerger(NAMES)
    good = message(NAMES, 1)
    for bad in ("position", "velocity", "effort"):
        broken = replace(good, **{bad: getattr(good, bad)[:-1]})
        assert merge.take(broken, 0.0) is None
    assert merge.malformed == 3
    assert merge.take(good, 0.0) is not None


@given(
    st.integers(0, 2**31),
    st.lists(st.floats(0.002, 0.1), min_size=2, max_size=30),
    st.lists(st.floats(0.0, 0.05), min_size=30, max_size=30),
)
def test_time_is_the_robots_whatever_the_network_does(zero: int, periods, delays) -> None:
    clock, taken, stamp = RobotClock(), 0.0, zero * NANO
    assert clock.read(stamp, 5.0 + delays[0]).time == 0.0
    quickest = delays[0]
    for period, delay in zip(periods, delays[1:], strict=False):
        stamp += round(period * NANO)
        taken += round(period * NANO) / NANO
        moment = clock.read(stamp, 5.0 + taken + delay)
        quickest = min(quickest, delay)
        assert abs(moment.time - taken) < 1e-6
        # Clocks may drift: a late quickest one is forgotten slowly.
        assert -1e-9 <= moment.lag <= delay - quickest + 1e-6
        assert moment.lag >= delay - quickest - 1e-4 * (taken + 0.1) - 1e-6
    assert clock.steps == 0


@given(st.floats(-1e4, 1e4).filter(lambda s: s < -0.02 or s > 0.3), st.integers(2, 20))
def test_a_step_of_the_robots_clock_changes_nothing(step: float, when: int) -> None:
    clock, stamp = RobotClock(), 10**5 * NANO
    times = []
    for k in range(30):
        if k == when:
            stamp += round(step * NANO)
        times.append(clock.read(stamp, 0.01 * k).time)
        stamp += NANO // 100
    assert clock.steps == 1
    assert np.allclose(np.diff(times), 0.01, atol=1e-6)


def test_the_same_stamp_again_is_no_news() -> None:
    clock = RobotClock()
    assert clock.read(NANO, 0.0) is not None
    assert clock.read(NANO, 0.5) is None
    assert clock.read(2 * NANO, 1.0).time == 1.0


def sea(stamp: int, joints=("a", "b"), gravity=(1.0, 2.0), hysteresis=(3.0, 4.0)) -> SEAJointState:
    empty = ((),) * 7
    return SEAJointState(Header(0, stamp, ""), joints, *empty, gravity, (), hysteresis, (), 0.0)


def test_what_the_robot_adds_is_recorded_where_it_says_so() -> None:
    newest = {"one": sea(1), "two": sea(1, ("c",), (5.0,), ())}
    columns = SeaColumns(newest)
    assert columns.names == ("gravity.a", "gravity.b", "hysteresis.a", "hysteresis.b", "gravity.c")
    assert columns.values().tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    newest["one"] = sea(2, gravity=(-1.0, -2.0))
    assert columns.values().tolist() == [-1.0, -2.0, 3.0, 4.0, 5.0]
    newest["one"] = sea(3, hysteresis=())
    assert np.array_equal(columns.values(), [1.0, 2.0, np.nan, np.nan, 5.0], equal_nan=True)
    assert SeaColumns({}).names == ()
