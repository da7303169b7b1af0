# SPDX-License-Identifier: BSD-3-Clause
r"""One hold on surfaces of many shapes, and how far a push moves a hand along a smooth one.

A hand that presses with N on a smooth pipe of radius R and is held across it by a spring K stands, pushed with F, at y:

    F = K y - N y / \sqrt{R^2 - y^2}                 from (F - K y) cos(phi) + N sin(phi) = 0, y = R sin(phi)

so the surface takes N/R from the stiffness, and beyond K = N/R nothing holds. In a hollow of radius R it adds N/R.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impedance_experiments.fouled_pipe import fouled_pipe
from impedance_experiments.task_run import only_arm, watch_task
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.prediction.contact_geometry import place_surface, surface_distance
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task import PushSpec, SurfaceSpec

TASK = "hold-to-saddle"
"""Its springs, phases and push hold on every surface."""

EVERY = 10
"""Cycles from one sample to the next."""

LEAST_CONTACT_FORCE = 0.1
"""A hand that a surface presses with less is not in contact [N]."""

PIPE_RADIUS = 0.1
"""Of the pipes [m]."""

GROWTH, SPACING = 0.004, 0.014
"""Highest growth on a fouled pipe and distance of its corners [m]."""

PIPE_LENGTH = 0.4

ALONG = (0.0, 0.5 * np.pi, 0.0)
"""Turns a z axis into the world's x."""

GENTLE = 3.0
"""The push on smooth surfaces [N]."""

FARTHEST = 0.2
"""Up to which the law looks for a place that holds [m]."""

SETTLED = 0.5
"""Over which a place is averaged before a push and at its end [s]."""


@dataclass(frozen=True)
class Hold:
    """One run, N samples; true, not measured.

    Attributes:
        time: (N,) [s].
        place: (N, 3) of the hand in world [m].
        normal_force: (N,) of the surface on the hand, along its normal there [N].
        asked: Along the force axis [N].
        touched: When the hand touched first [s].
        push: The push.
        paid: What the tank held less at its lowest than at the start [J].
        ending: How the run ended.
    """

    time: Array
    place: Array
    normal_force: Array
    asked: float
    touched: float
    push: PushSpec
    paid: float
    ending: str

    @property
    def held(self) -> Array:
        """Marks the samples from half a second after the first touch."""
        return np.asarray(self.time >= self.touched + SETTLED)

    @property
    def contact(self) -> float:
        """Share of the time since then in which the surface presses the hand."""
        return float(np.mean(self.normal_force[self.held] > LEAST_CONTACT_FORCE))

    @property
    def force_error(self) -> float:
        """RMS difference of the normal force from the asked one [N]."""
        return float(np.sqrt(np.mean((self.normal_force[self.held] - self.asked) ** 2)))

    @property
    def moved(self) -> float:
        """How far the hand is from its place before the push when the push begins to fall [m]."""
        return self._away(self.push.start + self.push.rise + self.push.hold)

    @property
    def slipped(self) -> float:
        """How far it still is half a second after the push is over [m]."""
        end = self.push.start + self.push.rise + self.push.hold + self.push.fall
        return self._away(end + 2.0 * SETTLED)

    def _away(self, time: float) -> float:
        return float(np.linalg.norm(self._mean(time) - self._mean(self.push.start)))

    def _mean(self, end: float) -> Array:
        """Averages the place over the time before ``end`` [s]."""
        return np.asarray(self.place[(self.time >= end - SETTLED) & (self.time < end)].mean(axis=0))


def held_task() -> Assembly:
    """Assembles the task whose hold is tried."""
    return assemble(TASK, effects=None, rate=None, scale=1.0, arm=None)


