# SPDX-License-Identifier: BSD-3-Clause
"""From a command line to a robot ready to start: simulated, or a recording that is fed back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impedance_modules.backends.backend import Backend
from impedance_modules.backends.replay import ReplayBackend
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import BadInput
from impedance_modules.runtime.assembly import Assembly, assemble
from impedance_modules.runtime.run import RunOptions, RunResult, carry_out, sim_backend


@dataclass(frozen=True)
class PreparedRun:
    """A task and a robot, checked and not yet moving.

    Attributes:
        assembly: The task.
        backend: The robot.
        backend_name: ``sim`` or ``replay``.
        seed: Of the simulated noise.
    """

    assembly: Assembly
    backend: Backend
    backend_name: str
    seed: int

    @property
    def name(self) -> str:
        """Name of the task."""
        return self.assembly.task.name

    def go(
        self,
        directory: Path,
        *,
        duration: float | None,
        live: bool,
        read_only: bool,
        on_progress: Callable[[float, str], None],
    ) -> RunResult:
        """Runs it into a directory; see ``run.carry_out``."""
        options = RunOptions(
            out=directory,
            seed=self.seed,
            duration=duration,
            live=live,
            read_only=read_only,
            backend=self.backend_name,
        )
        return carry_out(self.assembly, self.backend, options, on_progress)


def prepare_run(
    task: str,
    *,
    effects: Path | None,
    rate: float | None,
    scale: float,
    arm: str | None,
    backend: str,
    log: Path | None,
    seed: int,
) -> PreparedRun:
    """Assembles a task and its robot.

    Raises:
        BadInput, BadFile: Anything wrong with the input; nothing has moved.
    """
    assembly = assemble(task, effects=effects, rate=rate, scale=scale, arm=arm)
    robot: Backend
    if backend == "replay":
        if log is None:
            raise BadInput("--backend replay needs --log DIR, the recording to feed back")
        episode = read_episode(log)
        acting = episode.metadata.get("acting", [0.0] * assembly.model.n)
        robot = ReplayBackend(episode, assembly.model.joint_names, np.array(acting, dtype=float))
    else:
        robot = sim_backend(assembly, seed)
    return PreparedRun(assembly, robot, backend, seed)
