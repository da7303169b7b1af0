# SPDX-License-Identifier: BSD-3-Clause
"""The stop ladder, row by row, and the promises that hold for every sequence of events."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.safety import stop_levels as stop_events
from impedance_modules.safety.stop_levels import (
    RUNG_OF,
    RUNNING,
    Decision,
    Event,
    Occurrence,
    Rung,
    StopLimits,
    damping_effort,
    descend,
    hold_effort,
    hold_potential,
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
    Event.TANK_LOW: (Rung.SCALE, None),
    Event.LATE_CYCLE: (Rung.SCALE, None),
    Event.LATE_CYCLES: (Rung.DAMP, 0.5),
    Event.STALE_STATE: (Rung.DAMP, 0.02),
    Event.STATE_NOT_FINITE: (Rung.DAMP, 0.02),
    Event.EFFORT_NOT_FINITE: (Rung.DAMP, 0.5),
    Event.SOLVER_FAILED: (Rung.DAMP, 0.5),
    Event.OVERSPEED: (Rung.DAMP, 0.5),
    Event.TANK_STARVED: (Rung.DAMP, 0.5),
    Event.POSITION_LIMIT: (Rung.DAMP, 0.5),
    Event.PHASE_NOT_MET: (Rung.DAMP, 0.5),
    Event.INTERRUPT: (Rung.DAMP, 0.5),
    Event.OTHER_ARM: (Rung.DAMP, 0.5),
    Event.COLLISION: (Rung.HOLD, None),
    Event.CUFF: (Rung.HOLD, None),
    Event.TORQUE_REFUSED: (Rung.HOLD, None),
    Event.CONTROLLER_SILENT: (Rung.HOLD, None),
    Event.STATE_LOST: (Rung.HOLD, None),
    Event.HOLD_REFUSED: (Rung.RELEASE, None),
    Event.ROBOT_DISABLED: (Rung.RELEASE, None),
    Event.BACKEND_LOST: (Rung.RELEASE, None),
}


def step(
    ladder: dict[str, Decision], *events: Event, arm: str | None = None, speed: float = 0.5
) -> dict[str, Decision]:
    happened = [Occurrence(event, arm, "detail 1.25") for event in events]
    return descend(ladder, happened, dict.fromkeys(ladder, speed), PERIOD, LIMITS)


def test_the_table_has_a_row_for_every_event_and_the_docstring_says_the_same() -> None:
    assert set(TABLE) == set(Event) == set(RUNG_OF)
    rows = {}
    for line in (stop_events.__doc__ or "").splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split("|")]
        if cells[0] in set(Event):
            rows[cells[0]] = (cells[1], cells[2])
    lengths = {None: "-", 0.5: "full", 0.02: "brief"}
    assert rows == {e.value: (r.name.lower(), lengths[b]) for e, (r, b) in TABLE.items()}


@pytest.mark.parametrize("event", list(Event))
def test_each_event_leads_to_its_rung_with_a_reason(event: Event) -> None:
    rung, braking = TABLE[event]
    now = step(ONE, event)["a"]
    assert (now.rung, now.braking) == (rung, braking)
    for text in ("a: ", event.value.replace("_", " "), "detail 1.25", rung.name.lower()):
        assert text in now.reason
    assert now.discard == (rung >= Rung.DAMP or event is Event.LATE_CYCLE)


@pytest.mark.parametrize("event", list(Event))
def test_what_follows_when_nothing_more_happens(event: Event) -> None:
    ladder = step(ONE, event)
    braked = 0
    while ladder["a"].rung == Rung.DAMP:
        ladder = step(ladder)
        braked += 1
        assert braked < 100
    rung, braking = TABLE[event]
    if rung == Rung.SCALE:
        assert step(ladder)["a"].rung == Rung.RUN
    elif rung == Rung.DAMP:
        assert ladder["a"].rung == Rung.HOLD
        assert abs(braked * PERIOD - braking) < 1.01 * PERIOD
        assert "still at 0.500 rad/s" in ladder["a"].reason
    for _ in range(300):
        ladder = step(ladder)
    expected = {Rung.SCALE: Rung.RUN, Rung.DAMP: Rung.HOLD}.get(rung, rung)
    assert ladder["a"].rung == expected


def test_braking_ends_at_rest_or_when_the_speed_does_not_decay() -> None:
    damped = step(ONE, Event.OVERSPEED, speed=1.0)
    assert step(damped, speed=0.9)["a"].rung == Rung.DAMP
    for speed, word in ((0.005, "at rest"), (1.6, "speed grew"), (np.nan, "speed grew")):
        after = step(damped, speed=speed)["a"]
        assert after.rung == Rung.HOLD
        assert "overspeed" in after.reason
        assert word in after.reason


def test_going_blind_while_braking_makes_braking_brief() -> None:
    ladder = step(ONE, Event.SOLVER_FAILED)
    for _ in range(10):
        ladder = step(ladder)
    for _ in range(2):
        ladder = step(ladder, Event.STALE_STATE)
        assert ladder["a"].rung == Rung.DAMP
    assert step(ladder, Event.STALE_STATE)["a"].rung == Rung.HOLD


@pytest.mark.parametrize("event", [e for e in Event if TABLE[e][0] >= Rung.DAMP])
def test_one_arm_fails_the_other_damps(event: Event) -> None:
    now = step(BOTH, event, arm="a")
    assert now["a"].rung == TABLE[event][0]
    assert now["b"].rung == Rung.DAMP
    assert now["b"].discard
    assert "a stopped" in now["b"].reason


def test_an_event_of_an_unknown_arm_concerns_every_arm() -> None:
    assert {d.rung for d in step(BOTH, Event.COLLISION, arm="nobody").values()} == {Rung.HOLD}
    assert step(BOTH, Event.TANK_LOW, arm="a")["b"].rung == Rung.RUN


def test_the_hardest_event_wins_and_a_late_torque_never_leaves() -> None:
    assert step(ONE, Event.TANK_LOW, Event.BACKEND_LOST, Event.INTERRUPT)["a"].rung == Rung.RELEASE
    both = step(ONE, Event.TANK_LOW, Event.LATE_CYCLE)["a"]
    assert both.rung == Rung.SCALE
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
    ladder = dict(BOTH)
    seen = [ladder]
    for events, speed in story:
        happened = [Occurrence(event, arm, "x") for event, arm in events]
        ladder = descend(ladder, happened, {"a": speed, "b": speed}, PERIOD, LIMITS)
        seen.append(ladder)
    for before, after in pairwise(seen):
        stopped = any(d.rung >= Rung.DAMP for d in after.values())
        for arm in BOTH:
            if before[arm].rung >= Rung.DAMP:
                assert after[arm].rung >= before[arm].rung
                assert after[arm].reason.startswith(before[arm].reason)
            assert (after[arm].reason == "") == (after[arm].rung == Rung.RUN)
            assert after[arm].discard or after[arm].rung < Rung.DAMP
            assert after[arm].rung >= Rung.DAMP or not stopped


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


def test_stop_torques_stay_within_limits_and_never_drive() -> None:
    rng = np.random.default_rng(2)
    for _ in range(300):
        n = int(rng.integers(1, 8))
        A, B = rng.normal(size=(n, n)), rng.normal(size=(n, n))
        D, K, top = A @ A.T * 10, B @ B.T * 100, rng.uniform(1, 50, n)
        v, q, pose = rng.normal(size=n) * 3, rng.normal(size=n), rng.normal(size=n)
        tau = damping_effort(D, v, top)
        assert np.all(np.abs(tau) <= top * (1 + 1e-12))
        assert tau @ v <= 0
        held = hold_effort(K, D, q=q, q_hold=pose, v=v, effort_max=top)
        assert np.all(np.abs(held) <= top * (1 + 1e-12))
    small = hold_effort(K, D, q=q, q_hold=q + 1e-6, v=0 * v, effort_max=top)
    slope = [
        (hold_potential(K, q + d, q + 1e-6) - hold_potential(K, q - d, q + 1e-6)) / 2e-4
        for d in 1e-4 * np.eye(n)
    ]
    assert np.allclose(small, -np.array(slope), atol=1e-9)
    assert hold_potential(K, q, q) == 0.0
