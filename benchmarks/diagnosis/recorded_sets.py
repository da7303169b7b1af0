# SPDX-License-Identifier: BSD-3-Clause
"""Data sets whose diagnosis is timed: arms of the wide benchmark with causes planted, of fixed seeds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.injection import Situation
from benchmarks.wide.arms import WideArm, draw_arm, rigid, write_description
from benchmarks.wide.effects import draw_effect
from benchmarks.wide.logs import SPARE, record, save
from benchmarks.wide.motions import draw_motions, peaks_of
from benchmarks.wide.simulation import simulate

SHOWN = "case.json"

USUAL: Mapping[str, str] = {
    "robot": "baxter",
    "mount": "table",
    "rate": "200",
    "stamps": "even",
    "streams": "command+joint",
    "gravity": "robot",
    "controller": "impedance",
    "engine": "mujoco_implicit",
    "friction": "lugre",
    "transmission": "spring",
    "noise": "white",
    "velocity": "filtered",
    "motion": "identification",
    "repeats": "repeated",
    "known_by": "robot_file",
}
"""Values of the wide benchmark's dimensions where a set says nothing else."""


@dataclass(frozen=True)
class RecordedSet:
    """One set: recordings of some seconds, values that differ from `USUAL`, effect -> joint that has it."""

    logs: int
    seconds: int
    values: Mapping[str, str] = field(default_factory=dict)
    planted: Mapping[str, int] = field(default_factory=dict)


ONE_JOINT = {"robot": "planar_1", "known_by": "urdf", "transmission": "rigid", "velocity": "differenced"}
MOTOR = {"streams": "command+motor", "transmission": "rigid", "velocity": "absent"}
PUSHED = {"streams": "joint", "gravity": "none", "controller": "position_loop"}

SETS: dict[str, RecordedSet] = {
    "five-of-12": RecordedSet(5, 12, {}, {"coulomb_friction": 3, "torque_gain": 1}),
    "six-of-18": RecordedSet(6, 18, {}, {"viscous_friction": 2, "parallel_spring": 1, "torque_offset": 5}),
    "one-of-60": RecordedSet(1, 60, {"repeats": "different"}, {"coulomb_friction": 3}),
    "clean": RecordedSet(4, 12),
    "one-joint-60": RecordedSet(2, 60, {**ONE_JOINT, "rate": "1000"}, {"coulomb_friction": 0}),
    "one-joint-20": RecordedSet(
        3, 20, {**ONE_JOINT, "streams": "motor", "rate": "500", "repeats": "different"}, {"payload": 0}
    ),
    "motor": RecordedSet(4, 12, {**MOTOR, "robot": "ur5", "rate": "500"}, {"reflected_inertia": 2}),
    "urdf-only": RecordedSet(
        3, 12, {**MOTOR, "robot": "ur10", "known_by": "urdf", "repeats": "different"}, {"encoder_offset": 1}
    ),
    "planar": RecordedSet(3, 20, {**PUSHED, "robot": "planar_3", "rate": "100"}, {"payload": 2}),
    "slow": RecordedSet(4, 12, {"motion": "slow"}, {"hysteresis": 3}),
}  # fmt: skip
"""Name -> set. The first three are a minute and more of seven joints at 200 Hz."""


def make_set(name: str, folder: Path) -> Path:
    """Makes a set below a folder unless it is there; returns its own folder."""
    own = folder / name
    if (own / SHOWN).exists():
        return own
    wanted = SETS[name]
    values = {**USUAL, "seconds": str(wanted.seconds), "logs": str(wanted.logs), **wanted.values}
    rng = np.random.default_rng(list(name.encode()))
    arm = draw_arm(values, rng)
    drawn = draw_motions(
        values, rigid(arm.machine).model, arm.drive, wanted.seconds + SPARE, wanted.logs, rng
    )
    motions, repeats = drawn
    peak, least, weight = peaks_of(motions)
    injections = [
        draw_effect(effect, Situation(arm, joint, motions[0].position.mean(axis=0), peak, least, weight, rng))
        for effect, joint in wanted.planted.items()
    ]
    own.mkdir(parents=True, exist_ok=True)
    names = [f"run_{i + 1}.parquet" for i in range(len(motions))]
    for i, motion in enumerate(motions):
        wrong = arm
        for one in injections:
            changed = one.apply(wrong, 2.0 * one.first, i)
            if not isinstance(changed, WideArm):
                raise TypeError(f"{one.effect}: not an arm of the wide benchmark")
            wrong = changed
        channels, rows = record(simulate(wrong.plan(motion.position, i)), wrong, 500 + i)
        first = repeats[i]
        save(own / names[i], channels, rows, arm, None if first is None else f"run_{first + 1}")
    robot = arm.machine.name
    known = write_description(arm, own / robot)
    (own / SHOWN).write_text(json.dumps({"robot": robot, "known_by": known, "logs": names}) + "\n")
    return own


def compared_with(folder: Path) -> dict[str, Any]:
    """Returns recordings and model of a set as arguments of ``diagnosed``."""
    shown = json.loads((folder / SHOWN).read_text())
    robot = folder / shown["robot"]
    known = shown["known_by"] == "robot_file"
    return {
        "logs": [folder / name for name in shown["logs"]],
        "robot": str(robot) if known else None,
        "urdf": None if known else robot / f"{shown['robot']}.urdf",
    }
