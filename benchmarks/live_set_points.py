# SPDX-License-Identifier: BSD-3-Clause
"""Two hands are led along circles by set-points, a fifth of them lost: ``python -m benchmarks.live_set_points``.

Prints per rate and seed: how long set-points were fresh, the largest speed and change of speed of an equilibrium over
what the task allows, the least margin of the tank's claim over the work of the plant's own motors, and what it cost.
"""

from __future__ import annotations

import math

import numpy as np
from rich.console import Console
from rich.table import Table

from impedance_modules.control.assembly import assemble
from impedance_modules.control.equilibrium_following import Following
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.set_point_source import RunReport
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.spec.set_point_limits import SetPointLimits
from impedance_modules.streaming.inbox import Inbox
from impedance_modules.streaming.set_point_message import SetPointMessage, TargetSetPoint

TASK = "follow-set-points"
RATES = (10.0, 50.0, 200.0, 500.0)
SEEDS = (0, 1, 2)
LOSS = 0.2
RADIUS, TURNS = 0.08, 0.25
"""Of the circles [m], and how many a second [Hz]."""


class Circles:
    """Sends both hands along circles, by the robot's time, with jitter as large as the step, and loses some."""

    def __init__(self, limits: SetPointLimits, rate: float, seed: int) -> None:
        self.random, self.rate = np.random.default_rng(seed), rate
        self.now = self.due = 0.0
        self.sequence = 0
        self.inbox = Inbox(limits, clock=lambda: self.now, calendar=lambda: self.now)
        self.home: np.ndarray | None = None
        self.fresh: list[float] = []
        self.velocity: list[np.ndarray] = []

    def begin(self, phase: str, following: Following) -> None:
        """Takes notice of where the hands are when a phase begins that listens."""
        self.inbox.begin(phase, following)
        if following.active:
            self.home = following.translation.copy()

    def write(self, following: Following, state: RobotState) -> None:
        """Sends what is due and writes what counts."""
        self.now = state.time
        self.due = max(self.due, self.now - 1.0 / self.rate)
        while self.due <= self.now:
            self.due += self.random.uniform(0.0, 2.0 / self.rate)
            if self.random.random() > LOSS:
                self._send()
        self.inbox.write(following, state)
        self.fresh.append(float(following.fresh.mean()))
        self.velocity.append(following.velocity[:, :3].copy())

    def look(self, report: RunReport) -> list[str]:
        """Passes the report on."""
        return self.inbox.look(report)

    def _send(self) -> None:
        self.sequence += 1
        angle = 2.0 * math.pi * TURNS * self.now
        away = RADIUS * np.array([math.cos(angle) - 1.0, 0.0, math.sin(angle)])
        names = ("right.hand", "left.hand")
        targets = {name: TargetSetPoint(position=self.home[k] + away) for k, name in enumerate(names)}
        self.inbox.put(SetPointMessage(self.sequence, targets), "circles")


def measured(rate: float, seed: int) -> tuple[float, ...]:
    """One run: part of the time fresh, speed and change over the limit, least margin [J], cost [W], tracking [mm]."""
    assembly = assemble(TASK, effects=None, rate=None, scale=1.0, arm=None)
    limits = assembly.task.set_points
    source, backend = Circles(limits, rate, seed), sim_backend(assembly, seed)
    supervisor = Supervisor(assembly, source)
    margin, spent, lag = [], [], []

    def watch(*_: object) -> None:
        tank, cycle = supervisor.controller.tank, supervisor.controller.cycle
        margin.append(tank.work_bound - backend.plant.motor_work)
        spent.append(tank.level + tank.spring_scale * tank.potential)
        apart = cycle.arms.translation[:2] - cycle.modules.springs.target_translation[:2]
        lag.append(np.linalg.norm(apart, axis=1))

    first = backend.start()
    supervisor.start(first)
    run_loop(
        supervisor, backend, first.state, watch, Interrupt(), duration=13.0, paced=False, read_only=False
    )
    velocity, most = np.array(source.velocity), limits.targets["left.hand"].speed
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=2).max() / (most * assembly.period / limits.lag)
    speed = np.linalg.norm(velocity, axis=2).max() / most
    cost = (spent[1000] - spent[-1]) / 12.0
    return np.mean(source.fresh), speed, change, min(margin), cost, 1e3 * np.sqrt(np.mean(np.square(lag)))


def main() -> None:
    """Prints the table, mean over the seeds; of speeds the largest, of margins the least."""
    table = Table(title=f"{TASK}: circles of {RADIUS:g} m at {TURNS:g} Hz, {LOSS:.0%} lost, seeds {SEEDS}")
    for name in (
        "Hz",
        "fresh %",
        "speed / limit",
        "change / limit",
        "least margin J",
        "cost W",
        "apart mm RMS",
    ):
        table.add_column(name, justify="right")
    for rate in RATES:
        found = np.array([measured(rate, seed) for seed in SEEDS])
        mean = found.mean(axis=0)
        table.add_row(
            f"{rate:g}",
            f"{100 * mean[0]:.0f}",
            f"{found[:, 1].max():.3f}",
            f"{found[:, 2].max():.3f}",
            f"{found[:, 3].min():.3f}",
            f"{mean[4]:.2f} +- {found[:, 4].std():.2f}",
            f"{mean[5]:.1f}",
        )
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
