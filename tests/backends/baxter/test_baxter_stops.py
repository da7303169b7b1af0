# SPDX-License-Identifier: BSD-3-Clause
"""Every row of the stop table, with a clock of our own: what may leave, what must, and that nothing comes back."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.backends.baxter.ros.messages import AssemblyState
from impedance_modules.backends.baxter.stops import DriveMode, Stops, StopThresholds, stop_thresholds, why_off
from impedance_modules.safety.stop_levels import LEVEL_OF, Event, StopLevel

N = 4
LIMBS = {"one": np.array([0, 1]), "two": np.array([2, 3])}
ON = AssemblyState(True, True, False, False, 0, 0)
RULES = stop_thresholds(0.01, np.array([50.0, 50.0, 15.0, 15.0]))
Q, TAU = np.array([0.1, -0.2, 0.3, -0.4]), np.full(N, 2.0)

OFF_STATES = {
    "disabled": dataclasses.replace(ON, enabled=False),
    "stopped": dataclasses.replace(ON, stopped=True),
    "e-stop pressed": dataclasses.replace(ON, estop_button=1),
    "released, still stopped": dataclasses.replace(ON, stopped=True, estop_button=3, estop_source=1),
    "joint fault": dataclasses.replace(ON, estop_source=3),
    "heartbeat": dataclasses.replace(ON, estop_source=4),
}


def alive(stops: Stops, now: float) -> None:
    stops.on_robot(now, ON)
    stops.on_state(now, Q)


def running(thresholds: StopThresholds = RULES) -> Stops:
    """In torque mode since 0 s."""
    stops = Stops(thresholds, LIMBS)
    alive(stops, 0.0)
    assert stops.begin(0.0) is None
    return stops


@pytest.fixture
def stops() -> Stops:
    return running()


def is_torque(order, effort=None) -> bool:
    same = effort is None or np.array_equal(order.effort, effort)
    return order.effort is not None and order.position is None and order.limbs == tuple(LIMBS) and same


def is_hold(order, position=Q) -> bool:
    return order.effort is None and order.position is not None and np.array_equal(order.position, position)


def is_nothing(order) -> bool:
    return order.effort is None and order.position is None


def test_torque_leaves_as_long_as_everything_is_well(stops) -> None:
    for k in range(1, 300):
        alive(stops, 0.01 * k)
        assert is_torque(stops.torque(0.01 * k + 0.002, TAU), TAU)
        assert is_nothing(stops.watch(0.01 * k + 0.005))
    assert stops.reason is None


def test_nothing_leaves_before_torque_mode_begins() -> None:
    stops = Stops(RULES, LIMBS)
    assert stops.begin(0.0) == "no fresh state of the arms"
    stops.on_state(0.0, Q)
    assert "never heard" in str(stops.begin(0.0)) or "nothing heard" in str(stops.begin(0.0))
    stops.on_robot(0.0, OFF_STATES["disabled"])
    assert stops.begin(0.0) == "the robot is disabled"
    assert is_nothing(stops.torque(0.0, TAU))
    assert is_nothing(stops.watch(0.0))
    stops.on_robot(0.0, ON)
    stops.on_cuff("two", True)
    assert "cuff" in str(stops.begin(0.0))
    stops.on_cuff("two", False)
    assert stops.begin(0.5) == "no fresh state of the arms"


def test_a_stale_state_gets_zero_torque_briefly_then_a_hold(stops) -> None:
    assert is_torque(stops.torque(0.029, TAU), TAU)
    for now in (0.031, 0.045):
        stops.on_robot(now, ON)
        order = stops.torque(now, TAU)
        assert is_torque(order, np.zeros(N))
        assert is_torque(stops.watch(now), np.zeros(N))
    assert is_hold(stops.torque(0.0501, TAU))
    assert is_hold(stops.watch(0.06))
    assert stops.reason.event is Event.STATE_LOST


def test_a_state_that_is_lost_ends_torque_whatever_the_rate() -> None:
    stops = running(stop_thresholds(0.05, RULES.effort_max))
    stops.on_robot(0.4, ON)
    assert is_hold(stops.watch(0.31))
    assert not is_torque(stops.torque(0.4, TAU))


def test_a_silent_controller_gets_zero_torque_and_a_hold(stops) -> None:
    stops.torque(0.001, TAU)
    for k in range(1, 5):
        alive(stops, 0.01 * k)
    assert is_torque(stops.watch(0.04), np.zeros(N))
    alive(stops, 0.055)
    assert is_hold(stops.watch(0.055))
    assert stops.reason.event is Event.CONTROLLER_SILENT
    assert is_nothing(stops.torque(0.056, TAU))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 50.1, -1e9])
def test_a_torque_that_must_not_leave_becomes_zero_once_and_a_hold(stops, bad: float) -> None:
    order = stops.torque(0.005, np.array([0.0, bad, 0.0, 0.0]))
    assert is_torque(order, np.zeros(N))
    alive(stops, 0.01)
    assert is_nothing(stops.torque(0.01, TAU))
    assert is_hold(stops.watch(0.01))
    assert stops.reason.event is Event.TORQUE_REFUSED


@pytest.mark.parametrize("name", OFF_STATES)
def test_power_off_silences_everything_for_good(stops, name: str) -> None:
    stops.torque(0.001, TAU)
    stops.on_robot(0.002, OFF_STATES[name])
    assert stops.mode is DriveMode.OFF
    assert LEVEL_OF[stops.reason.event] is StopLevel.RELEASE
    # Somebody enables the robot again: nothing resumes by itself.
    alive(stops, 0.01)
    assert is_nothing(stops.torque(0.011, TAU))
    assert is_nothing(stops.watch(0.012))
    assert stops.begin(0.012) is not None
    assert stops.move(Q) is not None


def test_power_off_ends_a_hold_too(stops) -> None:
    stops.end()
    assert is_hold(stops.watch(0.01))
    stops.on_robot(0.011, OFF_STATES["e-stop pressed"])
    assert is_nothing(stops.watch(0.012))


def test_a_collision_holds_at_least_as_long_as_the_robot_pauses(stops) -> None:
    stops.on_collision(0.5, "one", True)
    stops.on_collision(0.6, "one", False)
    assert is_hold(stops.watch(0.6))
    assert stops.pause_end >= 2.5
    alive(stops, 3.0)
    assert is_nothing(stops.torque(3.0, TAU))
    assert is_hold(stops.watch(3.0))


def test_a_squeezed_cuff_lets_the_arm_follow_and_holds_it_where_it_was_left(stops) -> None:
    stops.on_cuff("one", True)
    order = stops.watch(0.01)
    assert is_hold(order)
    assert order.limbs == ("two",)
    led = Q + np.array([0.7, 0.7, 0.0, 0.0])
    stops.on_state(0.5, led)
    stops.on_cuff("one", False)
    order = stops.watch(0.51)
    assert order.limbs == ("one", "two")
    assert np.array_equal(order.position, led)
    assert is_nothing(stops.torque(0.52, TAU))
    assert stops.reason.event is Event.CUFF


def test_a_robot_that_stops_saying_how_it_is_is_held(stops) -> None:
    for k in range(1, 60):
        stops.on_state(0.01 * k, Q)
        stops.torque(0.01 * k, TAU)
    assert is_hold(stops.watch(0.6))
    assert "/robot/state silent" in str(stops.reason)


def test_a_planned_end_holds_the_measured_pose_without_blame(stops) -> None:
    stops.on_state(0.01, Q + 0.05)
    stops.end()
    assert is_hold(stops.watch(0.02), Q + 0.05)
    assert stops.reason is None
    stops.leave()
    assert is_nothing(stops.watch(0.03))


def test_moving_to_the_start_ends_with_whatever_ends_torque() -> None:
    stops = Stops(RULES, LIMBS)
    alive(stops, 0.0)
    assert stops.move(Q + 1.0) is None
    assert is_hold(stops.watch(0.01), Q + 1.0)
    stops.on_collision(0.02, "two", True)
    assert is_hold(stops.watch(0.03), Q)
    assert stops.move(Q + 1.0) is not None


def test_angles_that_are_not_finite_are_never_held(stops) -> None:
    stops.on_state(0.01, np.array([np.nan, 0.0, 0.0, 0.0]))
    stops.on_collision(0.02, "one", True)
    assert is_hold(stops.watch(0.02), Q)


EVENTS = {
    "state": lambda stops, now: stops.on_state(now, Q),
    "nan": lambda stops, now: stops.on_state(now, np.full(N, np.nan)),
    "robot": lambda stops, now: stops.on_robot(now, ON),
    "off": lambda stops, now: stops.on_robot(now, OFF_STATES["stopped"]),
    "cuff": lambda stops, now: stops.on_cuff("one", True),
    "free": lambda stops, now: stops.on_cuff("one", False),
    "hit": lambda stops, now: stops.on_collision(now, "two", True),
    "end": lambda stops, now: stops.end(),
    "watch": lambda stops, now: stops.watch(now),
    "torque": lambda stops, now: stops.torque(now, TAU),
    "bad": lambda stops, now: stops.torque(now, np.full(N, np.inf)),
}


@given(st.lists(st.tuples(st.sampled_from(sorted(EVENTS)), st.floats(0.0, 0.06)), max_size=60))
def test_whatever_happens_torque_never_returns_and_every_torque_is_within_limits(events) -> None:
    stops, now, ended, off = running(), 0.0, False, False
    for event, pause in events:
        now += pause
        order = EVENTS[event](stops, now)
        off = off or stops.mode is DriveMode.OFF
        if order is not None:
            assert order.effort is None or (np.abs(order.effort) <= RULES.effort_max).all()
            assert not (ended and order.effort is not None)
            assert not (off and not is_nothing(order))
        ended = ended or stops.mode is not DriveMode.TORQUE
        assert not (ended and stops.mode is DriveMode.TORQUE)


def test_every_reason_leads_to_a_hold_or_a_release() -> None:
    held = (Event.STATE_LOST, Event.CONTROLLER_SILENT, Event.TORQUE_REFUSED, Event.CUFF, Event.COLLISION)
    assert {LEVEL_OF[event] for event in held} == {StopLevel.HOLD}
    assert LEVEL_OF[Event.ROBOT_DISABLED] is StopLevel.RELEASE
    assert why_off(ON) is None
    assert all(why_off(state) for state in OFF_STATES.values())
