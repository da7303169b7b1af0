# SPDX-License-Identifier: BSD-3-Clause
"""The names that stay: load, check, analyse, run and diagnose from Python, and a controller for a loop of one's own.

``import impedance_modules`` gives them (docs/python.md). Whatever these functions raise because of their input is an
``ImpedanceError`` with the place; nothing has moved then.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.grippers import GripperRobot
from impedance_modules.backends.protocol import Backend, FirstState
from impedance_modules.control.assembly import Assembly, assemble, taught
from impedance_modules.control.gripper_watch import grippers_of
from impedance_modules.control.set_point_source import RunReport, SetPointSource
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.diagnosis.result import Diagnosis
from impedance_modules.effects.catalogue import add_effect, add_installed_effects
from impedance_modules.episode.data import Episode
from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import BadInput, ImpedanceError
from impedance_modules.modules.own_module import OwnModule, OwnTorque
from impedance_modules.prediction.analysis import Analysis, analyse_task
from impedance_modules.prediction.forecast import Forecast, forecast_task
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.run_backends import make_backend
from impedance_modules.runs.task_acceptance import accept
from impedance_modules.streaming.policy import PolicySource

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
"""Of a module of one's own: part of a column's name."""

__all__ = [
    "Assembly",
    "Backend",
    "Diagnosis",
    "Ending",
    "Episode",
    "FirstState",
    "ImpedanceError",
    "OwnModule",
    "OwnTorque",
    "PolicySource",
    "RobotState",
    "RunReport",
    "RunResult",
    "TaskController",
    "add_effect",
    "analyze",
    "check",
    "diagnose",
    "load_task",
    "read_episode",
    "run",
    "write_episode",
]


def load_task(
    task: str | Path,
    *,
    effects: Path | None = None,
    compensate: Path | None = None,
    rate: float | None = None,
    scale: float = 1.0,
    arm: str | None = None,
    robot: str | None = None,
    modules: Sequence[OwnModule] = (),
) -> Assembly:
    """Reads a task and everything it names, ready to be checked, analysed or run.

    Args:
        task: A file, or the name of a shipped task.
        effects: Patch that plant and model get.
        compensate: Patch that the controller compensates.
        rate: Of the control [Hz]; None for the robot's own.
        scale: Multiplies stiffness, damping and forces, in (0, 1].
        arm: The only arm that takes part; None for all.
        robot: Another robot than the one that the task names, by name or folder; None for that one.
        modules: Modules of your own that are summed with those of the task (``OwnModule``).

    Raises:
        BadInput, BadFile: Every problem of the input, with its file, line and column.
    """
    names = [module.name for module in modules]
    if len(set(names)) < len(names) or not all(NAME.fullmatch(name) for name in names):
        raise BadInput(f"modules {', '.join(names)}: (valid: different names of letters, digits, - and _)")
    loaded = assemble(
        str(task), effects=effects, compensate=compensate, rate=rate, scale=scale, arm=arm, robot_name=robot
    )
    return replace(loaded, own=tuple(modules))


def check(task: Assembly) -> Forecast:
    """Predicts a task: torques, deflections, stability of the loops, energy that the tank must hold.

    Raises:
        BadFile: It is infeasible, with the line of every reason.
    """
    prediction = accept(task)
    return forecast_task(taught(task), prediction)


def analyze(task: Assembly, phase: str | None = None) -> Analysis:
    """Gives inertia, damping and stiffness of every arm and their sum at the object (docs/check-and-analyze.md).

    Args:
        task: Loaded.
        phase: At rest where this phase ends; None for the start posture.

    Raises:
        BadInput: There is no such phase.
    """
    return analyse_task(taught(task), phase)


def run(
    task: Assembly,
    out: str | Path,
    *,
    backend: str | Backend = "sim",
    log: Path | None = None,
    seed: int = 0,
    duration: float | None = None,
    set_points: SetPointSource | None = None,
) -> RunResult:
    """Carries a task out on a simulated robot, a recording or a robot of one's own, and records it.

    Args:
        task: Loaded; one with ``playback`` is refused.
        out: Directory of its files; it must not hold an episode yet.
        backend: ``sim``, ``mujoco`` or ``replay``, or an object with the four methods of ``Backend``, which is taken
            to run in real time.
        log: Recording that ``replay`` feeds back.
        seed: Of the simulated noise.
        duration: Ends the run safely after this time [s]; None lets the task decide.
        set_points: Where they come from in phases that listen; see ``PolicySource``.

    Raises:
        ImpedanceError: The task is refused, the robot cannot be started, or a file not written.
    """
    if task.task.playback is not None:
        raise BadInput(f"task '{task.task.name}' is played back by the robot itself (valid: impedance run)")
    accept(task, plant=backend == "sim")
    robot = make_backend(task, backend=backend, log=log, seed=seed) if isinstance(backend, str) else backend
    options = RunOptions(
        out=Path(out),
        seed=seed,
        duration=duration,
        live=False,
        read_only=False,
        backend=backend if isinstance(backend, str) else type(backend).__name__,
    )
    return carry_out(task, robot, options, lambda *_: None, set_points)


def diagnose(
    logs: Sequence[str | Path],
    *,
    robot: str | None = None,
    urdf: str | Path | None = None,
    holdout: Sequence[str | Path] = (),
    without: Sequence[str] = (),
    hold: Mapping[str, float] | None = None,
    import_map: str | Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Says where recordings of one robot and its model differ, and what causes it (docs/diagnosis.md).

    Args:
        logs: Episodes, directories of runs, folders of episodes, or files that ``impedance import`` reads (CSV ...).
        robot: Name or folder of the robot that was to behave so.
        urdf: Or its URDF or MuJoCo XML; one of the two.
        holdout: Further recordings that no step of the fit may use.
        without: Effects that are left out of the catalogue.
        hold: Position of joints that were not recorded [rad or m]; with ``urdf``.
        import_map: What the columns of such files mean; None for those that say it themselves (what a table does not
            say and is assumed comes as a warning).
        jobs: Local cores that compute; 1 is this process itself. With more, a script needs ``if __name__ ==
            "__main__":``, as for all processes of Python's own ``multiprocessing``.
        scheduler: Address of an existing Dask cluster that computes instead of local cores.
        progress: Called with a sentence for each step.

    Raises:
        BadInput: A recording or model cannot be read, they contradict each other, or the cluster cannot be used.
        WorkerLost: A process that computed a part ended before it was there.
    """
    from impedance_modules.diagnosis.compared_recordings import diagnosed  # noqa: PLC0415 - slow to import

    return diagnosed(
        [Path(log) for log in logs],
        [Path(log) for log in holdout],
        robot=robot,
        urdf=None if urdf is None else Path(urdf),
        hold=hold,
        import_map=None if import_map is None else Path(import_map),
        without=without,
        jobs=None if jobs == 1 else jobs,
        scheduler=scheduler,
        progress=progress,
        note=warnings.warn,
    )


