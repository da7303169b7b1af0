# SPDX-License-Identifier: BSD-3-Clause
"""A trial on the built-in plant of a task whose prediction meets joint limits: is any joint too fast there?

The prediction of ``check`` is quasi-static. Where it says that a joint would leave its range, pass its speed limit, or
that a loop hardly damps, the run's filter takes part in the motion: it brakes joints whose motors and links swing
against each other, and now and then that swing passes the declared speed before the run is stopped. Such a task is
carried out on the plant first, without a recording, and refused if a motor or link of it passes its declared speed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.loop import Interrupt, no_collections, run_loop
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.errors import BadFile
from impedance_modules.plant.plant import Plant
from impedance_modules.prediction.joint_limits import LimitsMet
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.task_plant import sim_backend

ALLOWED = 1.01
"""Of a declared speed. A run with other noise than the trial's is to stay below 1.02."""


NOISES = 6
"""Trials of a task in which a loop hardly damps: whether its swing builds up is up to the noise."""


@dataclass(frozen=True)
class Trial:
    """What a task did on the plant, where it was fastest.

    Attributes:
        met: Why it was tried.
        joint: The fastest, relative to its limit.
        speed: Of its motor or link, the faster [rad/s].
        limit: Its declared speed [rad/s].
        time: When [s].
        phase: Index of the phase then.
        ended: How the trial ended, with when.
    """

    met: LimitsMet
    joint: str
    speed: float
    limit: float
    time: float
    phase: int
    ended: str


def try_on_plant(
    assembly: Assembly, met: LimitsMet, seed: int, on_progress: Callable[[float, str], None]
) -> Trial:
    """Carries a task out on the plant; nothing is recorded.

    Args:
        assembly: The task.
        met: Why.
        seed: Of the simulated noise; of the first trial, where there are several.
        on_progress: Called about ten times a second of run time with the time [s] and the phase.

    Raises:
        BadFile: A motor or link passes ``ALLOWED`` of its declared speed; with the phase.
    """
    noises = range(seed, seed + (NOISES if met.swings else 1))
    trials = [_tried(assembly, met, noise, on_progress) for noise in noises]
    return max(trials, key=lambda trial: trial.speed / trial.limit)


def _tried(assembly: Assembly, met: LimitsMet, seed: int, on_progress: Callable[[float, str], None]) -> Trial:
    """One trial."""
    watch = _carried_out(assembly, seed, on_progress)
    limit = float(assembly.limits.velocity_max[watch.joint])
    name = assembly.model.joint_names[watch.joint]
    trial = Trial(met, name, watch.share * limit, limit, watch.time, watch.phase, watch.ended())
    if watch.share > ALLOWED:
        raise BadFile([assembly.task.document.problem(("phases", trial.phase), _told(trial))])
    return trial


def _told(trial: Trial) -> str:
    return (
        f"on the built-in plant, motor or link of {trial.joint} moves at {trial.speed:.3g} rad/s after"
        f" {trial.time:.2f} s, its declared limit is {trial.limit:g} rad/s; tried because, in {trial.met.first}"
        " (valid: equilibria within the joints' ranges, a slower motion, softer or better damped springs)"
    )


def _carried_out(assembly: Assembly, seed: int, on_progress: Callable[[float, str], None]) -> _Watch:
    """Runs the whole task on the plant, or until a joint is too fast."""
    backend = sim_backend(assembly, seed)
    supervisor = Supervisor(assembly, grippers=backend)
    supervisor.controller.warm()
    watch = _Watch(supervisor, backend, on_progress)
    with no_collections():
        first = backend.start()
        supervisor.start(first)
        run_loop(
            supervisor,
            backend,
            first.state,
            watch.look,
            watch.interrupt,
            duration=None,
            paced=False,
            read_only=False,
        )
    return watch


class _Watch:
    """Remembers the fastest motor or link of a run, and ends the run once it is too fast.

    Attributes:
        interrupt: Of the run.
        share: Largest speed over its limit.
        joint: Whose.
        time: When [s].
        phase: Index of the phase then.
    """

    def __init__(
        self, supervisor: Supervisor, backend: SimBackend[Plant], on_progress: Callable[[float, str], None]
    ) -> None:
        self.interrupt = Interrupt()
        self.share, self.joint, self.time, self.phase = 0.0, 0, 0.0, 0
        self._supervisor, self._plant, self._on_progress = supervisor, backend.plant, on_progress
        self._every = max(1, round(0.1 * supervisor.assembly.rate))
        self._cycle = 0

    def look(self, state: RobotState, effort: Array, late: bool, interrupted: bool) -> None:  # noqa: ARG002
        """Looks at the plant's own speeds once per cycle; sensors lag behind them."""
        truth, sequence = self._plant.state.start, self._supervisor.sequence
        speeds = np.maximum(np.abs(truth.velocity), np.abs(truth.motor_velocity))
        shares = speeds / self._supervisor.assembly.limits.velocity_max
        worst = int(np.argmax(shares))
        if shares[worst] > self.share:
            self.share, self.joint, self.time = float(shares[worst]), worst, self._plant.time
            self.phase = min(len(sequence.ended), len(self._supervisor.assembly.task.phases) - 1)
        if self.share > ALLOWED:
            self.interrupt.asked = True
        if self._cycle % self._every == 0:
            self._on_progress(self._plant.time, sequence.phase.name)
        self._cycle += 1

    def ended(self) -> str:
        """Tells how the run ended."""
        if self._supervisor.ending is Ending.DONE:
            return f"done after {self._plant.time:.2f} s"
        return f"{self._supervisor.reason} at {self._plant.time:.2f} s"
