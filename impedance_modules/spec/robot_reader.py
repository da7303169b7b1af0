# SPDX-License-Identifier: BSD-3-Clause
"""Reads a robot folder: ``robot.yaml`` and its URDF, into a frozen ``RobotSpec``.

First the shape of the file is checked against ``schemas/robot.schema.json``, then its meaning against the
URDF (``robot_checks``). Each stage reports everything it finds at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from impedance_modules.errors import BadFile
from impedance_modules.spec.locate import ROBOT_FILE, find_robot
from impedance_modules.spec.robot_spec import (
    CollisionSpec,
    ContactDetectionSpec,
    JointSpec,
    LimbSpec,
    MirrorSpec,
    PlaybackSpec,
    RobotSpec,
    SensorSpec,
    TimingSpec,
)
from impedance_modules.spec.robot_checks import robot_problems
from impedance_modules.spec.schema import schema_problems
from impedance_modules.spec.document import scan_document
from impedance_modules.spec.urdf import read_urdf

RIGID = "rigid"
"""The word for a joint without a series spring."""


def read_robot(name_or_folder: str | Path, beside: Path | None = None) -> RobotSpec:
    """Reads a robot: what its joints can do, what its sensors show, which links must stay apart.

    Args:
        name_or_folder: A name (``robots/<name>``), or a folder that holds ``robot.yaml``.
        beside: The task file that names the robot, for names relative to it; None when nothing does.

    Raises:
        BadInput: There is no such robot, or a file of it cannot be read.
        BadFile: ``robot.yaml`` or the URDF says something wrong; all problems, each with its position.
    """
    folder = find_robot(name_or_folder, beside)
    document = scan_document(folder / ROBOT_FILE)
    problems = [*document.traps, *schema_problems(document, "robot")]
    if problems:
        raise BadFile(problems)
    if not (folder / document.data["urdf"]).is_file():
        present = sorted(file.name for file in folder.glob("*.urdf"))
        raise BadFile(
            [document.problem(("urdf",), f"{folder} has no file '{document.data['urdf']}'", present)]
        )
    problems = robot_problems(document, read_urdf(folder / document.data["urdf"]))
    if problems:
        raise BadFile(problems)
    return _build(document.data, folder)


def _build(data: Mapping[str, Any], folder: Path) -> RobotSpec:
    """Turns checked data into the frozen spec."""
    collision = data["collision"]
    return RobotSpec(
        name=data["name"],
        # Resolved: a task may reach the folder through a link that does not last.
        urdf=(folder / data["urdf"]).resolve(),
        limbs={
            name: LimbSpec(name, limb["hand"], dict(limb["joints"])) for name, limb in data["limbs"].items()
        },
        joints=_joints(data),
        locked={name: float(angle) for name, angle in data.get("locked", {}).items()},
        mirror=_mirror(data["mirror"]) if "mirror" in data else None,
        timing=TimingSpec(**_numbers(data["timing"])),
        sensors=SensorSpec(**_numbers(data["sensors"])),
        contact_detection=ContactDetectionSpec(**_numbers(data["contact_detection"])),
        collision=CollisionSpec(tuple((a, b) for a, b in collision["pairs"]), float(collision["margin"])),
        gravity_compensation=data["gravity_compensation"],
        control_modes=tuple(data["control_modes"]),
        solver=data["solver"],
        folder=folder,
        playback=_playback(data["playback"]) if "playback" in data else None,
    )


def _numbers(table: Mapping[str, float]) -> dict[str, float]:
    return {key: float(value) for key, value in table.items()}


def _playback(data: Mapping[str, Any]) -> PlaybackSpec:
    found: dict[str, Any] = {
        key: _numbers(value) if isinstance(value, Mapping) else float(value) for key, value in data.items()
    }
    return PlaybackSpec(**found)


def _mirror(data: Mapping[str, Any]) -> MirrorSpec:
    return MirrorSpec(data["plane"], {short: int(sign) for short, sign in data["joint_sign"].items()})


def _joints(data: Mapping[str, Any]) -> dict[str, JointSpec]:
    """Collects each joint's numbers from the tables; its URDF name wins over its short name."""
    joints: dict[str, JointSpec] = {}
    for limb in data["limbs"].values():
        for short, name in limb["joints"].items():
            row = {quantity: table.get(name, table.get(short)) for quantity, table in data["joints"].items()}
            joints[name] = _joint(name, row)
    return joints


def _joint(name: str, row: Mapping[str, Any]) -> JointSpec:
    stiffness = row["spring_stiffness"]
    return JointSpec(
        name=name,
        position_min=float(row["position"][0]),
        position_max=float(row["position"][1]),
        velocity_max=float(row["velocity"]),
        effort_max=float(row["effort"]),
        effort_rate_max=float(row["effort_rate"]),
        spring_stiffness=None if stiffness == RIGID else float(stiffness),
        reflected_inertia=float(row["reflected_inertia"]),
        motor_damping=float(row["motor_damping"]),
        spring_damping=float(row["spring_damping"]),
    )
