# SPDX-License-Identifier: BSD-3-Clause
"""Sanding on the plant: what the hand measured, what became of the wood, and the thesis's three cases at two depths.

The cases are rough wood at the start of sanding, rough wood at its end, and a smooth piece (fig. 5-11 and 5-13).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.sanding_rule import KINDS, WoodKind
from impedance_experiments.task_run import watch_task
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.roughness_detection import (
    SAMPLE_RATE,
    Directions,
    HandForce,
    Window,
    WindowFinder,
    frequencies,
)
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.wood import WoodState
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task import SurfaceSpec
from impedance_modules.tools.recorded_roughness import Touched

TOWARDS = Directions(np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
"""Strokes towards the robot on a level board: the ones that the thesis judges."""
SHALLOW, DEEP, SLANTED = "sand-wood", "sand-wood-deep", "sand-wood-slanted"
MOST_WINDOWS = 8
"""Windows per case; the thesis's eight."""


@dataclass(frozen=True)
class Sanding:
    """One run, N samples.

    Attributes:
        touched: What the hand measured.
        force: (N, 3) of the wood on the hand, true [N].
        place: (N, 3) of the hand, true [m].
        velocity: (N, 3) of the hand, true [m/s].
        caught: (N,) whether a splinter held it.
        target: (N, 3) where the hand's spring is at rest [m].
        windows: All windows of strokes towards the robot.
        refused: How many strokes gave none, by reason.
        wood: What became of the wood.
        left: (M, 3) every second: time [s], least and mean roughness left where the hand has rubbed, 0 to 1.
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
    left: Array
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


def wear_values(wood: WoodState) -> tuple[float, float]:
    """Gives the least and the mean roughness left where the hand has rubbed, 0 to 1."""
    rubbed = wood.remaining[wood.remaining < 1.0]
    return (float(rubbed.min()), float(np.mean(rubbed))) if rubbed.size else (1.0, 1.0)


def sanding_task(name: str, *, board: SurfaceSpec | None = None, seconds: float | None = None) -> Assembly:
    """Assembles a sanding task, on another piece of wood or for another time [s] of sanding."""
    assembly = assemble(name, effects=None, rate=None, scale=1.0, arm=None)
    task = assembly.task
    if board is not None:
        task = replace(task, environment=(board,))
    if seconds is not None:
        task = replace(task, phases=(*task.phases[:-1], replace(task.phases[-1], duration=seconds)))
    return replace(assembly, task=task)


class _SandingRecorder:
    """Measures while a task sands, ``SAMPLE_RATE`` times in a second."""

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
        self.left: list[tuple[float, float, float]] = []

    def observe(self, state: RobotState, plant: Plant, supervisor: Supervisor) -> None:
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
        if state.time >= len(self.left):
            self.left.append((state.time, *wear_values(self.wood)))


def sand(assembly: Assembly, seed: int) -> Sanding:
    """Carries a sanding task out, with sensor noise.

    Raises:
        BadInput: The run ends before it has begun.
    """
    recorder = _SandingRecorder(assembly)
    supervisor = watch_task(assembly, recorder.observe, seed=seed)
    if recorder.wood is None:
        raise BadInput(f"task '{assembly.task.name}' ends before anything is sanded: {supervisor.reason}")
    time, position, force, true, place, velocity, caught, target = (
        np.array(column) for column in zip(*recorder.rows, strict=True)
    )
    ending = supervisor.ending.value if supervisor.ending is not None else "went on"
    return Sanding(
        touched=Touched(recorder.hand, "effort", time[:, 0], position, force),
        force=true,
        place=place,
        velocity=velocity,
        caught=caught[:, 0] > 0.0,
        target=target,
        windows=tuple(recorder.windows),
        refused=dict(recorder.finder.refused),
        wood=recorder.wood,
        left=np.array(recorder.left),
        tank=assembly.tank.initial - float(supervisor.controller.tank.level),
        ending=f"{ending} {supervisor.reason}".strip(),
        messages=tuple(text for _, text in supervisor.messages),
    )


@dataclass(frozen=True)
class DepthRuns:
    """One depth of the equilibrium.

    Attributes:
        rough, smooth: The runs.
        start, end: First and last windows of the rough run.
        plain: Windows of the smooth run.
    """

    rough: Sanding
    smooth: Sanding
    start: tuple[Window, ...]
    end: tuple[Window, ...]
    plain: tuple[Window, ...]

    @property
    def cases(self) -> dict[str, tuple[Window, ...]]:
        """The three cases of fig. 5-11 and 5-13, by name."""
        return {
            "rough wood, start": self.start,
            "rough wood, end": self.end,
            "smooth wood": self.plain,
        }


def smooth_board(board: SurfaceSpec) -> SurfaceSpec:
    """Makes the same board of smooth wood: the middle of the smooth kind's ranges, no splinters."""
    wood = board.wood
    if wood is None or wood.roughness is None:
        return board
    ranges = KINDS[WoodKind.SMOOTH]
    even = replace(
        wood.roughness,
        height=float(np.mean(ranges.height)),
        friction=float(np.mean(ranges.rough_friction)),
    )
    return replace(board, wood=replace(wood, roughness=even, splinters=None))


def run_depth(task: str, seed: int, rough_seconds: float, smooth_seconds: float) -> DepthRuns:
    """Sands the task's own wood and a smooth board of the same shape."""
    rough = sand(sanding_task(task, seconds=rough_seconds), seed)
    board = smooth_board(board_of(sanding_task(task)))
    smooth = sand(sanding_task(task, board=board, seconds=smooth_seconds), seed)
    count = min(MOST_WINDOWS, len(rough.windows) // 2)
    if count == 0 or not smooth.windows:
        raise BadInput(
            f"task '{task}': too few windows, {len(rough.windows)} on rough and {len(smooth.windows)} on smooth wood "
            f"(valid: two and one; on rough wood {rough.stuck} s were spent in splinters)"
        )
    return DepthRuns(
        rough, smooth, rough.windows[:count], rough.windows[-count:], smooth.windows[:MOST_WINDOWS]
    )


def numbers(windows: Sequence[Window], name: str) -> Array:
    """Collects one number of every window."""
    return np.array([getattr(window, name) for window in windows])


def spectrum(windows: Sequence[Window]) -> tuple[Array, Array]:
    """Gives frequencies [Hz] and mean amplitudes [N]."""
    return frequencies(), np.mean([window.spectrum for window in windows], axis=0)


def separation(first: Sequence[Window], second: Sequence[Window], name: str) -> float:
    """Gives how many standard deviations lie between the means of two cases; the pooled deviation."""
    a, b = numbers(first, name), numbers(second, name)
    pooled = float(np.sqrt(0.5 * (a.var() + b.var())))
    return abs(float(a.mean() - b.mean())) / max(pooled, 1e-12)


def contact_shares(run: Sanding, since: float) -> tuple[float, float]:
    """Gives the shares of the time in contact while the hand goes towards the robot, and while it pushes away."""
    moving = (np.abs(run.velocity[:, 0]) > 0.03) & (run.time > since)
    touching = run.force[:, 2] > 0.0
    towards, away = moving & (run.velocity[:, 0] < 0.0), moving & (run.velocity[:, 0] > 0.0)
    return float(np.mean(touching[towards])), float(np.mean(touching[away]))