class TaskController:
    """A task's controller for a loop of one's own: from each state of the robot to the torque that may leave.

    Tank, torque filter, phases and stops are those of every run. The loop is the caller's: it reads states, sends
    torques, and holds the robot once there are none.

    Example:
        >>> controller = TaskController(load_task("soft-hold"))
        >>> controller.start(first)
        >>> while (effort := controller.tick(state)) is not None:
        ...     send(effort)
    """

    def __init__(
        self,
        task: Assembly,
        *,
        set_points: SetPointSource | None = None,
        grippers: GripperRobot | None = None,
    ) -> None:
        """Takes a task, refuses what cannot work, and compiles what runs in every cycle.

        Args:
            task: As ``load_task`` returns it.
            set_points: Where set-points come from, for phases that listen; None where nothing comes.
            grippers: Takes the orders of the task's grippers; None for a task that orders none.

        Raises:
            BadFile: The task is infeasible, with the line of every reason.
            BadInput: It orders grippers, and nothing takes the orders.
        """
        accept(task, plant=False)
        taken = grippers_of(grippers, task, "this loop")
        self.task = task
        self._supervisor = Supervisor(task, set_points, taken)
        self._supervisor.controller.warm()
        self._stop: str | None = None

    @property
    def phase(self) -> str:
        """Name of the current phase."""
        return self._supervisor.sequence.phase.name

    @property
    def ending(self) -> Ending | None:
        """How it ended; None while it goes on."""
        return self._supervisor.ending

    @property
    def reason(self) -> str:
        """Why it was stopped; empty after a task that is done."""
        return self._supervisor.reason

    @property
    def messages(self) -> tuple[tuple[float, str], ...]:
        """Time [s] and text of everything worth telling so far."""
        return tuple(self._supervisor.messages)

    @property
    def tank(self) -> float:
        """Energy in the tank [J]."""
        return float(self._supervisor.controller.tank.level)

    def start(self, state: RobotState, acting: Array | None = None) -> None:
        """Takes over the robot as it stands.

        Args:
            state: Its first state, in the order of ``task.model.joint_names``.
            acting: (n,) torque command in force already, without the robot's own gravity compensation [N.m]; None
                for zero.

        Raises:
            SafetyStop: The state is not finite.
        """
        in_force = np.zeros(self.task.model.n) if acting is None else np.asarray(acting, dtype=float)
        self._supervisor.start(FirstState(state, in_force))

    def tick(self, state: RobotState | None, *, late: bool = False) -> Array | None:
        """Gives the torque (n,) to send in this cycle [N.m], without what the robot adds against gravity.

        The first call takes the state that ``start`` had. The array is overwritten by the next call.

        Args:
            state: The newest state; None where none came in time.
            late: The torque of the last cycle was ready too late and was not sent.

        Returns:
            None where nothing may leave: hold the robot. Once ``ending`` is set it stays so.
        """
        supervisor = self._supervisor
        if supervisor.ending is not None:
            return None
        effort = supervisor.step(state, late=late, stop_request=self._stop)
        supervisor.look()
        return effort

    def stop(self, why: str) -> None:
        """Asks for the end: the following ticks brake the arms, then there is no torque any more."""
        self._stop = why


add_installed_effects()
