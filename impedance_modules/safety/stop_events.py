# SPDX-License-Identifier: BSD-3-Clause
"""What can stop a run, and which rung of the stop ladder each event leads to. Data only.

| event | rung | braking | why |
|---|---|---|---|
| tank_low | scale | - | the tank pays for part of the torque; the task slows down |
| late_cycle | scale | - | this torque is dropped, no two commands catch up; the ledger books ``missed`` |
| late_cycles | damp | full | too many in a second: the loop does not keep its rate |
| stale_state | damp | brief | no state for some periods: the last velocity is only good for a moment |
| state_not_finite | damp | brief | likewise |
| effort_not_finite | damp | full | the law failed, the state is sound |
| solver_failed | damp | full | unfiltered torque never leaves |
| overspeed | damp | full | the declared v_max, on which the guarantee rests, was exceeded |
| tank_starved | damp | full | short of energy for too long: something keeps draining it |
| position_limit | damp | full | beyond the limit in spite of the QP's rows |
| phase_not_met | damp | full | the task's own ``until`` was not met in time |
| interrupt | damp | full | a person stopped the run |
| other_arm | damp | full | another arm stopped: this one brakes, it does not push on a held object |
| collision | hold | - | the robot's collision detection has already stopped the arm |
| cuff | hold | - | somebody squeezes the robot's cuff to lead the arm by hand |
| torque_refused | hold | - | the robot's driver was given a torque that must not leave |
| controller_silent | hold | - | the robot's watchdog heard no torque for too long |
| state_lost | hold | - | no state for so long that damping would be guessing |
| hold_refused | release | - | the robot cannot hold, or the tank cannot pay a hold |
| robot_disabled | release | - | disabled or emergency stop: stop sending at once, never enable it again |
| backend_lost | release | - | nothing can be sent any more |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum


class Rung(IntEnum):
    """What leaves for one arm; a higher number is a harder stop."""

    RUN = 0
    SCALE = 1
    DAMP = 2
    HOLD = 3
    RELEASE = 4


class Event(StrEnum):
    """What can go wrong in a cycle; ``RUNG_OF`` says what follows."""

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
    INTERRUPT = "interrupt"
    OTHER_ARM = "other_arm"
    COLLISION = "collision"
    CUFF = "cuff"
    TORQUE_REFUSED = "torque_refused"
    CONTROLLER_SILENT = "controller_silent"
    STATE_LOST = "state_lost"
    HOLD_REFUSED = "hold_refused"
    ROBOT_DISABLED = "robot_disabled"
    BACKEND_LOST = "backend_lost"


RUNG_OF: Mapping[Event, Rung] = {
    Event.TANK_LOW: Rung.SCALE,
    Event.LATE_CYCLE: Rung.SCALE,
    Event.LATE_CYCLES: Rung.DAMP,
    Event.STALE_STATE: Rung.DAMP,
    Event.STATE_NOT_FINITE: Rung.DAMP,
    Event.EFFORT_NOT_FINITE: Rung.DAMP,
    Event.SOLVER_FAILED: Rung.DAMP,
    Event.OVERSPEED: Rung.DAMP,
    Event.TANK_STARVED: Rung.DAMP,
    Event.POSITION_LIMIT: Rung.DAMP,
    Event.PHASE_NOT_MET: Rung.DAMP,
    Event.INTERRUPT: Rung.DAMP,
    Event.OTHER_ARM: Rung.DAMP,
    Event.COLLISION: Rung.HOLD,
    Event.CUFF: Rung.HOLD,
    Event.TORQUE_REFUSED: Rung.HOLD,
    Event.CONTROLLER_SILENT: Rung.HOLD,
    Event.STATE_LOST: Rung.HOLD,
    Event.HOLD_REFUSED: Rung.RELEASE,
    Event.ROBOT_DISABLED: Rung.RELEASE,
    Event.BACKEND_LOST: Rung.RELEASE,
}

BLIND: frozenset[Event] = frozenset({Event.STALE_STATE, Event.STATE_NOT_FINITE})
"""Events after which the velocity is not known: braking is brief."""


@dataclass(frozen=True)
class StopLimits:
    """Thresholds of the ladder.

    Attributes:
        damping_time: Longest braking on a sound velocity [s].
        blind_damping_time: Longest braking on the last velocity seen [s].
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
