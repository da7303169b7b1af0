# SPDX-License-Identifier: BSD-3-Clause
"""Stop levels: run, scale, damp, hold, release. What can stop an arm, how hard, and what it sends then.

A torque that is late, not finite, unsolved or not covered by the tank never leaves: ``Decision.discard`` is set
in every stop and in a late cycle. SCALE is not a stop (the tank slows the task, or one late cycle is left out) and
ends with its cause. The three stops never go back: only a new run does, from the measured pose, when a
person asks for it.

DAMP is the torque of ``safety.brake``, covered by the tank with its floor released; it becomes HOLD
when the arm is at rest, when its time is up, or when the speed grows instead of decaying. HOLD is the robot's
own position mode. RELEASE is zero torque; the robot's own gravity compensation remains.

| event | level | braking | why |
|---|---|---|---|
| tank_low | scale | - | the tank covers part of the torque; the task slows down |
| late_cycle | scale | - | this torque is dropped, no two commands catch up; the ledger books ``missed`` |
| late_cycles | damp | full | too many in a second: the loop does not keep its rate |
| stale_state | damp | brief | no state for some periods: the brake only relaxes |
| state_not_finite | damp | brief | likewise |
| effort_not_finite | damp | full | the law failed, the state is sound |
| solver_failed | damp | full | unfiltered torque never leaves |
| overspeed | damp | full | the declared v_max, on which the guarantee rests, was exceeded |
| tank_starved | damp | full | short of energy for too long: something keeps draining it |
| position_limit | damp | full | beyond the limit in spite of the QP's rows |
| phase_not_met | damp | full | the task's own ``until`` was not met in time |
| gripper_failed | damp | full | a gripper reports an error, is silent, or does not end its order in time |
| interrupt | damp | full | a person stopped the run |
| other_arm | damp | full | another arm stopped: this one brakes, it does not push on a held object |
| collision | hold | - | the robot's collision detection has already stopped the arm |
| cuff | hold | - | somebody squeezes the robot's cuff to lead the arm by hand |
| torque_refused | hold | - | the robot's driver was given a torque that must not leave |
| controller_silent | hold | - | the robot's watchdog heard no torque for too long |
| state_lost | hold | - | no state for so long that damping would be guessing |
| robot_reflex | hold | - | the robot's own watch has already stopped it: a limit, a leap, an error of its own |
| memory_short | hold | - | the computer has no memory left for the law |
| plant_not_finite | hold | - | a number of the simulated robot's state is not finite: there is nothing left to brake |
| not_recorded | hold | - | the files of the run cannot be written: what it did would not be known |
| hold_refused | release | - | the robot cannot hold, or the tank cannot cover a hold |
| robot_disabled | release | - | disabled or emergency stop: stop sending at once, never enable it again |
| backend_lost | release | - | nothing can be sent any more |
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum


class StopLevel(IntEnum):
    """What leaves for one arm; a higher number is a harder stop."""

    RUN = 0
    SCALE = 1
    DAMP = 2
    HOLD = 3
    RELEASE = 4


class Event(StrEnum):
    """What can go wrong in a cycle; ``LEVEL_OF`` says what follows."""

    TANK_LOW = "tank_low"
    LATE_CYCLE = "late_cycle"
    LATE_CYCLES = "late_cycles"
    STALE_STATE = "stale_state"
    STATE_NOT_FINITE = "state_not_finite"
    EFFORT_NOT_FINITE = "effort_not_finite"
    SOLVER_FAILED = "solver_failed"
    OVERSPEED = "overspeed"
    TANK_STARVED = "tank_starved"
    POSITION_LIMIT = "position_limit"
    PHASE_NOT_MET = "phase_not_met"
    GRIPPER_FAILED = "gripper_failed"
    INTERRUPT = "interrupt"
    OTHER_ARM = "other_arm"
    COLLISION = "collision"
    CUFF = "cuff"
    TORQUE_REFUSED = "torque_refused"
    CONTROLLER_SILENT = "controller_silent"
    STATE_LOST = "state_lost"
    ROBOT_REFLEX = "robot_reflex"
    MEMORY_SHORT = "memory_short"
    PLANT_NOT_FINITE = "plant_not_finite"
    NOT_RECORDED = "not_recorded"
    HOLD_REFUSED = "hold_refused"
    ROBOT_DISABLED = "robot_disabled"
    BACKEND_LOST = "backend_lost"


LEVEL_OF: Mapping[Event, StopLevel] = {
    Event.TANK_LOW: StopLevel.SCALE,
    Event.LATE_CYCLE: StopLevel.SCALE,
    Event.LATE_CYCLES: StopLevel.DAMP,
    Event.STALE_STATE: StopLevel.DAMP,
    Event.STATE_NOT_FINITE: StopLevel.DAMP,
    Event.EFFORT_NOT_FINITE: StopLevel.DAMP,
    Event.SOLVER_FAILED: StopLevel.DAMP,
    Event.OVERSPEED: StopLevel.DAMP,
    Event.TANK_STARVED: StopLevel.DAMP,
    Event.POSITION_LIMIT: StopLevel.DAMP,
    Event.PHASE_NOT_MET: StopLevel.DAMP,
    Event.GRIPPER_FAILED: StopLevel.DAMP,
    Event.INTERRUPT: StopLevel.DAMP,
    Event.OTHER_ARM: StopLevel.DAMP,
    Event.COLLISION: StopLevel.HOLD,
    Event.CUFF: StopLevel.HOLD,
    Event.TORQUE_REFUSED: StopLevel.HOLD,
    Event.CONTROLLER_SILENT: StopLevel.HOLD,
    Event.STATE_LOST: StopLevel.HOLD,
    Event.ROBOT_REFLEX: StopLevel.HOLD,
    Event.MEMORY_SHORT: StopLevel.HOLD,
    Event.PLANT_NOT_FINITE: StopLevel.HOLD,
    Event.NOT_RECORDED: StopLevel.HOLD,
    Event.HOLD_REFUSED: StopLevel.RELEASE,
    Event.ROBOT_DISABLED: StopLevel.RELEASE,
    Event.BACKEND_LOST: StopLevel.RELEASE,
}

BLIND: frozenset[Event] = frozenset({Event.STALE_STATE, Event.STATE_NOT_FINITE})
"""Events after which the motion is not known: the brake relaxes, and soon a hold follows."""


@dataclass(frozen=True)
class StopLimits:
    """Thresholds of the stop levels.

    Attributes:
        damping_time: Longest braking while states come [s].
        blind_damping_time: Longest braking without a state [s].
        rest_speed: Every joint below this counts as at rest [rad/s].
        speed_growth: Braking ends in a hold when the speed exceeds this many times its value at the start.
        late_cycles: More late cycles than this in a second stop the arms.
        stale_time, lost_time: Age of the last state that stops, and that makes damping a guess [s].
        starvation_time: Longest time for which the tank may reduce torque or springs [s].
    """

    damping_time: float
    blind_damping_time: float
    rest_speed: float
    speed_growth: float
    late_cycles: int
    stale_time: float
    lost_time: float
    starvation_time: float


@dataclass(frozen=True)
class Occurrence:
    """One event of one cycle.

    Attributes:
        event: What happened.
        arm: Which arm; None concerns all.
        detail: Numbers and names for the reason, e.g. ``joint 3 at 2.4 rad/s, bound 2.0``.
    """

    event: Event
    arm: str | None
    detail: str


@dataclass(frozen=True)
class Decision:
    """What one arm sends from now on, and why.

    Attributes:
        stop_level: What leaves.
        reason: Why, with everything that followed; empty only in RUN.
        discard: The torque computed in this cycle must not leave.
        seconds: Time at this level [s].
        braking: Longest time in DAMP [s]; None at other levels.
        entry_speed: Largest joint speed when DAMP began [rad/s]; None at other levels.
        event: What began the stop; None where there is none.
    """

    stop_level: StopLevel
    reason: str
    discard: bool
    seconds: float
    braking: float | None
    entry_speed: float | None
    event: Event | None = None


RUNNING = Decision(StopLevel.RUN, "", discard=False, seconds=0.0, braking=None, entry_speed=None)


def watch_time(
    late: bool, late_in_last_second: int, state_age: float, starved_time: float, limits: StopLimits
) -> tuple[Occurrence, ...]:
    """Turns a cycle's clocks into events for all arms.

    Args:
        late: This cycle's torque missed its deadline.
        late_in_last_second: Late cycles in the second that ends now.
        state_age: Age of the newest usable state [s].
        starved_time: ``Tank.starved_time`` [s].
        limits: Thresholds.
    """
    found: list[Occurrence] = []
    if late_in_last_second > limits.late_cycles:
        found.append(Occurrence(Event.LATE_CYCLES, None, f"{late_in_last_second} late cycles in one second"))
    if late:
        found.append(Occurrence(Event.LATE_CYCLE, None, "torque ready after its deadline"))
    if state_age >= limits.lost_time:
        found.append(Occurrence(Event.STATE_LOST, None, f"no state for {state_age:.3f} s"))
    elif state_age >= limits.stale_time:
        found.append(Occurrence(Event.STALE_STATE, None, f"no state for {state_age:.3f} s"))
    if starved_time >= limits.starvation_time:
        found.append(Occurrence(Event.TANK_STARVED, None, f"tank short of energy for {starved_time:.2f} s"))
    elif starved_time > 0:
        found.append(Occurrence(Event.TANK_LOW, None, "torque or springs reduced to what the tank can pay"))
    return tuple(found)


def escalate(
    decisions: Mapping[str, Decision],
    occurrences: Iterable[Occurrence],
    speeds: Mapping[str, float],
    period: float,
    limits: StopLimits,
) -> dict[str, Decision]:
    """The next decision of every arm; no arm ever leaves a stop by itself.

    An arm that stops makes every other running arm damp (event ``other_arm``), whether they hold one object
    or not: with an object it would push, without one the task is over all the same.

    Args:
        decisions: Arm -> decision of the last cycle (``RUNNING`` at the start).
        occurrences: Events of this cycle; one whose ``arm`` is None or unknown concerns every arm.
        speeds: Arm -> largest joint speed [rad/s]; the last one known when the state is stale.
        period: Time since the last call [s].
        limits: Thresholds.
    """
    events = tuple(occurrences)
    own: dict[str, Decision] = {}
    for arm, last in decisions.items():
        mine = [replace(o, arm=arm) for o in events if o.arm == arm or o.arm not in decisions]
        own[arm] = _next(last, mine, speeds[arm], period, limits)
    stopped = [arm for arm, decision in own.items() if decision.stop_level >= StopLevel.DAMP]
    for arm, decision in own.items():
        if stopped and decision.stop_level < StopLevel.DAMP:
            other = Occurrence(Event.OTHER_ARM, arm, f"{stopped[0]} stopped")
            own[arm] = _next(decisions[arm], [other], speeds[arm], period, limits)
    return own


def _next(
    last: Decision, events: list[Occurrence], speed: float, period: float, limits: StopLimits
) -> Decision:
    """One arm's decision: the hardest level wins, ties by the table's order."""
    order = list(LEVEL_OF)
    events = sorted(events, key=lambda o: (-LEVEL_OF[o.event], order.index(o.event)))
    target = LEVEL_OF[events[0].event] if events else StopLevel.RUN
    if target >= StopLevel.DAMP and target > last.stop_level:
        return _entered(last, events[0], speed, limits)
    if last.stop_level >= StopLevel.DAMP:
        going_blind = any(o.event in BLIND for o in events)
        return _braked(replace(last, seconds=last.seconds + period), going_blind, speed, limits)
    seconds = last.seconds + period if last.stop_level == target else 0.0
    if not events:
        return replace(RUNNING, seconds=seconds)
    late = any(o.event is Event.LATE_CYCLE for o in events)
    return Decision(StopLevel.SCALE, _reason(events[0]), late, seconds, None, None)


def _reason(occurrence: Occurrence) -> str:
    """Arm, event, numbers and the level it leads to, in one line."""
    name = occurrence.event.replace("_", " ")
    level = LEVEL_OF[occurrence.event].name.lower()
    return f"{occurrence.arm}: {name} ({occurrence.detail}) -> {level}"


def _entered(last: Decision, cause: Occurrence, speed: float, limits: StopLimits) -> Decision:
    """The first cycle of a stop; an earlier stop's reason stays in front."""
    target = LEVEL_OF[cause.event]
    reason = f"{last.reason}; {_reason(cause)}" if last.stop_level >= StopLevel.DAMP else _reason(cause)
    event = cause.event if last.event is None else last.event
    if target > StopLevel.DAMP:
        return Decision(target, reason, True, 0.0, None, None, event)
    braking = limits.blind_damping_time if cause.event in BLIND else limits.damping_time
    return Decision(target, reason, True, 0.0, braking, speed, event)


