# SPDX-License-Identifier: BSD-3-Clause
"""Faults in the control loop, one by one, on a moving simulated robot: what stops it, how soon, how hard."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from impedance_modules.backends.protocol import Finish, FirstState
from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.solvers import FilterSolution, failed
from impedance_modules.safety.stop_levels import StopLevel
from tests.support.forecast_tasks import SOFT_HANDS

TASK = f"""
format: 1
name: faults
robot: baxter
{SOFT_HANDS}\
safety: {{tank: {{initial: 8, max: 16, floor: 0.5}}}}
phases:
  - {{name: lift, equilibrium: {{right.hand: {{z: 0.2}}, left.hand: {{z: 0.2}}}}, duration: 0.8}}
  - {{name: stay, duration: 0.4}}
"""

BEGIN = 0.4
"""When the fault begins: the arms move at their fastest [s]."""

JOINT = "right_e1"


class FaultyRobot:
    """A simulated robot whose states pass through a fault, and what really happens to it.

    Attributes:
        plant: The truth.
        speeds: Largest motor speed over the declared one, cycle by cycle.
        efforts: Largest torque that was sent over the limit, cycle by cycle.
        change: From the cycle's number and its state to what the loop gets, from ``BEGIN`` on.
    """

    def __init__(self, assembly: Assembly, change: Callable[[int, RobotState], RobotState | None]) -> None:
        plant = Plant(assembly.model, (), None, PlantOptions(rate=assembly.rate, seed=0))
        self._inner = SimBackend(plant, assembly.modules.posture, assembly.period)
        self.plant, self.change, self.assembly = plant, change, assembly
        self.speeds: list[float] = []
        self.efforts: list[float] = []
        self.cycle = 0

    @property
    def first_faulty(self) -> int:
        """The cycle in which the fault begins."""
        return round(BEGIN * self.assembly.rate)

    def start(self) -> FirstState:
        return self._inner.start()

    def write(self, effort: np.ndarray) -> None:
        self.efforts[-1:] = [float(np.max(np.abs(effort) / self.assembly.limits.effort_max))]
        self._inner.write(effort)

    def read(self) -> RobotState | None:
        state = self._inner.read()
        self.cycle += 1
        self._watch()
        if state is None or self.cycle < self.first_faulty:
            return state
        return self.change(self.cycle - self.first_faulty, state)

    def sleep(self, seconds: float) -> RobotState | None:
        """Lets the robot go on without the controller; returns its state then."""
        state = None
        for _ in range(round(seconds * self.assembly.rate)):
            state = self._inner.read()
            self._watch()
        return state

    def finish(self, how: Finish) -> None:
        if how == "hold":
            self.plant.hold()
        else:
            self.plant.release()
        for _ in range(round(0.5 * self.assembly.rate)):
            self.plant.advance(None)
            self._watch()

    def _watch(self) -> None:
        self.speeds.append(
            float(np.max(np.abs(self.plant.motor_velocity) / self.assembly.limits.velocity_max))
        )
        self.efforts.append(0.0)


class BrokenSolver:
    """Fails from its first call on."""

    name = "broken"

    def solve(self, problem: object) -> FilterSolution:
        return failed("no solution within its iterations", 1)


@dataclass(frozen=True)
class Verdict:
    """What followed a fault.

    Attributes:
        level: The hardest stop level; RUN where the run went on to its end.
        seconds: From the fault to the stop [s]; 0 where there was none.
        effort: Largest torque sent after the fault over the joint's limit.
        speed_before, speed: Largest true motor speed over the declared one, before and after it.
        reason: The supervisor's.
    """

    level: StopLevel
    seconds: float
    effort: float
    speed_before: float
    speed: float
    reason: str


Fault = Callable[[FaultyRobot, Supervisor], None]


def _states(change: Callable[[FaultyRobot, int, RobotState], RobotState | None]) -> Fault:
    """A fault of the states alone."""

    def apply(robot: FaultyRobot, _: Supervisor) -> None:
        robot.change = partial(change, robot)

    return apply


def _entry(name: str, value: Callable[[float], float]) -> Fault:
    """One joint's reading is replaced by a function of it."""

    def change(robot: FaultyRobot, _: int, state: RobotState) -> RobotState:
        values, joint = getattr(state, name).copy(), robot.assembly.model.joint_names.index(JOINT)
        values[joint] = value(values[joint])
        return replace(state, **{name: values})

    return _states(change)


def _lost(periods: int, every: int) -> Fault:
    """Of so many states the first ones never come."""
    return _states(lambda _, cycle, state: None if cycle % every < periods else state)


def _late() -> Callable[[FaultyRobot, int, RobotState], RobotState | None]:
    """Every fifth state comes a period late, in place of the one that is due then."""
    kept: list[RobotState] = []

    def change(_: FaultyRobot, cycle: int, state: RobotState) -> RobotState | None:
        if cycle % 5 == 0:
            kept[:] = [state]
            return None
        return kept.pop() if cycle % 5 == 1 else state

    return change


def _swapped() -> Callable[[FaultyRobot, int, RobotState], RobotState | None]:
    """Of each pair of states the later one comes first."""
    kept: list[RobotState] = []

    def change(_: FaultyRobot, __: int, state: RobotState) -> RobotState | None:
        kept.append(state)
        if len(kept) == 3:
            return kept.pop(0) if kept[0].time < kept[1].time else kept.pop(1)
        return kept.pop(1) if len(kept) == 2 else None

    return change


