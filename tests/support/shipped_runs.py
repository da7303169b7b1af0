# SPDX-License-Identifier: BSD-3-Clause
"""Runs a task on the noisy plant without files and watches what really happens.

``python tests/support/shipped_runs.py [NAME ...]`` from the checkout prints the table of docs/tasks.md.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.task_plant import sim_backend
from tests.support.paths import CHECKOUT

Array = NDArray[np.float64]

TASKS = CHECKOUT / "tasks"
SHIPPED = tuple(sorted(path.stem for path in TASKS.glob("*.yaml")))
OBJECT = "object"
SAMPLES = 100.0
"""How often the plant's truth is looked at [Hz]; the tank and the torques are watched in every cycle."""


class Watched:
    """One run. ``seen(name)`` gives what was sampled: see ``_look`` for names, shapes and units.

    Attributes:
        assembly, supervisor: Of the run.
        headroom: Least energy the tank had above its floor and what the torque of the moment asks for [J].
        lowest: Least energy in the tank [J].
        slowed: Number of cycles in which the tank cut motion or torque.
        softest: Smallest scale on the springs.
    """

    def __init__(self, assembly: Assembly, supervisor: Supervisor, plant: Plant) -> None:
        self.assembly, self.supervisor, self._plant = assembly, supervisor, plant
        self._samples: dict[str, list[Array | float | str]] = defaultdict(list)
        self._every, self._cycle = round(assembly.rate / SAMPLES), 0
        self._peak = np.zeros(assembly.model.n)
        self.headroom, self.lowest, self.slowed, self.softest = np.inf, np.inf, 0, 1.0

    def on_cycle(self, state: RobotState, effort: Array, _late: bool, asked: bool) -> None:
        """Takes a cycle, unless the run is already being ended because its ``duration`` is over."""
        if asked:
            return
        cycle, tank = self.supervisor.controller.cycle, self.supervisor.controller.tank
        self.headroom = min(self.headroom, tank.level - self.assembly.tank.floor - tank.need)
        self.lowest = min(self.lowest, tank.level)
        np.maximum(self._peak, np.abs(effort), out=self._peak)
        self.slowed += cycle.admitted < 1.0 or cycle.effort_scale < 1.0
        self.softest = min(self.softest, tank.spring_scale)
        self._cycle += 1
        if self._cycle % self._every == 0:
            self._look(state.time)

    def _look(self, time: float) -> None:
        """Samples the truth: forces [N], positions in world [m], angles [rad]."""
        plant, samples, controller = self._plant, self._samples, self.supervisor.controller
        samples["time"].append(time)
        samples["clock"].append(controller.clock)
        samples["phase"].append(self.supervisor.sequence.phase.name)
        samples["q"].append(plant.position)
        springs = controller.cycle.modules.springs
        for row, arm in enumerate(self.assembly.modules.arms):
            hand = arm.limb.hand
            at = plant.pose(hand).translation
            samples[f"at {hand}"].append(at)
            samples[f"surface on {hand}"].append(plant.contact_wrench(hand)[:3])
            samples[f"object on {hand}"].append(plant.grasp_wrench(hand)[:3])
            if (springs.frame == row).any():
                target = springs.target_translation[np.flatnonzero(springs.frame == row)[0]]
                samples[f"error {hand}"].append(float(np.linalg.norm(at - target)))
        pose = plant.object_pose
        if pose is not None:
            samples[f"at {OBJECT}"].append(pose.translation)
            samples[f"surface on {OBJECT}"].append(plant.contact_wrench(OBJECT)[:3])
            samples["tilt"].append(float(np.arccos(np.clip(pose.rotation[2, 2], -1.0, 1.0))))

    def seen(self, name: str, *phases: str) -> Array:
        """Returns the samples of a name, in all phases or some."""
        values = np.array(self._samples[name])
        return values[np.isin(self._samples["phase"], phases)] if phases else values

    @property
    def names(self) -> tuple[str, ...]:
        """Everything that was sampled."""
        return tuple(self._samples)

    @property
    def done(self) -> bool:
        """Whether the task ran to its end."""
        return self.supervisor.ending is Ending.DONE

    @property
    def need(self) -> float:
        """Least ``tank.initial`` with which nothing would have been slowed [J]."""
        return float(self.assembly.tank.initial - self.headroom)

    @property
    def effort_share(self) -> Array:
        """Largest commanded torque of every joint over its limit, (n,)."""
        return np.asarray(self._peak / self.assembly.limits.effort_max)

    def limit_margin(self) -> float:
        """Smallest distance of a moving joint from its limits [rad]."""
        model = self.assembly.model
        joints = np.concatenate([arm.limb.joints for arm in self.assembly.modules.arms])
        q = self.seen("q")[:, joints]
        low, high = model.column("position_min")[joints], model.column("position_max")[joints]
        return float(min(np.min(q - low), np.min(high - q)))


def watch(task: Path, *, seed: int = 0, rate: float | None = None, duration: float | None = None) -> Watched:
    """Runs a task file on the noisy plant, to its end or for ``duration`` [s], and watches it."""
    assembly = assemble(str(task), effects=None, rate=rate, scale=1.0, arm=None)
    supervisor = Supervisor(assembly)
    backend = sim_backend(assembly, seed)
    first = backend.start()
    supervisor.start(first)
    watched = Watched(assembly, supervisor, backend.plant)
    options = {"duration": duration, "paced": False, "read_only": False}
    run_loop(supervisor, backend, first.state, watched.on_cycle, Interrupt(), **options)
    return watched


def shipped(name: str) -> Path:
    """Returns the path of a shipped task."""
    return TASKS / f"{name}.yaml"


def table_row(name: str, watched: Watched) -> str:
    """Writes a run as a row of the table in docs/tasks.md."""
    bodies = [seen for seen in watched.names if seen.startswith("surface on")]
    peak = max(float(np.max(np.linalg.norm(watched.seen(body), axis=1))) for body in bodies)
    errors = [watched.seen(seen) for seen in watched.names if seen.startswith("error")]
    error = f"{1e3 * np.sqrt(np.mean(np.square(errors))):.1f}" if errors else "-"
    initial, duration = watched.assembly.tank.initial, watched.seen("time")[-1]
    energies = f"{initial:.2f} | {watched.lowest:.2f} | {initial - watched.lowest:.2f} | {watched.need:.2f}"
    force = f"{peak:.1f}" if peak > 0.0 else "-"
    share, margin = 100.0 * np.max(watched.effort_share), watched.limit_margin()
    return f"| {name} | {duration:.1f} | {energies} | {force} | {error} | {share:.0f} | {margin:.2f} |"


if __name__ == "__main__":
    for wanted in sys.argv[1:] or SHIPPED:
        found = watch(shipped(wanted))
        print(table_row(wanted, found) if found.done else f"{wanted}: {found.supervisor.reason}")
