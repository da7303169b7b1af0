# SPDX-License-Identifier: BSD-3-Clause
"""What is known about the robot of a log: its joints, which of them slide, and how far they go."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.errors import BadInput, nearest
from impedance_modules.spec.locate import find_robot, list_robots
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.urdf import UrdfFacts, read_urdf

Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class RobotFacts:
    """Joints of a robot.

    Attributes:
        source: File or folder they come from, for messages.
        joints: Names of all that move.
        prismatic: Those that slide.
        limits: Joint -> lowest and highest position [rad] ([m] if prismatic), where known.
    """

    source: Path
    joints: tuple[str, ...]
    prismatic: frozenset[str]
    limits: Limits


def facts_of_urdf(path: Path) -> RobotFacts:
    """Reads the facts from a URDF.

    Raises:
        BadInput: No such file, or no URDF.
    """
    urdf = read_urdf(path)
    moving = {name: joint for name, joint in urdf.joints.items() if joint.moves}
    limits = {name: (j.limits.lower, j.limits.upper) for name, j in moving.items() if j.limits is not None}
    return RobotFacts(path, tuple(moving), _sliding(urdf), limits)


def facts_of_robot(name: str, beside: Path) -> RobotFacts | None:
    """Reads the facts from a robot folder; None where there is none of that name.

    Raises:
        BadInput: The folder is there, but something in it is wrong.
    """
    try:
        folder = find_robot(name, beside)
    except BadInput:
        return None
    spec = read_robot(folder)
    urdf = read_urdf(spec.urdf)
    limits = {joint: (row.position_min, row.position_max) for joint, row in spec.joints.items()}
    joints = tuple(joint for joint, entry in urdf.joints.items() if entry.moves)
    return RobotFacts(folder, joints, _sliding(urdf), limits)


def unknown_robot_note(name: str) -> str:
    """Returns the sentence for a robot that has no folder."""
    near = nearest(name, list_robots())
    return f"there is no robot folder '{name}'{near}: joint names and limits were not checked"


def recognise(names: Iterable[str]) -> RobotSpec | None:
    """Returns the shipped robot to which these joint names belong: one with a whole limb among them, or None."""
    present = frozenset(names)
    for name in list_robots():
        spec = read_robot(name)
        if any(present.issuperset(limb.joints.values()) for limb in spec.limbs.values()):
            return spec
    return None


def _sliding(urdf: UrdfFacts) -> frozenset[str]:
    return frozenset(name for name, joint in urdf.joints.items() if joint.type == "prismatic")
