# SPDX-License-Identifier: BSD-3-Clause
"""Whatever the robot, the solver or the user does: nothing unsafe leaves, and the end says why.

A simulated robot goes through supervisor and loop, and what it reports is changed as a script says. After every run the
same is checked: every torque finite and within the limits, none after the ending, ``finish`` called once, a reason in
the messages.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count as count_from
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from impedance_modules.backends.protocol import FirstState
from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.errors import EndOfRecording, SafetyStop
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.solvers import FilterSolution, failed
from tests.support.forecast_tasks import SOFT_HANDS
from tests.support.tank_worlds import sensing_uncertainty

TASK = f"""
format: 1
name: scripted
robot: baxter
{SOFT_HANDS}\
safety: {{tank: {{initial: 8, max: 10, floor: 0.2}}}}
phases:
  - {{name: move, duration: 0.5, equilibrium: {{right.hand: {{z: 0.2}}, left.hand: {{z: 0.2}}}}}}
  - {{name: wait, duration: 0.3UNTIL}}
"""


def assembly_of(path: Path, until: str = "") -> Assembly:
    path.write_text(TASK.replace("UNTIL", until))
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


@pytest.fixture(scope="module")
def assembly(tmp_path_factory) -> Assembly:
    return assembly_of(tmp_path_factory.mktemp("scripted") / "task.yaml")


Script = Callable[[RobotState, int], RobotState | None]


def sound(state: RobotState, k: int) -> RobotState:
    return state


class ScriptedRobot:
    """A simulated robot; ``script`` changes what it reports, cycle by cycle."""

    def __init__(self, assembly: Assembly, script: Script = sound) -> None:
        options = PlantOptions(rate=assembly.rate, seed=0)
        self.plant = Plant(assembly.model, (), None, options)
        self.inner = SimBackend(self.plant, assembly.modules.posture, assembly.period)
        self.assembly, self.script = assembly, script
        self.sent: list[tuple[int, np.ndarray]] = []
        self.finished: list[str] = []
        self.command = np.zeros(assembly.model.n)
        self.reads = 0

    def start(self) -> FirstState:
        return self.inner.start()

    def read(self) -> RobotState | None:
        assert not self.finished, "read after finish"
        self.reads += 1
        return self.script(self.inner.read(), self.reads)

    def write(self, effort: np.ndarray) -> None:
        assert not self.finished, "torque after finish"
        self.sent.append((self.reads, effort.copy()))
        self.command = effort.copy()
        self.inner.write(effort)

    def finish(self, how: str) -> None:
        self.finished.append(how)


class Outcome(NamedTuple):
    robot: ScriptedRobot
    supervisor: Supervisor
    cycles: list[int]

    @property
    def said(self) -> str:
        return " | ".join(text for _, text in self.supervisor.messages)


def run(
    assembly: Assembly,
    script: Script = sound,
    *,
    tamper: Callable[[Supervisor], None] = lambda supervisor: None,
    on_cycle: Callable[[int], None] = lambda k: None,
    interrupt: Interrupt | None = None,
    paced: bool = False,
    duration: float | None = None,
    robot: ScriptedRobot | None = None,
) -> Outcome:
    """Runs the task on a scripted robot and checks what must always hold."""
    robot = ScriptedRobot(assembly, script) if robot is None else robot
    supervisor, cycles = Supervisor(assembly), []
    supervisor.controller.warm()
    first = robot.start()
    supervisor.start(first)
    tamper(supervisor)

    def record(*_: object) -> None:
        cycles.append(robot.reads)
        on_cycle(len(cycles))

    options = {"duration": duration, "paced": paced, "read_only": False}
    try:
        run_loop(supervisor, robot, first.state, record, interrupt or Interrupt(), **options)
    finally:
        check_safety(robot, supervisor)
    return Outcome(robot, supervisor, cycles)


def check_safety(robot: ScriptedRobot, supervisor: Supervisor) -> None:
    limit = robot.assembly.limits.effort_max
    for _, effort in robot.sent:
        assert np.isfinite(effort).all()
        assert (np.abs(effort) <= limit).all()
    assert robot.finished == ["release" if supervisor.released else "hold"]
    assert all(np.isfinite(moment) for moment, _ in supervisor.messages)
    if supervisor.ending in {Ending.STOPPED, Ending.INTERRUPTED}:
        assert supervisor.reason
        assert supervisor.messages[-1][1] == supervisor.reason
    tank = supervisor.controller.tank
    assert np.isfinite([tank.level, tank.work, sensing_uncertainty(tank)]).all()


def stopped(outcome: Outcome, word: str, how: str = "hold") -> None:
    assert outcome.supervisor.ending is Ending.STOPPED
    assert word in outcome.supervisor.reason, outcome.supervisor.reason
    assert outcome.robot.finished == [how]


def test_task_that_nothing_disturbs_is_done(assembly: Assembly) -> None:
    outcome = run(assembly)
    assert outcome.supervisor.ending is Ending.DONE
    assert outcome.supervisor.reason == ""
    assert len(outcome.robot.sent) > 700
    assert "phase 'move' ended" in outcome.said


def from_cycle(first: int, change: Script, last: float = np.inf) -> Script:
    return lambda state, k: change(state, k) if first <= k <= last else state


def with_entry(name: str, joint: int, value: float) -> Script:
    """A state with one entry replaced."""

    def script(state: RobotState, k: int) -> RobotState:
        values = getattr(state, name).copy()
        values[joint] = value
        return replace(state, **{name: values})

    return script


@pytest.mark.parametrize("name", ["position", "velocity", "effort"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_state_that_is_not_finite_stops(assembly: Assembly, name: str, bad: float) -> None:
    outcome = run(assembly, from_cycle(100, with_entry(name, 3, bad)))
    stopped(outcome, "state not finite")
    braking = [effort for at, effort in outcome.robot.sent if at >= 100]
    assert 1 <= len(braking) <= 30
    # Nobody has seen the motion since the stop began: nothing pushes against what may not be there.
    assert not np.any(braking)


def test_one_bad_state_is_enough_and_the_arm_brakes_on_the_sound_ones_after_it(assembly: Assembly) -> None:
    stopped(run(assembly, from_cycle(50, with_entry("velocity", 3, np.nan), last=50)), "state not finite")


@pytest.mark.parametrize("frozen", [False, True])
def test_state_that_stays_away_or_stands_still_stops(assembly: Assembly, frozen: bool) -> None:
    kept: list[RobotState] = []

    def script(state: RobotState, k: int) -> RobotState | None:
        kept.append(state)
        return state if k < 100 else kept[98] if frozen else None

    outcome = run(assembly, script)
    stopped(outcome, "no state for")
    assert outcome.robot.reads < 100 + 60
    assert len(outcome.cycles) <= 101


def test_single_missing_states_are_booked_and_survived(assembly: Assembly) -> None:
    rich = replace(assembly, tank=replace(assembly.tank, initial=20.0, max=30.0))
    outcome = run(rich, lambda state, k: None if k % 100 == 0 else state)
    assert outcome.supervisor.ending is Ending.DONE
    assert outcome.supervisor.controller.tank.assumed > 0.0


def test_motor_faster_than_declared_stops(assembly: Assembly) -> None:
    jump = np.zeros(assembly.model.n)
    jump[2] = 3.0 * assembly.limits.velocity_max[2] * assembly.period
    outcome = run(assembly, from_cycle(60, lambda state, k: replace(state, position=state.position + jump)))
    stopped(outcome, "overspeed")
    assert assembly.model.joint_names[2] in outcome.supervisor.reason


def lasting(assembly: Assembly, seconds: float) -> Assembly:
    """The task with its first phase alone, for so long."""
    first = replace(assembly.task.phases[0], duration=seconds)
    return replace(assembly, task=replace(assembly.task, phases=(first,)))


def test_joint_beyond_its_range_stops(assembly: Assembly) -> None:
    high = assembly.limits.position_max[1] + 0.1
    creep = 0.5 * assembly.limits.velocity_max[1] * assembly.period

    def script(state: RobotState, k: int) -> RobotState:
        return with_entry("position", 1, min(assembly.modules.posture[1] + creep * k, high))(state, k)

    outcome = run(lasting(assembly, 60.0), script)
    assert outcome.supervisor.ending is Ending.STOPPED
    assert outcome.robot.reads <= int((high - assembly.modules.posture[1]) / creep) + 10
    assert "position limit" in outcome.supervisor.reason or "tank starved" in outcome.supervisor.reason


class BrokenSolver:
    """Fails, or gives nonsense, from its first call on."""

    def __init__(self, answer: FilterSolution) -> None:
        self.name, self.answer = "broken", answer

    def solve(self, problem: object) -> FilterSolution:
        return self.answer


def not_finite(n: int) -> FilterSolution:
    one = np.zeros(1)
    return FilterSolution(np.full(n, np.nan), one, np.zeros(n), one.astype(bool), 1, True, "optimal")


@pytest.mark.parametrize(
    ("answer", "reason"),
    [(lambda n: failed("iteration limit", 1000), "iteration limit"), (not_finite, "effort not finite")],
)
def test_solver_that_fails_or_answers_nonsense_stops(assembly: Assembly, answer, reason: str) -> None:
    def tamper(supervisor: Supervisor) -> None:
        supervisor.controller.solver = BrokenSolver(answer(assembly.model.n))

    stopped(run(assembly, tamper=tamper), reason)


def test_late_torques_never_leave_and_many_of_them_stop(assembly: Assembly) -> None:
    """Paced: cycles 20 and 40 are slow by chance, from 60 on all are."""
    late: set[int] = set()

    def tamper(supervisor: Supervisor) -> None:
        tick, count = supervisor.controller.tick, count_from(1)

        def slow(state: RobotState) -> int:
            status, k = tick(state), next(count)
            if k in {20, 40} or k >= 60:
                late.add(round(state.time / assembly.period))
                time.sleep(1.5 * assembly.period)
            return status

        supervisor.controller.tick = slow

    outcome = run(assembly, tamper=tamper, paced=True)
    assert late
    assert not late & {at for at, _ in outcome.robot.sent}
    stopped(outcome, "late cycles")


def test_interrupt_brakes_and_ends(assembly: Assembly) -> None:
    interrupt = Interrupt()

    def ask(k: int) -> None:
        interrupt.asked = interrupt.asked or k == 80

    outcome = run(assembly, on_cycle=ask, interrupt=interrupt)
    assert outcome.supervisor.ending is Ending.INTERRUPTED
    assert "asked to stop" in outcome.supervisor.reason
    assert outcome.robot.reads < 80 + 1100


def test_time_given_to_a_run_ends_it_like_an_interrupt(assembly: Assembly) -> None:
    outcome = run(assembly, duration=0.1)
    assert outcome.supervisor.ending is Ending.INTERRUPTED
    assert "time given to the run is over" in outcome.supervisor.reason


def test_condition_not_met_stops_with_the_phase_in_the_reason(tmp_path: Path) -> None:
    assembly = assembly_of(tmp_path / "task.yaml", ", until: {contact: {force: 500}}")
    stopped(run(assembly), "phase 'wait': no contact within its 0.3 s")


def test_tank_that_something_drains_stops(assembly: Assembly) -> None:
    poor = lasting(replace(assembly, tank=replace(assembly.tank, initial=0.25)), 20.0)
    robot, step = ScriptedRobot(poor), 0.5 * poor.limits.velocity_max * poor.period
    place, efforts = poor.modules.posture.copy(), list[np.ndarray]()

    def follow(state: RobotState, k: int) -> RobotState:
        # The arm runs where the torque pushes it, at a good part of the declared speed.
        place[:] += step * np.sign(robot.command)
        velocity = step / poor.period * np.sign(robot.command)
        efforts.append(state.effort)
        return replace(state, position=place.copy(), velocity=velocity, effort=efforts[0])

    robot.script = follow
    outcome = run(poor, robot=robot)
    assert outcome.supervisor.ending is Ending.STOPPED
    assert "tank" in outcome.supervisor.reason
    assert outcome.supervisor.controller.tank.level >= -1e-9


def test_recording_that_ends_holds_and_says_so(assembly: Assembly) -> None:
    def end(state: RobotState, k: int) -> RobotState:
        raise EndOfRecording("the recording ends after 30 samples")

    outcome = run(assembly, from_cycle(30, end))
    assert outcome.supervisor.ending is None
    assert "the recording ends" in outcome.said


@pytest.mark.parametrize("where", ["recorder", "robot", "law"])
def test_exceptions_anywhere_still_hold_the_robot(assembly: Assembly, where: str) -> None:
    def fail(*_: object) -> None:
        raise OSError(f"the {where} broke")

    def on_cycle(k: int) -> None:
        if where == "recorder" and k == 40:
            fail()

    def tamper(supervisor: Supervisor) -> None:
        if where == "law":
            supervisor.controller.distances.update = fail

    robot = ScriptedRobot(assembly, from_cycle(40, fail) if where == "robot" else sound)
    with pytest.raises(OSError, match="broke"):
        run(assembly, on_cycle=on_cycle, tamper=tamper, robot=robot)
    assert robot.finished == ["hold"]


def test_first_state_that_is_not_finite_is_refused(assembly: Assembly) -> None:
    still = np.zeros(assembly.model.n)
    with pytest.raises(SafetyStop, match="not finite"):
        Supervisor(assembly).start(FirstState(RobotState(0.0, still + np.nan, still, still), still))


def test_stop_after_the_law_has_run_books_the_interval_once(assembly: Assembly) -> None:
    """The solver fails in the third cycle: commands in flight keep their order in the ledger."""
    seen: list[np.ndarray] = []

    def tamper(supervisor: Supervisor) -> None:
        controller, count = supervisor.controller, count_from(1)
        tick, brake = controller.tick, controller.brake

        def counted(state: RobotState) -> int:
            if next(count) == 5:
                seen.append(controller.tank.pending.copy())
                controller.solver = BrokenSolver(failed("on purpose", 1))
            return tick(state)

        def braking(state: RobotState | None) -> int:
            status = brake(state)
            seen.append(controller.tank.pending.copy())
            return status

        controller.tick, controller.brake = counted, braking

    # A moving robot, so that the stop takes more than a cycle.
    run(assembly, lambda state, k: replace(state, velocity=np.full_like(state.velocity, 0.2)), tamper=tamper)
    before, after = seen[:2]
    assert np.array_equal(after[:-1], before[1:])
