# SPDX-License-Identifier: BSD-3-Clause
"""A task carried out for an experiment: the same assembly, safety and plant as ``impedance run``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.backends.sim import SimBackend
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.plant.plant import Plant
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.prepare import sim_backend
from impedance_modules.runs.run import RunOptions, RunResult, carry_out

Look = Callable[[RobotState, Plant, Supervisor], None]


@dataclass(frozen=True)
class TaskRun:
    """A finished run with its recording."""

    assembly: Assembly
    result: RunResult
    episode: Episode


def record_task(task: str, out: Path, *, effects: Path | None = None, seed: int = 0) -> TaskRun:
    """Runs a task as ``impedance run TASK --out DIR --effects PATCH --seed N`` does, and reads its recording.

    Raises:
        BadInput: The task is refused.
    """
    assembly = assemble(task, effects=effects, rate=None, scale=1.0, arm=None)
    refuse_infeasible(assembly)
    options = RunOptions(out=out, seed=seed, duration=None, live=False, read_only=False, backend="sim")
    result = carry_out(assembly, sim_backend(assembly, seed), options, lambda _time, _phase: None)
    return TaskRun(assembly, result, read_episode(out))


def watch_task(assembly: Assembly, look: Look, *, seed: int = 0, noise: bool = True) -> Supervisor:
    """Runs a task without files and shows the plant's truth to ``look`` once a cycle.

    Args:
        assembly: The task, checked by the caller where it need be.
        look: Called with what the robot measured, the plant, and the supervisor.
        seed: Of the simulated noise.
        noise: Whether sensors are noisy.
    """
    supervisor = Supervisor(assembly)
    supervisor.controller.warm()
    backend: SimBackend = sim_backend(assembly, seed, noise=noise)
    first = backend.start()
    supervisor.start(first)
    run_loop(
        supervisor,
        backend,
        first.state,
        lambda state, _effort, _late, _asked: look(state, backend.plant, supervisor),
        Interrupt(),
        duration=None,
        paced=False,
        read_only=False,
    )
    return supervisor
