# SPDX-License-Identifier: BSD-3-Clause
"""Short recordings of a six-joint robot with effects, driven through its plant; sensors without noise."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.regressor import PAIR
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import PatchSpec, read_patch
from impedance_modules.spec.robot_spec import RobotSpec
from tests.support.plant_parts import SIX_JOINTS, exact, spec_of, with_every

RATE = 1000.0
SECONDS = 2.2
STILL = 0.4
"""What is cut from the start, where the motion fades in [s]."""


@dataclass(frozen=True)
class AppliedEffect:
    """One effect in a patch, with the numbers that a recording must give back."""

    effect: str
    port: str
    key: str
    values: tuple[tuple[str, float], ...]

    @property
    def numbers(self) -> dict[str, float]:
        return dict(self.values)

    def entry(self) -> dict[str, object]:
        """As a patch file writes it."""
        description = CATALOGUE[self.effect].description
        joints = [self.key.partition(PAIR)[0]] if {"joint", "pair"} & set(description.keys) else []
        numbers = {s: {"value": float(v), "unit": description.parameter(s).unit} for s, v in self.values}
        return {"effect": self.effect, "joints": joints, "port": self.port, "parameters": {self.key: numbers}}


def applied(effect: str, port: str, key: str, **values: float) -> AppliedEffect:
    return AppliedEffect(effect, port, key, tuple(values.items()))


def write_patch(folder: Path, *entries: dict[str, object], robot: str = "six_joint_pair") -> Path:
    head = {"format": 1, "robot": robot, "provenance": {"origin": "hand", "date": "2026-11-21"}}
    path = folder / "patch.yaml"
    path.write_text(yaml.safe_dump({**head, "effects": list(entries)}, sort_keys=False))
    return path


def patch_with(*entries: dict[str, object], robot: str = "six_joint_pair") -> PatchSpec:
    """A patch of some entries, written and read."""
    with tempfile.TemporaryDirectory() as folder:
        return read_patch(write_patch(Path(folder), *entries, robot=robot))


def patch_of(robot: str, entries: Sequence[AppliedEffect]) -> PatchSpec:
    return patch_with(*(entry.entry() for entry in entries), robot=robot)


def nominal(spring_damping: float) -> RobotSpec:
    """Perfect sensors, no delay, and springs whose damping the effort sensor does not miss."""
    spec = exact(spec_of(SIX_JOINTS))
    return with_every(spec, spring_damping=spring_damping)


def start(model: RobotModel) -> np.ndarray:
    angles = {"turn": 0.13, "lift": 0.5, "bend": -1.2, "roll": -1.0, "tilt": 1.0, "spin": 0.3}
    mirrored = {**angles, "roll": 1.0, "tilt": -1.0}
    return model.position({"port": angles, "starboard": mirrored})


@dataclass(frozen=True)
class Recording:
    """What was logged, and the nominal robot it is compared with."""

    robot: RobotSpec
    signals: Signals
    reported_velocity: np.ndarray

    def residual(self, kind: str) -> np.ndarray:
        s = self.signals
        if kind == "link":
            return s.effort - s.rigid
        if kind == "velocity":
            return self.reported_velocity - s.velocity
        rotor = s.reflected_inertia * s.motor_acceleration + s.motor_damping * s.motor_velocity
        return s.drive - s.effort - rotor


def signals_of(model: RobotModel, time: np.ndarray, *motion: np.ndarray | None, **more: object) -> Signals:
    """What the diagnosis reads of a recording of a robot: its motion, and the numbers of its drives."""
    drives = {
        "reflected_inertia": model.reflected_inertia,
        "motor_damping": model.column("motor_damping"),
        "spring_compliance": model.spring_compliance(),
    }
    return Signals(RigidModel.of_robot(model), time, *motion, effort_source="joint_sensor", **drives, **more)


@cache
def record(
    entries: tuple[AppliedEffect, ...], spring_damping: float = 0.0, seconds: float = SECONDS
) -> Recording:
    """Tracks a motion of several tones on all joints at once; drive torque is that of the sample's middle."""
    robot = nominal(spring_damping)
    plant = plant_with(robot, entries)
    n, q0 = plant.model.n, start(plant.model)
    plant.reset(q0)
    random = np.random.default_rng(7)
    tones, phase = random.uniform(0.3, 1.6, (3, n)), random.uniform(0.0, 2.0 * np.pi, (3, n))
    swing = random.uniform(0.25, 0.5, (3, n)) * np.array([0.25, 0.25, 0.3, 0.4, 0.3, 0.5] * 2)
    inertia = np.diag(plant.model.mass_matrix(q0))
    deflection = plant.motor_position - q0
    rows = []
    for k in range(round(seconds * RATE)):
        state = plant.sense()
        aim, speed = _aim(k / RATE, tones, phase, swing)
        plant.aim(q0 + aim, speed)
        ahead = plant.motor_position - deflection - q0
        pull = 64.0 * (aim - ahead) + 10.0 * (speed - plant.motor_velocity)
        command = plant.start_command + inertia * pull
        rows.append((np.full(n, state.time), state.position, state.velocity, state.effort, command, q0 + aim))
        plant.advance(command)
    time, position, velocity, effort, command, aims = (np.array(column) for column in zip(*rows, strict=True))
    # A command acts from its sample to the next: what acts at a sample, on average, is the mean of two.
    command[1:] = 0.5 * (command[1:] + command[:-1])
    model = RobotModel(robot)
    assistance = RigidModel.of_robot(model).weight(position)
    for joint, spring in _springs(entries, plant.model):
        assistance[:, joint] += spring["k"] * position[:, joint] - spring["preload"]
    moving = np.gradient(position, time[:, 0], axis=0)
    motion = (position, moving, np.gradient(moving, time[:, 0], axis=0), effort, command + assistance, aims)
    signals = signals_of(model, time[:, 0], *motion, assistance=assistance)
    return Recording(robot, signals, velocity)


def plant_with(robot: RobotSpec, entries: tuple[AppliedEffect, ...]) -> Plant:
    """The plant of a robot with effects."""
    options = PlantOptions(rate=RATE, seed=0, noise=False, step=0.5e-3)
    if not entries:
        return Plant(RobotModel(robot), [], None, options)
    patch = patch_of(robot.name, entries)
    model = RobotModel(apply_patch(robot, patch))
    return Plant(model, [], None, options, apply_to_plant(model, patch))


def _springs(entries: tuple[AppliedEffect, ...], model: RobotModel) -> list[tuple[int, dict[str, float]]]:
    return [(model.joint_names.index(e.key), e.numbers) for e in entries if e.effect == "parallel_spring"]


def _aim(t: float, tones: np.ndarray, phase: np.ndarray, swing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = min(1.0, t / STILL)
    ramp, rate = x**3 * (10 - 15 * x + 6 * x * x), 30.0 * x * x * (1 - x) ** 2 / STILL
    angle = 2 * np.pi * tones * t + phase
    along = np.sum(swing * (np.sin(angle) - np.sin(phase)), axis=0)
    speed = np.sum(swing * 2 * np.pi * tones * np.cos(angle), axis=0)
    return ramp * along, ramp * speed + rate * along
