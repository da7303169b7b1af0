# SPDX-License-Identifier: BSD-3-Clause
"""The stop levels, row by row, and the promises that hold for every sequence of events."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.safety import stop_levels
from impedance_modules.safety.stop_levels import (
    LEVEL_OF,
    RUNNING,
    Decision,
    Event,
    Occurrence,
    StopLevel,
    StopLimits,
    escalate,
    stop_reason,
    watch_time,
)

LIMITS = StopLimits(
    damping_time=0.5,
    blind_damping_time=0.02,
    rest_speed=0.01,
    speed_growth=1.5,
    late_cycles=5,
    stale_time=0.03,
    lost_time=0.1,
    starvation_time=2.0,
)
PERIOD = 0.01
ONE = {"a": RUNNING}
BOTH = {"a": RUNNING, "b": RUNNING}

TABLE = {
    Event.TANK_LOW: (StopLevel.SCALE, None),
    Event.LATE_CYCLE: (StopLevel.SCALE, None),
    Event.LATE_CYCLES: (StopLevel.DAMP, 0.5),
    Event.STALE_STATE: (StopLevel.DAMP, 0.02),
    Event.STATE_NOT_FINITE: (StopLevel.DAMP, 0.02),
    Event.EFFORT_NOT_FINITE: (StopLevel.DAMP, 0.5),
    Event.SOLVER_FAILED: (StopLevel.DAMP, 0.5),
    Event.OVERSPEED: (StopLevel.DAMP, 0.5),
    Event.TANK_STARVED: (StopLevel.DAMP, 0.5),
    Event.POSITION_LIMIT: (StopLevel.DAMP, 0.5),
    Event.PHASE_NOT_MET: (StopLevel.DAMP, 0.5),
    Event.GRIPPER_FAILED: (StopLevel.DAMP, 0.5),
    Event.INTERRUPT: (StopLevel.DAMP, 0.5),
    Event.OTHER_ARM: (StopLevel.DAMP, 0.5),
    Event.COLLISION: (StopLevel.HOLD, None),
    Event.CUFF: (StopLevel.HOLD, None),
    Event.ROBOT_REFLEX: (StopLevel.HOLD, None),
    Event.TORQUE_REFUSED: (StopLevel.HOLD, None),
    Event.CONTROLLER_SILENT: (StopLevel.HOLD, None),
    Event.STATE_LOST: (StopLevel.HOLD, None),
    Event.MEMORY_SHORT: (StopLevel.HOLD, None),
    Event.PLANT_NOT_FINITE: (StopLevel.HOLD, None),
    Event.NOT_RECORDED: (StopLevel.HOLD, None),
    Event.HOLD_REFUSED: (StopLevel.RELEASE, None),
    Event.ROBOT_DISABLED: (StopLevel.RELEASE, None),
    Event.BACKEND_LOST: (StopLevel.RELEASE, None),
}


def step(
    decisions: dict[str, Decision], *events: Event, arm: str | None = None, speed: float = 0.5
) -> dict[str, Decision]:
    happened = [Occurrence(event, arm, "detail 1.25") for event in events]
    return escalate(decisions, happened, dict.fromkeys(decisions, speed), PERIOD, LIMITS)


def test_the_table_has_a_row_for_every_event_and_the_docstring_says_the_same() -> None:
    assert set(TABLE) == set(Event) == set(LEVEL_OF)
    rows = {}
    for line in (stop_levels.__doc__ or "").splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split("|")]
        if cells[0] in set(Event):
            rows[cells[0]] = (cells[1], cells[2])
    lengths = {None: "-", 0.5: "full", 0.02: "brief"}
    assert rows == {e.value: (r.name.lower(), lengths[b]) for e, (r, b) in TABLE.items()}


@pytest.mark.parametrize("event", list(Event))
def test_each_event_leads_to_its_rung_with_a_reason(event: Event) -> None:
    stop_level, braking = TABLE[event]
    now = step(ONE, event)["a"]
    assert (now.stop_level, now.braking) == (stop_level, braking)
    for text in ("a: ", event.value.replace("_", " "), "detail 1.25", stop_level.name.lower()):
        assert text in now.reason
    assert now.discard == (stop_level >= StopLevel.DAMP or event is Event.LATE_CYCLE)


@pytest.mark.parametrize("event", list(Event))
def test_what_follows_when_nothing_more_happens(event: Event) -> None:
    decisions = step(ONE, event)
    braked = 0
    while decisions["a"].stop_level == StopLevel.DAMP:
        decisions = step(decisions)
        braked += 1
        assert braked < 100
    stop_level, braking = TABLE[event]
    if stop_level == StopLevel.SCALE:
        assert step(decisions)["a"].stop_level == StopLevel.RUN
    elif stop_level == StopLevel.DAMP:
        assert decisions["a"].stop_level == StopLevel.HOLD
        assert abs(braked * PERIOD - braking) < 1.01 * PERIOD
        assert "still at 0.500 rad/s" in decisions["a"].reason
    for _ in range(300):
        decisions = step(decisions)
    expected = {StopLevel.SCALE: StopLevel.RUN, StopLevel.DAMP: StopLevel.HOLD}.get(stop_level, stop_level)
    assert decisions["a"].stop_level == expected


def test_braking_ends_at_rest_or_when_the_speed_does_not_decay() -> None:
    damped = step(ONE, Event.OVERSPEED, speed=1.0)
    assert step(damped, speed=0.9)["a"].stop_level == StopLevel.DAMP
    for speed, word in ((0.005, "at rest"), (1.6, "speed grew"), (np.nan, "speed grew")):
        after = step(damped, speed=speed)["a"]
        assert after.stop_level == StopLevel.HOLD
        assert "overspeed" in after.reason
        assert word in after.reason


def test_going_blind_while_braking_makes_braking_brief() -> None:
    decisions = step(ONE, Event.SOLVER_FAILED)
    for _ in range(10):
        decisions = step(decisions)
    for _ in range(2):
        decisions = step(decisions, Event.STALE_STATE)
        assert decisions["a"].stop_level == StopLevel.DAMP
    assert step(decisions, Event.STALE_STATE)["a"].stop_level == StopLevel.HOLD


@pytest.mark.parametrize("event", [e for e in Event if TABLE[e][0] >= StopLevel.DAMP])
def test_one_arm_fails_the_other_damps(event: Event) -> None:
    now = step(BOTH, event, arm="a")
    assert now["a"].stop_level == TABLE[event][0]
    assert now["b"].stop_level == StopLevel.DAMP
    assert now["b"].discard
    assert "a stopped" in now["b"].reason


def test_an_event_of_an_unknown_arm_concerns_every_arm() -> None:
    assert {d.stop_level for d in step(BOTH, Event.COLLISION, arm="nobody").values()} == {StopLevel.HOLD}
    assert step(BOTH, Event.TANK_LOW, arm="a")["b"].stop_level == StopLevel.RUN


def test_the_hardest_event_wins_and_a_late_torque_never_leaves() -> None:
    assert step(ONE, Event.TANK_LOW, Event.BACKEND_LOST, Event.INTERRUPT)["a"].stop_level == StopLevel.RELEASE
    both = step(ONE, Event.TANK_LOW, Event.LATE_CYCLE)["a"]
    assert both.stop_level == StopLevel.SCALE
    assert both.discard


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.lists(st.tuples(st.sampled_from(list(Event)), st.sampled_from(["a", "b", None])), max_size=3),
            st.floats(0, 3),
        ),
        max_size=40,
    )
)
def test_no_sequence_of_events_climbs_back_or_stops_without_a_reason(
    story: list[tuple[list[tuple[Event, str | None]], float]],
) -> None:
    decisions = dict(BOTH)
    seen = [decisions]
    for events, speed in story:
        happened = [Occurrence(event, arm, "x") for event, arm in events]
        decisions = escalate(decisions, happened, {"a": speed, "b": speed}, PERIOD, LIMITS)
        seen.append(decisions)
    for before, after in pairwise(seen):
        stopped = any(d.stop_level >= StopLevel.DAMP for d in after.values())
        for arm in BOTH:
            if before[arm].stop_level >= StopLevel.DAMP:
                assert after[arm].stop_level >= before[arm].stop_level
                assert after[arm].reason.startswith(before[arm].reason)
            assert (after[arm].reason == "") == (after[arm].stop_level == StopLevel.RUN)
            assert after[arm].discard or after[arm].stop_level < StopLevel.DAMP
            assert after[arm].stop_level >= StopLevel.DAMP or not stopped


def test_clocks_turn_into_events() -> None:
    def names(late: bool, count: int, age: float, starved: float) -> list[Event]:
        return [o.event for o in watch_time(late, count, age, starved, LIMITS)]

    assert names(False, 0, 0.01, 0.0) == []
    assert names(True, 5, 0.01, 0.0) == [Event.LATE_CYCLE]
    assert names(True, 6, 0.01, 0.0) == [Event.LATE_CYCLES, Event.LATE_CYCLE]
    assert names(False, 0, 0.03, 0.0) == [Event.STALE_STATE]
    assert names(False, 0, 0.10, 0.0) == [Event.STATE_LOST]
    assert names(False, 0, 0.0, 0.01) == [Event.TANK_LOW]
    assert names(False, 0, 0.0, 2.0) == [Event.TANK_STARVED]


def test_the_reason_names_the_arm_that_caused_the_stop_and_what_followed() -> None:
    running = dict.fromkeys(("left", "right"), RUNNING)
    cause = Occurrence(Event.OVERSPEED, "right", "motor of right_w2 too fast")
    stopped = escalate(running, [cause], {"left": 0.001, "right": 2.0}, PERIOD, LIMITS)
    assert stop_reason(stopped) == "right: overspeed (motor of right_w2 too fast) -> damp"
    rested = escalate(stopped, [], {"left": 0.001, "right": 2.0}, PERIOD, LIMITS)
    assert rested["left"].stop_level > rested["right"].stop_level
    assert stop_reason(rested).startswith("right: overspeed")
    assert "left: other arm (right stopped)" in stop_reason(rested)
    lost = escalate(
        rested, [Occurrence(Event.BACKEND_LOST, None, "gone")], {"left": 0, "right": 0}, PERIOD, LIMITS
    )
    assert stop_reason(lost).startswith("right: overspeed")
    assert stop_reason(running) == ""