def _braked(now: Decision, going_blind: bool, speed: float, limits: StopLimits) -> Decision:
    """Ends braking at rest, after its time, or when the speed does not decay."""
    if now.braking is None or now.entry_speed is None:
        return now
    braking = min(now.braking, now.seconds + limits.blind_damping_time) if going_blind else now.braking
    if speed <= limits.rest_speed:
        end = f"at rest after {now.seconds:.3f} s"
    elif now.seconds >= braking:
        end = f"still at {speed:.3f} rad/s after {now.seconds:.3f} s"
    elif not speed <= limits.speed_growth * max(now.entry_speed, limits.rest_speed):
        end = f"speed grew to {speed:.3f} rad/s"
    else:
        return replace(now, braking=braking)
    reason = f"{now.reason}; {end} -> hold"
    return Decision(StopLevel.HOLD, reason, True, 0.0, None, None, now.event)


def stop_reason(decisions: Mapping[str, Decision]) -> str:
    """Why the arms stop: the arm that caused it, what it did, and what followed.

    An arm that stops because the other one did is named only where it went further than the cause.
    """
    hardest = max(decisions.values(), key=lambda decision: decision.stop_level)
    causes = [decision for decision in decisions.values() if decision.event not in (None, Event.OTHER_ARM)]
    own = max(causes, key=lambda decision: decision.stop_level, default=hardest)
    return own.reason if own.stop_level == hardest.stop_level else f"{own.reason}; {hardest.reason}"