def _repeated() -> Callable[[FaultyRobot, int, RobotState], RobotState | None]:
    """Every other state is the one before once more."""
    kept: list[RobotState] = []

    def change(_: FaultyRobot, cycle: int, state: RobotState) -> RobotState | None:
        kept[:1] = [state] if cycle % 2 == 0 or not kept else kept[:1]
        return kept[0]

    return change


def _frozen() -> Callable[[FaultyRobot, int, RobotState], RobotState]:
    """The first state, time stamp and all, is all that ever comes."""
    kept: list[RobotState] = []

    def change(_: FaultyRobot, __: int, state: RobotState) -> RobotState:
        kept.append(state)
        return kept[0]

    return change


def _stuck() -> Callable[[FaultyRobot, int, RobotState], RobotState]:
    """A joint's encoder stands still."""
    kept: list[float] = []

    def change(robot: FaultyRobot, _: int, state: RobotState) -> RobotState:
        joint = robot.assembly.model.joint_names.index(JOINT)
        position, velocity = state.position.copy(), state.velocity.copy()
        kept.append(float(position[joint]))
        position[joint], velocity[joint] = kept[0], 0.0
        return replace(state, position=position, velocity=velocity)

    return change


def _paused(robot: FaultyRobot, cycle: int, state: RobotState) -> RobotState | None:
    return robot.sleep(1.0) if cycle == 0 else state


def _broken_solver(robot: FaultyRobot, supervisor: Supervisor) -> None:
    def change(cycle: int, state: RobotState) -> RobotState:
        supervisor.controller.solver = BrokenSolver()  # type: ignore[assignment]
        return state

    robot.change = change


def _in_the_tick(happens: Callable[[], None]) -> Fault:
    """Something happens whenever the law runs."""

    def apply(robot: FaultyRobot, supervisor: Supervisor) -> None:
        tick = supervisor.controller.tick

        def disturbed(state: RobotState) -> int:
            if robot.cycle >= robot.first_faulty:
                happens()
            return tick(state)

        supervisor.controller.tick = disturbed  # type: ignore[method-assign]

    return apply


def _no_memory() -> None:
    raise MemoryError


SLOW = "every cycle takes two periods"
"""The one fault of real time: all others run as fast as they can, where no cycle is late."""


def faults() -> dict[str, Fault]:
    """Every fault by name, made anew: some remember what they have seen."""
    return {
        "none": lambda robot, supervisor: None,
        "every fifth state a period late": _states(_late()),
        "every tenth state lost": _lost(1, 10),
        "every other state lost": _lost(1, 2),
        "every other state repeated": _states(_repeated()),
        "states swapped in pairs": _states(_swapped()),
        "no state any more": _lost(10**9, 10**9),
        "the same state for ever": _states(_frozen()),
        "a velocity is NaN": _entry("velocity", lambda _: np.nan),
        "an encoder stands still": _states(_stuck()),
        "an encoder jumps by 0.1 rad": _entry("position", lambda q: q + 0.1),
        "an effort sensor reads 0": _entry("effort", lambda _: 0.0),
        "the robot's clock steps back by 1 s": _states(
            lambda r, k, state: replace(state, time=state.time - 1.0)
        ),
        "the filter has no solution": _broken_solver,
        SLOW: _in_the_tick(lambda: time.sleep(0.02)),
        "no memory is left": _in_the_tick(_no_memory),
        "the process is paused for 1 s": _states(_paused),
    }


RATE = 100.0
"""Of the control [Hz]; a period is long enough to be late on purpose."""


def faults_task(folder: Path) -> Assembly:
    """A task that lifts both hands."""
    path = folder / "faults.yaml"
    path.write_text(TASK)
    return assemble(str(path), effects=None, rate=RATE, scale=1.0, arm=None)


def run_with(assembly: Assembly, name: str) -> Verdict:
    """Carries out the task and lets the fault of that name happen on the way."""
    robot = FaultyRobot(assembly, lambda _, state: state)
    supervisor = Supervisor(assembly)
    supervisor.controller.warm()
    first = robot.start()
    faults()[name](robot, supervisor)
    supervisor.start(first)
    levels: list[tuple[int, StopLevel]] = []

    def watch(*_: object) -> None:
        levels.append((robot.cycle, supervisor.stop_level))

    step = supervisor.step

    def seen(state: RobotState | None, *, late: bool, stop_request: str | None) -> np.ndarray | None:
        effort = step(state, late=late, stop_request=stop_request)
        watch()
        return effort

    supervisor.step = seen  # type: ignore[method-assign]
    run_loop(
        supervisor, robot, first.state, watch, Interrupt(), duration=None, paced=name == SLOW, read_only=False
    )
    watch()
    begin = robot.first_faulty
    stops = [cycle for cycle, level in levels if level >= StopLevel.DAMP]
    return Verdict(
        level=max(level for _, level in levels) if stops else StopLevel.RUN,
        seconds=max(0, min(stops) - begin) * assembly.period if stops else 0.0,
        effort=max(robot.efforts[begin:]),
        speed_before=max(robot.speeds[:begin]),
        speed=max(robot.speeds[begin:]),
        reason=supervisor.reason,
    )
