# SPDX-License-Identifier: BSD-3-Clause
"""Watches every cycle and decides what leaves: the law's torque, a braking torque, or nothing.

All causes end in one place, the decisions of ``safety.stop_levels``; every stop has a reason in ``reason`` and in
``messages``. The supervisor is a function of the states it is given (and of lateness and interrupts, which are
recorded), so a replay decides the same.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.grippers import GripperRobot
from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.contact_detection import ContactLoss, HandWrenches
from impedance_modules.control.controller import Controller
from impedance_modules.control.cycle import EFFORT_NOT_FINITE, STATE_NOT_FINITE
from impedance_modules.control.equilibrium_following import Following, following_nothing
from impedance_modules.control.gripper_watch import GripperWatch
from impedance_modules.control.phases import Outcome, Sequence
from impedance_modules.control.set_point_source import SetPointSource, report_of
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.stop_levels import (
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

Array = NDArray[np.float64]

LOOKS = 100.0
"""How often conditions are judged [Hz]: contact is judged over several hundredths of a second."""

BEYOND_LIMIT = 0.02
"""A joint this far outside its range in spite of the filter's rows stops the run [rad]."""


class Ending(Enum):
    """How a run ended."""

    DONE = "done"
    STOPPED = "stopped"
    INTERRUPTED = "interrupted"