def hold(assembly: Assembly, surface: SurfaceSpec, seed: int) -> Hold:
    """Runs a task on another surface."""
    task = replace(assembly.task, environment=(surface,))
    hand = assembly.model.limbs[only_arm(assembly)].hand
    placed = place_surface(surface)
    rows: list[tuple[float, Array, Array, float]] = []
    count = 0

    def observe(_: RobotState, plant: Plant, supervisor: Supervisor) -> None:
        nonlocal count
        count += 1
        if count % EVERY == 0:
            place, level = plant.pose(hand).translation.copy(), float(supervisor.controller.tank.level)
            rows.append((plant.time, place, plant.contact_wrench(hand)[:3].copy(), level))

    supervisor = watch_task(replace(assembly, task=task), observe, seed=seed)
    ending = "" if supervisor.ending is None else supervisor.ending.value
    force = np.array([row[2] for row in rows])
    places = np.array([row[1] for row in rows])
    pressed = np.linalg.norm(force, axis=1) > 0.0
    normals = np.array([surface_distance(placed, place)[1] for place in places])
    time = np.array([row[0] for row in rows])
    return Hold(
        time=time,
        place=places,
        normal_force=np.where(pressed, np.sum(force * normals, axis=1), 0.0),
        asked=asked_force(assembly),
        touched=float(time[np.argmax(pressed)]) if pressed.any() else 0.0,
        push=task.pushes[0],
        paid=float(assembly.tank.initial - min(row[3] for row in rows)),
        ending=f"{ending} {supervisor.reason}".strip(),
    )


def asked_force(assembly: Assembly) -> float:
    """Gives the force along the task's force axis [N]."""
    return abs(assembly.task.arms[only_arm(assembly)].springs[0].axes["z"].force)


def surfaces_to_hold(assembly: Assembly, fouled: int) -> dict[str, SurfaceSpec]:
    """Makes the surfaces by their names: all have their top where the task's saddle has its middle.

    Args:
        assembly: The task.
        fouled: How many fouled pipes there are, each another.
    """
    saddle = assembly.task.environment[0]
    top = np.array(saddle.position)
    flat = replace(saddle, surface="plane", height=float(top[2]), position=None, size=None, radii=None)
    found = {"flat": flat, "pipe": pipe(saddle, PIPE_RADIUS), "saddle": saddle}
    for seed in range(1, fouled + 1):
        mesh = fouled_pipe(
            seed=seed, diameter=2.0 * PIPE_RADIUS, length=PIPE_LENGTH, growth=GROWTH, spacing=SPACING
        )
        grown = replace(pipe(saddle, PIPE_RADIUS), surface="mesh", size=None, mesh=mesh)
        found[f"fouled pipe {seed}"] = grown
    return found


def pipe(saddle: SurfaceSpec, radius: float) -> SurfaceSpec:
    """Makes a pipe along the world's x whose top is where a saddle has its middle."""
    x, y, z = (0.0, 0.0, 0.0) if saddle.position is None else saddle.position
    return replace(
        saddle,
        surface="cylinder",
        position=(x, y, z - radius),
        rotation=ALONG,
        size=(2.0 * radius, PIPE_LENGTH),
        radii=None,
    )


def gently(assembly: Assembly, way: str) -> Assembly:
    """The same task with its phases until the push is over, and a gentle push along ``x`` or ``y``."""
    push = assembly.task.pushes[0]
    x, y = (GENTLE, 0.0) if way == "x" else (0.0, GENTLE)
    longer = replace(push, wrench=(x, y, 0.0, 0.0, 0.0, 0.0), hold=3.0 * push.hold)
    touch, keep, *_ = assembly.task.phases
    keep = replace(keep, duration=longer.start + longer.rise + longer.hold + longer.fall)
    return replace(assembly, task=replace(assembly.task, pushes=(longer,), phases=(touch, keep)))


def smooth(surface: SurfaceSpec) -> SurfaceSpec:
    """The same surface without friction."""
    return replace(surface, friction=0.0)


def given_way(stiffness: float, pressed: float, force: float, curvature: float) -> float:
    """Solves F = K y - N y / sqrt(R^2 - y^2) for the first y > 0 [m]; infinite where nothing holds.

    Args:
        stiffness: K across the pipe [N/m].
        pressed: N [N].
        force: F [N].
        curvature: 1/R [1/m]; below 0 in a hollow, where N holds.
    """
    if curvature == 0.0:
        return force / stiffness
    radius, sign = 1.0 / abs(curvature), 1.0 if curvature > 0.0 else -1.0
    y = np.linspace(0.0, min(0.95 * radius, FARTHEST), 20_000)
    left = stiffness * y - sign * pressed * y / np.sqrt(radius**2 - y**2) - force
    beyond = np.flatnonzero(left >= 0.0)
    return float(y[beyond[0]]) if beyond.size else np.inf
