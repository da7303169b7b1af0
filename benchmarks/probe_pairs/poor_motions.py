# SPDX-License-Identifier: BSD-3-Clause
"""Motions that cannot tell a pair of effects apart, recorded on the plant with one of the two in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.probe_pairs.pairs import JOINT, OTHER, PairCase, Truth
from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.metadata import episode_metadata
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import read_patch
from impedance_modules.spec.robot_reader import read_robot

Array = NDArray[np.float64]

RATE = 500.0
SECONDS = 6.0
LEAD = 2.0
"""Seconds before a recording begins: the start from rest would tell what the motion cannot."""

UPRIGHT = "port_turn"
"""A joint whose motion changes no joint's weight."""

START = {UPRIGHT: 0.13, JOINT: 0.5, OTHER: -1.2}
LOOP = (400.0, 36.0)
"""Feedback of a joint's angle and speed, over its inertia [1/s^2, 1/s]."""

REPEATED = (0, 0, 1, 2)
"""Which motion each recording is of: the first two repeat one another."""

Aim = Callable[[float], tuple[float, float]]
"""Time [s] -> displacement [rad] and speed [rad/s] of one joint."""


def tone(size: float, frequency: float) -> Aim:
    """A sine."""
    omega = 2.0 * np.pi * frequency
    return lambda t: (size * np.sin(omega * t), size * omega * np.cos(omega * t))


def to_and_fro(speed: float, length: float) -> Aim:
    """One speed both ways, with reversals of 0.15 s."""
    half = length / speed

    def aim(t: float) -> tuple[float, float]:
        phase = (t / half) % 2.0
        way = np.tanh((min(phase, abs(1.0 - phase), 2.0 - phase)) * half / 0.05)
        place = phase if phase < 1.0 else 2.0 - phase
        return length * (place - 0.5), speed * way * (1.0 if phase < 1.0 else -1.0)

    return aim


def onwards(speed: float) -> Aim:
    """One speed, one way, from before the recording until after it."""
    return lambda t: (speed * (t - LEAD - 0.5 * SECONDS), speed)


POOR: dict[str, Callable[[int], dict[str, Aim]]] = {
    "held": lambda i: {UPRIGHT: tone((0.2, 0.15, 0.1)[i], (0.4, 0.6, 0.9)[i])},
    "small": lambda i: {JOINT: tone(0.02, (0.4, 0.5, 0.6)[i]), OTHER: tone(0.1, (0.7, 0.9, 1.1)[i])},
    "one_speed": lambda i: {JOINT: to_and_fro(0.25, (0.25, 0.2, 0.3)[i])},
    "one_way": lambda i: {JOINT: onwards((0.1, 0.1, 0.1)[i]), OTHER: tone(0.1, (0.4, 0.6, 0.9)[i])},
    "slow_tone": lambda i: {JOINT: tone((0.25, 0.2, 0.3)[i], (0.35, 0.4, 0.3)[i])},
}
"""Name -> what each joint does in motion 0, 1 and 2; a joint that is left out stands still."""


def write_withheld(folder: Path, truth: Truth, robot: str) -> Path:
    """Writes the effect that the plant has and the model lacks as a patch."""
    head = {"format": 1, "robot": robot, "provenance": {"origin": "hand", "date": "2026-11-26"}}
    path = folder / "withheld.yaml"
    path.write_text(yaml.safe_dump({**head, "effects": [truth.entry()]}, sort_keys=False))
    return path


def record_poor(folder: Path, robot: Path, case: PairCase, motion: str) -> list[Path]:
    """Records the four poor recordings of a case, each on a plant with noise of its own.

    Args:
        folder: Where they go; it holds ``withheld.yaml``.
        robot: The robot's folder.
        case: The pair.
        motion: One of `POOR`.
    """
    nominal, patch = read_robot(robot), read_patch(folder / "withheld.yaml")
    model = RobotModel(apply_patch(nominal, patch))
    applied = apply_to_plant(model, patch)
    paths = []
    for index, which in enumerate(REPEATED):
        options = PlantOptions(rate=RATE, seed=index, step=0.5e-3)
        columns = _recorded(Plant(model, [], None, options, applied), POOR[motion](which))
        about = episode_metadata(
            robot=nominal.name,
            episode=f"{motion}{index}",
            effort_source="joint_sensor" if case.torque_sensor else None,
            gravity_compensation="robot",
            repeat_of=f"{motion}0" if index == 1 else None,
            task=None,
        )
        kept = {n: x for n, x in columns.items() if case.torque_sensor or not n.startswith("effort.")}
        paths.append(write_episode(folder / f"{motion}{index}.parquet", kept, about))
    return paths


def _recorded(plant: Plant, aims: dict[str, Aim]) -> dict[str, Array]:
    """Follows the aims; nothing is kept of the first `LEAD` seconds."""
    model = plant.model
    begin = np.array([START[name] for name in model.joint_names])
    moved = [model.joint_names.index(name) for name in aims]
    first = np.array([aim(0.0)[0] for aim in aims.values()])
    begin[moved] += first
    inertia = np.diag(model.mass_matrix(begin))
    plant.reset(begin)
    deflection = plant.motor_position - begin
    rows: list[Sequence[Array]] = []
    for step in range(round((LEAD + SECONDS) * RATE)):
        state = plant.sense()
        aim, speed = begin.copy(), np.zeros(model.n)
        aim[moved] -= first
        for joint, one in zip(moved, aims.values(), strict=True):
            displacement, speed[joint] = one(step / RATE)
            aim[joint] += displacement
        plant.aim(aim, speed)
        late = aim - plant.motor_position + deflection
        command = inertia * (LOOP[0] * late + LOOP[1] * (speed - plant.motor_velocity))
        rows.append((state.position, state.velocity, state.effort, command, aim))
        plant.advance(command)
    return _columns(rows[round(LEAD * RATE) :], model.joint_names)


def _columns(rows: Sequence[Sequence[Array]], joints: Sequence[str]) -> dict[str, Array]:
    kinds = ("position", "velocity", "effort", "effort_command", "position_command")
    arrays = [np.array(column) for column in zip(*rows, strict=True)]
    named = {
        f"{kind}.{joint}": values[:, index].copy()
        for kind, values in zip(kinds, arrays, strict=True)
        for index, joint in enumerate(joints)
    }
    return {"time": np.arange(len(rows)) / RATE, **named}
