# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of two joints of the six-joint robot, made on its plant: tracked tones, noisy sensors."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import read_patch
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import RobotSpec
from tests.support.paths import TESTS
from tests.support.recordings import columns_of, save

SIX_JOINTS = TESTS / "robots" / "six_joint_pair"
RATE = 500.0
MOVING = ("port_lift", "port_bend")
START = np.array([0.5, -1.2])
TREMOR = 6.0
"""Its frequency [Hz]."""
STALL = 0.036
"""Time for which a controller stops [s]."""
SWING = np.array([0.25, 0.3])
CHANGES = {
    "spring_damping: {turn: 0, lift: 1.0, bend: 1.0,": "spring_damping: {turn: 0, lift: 0, bend: 0,",
    "position_noise: 0\n": "position_noise: 2.0e-5\n",
    "effort_noise: 0.002": "effort_noise: 0.05",
}
"""An effort sensor does not see what a spring's own damping passes on: here it has none. And sensors are noisy."""


def robot_folder(parent: Path) -> Path:
    """A copy of the six-joint robot with noisy sensors and undamped springs."""
    folder = parent / "six_joint_pair"
    shutil.copytree(SIX_JOINTS, folder)
    text = (folder / "robot.yaml").read_text()
    for old, new in CHANGES.items():
        if old not in text:
            raise AssertionError(f"robot.yaml no longer says '{old}'")
        text = text.replace(old, new)
    (folder / "robot.yaml").write_text(text)
    return folder


def two_joints(folder: Path) -> RobotSpec:
    """The robot with two joints that move, the others locked at zero."""
    spec = read_robot(folder)
    joints = {name: spec.joints[name] for name in MOVING}
    still = dict.fromkeys((name for name in spec.joints if name not in joints), 0.0)
    return replace(spec, limbs={}, joints=joints, locked={**spec.locked, **still}, mirror=None)


def patch_text(effect: str, port: str, joint: str, **numbers: tuple[float, str]) -> str:
    values = ", ".join(f"{name}: {{value: {value}, unit: {unit}}}" for name, (value, unit) in numbers.items())
    return f"""format: 1
robot: six_joint_pair
provenance: {{origin: hand, date: 2026-11-21}}
effects:
  - {{effect: {effect}, joints: [{joint}], port: {port}, parameters: {{{joint}: {{{values}}}}}}}
"""


def record(
    folder: Path,
    robot: Path,
    patch: str | None,
    seconds: float = 6.0,
    stalls: Sequence[float] = (),
    tremor: float = 0.0,
) -> list[Path]:
    """Three motions, the last one twice; the repeat's noise differs.

    At the times of ``stalls`` the controller stops for `STALL`: the robot holds the last command, and no row is
    written. Commands have a tremor of so many N.m.
    """
    spec, applied = two_joints(robot), None
    if patch is not None:
        (folder / "truth.yaml").write_text(patch)
        read = read_patch(folder / "truth.yaml")
        spec = apply_patch(spec, read)
        applied = apply_to_plant(RobotModel(spec), read)
    model = RobotModel(spec)
    paths = []
    for index, motion in enumerate([0, 1, 2, 2]):
        plant = Plant(model, [], None, PlantOptions(rate=RATE, seed=index, step=0.5e-3), applied)
        about = {"gravity_compensation": "robot", "repeat_of": "run2" if index == 3 else None}
        columns = _run(plant, motion, seconds, stalls, tremor)
        paths.append(save(folder, f"run{index}", columns, robot=spec.name, **about))
    return paths


def _run(
    plant: Plant, motion: int, seconds: float, stalls: Sequence[float], tremor: float
) -> dict[str, np.ndarray]:
    model = plant.model
    random = np.random.default_rng(50 + motion)
    tones = random.uniform(0.1, 0.9, (4, model.n))
    phases = random.uniform(0.0, 2.0 * np.pi, (4, model.n))
    sizes = SWING * random.uniform(0.2, 0.5, (4, model.n))
    q0 = START
    inertia = np.diag(model.mass_matrix(q0))
    plant.reset(q0)
    deflection = plant.motor_position - q0
    times, rows, command = [], [], np.zeros(model.n)
    for k in range(round(seconds * RATE)):
        t = k / RATE
        if any(0.0 < t - begin < STALL for begin in stalls):
            plant.advance(command)
            continue
        ramp = 1.0 - np.exp(-((t / 0.5) ** 2))
        angle = 2.0 * np.pi * tones * t + phases
        aim = q0 + ramp * np.sum(sizes * (np.sin(angle) - np.sin(phases)), axis=0)
        speed = ramp * np.sum(sizes * 2.0 * np.pi * tones * np.cos(angle), axis=0)
        state = plant.sense()
        ahead = plant.motor_position - deflection
        command = inertia * (60.0 * (aim - ahead) + 12.0 * (speed - plant.motor_velocity))
        command += tremor * np.sin(2.0 * np.pi * TREMOR * t)
        times.append(t)
        rows.append((state.position, state.velocity, state.effort, command))
        plant.advance(command)
    kinds = ("position", "velocity", "effort", "effort_command")
    recorded = dict(zip(kinds, map(np.array, zip(*rows, strict=True)), strict=True))
    return columns_of(np.array(times), model.joint_names, **recorded)
