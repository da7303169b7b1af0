# SPDX-License-Identifier: BSD-3-Clause
"""What may be sent to a Baxter now, and why not: a state machine without a clock of its own; times are arguments.

| what happens | what follows |
|---|---|
| no state for `stale` | zero torque for `blind`, then a hold |
| no state for `lost` | hold; nothing else is sent |
| the controller is silent though states come | likewise |
| a torque that is not finite or beyond a joint's limit | it is never sent; zero torque once, then a hold |
| /robot/state silent for `silent` | hold |
| disabled, stopped, e-stop | nothing is sent any more, not even a hold |
| collision reported | hold, for at least `COLLISION_PAUSE` |
| cuff squeezed | that arm gets nothing while it is squeezed and is held where it was left; the others are held |
| end of the run | hold |

A hold is the robot's position mode at the measured angles. Nothing here ever returns to torque mode, enables,
resets or resumes: that takes a new run, begun by a person. The supervisor (``control/supervisor.py``) handles late
cycles, a filter without solution and the task's own limits; its torque passes through here all the same. If the whole
process is killed, the robot's own command time-out acts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter.ros.messages import AssemblyState
from impedance_modules.safety.stop_levels import Event

COLLISION_PAUSE = 2.0
"""Time for which the robot itself pauses after a collision; a hold lasts at least as long [s]."""


class DriveMode(Enum):
    """What is sent to the arms."""

    IDLE = "idle"
    TORQUE = "torque"
    HOLD = "hold"
    OFF = "off"


@dataclass(frozen=True)
class StopThresholds:
    """Thresholds.

    Attributes:
        stale, blind, lost: Age of the last state from which zero torque is sent; for how long; age from
            which the arms are held in any case [s].
        silent: Age of the last /robot/state at which the robot counts as gone [s].
        effort_max: (n,) largest torque that is sent [N.m].
    """

    stale: float
    blind: float
    lost: float
    silent: float
    effort_max: Array


@dataclass(frozen=True)
class Outgoing:
    """What is sent now, to each limb at most one thing.

    Attributes:
        effort: (n,) torque [N.m] for ``limbs``, or None.
        position: (n,) angles [rad] for ``limbs`` in position mode, or None.
        limbs: Which limbs it is for.
    """

    effort: Array | None
    position: Array | None
    limbs: tuple[str, ...]


NOTHING = Outgoing(None, None, ())


@dataclass(frozen=True)
class StopReason:
    """Why torque control ended by itself; ``event`` as in the table of stop levels."""

    event: Event
    detail: str


def stop_thresholds(period: float, effort_max: Array) -> StopThresholds:
    """Makes the thresholds of a control period.

    A state is stale after three periods, but no less than 30 ms, which is three periods of the slowest rate: at 500 Hz
    ordinary scheduling delays are longer than three periods.

    Args:
        period: Of the control loop [s].
        effort_max: (n,) of the joints [N.m].
    """
    return StopThresholds(
        stale=max(3.0 * period, 0.03),
        blind=max(2.0 * period, 0.02),
        lost=max(0.1, 6.0 * period),
        silent=0.5,
        effort_max=effort_max,
    )


def why_off(robot: AssemblyState) -> str | None:
    """Says why a robot in this state must not be sent anything; None where it may."""
    if robot.estop_button == robot.BUTTON_PRESSED:
        return "the e-stop is pressed"
    if robot.estop_source != robot.SOURCE_NONE:
        sources = {1: "a person", 2: "an unknown source", 3: "a joint fault", 4: "a lost heartbeat"}
        return f"stopped by {sources.get(robot.estop_source, f'source {robot.estop_source}')}"
    if robot.stopped:
        return "the robot is stopped"
    if not robot.enabled:
        return "the robot is disabled"
    return None


class Stops:
    """Decides, event by event, what may be sent.

    Attributes:
        mode: Now.
        reason: The first reason why torque ended; None while it has not, or ended as it should.
    """

    def __init__(self, thresholds: StopThresholds, limbs: Mapping[str, NDArray[np.intp]]) -> None:
        """Takes the thresholds and each commanded limb's place in the vectors."""
        self.mode = DriveMode.IDLE
        self.reason: StopReason | None = None
        self._thresholds = thresholds
        self._limbs = limbs
        self._position: Array | None = None
        self._taken = -np.inf
        self._robot_seen = -np.inf
        self._off: str | None = "/robot/state was never heard"
        self._torque_at = -np.inf
        self._squeezed: set[str] = set()
        self._hold: Array | None = None
        self._pause_end = -np.inf

    @property
    def pause_end(self) -> float:
        """Until when a hold must last at least [s]."""
        return self._pause_end

    def on_state(self, taken: float, position: Array) -> None:
        """A state that was taken at ``taken`` [s]; angles that are not finite change nothing here."""
        if not np.isfinite(position).all():
            return
        self._taken, self._position = taken, position
        if self._hold is not None:
            for limb in self._squeezed & set(self._limbs):
                joints = self._limbs[limb]
                self._hold[joints] = position[joints]

    def on_robot(self, now: float, robot: AssemblyState) -> None:
        """/robot/state: enabled, stopped, e-stop."""
        self._robot_seen, self._off = now, why_off(robot)
        why = self._off
        if why is not None and self.mode in (DriveMode.TORQUE, DriveMode.HOLD):
            self._note_reason(Event.ROBOT_DISABLED, why)
            self.mode = DriveMode.OFF

    def on_collision(self, now: float, limb: str, detected: bool) -> None:
        """The robot's own collision detection."""
        if detected and self.mode in (DriveMode.TORQUE, DriveMode.HOLD):
            self._pause_end = now + COLLISION_PAUSE
            self._hold_for(Event.COLLISION, f"the robot reports a collision of its {limb} arm")

    def on_cuff(self, limb: str, squeezed: bool) -> None:
        """The switch in the cuff."""
        if not squeezed:
            self._squeezed.discard(limb)
            return
        self._squeezed.add(limb)
        if self.mode in (DriveMode.TORQUE, DriveMode.HOLD) and limb in self._limbs:
            self._hold_for(Event.CUFF, f"the cuff of the {limb} arm is squeezed")

    def begin(self, now: float) -> str | None:
        """Starts torque mode; returns why that is impossible, or None."""
        if self.reason is not None or self.mode is DriveMode.OFF:
            return "nothing is sent any more" if self.reason is None else self.reason.detail
        if self._position is None or now - self._taken > self._thresholds.stale:
            return "no fresh state of the arms"
        if now - self._robot_seen > self._thresholds.silent:
            return f"nothing heard of the robot's state for {now - self._robot_seen:.2f} s"
        if self._reason_not_to_move() is not None:
            return self._reason_not_to_move()
        self.mode, self._torque_at, self._hold = DriveMode.TORQUE, now, None
        return None

    def torque(self, now: float, effort: Array) -> Outgoing:
        """Returns what is sent for the controller's torque (n,) [N.m]: that, zero torque, or nothing."""
        if self.mode is not DriveMode.TORQUE:
            return NOTHING
        self._torque_at = now
        if now - self._taken > self._thresholds.stale:
            return self.watch(now)
        wrong = self._refused_torque(effort)
        if wrong is not None:
            self._hold_for(Event.TORQUE_REFUSED, wrong)
            return self._zero_torque()
        return Outgoing(effort, None, tuple(self._limbs))

    def watch(self, now: float) -> Outgoing:
        """Returns what must be sent without a request: zero torque, a hold, or nothing; call it every few ms."""
        if self.mode is DriveMode.TORQUE:
            return self._watch_torque(now)
        if self.mode is DriveMode.HOLD and self._hold is not None:
            limbs = tuple(limb for limb in self._limbs if limb not in self._squeezed)
            return Outgoing(None, self._hold, limbs) if limbs else NOTHING
        return NOTHING

    def move(self, position: Array) -> str | None:
        """Sets the target (n,) [rad] of position mode before torque begins; returns why that is impossible."""
        if self.reason is not None or self.mode not in (DriveMode.IDLE, DriveMode.HOLD):
            return "torque mode is on" if self.reason is None else self.reason.detail
        if self._reason_not_to_move() is not None:
            return self._reason_not_to_move()
        self.mode, self._hold = DriveMode.HOLD, position.copy()
        return None

    def end(self) -> None:
        """Ends torque control as planned: from now on, hold."""
        if self.mode is DriveMode.TORQUE:
            self._enter_hold()

    def leave(self) -> None:
        """Sends nothing any more."""
        self.mode = DriveMode.OFF

    def _reason_not_to_move(self) -> str | None:
        """Says why a robot that is known to be there may not be moved now."""
        if self._off is not None:
            return self._off
        return f"a cuff is squeezed: {', '.join(sorted(self._squeezed))}" if self._squeezed else None

    def _watch_torque(self, now: float) -> Outgoing:
        thresholds = self._thresholds
        age, silence = now - self._taken, now - self._torque_at
        if now - self._robot_seen > thresholds.silent:
            self._hold_for(Event.STATE_LOST, f"/robot/state silent for {now - self._robot_seen:.2f} s")
        elif age > thresholds.lost or age > thresholds.stale + thresholds.blind:
            self._hold_for(Event.STATE_LOST, f"no state for {1e3 * age:.0f} ms")
        elif silence > thresholds.stale + thresholds.blind:
            self._hold_for(Event.CONTROLLER_SILENT, f"the controller was silent for {1e3 * silence:.0f} ms")
        elif max(age, silence) > thresholds.stale:
            return self._zero_torque()
        else:
            return NOTHING
        return self.watch(now)

    def _refused_torque(self, effort: Array) -> str | None:
        if not np.isfinite(effort).all():
            return "a torque is not finite"
        over = np.abs(effort) > self._thresholds.effort_max * (1.0 + 1e-9)
        if over.any():
            joint = int(np.argmax(over))
            limit = self._thresholds.effort_max[joint]
            return f"torque {effort[joint]:.3f} N.m of joint {joint} is beyond its limit of {limit:g} N.m"
        return None

    def _zero_torque(self) -> Outgoing:
        """For a moment in which nobody knows the motion well enough to brake it."""
        return Outgoing(np.zeros(self._thresholds.effort_max.size), None, tuple(self._limbs))

    def _hold_for(self, event: Event, detail: str) -> None:
        first = self.reason is None
        self._note_reason(event, detail)
        if first:
            self._enter_hold()

    def _enter_hold(self) -> None:
        self.mode = DriveMode.HOLD
        self._hold = None if self._position is None else self._position.copy()

    def _note_reason(self, event: Event, detail: str) -> None:
        if self.reason is None:
            self.reason = StopReason(event, detail)
