# SPDX-License-Identifier: BSD-3-Clause
"""Block N: the three causes that a leading tool could not name, on a five-joint arm of our own; and nothing at all.

Each sits on the second joint: dry friction of 0.8 N.m, a command that is 12 ms late, a torque that is 0.9 of what was
asked. Runs of 4 s, 1 mrad of noise on positions, no torque sensor. The rigid arm, its rotors and its dampers are
MuJoCo's own; so is the friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml
from numpy.typing import NDArray

from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.metadata import episode_metadata

Array = NDArray[np.float64]

FOLDER = Path(__file__).resolve().parent / "arm5"
JOINT = "lift"
SECONDS, PERIOD = 4.0, 0.002
POSITION_NOISE, VELOCITY_NOISE = 0.001, 0.01


@dataclass(frozen=True)
class Wrong:
    """What is wrong with the arm: dry friction [N.m], delay [s] and gain of the torque on `JOINT`."""

    effect: str
    friction: float = 0.0
    delay: float = 0.0
    gain: float = 1.0

    @property
    def parameters(self) -> dict[str, float]:
        """Under the symbols of design 3.3."""
        stated = {
            "coulomb_friction": {"fc": self.friction},
            "command_delay": {"T": self.delay},
            "torque_gain": {"s": self.gain},
        }
        return stated[self.effect]


NAMES: tuple[Wrong | None, ...] = (
    Wrong("coulomb_friction", friction=0.8),
    Wrong("command_delay", delay=0.012),
    Wrong("torque_gain", gain=0.9),
    None,
)


def make_named(
    index: int, rng: np.random.Generator, folder: Path
) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """Records one case; returns its name, what is shown of it and its truth."""
    wrong = NAMES[index]
    name = f"{int(rng.integers(16**10)):010x}"
    (folder / name).mkdir(parents=True, exist_ok=True)
    model = load(wrong)
    first, second, third = (desired(model.nv, rng) for _ in range(3))
    for i, motion in enumerate((first, first, second, third)):
        table = simulate(model, motion, wrong, rng)
        save(folder / name / f"run_{i + 1}.parquet", table, model, "run_1" if i == 1 else None)
    logs = [f"run_{i + 1}.parquet" for i in range(4)]
    shown = {"robot": "arm5", "logs": logs[:3], "holdout": logs[3:], "without": []}
    effects = []
    if wrong is not None:
        port = "timing" if wrong.effect == "command_delay" else "actuator"
        effect = {"effect": wrong.effect, "joints": [JOINT], "port": port, "also": []}
        effects = [effect | {"parameters": {JOINT: wrong.parameters}}]
    truth = {"block": "N", "index": index, "effects": effects, "noise_level": 1.0, "inertia_error": 0.0}
    return name, shown, truth


def load(wrong: Wrong | None) -> mujoco.MjModel:
    """Returns the arm with rotors, dampers and, where planted, dry friction."""
    drives = yaml.safe_load((FOLDER / "robot.yaml").read_text())["joints"]
    spec = mujoco.MjSpec.from_file(str(FOLDER / "arm5.urdf"))
    spec.option.timestep, spec.option.integrator = 0.0005, mujoco.mjtIntegrator.mjINT_RK4
    for joint in spec.joints:
        joint.armature = drives["reflected_inertia"][joint.name]
        joint.damping = np.array([drives["motor_damping"][joint.name], *np.ravel(joint.damping)[1:]])
        if wrong is not None and joint.name == JOINT:
            joint.frictionloss = wrong.friction
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    return spec.compile()


def desired(n: int, rng: np.random.Generator) -> Array:
    """Returns joint angles (samples, n) [rad]: five tones per joint, grown from rest."""
    time = np.arange(round(SECONDS / PERIOD)) * PERIOD
    tones = np.geomspace(0.25, 2.0, 5) * rng.uniform(0.85, 1.15, (n, 5))
    phases, sizes = rng.uniform(0, 2 * np.pi, (n, 5)), 0.35 / tones
    waves = np.sin(2 * np.pi * tones[:, :, None] * time + phases[:, :, None]) - np.sin(phases)[:, :, None]
    shape = (sizes[:, :, None] * waves).sum(axis=1).T
    centre = np.array([0.0, 0.6, 0.8, 0.0, 0.4]) + rng.uniform(-0.2, 0.2, n)
    grown = np.clip(time / 0.8, 0.0, 1.0)[:, None]
    return np.asarray(
        centre + 0.45 * shape / np.abs(shape).max(axis=0) * grown**3 * (10 - 15 * grown + 6 * grown**2)
    )


def simulate(
    model: mujoco.MjModel, motion: Array, wrong: Wrong | None, rng: np.random.Generator
) -> dict[str, Array]:
    """Follows a motion by computed torque and a spring; returns what is logged, one (samples, n) array a channel."""
    data, ideal = mujoco.MjData(model), mujoco.MjData(model)
    v, n = np.gradient(motion, PERIOD, axis=0), model.nv
    a = np.gradient(v, PERIOD, axis=0)
    data.qpos[:] = motion[0]
    at = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, JOINT)
    late = 0 if wrong is None else round(wrong.delay / PERIOD)
    gain = 1.0 if wrong is None else wrong.gain
    command, rows = np.zeros((len(motion), n)), np.zeros((len(motion), 2, n))
    inertia = np.array(model.dof_armature)
    stiffness, damping = 60 * np.sqrt(inertia), 9 * np.sqrt(inertia)
    for k in range(len(motion)):
        seen = data.qpos + POSITION_NOISE * rng.standard_normal(n)
        speed = data.qvel + VELOCITY_NOISE * rng.standard_normal(n)
        rows[k] = seen, speed
        ideal.qpos[:], ideal.qvel[:], ideal.qacc[:] = motion[k], v[k], a[k]
        mujoco.mj_inverse(model, ideal)
        needed = ideal.qfrc_inverse + ideal.qfrc_constraint  # the controller knows nothing of dry friction
        command[k] = needed + stiffness * (motion[k] - seen) + damping * (v[k] - speed)
        data.qfrc_applied[:] = command[k]
        data.qfrc_applied[at] = gain * (command[k - late, at] if k >= late else command[0, at])
        for _ in range(round(PERIOD / model.opt.timestep)):
            mujoco.mj_step(model, data)
    return {
        "position": rows[:, 0],
        "velocity": rows[:, 1],
        "effort_command": command,
        "position_command": motion,
    }


def save(path: Path, table: dict[str, Array], model: mujoco.MjModel, repeat_of: str | None) -> None:
    """Writes one episode without measured torque."""
    joints = [model.joint(i).name for i in range(model.njnt)]
    columns: dict[str, Any] = {"time": np.arange(len(table["position"])) * PERIOD}
    for channel, values in table.items():
        columns |= {f"{channel}.{joint}": values[:, i] for i, joint in enumerate(joints)}
    metadata = episode_metadata(
        robot="arm5",
        episode=path.stem,
        effort_source=None,
        gravity_compensation="command",
        repeat_of=repeat_of,
        task=None,
    )
    write_episode(path, columns, metadata)
