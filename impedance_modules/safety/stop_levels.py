# SPDX-License-Identifier: BSD-3-Clause
"""The stop ladder: run, scale, damp, hold, release. A pure decision, one step per cycle.

A torque that is late, not finite, unsolved or unpaid for never leaves: ``Decision.discard`` is set in every
stop and in a late cycle. SCALE is not a stop (the tank slows the task, or one late cycle is left out) and
ends with its cause. The three stops never climb back: only a new run does, from the measured pose, when a
person asks for it. Which event leads where: ``stop_events.py``.

DAMP is torque -D v (``stopping.damping_effort``), paid by the tank with its floor released; it becomes HOLD
when the arm is at rest, when its time is up, or when the speed grows instead of decaying. HOLD is the robot's
own position mode, or ``stopping.hold_effort`` where it has none. RELEASE is zero torque; the robot's own
gravity compensation remains.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from impedance_modules.safety.stop_events import BLIND, RUNG_OF, Event, Occurrence, Rung, StopLimits


@dataclass(frozen=True)
class Decision:
    """What one arm sends from now on, and why.

    Attributes:
        rung: What leaves.
        reason: Why, with everything that followed; empty only in RUN.
        discard: The torque computed in this cycle must not leave.
        seconds: Time in this rung [s].
        braking: Longest time in DAMP [s]; None in other rungs.
        entry_speed: Largest joint speed when DAMP began [rad/s]; None in other rungs.
    """

    rung: Rung
    reason: str
    discard: bool
    seconds: float
    braking: float | None
    entry_speed: float | None


RUNNING = Decision(Rung.RUN, "", discard=False, seconds=0.0, braking=None, entry_speed=None)


def descend(
    ladder: Mapping[str, Decision],
    occurrences: Iterable[Occurrence],
    speeds: Mapping[str, float],
    period: float,
    limits: StopLimits,
) -> dict[str, Decision]:
    """The next decision of every arm; no arm ever leaves a stop by itself.

    An arm that stops makes every other running arm damp (event ``other_arm``), whether they hold one object
    or not: with an object it would push, without one the task is over all the same.

    Args:
        ladder: Arm -> decision of the last cycle (``RUNNING`` at the start).
        occurrences: Events of this cycle; one whose ``arm`` is None or unknown concerns every arm.
        speeds: Arm -> largest joint speed [rad/s]; the last one known when the state is stale.
        period: Time since the last call [s].
        limits: Thresholds.
    """
    events = tuple(occurrences)
    own: dict[str, Decision] = {}
    for arm, last in ladder.items():
        mine = [replace(o, arm=arm) for o in events if o.arm == arm or o.arm not in ladder]
        own[arm] = _next(last, mine, speeds[arm], period, limits)
    stopped = [arm for arm, decision in own.items() if decision.rung >= Rung.DAMP]
    for arm, decision in own.items():
        if stopped and decision.rung < Rung.DAMP:
            other = Occurrence(Event.OTHER_ARM, arm, f"{stopped[0]} stopped")
            own[arm] = _next(ladder[arm], [other], speeds[arm], period, limits)
    return own


def _next(
    last: Decision, events: list[Occurrence], speed: float, period: float, limits: StopLimits
) -> Decision:
    """One arm's decision: the hardest rung wins, ties by the table's order."""
    order = list(RUNG_OF)
    events = sorted(events, key=lambda o: (-RUNG_OF[o.event], order.index(o.event)))
    target = RUNG_OF[events[0].event] if events else Rung.RUN
    if target >= Rung.DAMP and target > last.rung:
        return _entered(last, events[0], speed, limits)
    if last.rung >= Rung.DAMP:
        going_blind = any(o.event in BLIND for o in events)
        return _braked(replace(last, seconds=last.seconds + period), going_blind, speed, limits)
    seconds = last.seconds + period if last.rung == target else 0.0
    if not events:
        return replace(RUNNING, seconds=seconds)
    late = any(o.event is Event.LATE_CYCLE for o in events)
    return Decision(Rung.SCALE, _reason(events[0]), late, seconds, None, None)


def _reason(occurrence: Occurrence) -> str:
    """Arm, event, numbers and the rung it leads to, in one line."""
    name = occurrence.event.replace("_", " ")
    rung = RUNG_OF[occurrence.event].name.lower()
    return f"{occurrence.arm}: {name} ({occurrence.detail}) -> {rung}"


def _entered(last: Decision, cause: Occurrence, speed: float, limits: StopLimits) -> Decision:
    """The first cycle of a stop; an earlier stop's reason stays in front."""
    target = RUNG_OF[cause.event]
    reason = f"{last.reason}; {_reason(cause)}" if last.rung >= Rung.DAMP else _reason(cause)
    if target > Rung.DAMP:
        return Decision(target, reason, True, 0.0, None, None)
    braking = limits.blind_damping_time if cause.event in BLIND else limits.damping_time
    return Decision(target, reason, True, 0.0, braking, speed)


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
    return Decision(Rung.HOLD, f"{now.reason}; {end} -> hold", True, 0.0, None, None)