class Supervisor:
    """Runs a controller through its task, safely.

    Attributes:
        controller: The law.
        sequence: The phases.
        touch: Wrenches on the hands.
        grippers: What they were ordered and report.
        followed: What followed set-points in the last cycle of the law; ``look`` may have ended its phase since.
        decisions: Arm -> what it sends and why.
        ending: None while the run goes on.
        reason: Why it stopped; empty after a task that is done.
        messages: (time, text) of everything worth telling.
    """

    def __init__(
        self,
        assembly: Assembly,
        source: SetPointSource | None = None,
        grippers: GripperRobot | None = None,
    ) -> None:
        """Takes the task and what it needs besides states.

        Args:
            assembly: The task.
            source: Where set-points come from in phases that listen; None where nothing comes.
            grippers: Takes the orders of the task's grippers (``grippers_of``); None for a task without.

        Raises:
            BadInput: The task orders grippers, and nothing takes that.
        """
        self.assembly = assembly
        self._source = source
        self.followed: Following = following_nothing()
        self.controller = Controller(assembly)
        self._every = max(1, round(assembly.rate / LOOKS))
        self.hand_wrenches = HandWrenches(
            assembly.weighed,
            assembly.modules,
            self.controller.kinematics,
            self._every * assembly.period,
        )
        self.grippers = GripperWatch(assembly, grippers)
        self.sequence = Sequence(self.controller, self.hand_wrenches, self.grippers)
        self.decisions: dict[str, Decision] = {arm.limb.name: RUNNING for arm in assembly.modules.arms}
        self._hardest = StopLevel.RUN
        self.ending: Ending | None = None
        self.reason = ""
        self.messages: list[tuple[float, str]] = []
        self._lost_contact = ContactLoss(self.controller, self.hand_wrenches)
        self._cycle = 0
        self._interrupted = False
        self._unseen: RobotState | None = None
        self._seen: list[Occurrence] = []
        self._speeds = dict.fromkeys(self.decisions, 0.0)
        self._velocity: Array = np.zeros(assembly.model.n)
        self._time = 0.0
        limits = assembly.limits
        self._low = limits.position_min - BEYOND_LIMIT
        self._high = limits.position_max + BEYOND_LIMIT
        self.stop_limits = stop_limits(assembly.period)
        self._timekeeper = Timekeeper(self.controller, self.stop_limits, assembly.period)

    @property
    def missed(self) -> int:
        """Cycles without a state just before the last one that had one."""
        return self._timekeeper.missed

    @property
    def stop_level(self) -> StopLevel:
        """The lowest stop_level any arm is on; SCALE while the tank slows the task."""
        controller = self.controller
        if self._hardest == StopLevel.RUN and (
            controller.tank.starved_time > 0.0 or controller.cycle.admitted < 1.0
        ):
            return StopLevel.SCALE
        return self._hardest

    @property
    def released(self) -> bool:
        """Whether some arm must not be held."""
        return any(decision.stop_level == StopLevel.RELEASE for decision in self.decisions.values())

    def note(self, text: str) -> None:
        """Adds a message at the last known time."""
        self._say(self.messages[-1][0] if self.messages else 0.0, text)

    def halt(self, event: Event, detail: str) -> None:
        """Ends the run because the robot, or what watches it, has ended torque control by itself.

        Args:
            event: One that leads to a hold or a release.
            detail: Numbers and names for the reason.
        """
        self._escalate(None, [Occurrence(event, None, detail)], entering=False)
        if detail not in self.reason:
            self.reason = f"{self.reason}; {event.replace('_', ' ')} ({detail})"
            self._say(self._time, self.reason)
        # Also where somebody had asked for the end: the robot was not braked by this run.
        self.ending = Ending.STOPPED

    def start(self, first: FirstState) -> None:
        """Takes over the robot as it stands.

        Raises:
            SafetyStop: The first state is not finite.
        """
        self.controller.start(first, self.sequence.phase)
        self.hand_wrenches.reset(first.state)
        self._velocity, self._time = first.state.velocity, first.state.time
        self._begin_listening()
        self._enter_phase(first.state.time)

    def step(self, state: RobotState | None, *, late: bool, stop_request: str | None) -> Array | None:
        """Decides what leaves in one cycle; ``look`` follows once it has left.

        Args:
            state: The newest state, None if none came.
            late: The last torque missed its deadline and was not sent.
            stop_request: Why the run is asked to end; None while it is not.

        Returns:
            (n,) torque to send [N.m], or None when nothing may leave in this cycle. After ``ending`` is set, None.
        """
        running = self._hardest < StopLevel.DAMP
        self._unseen = None
        overdue = self._timekeeper.count(state, since=self._time, running=running)
        events = self._timekeeper.watch(self._cycle, missing=state is None, late=late) + self._seen
        self._seen = []
        if stop_request is not None and not self._interrupted:
            self._interrupted = True
            events.append(Occurrence(Event.INTERRUPT, None, stop_request))
        if state is None:
            self.controller.miss()
        elif running and not events:
            events = self._run(state)
            if not events:
                self._velocity, self._time = state.velocity, state.time
                if overdue:
                    self.controller.repeat()
                return self.controller.effort
        return self._escalate(state, events, entering=running)

    def _run(self, state: RobotState) -> list[Occurrence]:
        """One cycle of the law; returns what went wrong."""
        controller = self.controller
        self.followed = controller.following
        if self._source is not None and controller.following.active:
            self._source.write(controller.following, state)
        status = controller.tick(state)
        self._cycle += 1
        if status == STATE_NOT_FINITE:
            return [Occurrence(Event.STATE_NOT_FINITE, None, "a position, velocity or effort is not finite")]
        if status == EFFORT_NOT_FINITE:
            return [Occurrence(Event.EFFORT_NOT_FINITE, None, "the modules' torque is not finite")]
        if not controller.solved:
            solution = controller.solution
            status_text = "no solution" if solution is None else solution.status
            return [Occurrence(Event.SOLVER_FAILED, None, status_text)]
        if controller.cycle.too_fast < state.position.size:
            return [self._overspeed(controller.cycle.too_fast)]
        return self._beyond_limits(state) if self._cycle % self._every == 0 else []

    def _beyond_limits(self, state: RobotState) -> list[Occurrence]:
        """Stops for a joint outside its range, or leaves the state to be looked at further."""
        outside = (state.position < self._low) | (state.position > self._high)
        if outside.any():
            names = self.assembly.model.joint_names
            return [
                Occurrence(Event.POSITION_LIMIT, self._arm_of(j), f"{names[j]} beyond the joint's range")
                for j in map(int, np.flatnonzero(outside))
            ]
        self._unseen = state
        return []

    def look(self) -> None:
        """Judges touch and phases at 100 Hz, once the torque of the cycle, which does not need them, has left.

        What is found takes effect in the next cycle: a new phase, the end of the run, a stop.
        """
        state = self._unseen
        if state is None:
            return
        self.hand_wrenches.update(state)
        for text in self._lost_contact.look():
            self._say(state.time, text)
        self._report(state)
        self._seen = self.grippers.look()
        if self._seen:
            return
        outcome = self.sequence.look(state.time)
        if outcome is Outcome.NOT_MET:
            self._seen = [Occurrence(Event.PHASE_NOT_MET, None, self.sequence.why_not_met())]
        if outcome in (Outcome.NOT_MET, Outcome.GOES_ON):
            return
        name, _, why = self.sequence.ended[-1]
        self._say(state.time, f"phase '{name}' ended: {why}")
        if outcome is Outcome.DONE:
            self.ending = Ending.DONE
        else:
            self.controller.next_phase(self.sequence.phase)
            self._begin_listening()
            self._enter_phase(state.time)

    def _enter_phase(self, time: float) -> None:
        """Says which phase begins and orders what it asks of grippers."""
        phase = self.sequence.phase
        self._say(time, f"phase '{phase.name}'")
        self.grippers.begin(phase, lambda text: self._say(time, text))

    def _report(self, state: RobotState) -> None:
        """Tells the source of set-points how the run is, and the log what the source has to tell."""
        if self._source is None:
            return
        report = report_of(self.controller, self.hand_wrenches.wrench, self.sequence.phase.name, state)
        for text in self._source.look(report):
            self._say(state.time, text)

    def _begin_listening(self) -> None:
        if self._source is not None:
            self._source.begin(self.sequence.phase.name, self.controller.following)

    def _escalate(
        self, state: RobotState | None, events: list[Occurrence], *, entering: bool
    ) -> Array | None:
        """Applies the decisions, and brakes where it says so."""
        sound = state is not None and _is_finite(state)
        if state is not None and sound:
            self._velocity, self._time = state.velocity, state.time
        elif state is not None:
            # Nothing was booked for a state that cannot be read; for one that did not come, ``step`` has done so.
            self.controller.miss()
        # Without a sound state, of the last velocity seen: an arm that was moving is not at rest.
        self._speeds = self._arm_speeds(self._velocity)
        before = self.decisions
        self.decisions = escalate(before, events, self._speeds, self.assembly.period, self.stop_limits)
        self._hardest = max(decision.stop_level for decision in self.decisions.values())
        if self._hardest < StopLevel.DAMP:
            return None
        self.reason = stop_reason(self.decisions)
        if self.reason != stop_reason(before):
            self._say(self._time, self.reason)
        if self._hardest > StopLevel.DAMP:
            self.ending = Ending.INTERRUPTED if self._interrupted else Ending.STOPPED
            return None
        if entering:
            self.controller.relax()
        return self.controller.effort if self.controller.brake(state if sound else None) == 0 else None

    def _overspeed(self, joint: int) -> Occurrence:
        name = self.assembly.model.joint_names[joint]
        bound = self.assembly.limits.velocity_max[joint]
        detail = f"motor or link of {name} beyond its declared {bound:g} rad/s"
        return Occurrence(Event.OVERSPEED, self._arm_of(joint), detail)

    def _arm_of(self, joint: int) -> str | None:
        """Names the arm that a joint belongs to; None where that arm takes no part in the task."""
        owners = (arm.limb.name for arm in self.assembly.modules.arms if joint in arm.limb.joints)
        return next(owners, None)

    def _arm_speeds(self, velocity: Array) -> dict[str, float]:
        return {
            arm.limb.name: float(np.max(np.abs(velocity[arm.limb.joints])))
            for arm in self.assembly.modules.arms
        }

    def _say(self, time: float, text: str) -> None:
        self.messages.append((time, text))


