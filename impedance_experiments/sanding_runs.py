# SPDX-License-Identifier: BSD-3-Clause
"""Sanding carried out on the plant: what the hand measured, and what really became of the wood."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.task_run import watch_task
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.hand_force import HandForce
from impedance_modules.control.roughness_windows import SAMPLE_RATE, Directions, Window, WindowFinder
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import BadInput
from impedance_modules.plant.wood import WoodState
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task import SurfaceSpec
from impedance_modules.tools.roughness import Touched

Array = NDArray[np.float64]

TOWARDS = Directions(np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
"""Strokes towards the robot on a level board: the ones that the thesis judges."""

X, Z = 0, 2


@dataclass(frozen=True)
class Sanding:
    """One run, N looks.

    Attributes:
        touched: What the hand measured.
        force: (N, 3) of the wood on the hand, true [N].
        place: (N, 3) of the hand, true [m].
        velocity: (N, 3) of the hand, true [m/s].
        caught: (N,) whether a splinter held it.
        target: (N, 3) where the hand's spring is at rest [m].
        windows: All windows of strokes towards the robot.
        refused: How many strokes gave none, by why.
        wood: What became of the wood.
        tank: What the energy tank gave [J].
        ending: How the run ended, and after how many seconds.
        messages: Of the run.
    """

    touched: Touched
    force: Array
    place: Array
    velocity: Array
    caught: NDArray[np.bool_]
    target: Array
    windows: tuple[Window, ...]
    refused: dict[str, int]
    wood: WoodState
    tank: float
    ending: str
    messages: tuple[str, ...]

    @property
    def time(self) -> Array:
        """(N,) since the start [s]."""
        return self.touched.time

    @property
    def work(self) -> Array:
        """(N,) work that the hand has done on the wood so far [J], from true force and velocity."""
        power = -np.sum(self.force * self.velocity, axis=1)
        return np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(self.time))])

    @property
    def stuck(self) -> tuple[float, float] | None:
        """First and last time of the longest hold by splinters [s]; holds less than 0.3 s apart count as one."""
        held = self.time[self.caught]
        if held.size == 0:
            return None
        parts = np.split(held, np.flatnonzero(np.diff(held) > 0.3) + 1)
        longest = max(parts, key=lambda part: part[-1] - part[0])
        return float(longest[0]), float(longest[-1])


def board_of(assembly: Assembly) -> SurfaceSpec:
    """Returns the piece of wood of a task."""
    return next(surface for surface in assembly.task.environment if surface.wood is not None)


def sanding_task(name: str, *, board: SurfaceSpec | None = None, seconds: float | None = None) -> Assembly:
    """Assembles a sanding task, on another piece of wood or for another time [s] of sanding."""
    assembly = assemble(name, effects=None, rate=None, scale=1.0, arm=None)
    task = assembly.task
    if board is not None:
        task = replace(task, environment=(board,))
    if seconds is not None:
        task = replace(task, phases=(*task.phases[:-1], replace(task.phases[-1], duration=seconds)))
    return replace(assembly, task=task)


class _Watcher:
    """Looks on while a task sands, ``SAMPLE_RATE`` times in a second."""

    def __init__(self, assembly: Assembly) -> None:
        limb = assembly.modules.arms[0].limb
        self.hand = limb.hand
        self._sensor = HandForce(assembly.model, limb)
        self._every = max(1, round(assembly.rate / SAMPLE_RATE))
        self._cycle = 0
        self.finder = WindowFinder(TOWARDS, assembly.rate / self._every)
        self.windows: list[Window] = []
        self.rows: list[tuple[Array, ...]] = []
        self.wood: WoodState | None = None

    def look(self, state: RobotState, plant: Plant, supervisor: Supervisor) -> None:
        """Takes one control cycle into account."""
        self._cycle += 1
        if self._cycle % self._every:
            return
        position, force = self._sensor.of(state.position, state.velocity, state.effort)
        window = self.finder.add(state.time, position, force)
        if window is not None:
            self.windows.append(window)
        controller = supervisor.controller
        rest = next(iter(controller.motion.at(controller.clock).springs.values()))
        self.rows.append(
            (
                np.array([state.time]),
                position,
                force,
                plant.contact_wrench(self.hand)[:3].copy(),
                plant.pose(self.hand).translation,
                plant.hand_twist(self.hand)[:3].copy(),
                np.array([float(plant.caught(self.hand))]),
                rest.translation.copy(),
            )
        )
        self.wood = plant.woods[0]


def sand(assembly: Assembly, seed: int) -> Sanding:
    """Carries a sanding task out, with sensor noise.

    Raises:
        BadInput: The run ends before it has begun.
    """
    watcher = _Watcher(assembly)
    supervisor = watch_task(assembly, watcher.look, seed=seed)
    if watcher.wood is None:
        raise BadInput(f"task '{assembly.task.name}' ends before anything is sanded: {supervisor.reason}")
    time, position, force, true, place, velocity, caught, target = (
        np.array(column) for column in zip(*watcher.rows, strict=True)
    )
    ending = supervisor.ending.value if supervisor.ending is not None else "went on"
    return Sanding(
        touched=Touched(watcher.hand, "effort", time[:, 0], position, force),
        force=true,
        place=place,
        velocity=velocity,
        caught=caught[:, 0] > 0.0,
        target=target,
        windows=tuple(watcher.windows),
        refused=dict(watcher.finder.refused),
        wood=watcher.wood,
        tank=assembly.tank.initial - float(supervisor.controller.tank.level),
        ending=f"{ending} {supervisor.reason}".strip(),
        messages=tuple(text for _, text in supervisor.messages),
    )
