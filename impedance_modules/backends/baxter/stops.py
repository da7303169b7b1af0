# SPDX-License-Identifier: BSD-3-Clause
"""What may be sent to a Baxter now, and why not: a pure state machine with everybody's clock given to it.

| what happens | what follows |
|---|---|
| no state for `stale` | torque -D v on the last velocity for `blind`, then a hold |
| no state for `lost` | hold; nothing else leaves |
| the law is silent though states come | likewise braked, then held |
| a torque that is not finite or beyond a joint's limit | it never leaves; one braking torque, then a hold |
| /robot/state silent for `silent` | hold |
| disabled, stopped, e-stop | nothing is sent any more, not even a hold |
| collision felt | hold, for at least `COLLISION_PAUSE` |
| cuff squeezed | that arm gets nothing while it is squeezed and is held where it was left; the others are held |
| end of the run | hold |

A hold is the robot's position mode at the measured angles. Nothing here ever goes back to torque, enables,
resets or resumes: that takes a new run, begun by a person. Late cycles, a law without solution and a task's own
limits are the supervisor's (``control/supervisor.py``), whose torque passes through here all the same; a
controller that was killed is the robot's own command time-out's.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.messages import AssemblyState
from impedance_modules.backends.baxter.stop_rules import NOTHING, Fault, Mode, Order, StopRules, why_off
from impedance_modules.safety.stop_levels import Event, damping_effort

Array = NDArray[np.float64]

COLLISION_PAUSE = 2.0
"""For how long the robot itself pauses after a collision; a hold lasts at least as long [s]."""


class Stops:
    """Decides, event by event, what may be sent.

    Attributes:
        mode: Now.
        fault: The first reason why torque ended; None while it has not, or ended as it should.
    """

    def __init__(self, rules: StopRules, limbs: Mapping[str, NDArray[np.intp]]) -> None:
        """Takes the thresholds and each commanded limb's place in the vectors."""
        self.mode = Mode.IDLE
        self.fault: Fault | None = None
        self._rules = rules
        self._limbs = limbs
        self._position: Array | None = None
        self._velocity: Array | None = None
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

    def on_state(self, taken: float, position: Array, velocity: Array) -> None:
        """A state that was taken at ``taken`` [s]; angles that are not finite change nothing here."""
        if not np.isfinite(position).all():
            return
        self._taken, self._position = taken, position
        if np.isfinite(velocity).all():
            self._velocity = velocity
        if self._hold is not None:
            for limb in self._squeezed & set(self._limbs):
                joints = self._limbs[limb]
                self._hold[joints] = position[joints]

    def on_robot(self, now: float, robot: AssemblyState) -> None:
        """/robot/state: enabled, stopped, e-stop."""
        self._robot_seen, self._off = now, why_off(robot)
        why = self._off
        if why is not None and self.mode in (Mode.TORQUE, Mode.HOLD):
            self._blame(Event.ROBOT_DISABLED, why)
            self.mode = Mode.OFF

    def on_collision(self, now: float, limb: str, felt: bool) -> None:
        """The robot's own collision detection."""
        if felt and self.mode in (Mode.TORQUE, Mode.HOLD):
            self._pause_end = now + COLLISION_PAUSE
            self._hold_for(Event.COLLISION, f"the robot felt a collision of its {limb} arm")

    def on_cuff(self, limb: str, squeezed: bool) -> None:
        """The switch in the cuff."""
        if not squeezed:
            self._squeezed.discard(limb)
            return
        self._squeezed.add(limb)
        if self.mode in (Mode.TORQUE, Mode.HOLD) and limb in self._limbs:
            self._hold_for(Event.CUFF, f"the cuff of the {limb} arm is squeezed")

    def begin(self, now: float) -> str | None:
        """Starts torque mode; returns why that is impossible, or None."""
        if self.fault is not None or self.mode is Mode.OFF:
            return "nothing is sent any more" if self.fault is None else self.fault.detail
        if self._position is None or now - self._taken > self._rules.stale:
            return "no fresh state of the arms"
        if now - self._robot_seen > self._rules.silent:
            return f"nothing heard of the robot's state for {now - self._robot_seen:.2f} s"
        if self._obstacle() is not None:
            return self._obstacle()
        self.mode, self._torque_at, self._hold = Mode.TORQUE, now, None
        return None

    def torque(self, now: float, effort: Array) -> Order:
        """What leaves in place of the law's torque (n,) [N.m]: that, or braking, or nothing."""
        if self.mode is not Mode.TORQUE:
            return NOTHING
        self._torque_at = now
        if now - self._taken > self._rules.stale:
            return self.watch(now)
        wrong = self._wrong_torque(effort)
        if wrong is not None:
            self._hold_for(Event.TORQUE_REFUSED, wrong)
            return self._braking()
        return Order(effort, None, tuple(self._limbs))

    def watch(self, now: float) -> Order:
        """What must be sent though nobody asked: braking, a hold, or nothing. Call it every few milliseconds."""
        if self.mode is Mode.TORQUE:
            return self._watch_torque(now)
        if self.mode is Mode.HOLD and self._hold is not None:
            limbs = tuple(limb for limb in self._limbs if limb not in self._squeezed)
            return Order(None, self._hold, limbs) if limbs else NOTHING
        return NOTHING

    def move(self, position: Array) -> str | None:
        """Sets the target (n,) [rad] of position mode before torque begins; returns why that is impossible."""
        if self.fault is not None or self.mode not in (Mode.IDLE, Mode.HOLD):
            return "torque mode is on" if self.fault is None else self.fault.detail
        if self._obstacle() is not None:
            return self._obstacle()
        self.mode, self._hold = Mode.HOLD, position.copy()
        return None

    def end(self) -> None:
        """Ends torque control as planned: from now on, hold."""
        if self.mode is Mode.TORQUE:
            self._enter_hold()

    def leave(self) -> None:
        """Sends nothing any more."""
        self.mode = Mode.OFF

    def _obstacle(self) -> str | None:
        """Says why a robot that is known to be there may not be moved now."""
        if self._off is not None:
            return self._off
        return f"a cuff is squeezed: {', '.join(sorted(self._squeezed))}" if self._squeezed else None

    def _watch_torque(self, now: float) -> Order:
        rules = self._rules
        age, silence = now - self._taken, now - self._torque_at
        if now - self._robot_seen > rules.silent:
            self._hold_for(Event.STATE_LOST, f"/robot/state silent for {now - self._robot_seen:.2f} s")
        elif age > rules.lost or age > rules.stale + rules.blind:
            self._hold_for(Event.STATE_LOST, f"no state for {1e3 * age:.0f} ms")
        elif silence > rules.stale + rules.blind:
            self._hold_for(Event.CONTROLLER_SILENT, f"the controller was silent for {1e3 * silence:.0f} ms")
        elif max(age, silence) > rules.stale:
            return self._braking()
        else:
            return NOTHING
        return self.watch(now)

    def _wrong_torque(self, effort: Array) -> str | None:
        if not np.isfinite(effort).all():
            return "a torque is not finite"
        over = np.abs(effort) > self._rules.effort_max * (1.0 + 1e-9)
        if over.any():
            joint = int(np.argmax(over))
            limit = self._rules.effort_max[joint]
            return f"torque {effort[joint]:.3f} N.m of joint {joint} is beyond its limit of {limit:g} N.m"
        return None

    def _braking(self) -> Order:
        if self._velocity is None:
            return NOTHING
        effort = damping_effort(self._rules.damping, self._velocity, self._rules.effort_max)
        return Order(effort, None, tuple(self._limbs))

    def _hold_for(self, event: Event, detail: str) -> None:
        first = self.fault is None
        self._blame(event, detail)
        if first:
            self._enter_hold()

    def _enter_hold(self) -> None:
        self.mode = Mode.HOLD
        self._hold = None if self._position is None else self._position.copy()

    def _blame(self, event: Event, detail: str) -> None:
        if self.fault is None:
            self.fault = Fault(event, detail)
