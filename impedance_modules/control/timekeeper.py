# SPDX-License-Identifier: BSD-3-Clause
"""What a run makes of time: states that are late or never come, torques that are late, a tank that stays empty."""

from __future__ import annotations

from impedance_modules.control.controller import Controller
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.stop_levels import Event, Occurrence, StopLimits, watch_time


class Timekeeper:
    """Counts periods by the robot's clock and tells the ledger, and turns lateness into events.

    Attributes:
        missed: Cycles without a state just before the last one that had one.
    """

    def __init__(self, controller: Controller, limits: StopLimits, period: float) -> None:
        """Takes the law, the ladder's thresholds and the control period [s]."""
        self.missed = 0
        self._controller, self._limits, self._period = controller, limits, period
        self._without_state = 0
        self._late: list[float] = []
        self._age = 0.0

    def count(self, state: RobotState | None, *, since: float, running: bool) -> bool:
        """Tells the ledger how many periods the robot has lived through since its last state, by the robot's clock.

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
        starved = self._controller.starved_time
        if not (late or self._late) and self._age == 0.0 and starved < self._limits.starvation_time:
            return []
        now = cycle * self._period
        if late:
            self._controller.withdraw()
            self._late.append(now)
        self._late = [time for time in self._late if time > now - 1.0]
        found = watch_time(late, len(self._late), self._age, starved, self._limits)
        # A single late torque was withdrawn and a low tank slows the task by itself: neither is a stop.
        return [event for event in found if event.event not in (Event.TANK_LOW, Event.LATE_CYCLE)]


def stop_limits(period: float) -> StopLimits:
    """The ladder's thresholds at a control period [s]; times follow facts of Baxter's own time-outs."""
    return StopLimits(
        damping_time=1.0,
        blind_damping_time=max(0.02, 2.0 * period),
        rest_speed=0.05,
        speed_growth=1.5,
        late_cycles=5,
        stale_time=max(0.03, 3.0 * period),
        lost_time=max(0.1, 6.0 * period),
        starvation_time=2.0,
    )