def _is_finite(state: RobotState) -> bool:
    return bool(np.isfinite(np.concatenate([state.position, state.velocity, state.effort])).all())


class Timekeeper:
    """Counts periods by the robot's clock and tells the ledger, and turns lateness into events.

    Attributes:
        missed: Cycles without a state just before the last one that had one.
    """

    def __init__(self, controller: Controller, limits: StopLimits, period: float) -> None:
        """Takes the law, the thresholds of stops and the control period [s]."""
        self.missed = 0
        self._controller, self._limits, self._period = controller, limits, period
        self._without_state = 0
        self._late: list[float] = []
        self._age = 0.0
        self._gap = 0.0

    def count(self, state: RobotState | None, *, since: float, running: bool) -> bool:
        """Tells the ledger how many periods the robot has run since its last state, by the robot's clock.

        Fewer than the cycles that were counted meanwhile: the state is late, not lost. Its torque would begin to act
        somewhere within a period that is under way, and nobody could say what it does there: the last one goes on.

        Args:
            state: Of this cycle; None where none came.
            since: Time of the last one [s].
            running: No stop is under way.

        Returns:
            Whether the state is late.
        """
        if state is None:
            self._without_state += 1
            return False
        self._gap = state.time - since
        self.missed, self._without_state = self._without_state, 0
        intervals = max(1, round((state.time - since) / self._period))
        counted = self.missed + 1
        # In a stop a torque left for every cycle that was counted, with or without a state: those stay booked.
        if intervals > counted or (running and intervals < counted):
            self._controller.reckon(intervals if running else intervals - self.missed, anew=running)
        return intervals < counted

    def watch(self, cycle: int, *, missing: bool, late: bool) -> list[Occurrence]:
        """Tells lateness, a state that does not come, a tank that stays empty.

        Args:
            cycle: Counts the cycles of the law.
            missing: No state came in this one.
            late: The last torque missed its deadline and was not sent; it is taken back.
        """
        self._age = self._age + self._period if missing else 0.0
        # A loop that slept has missed no cycle of its own, but the robot has run without it.
        age = self._age if missing or self._gap < self._limits.lost_time else self._gap
        starved = self._controller.tank.starved_time
        if not (late or self._late) and age == 0.0 and starved < self._limits.starvation_time:
            return []
        now = cycle * self._period
        if late:
            self._controller.withdraw()
            self._late.append(now)
        self._late = [time for time in self._late if time > now - 1.0]
        found = watch_time(late, len(self._late), age, starved, self._limits)
        # A single late torque was withdrawn and a low tank slows the task by itself: neither is a stop.
        return [event for event in found if event.event not in (Event.TANK_LOW, Event.LATE_CYCLE)]


def stop_limits(period: float) -> StopLimits:
    """The thresholds of stops at a control period [s]; times follow facts of Baxter's own time-outs."""
    return StopLimits(
        damping_time=0.5,
        blind_damping_time=max(0.02, 2.0 * period),
        rest_speed=0.05,
        speed_growth=1.5,
        late_cycles=5,
        stale_time=max(0.03, 3.0 * period),
        lost_time=max(0.1, 6.0 * period),
        starvation_time=2.0,
    )
