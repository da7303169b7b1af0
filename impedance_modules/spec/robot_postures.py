# SPDX-License-Identifier: BSD-3-Clause
"""Postures that a robot file names, and the list of its numbers that are assumed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.document import Document
from impedance_modules.spec.locate import ROBOT_FILE
from impedance_modules.spec.robot_spec import AssumedNumber, RobotSpec

CONSEQUENCES = {
    "position": "a joint may meet a stop or a cable before the controller brakes it",
    "velocity": "the controller brakes joints at another speed than the robot does",
    "effort": "margins of torque are foretold of another drive; the robot may cut what is commanded",
    "effort_rate": "a torque may rise faster than the robot follows, or be held back for nothing",
    "spring_stiffness": "joints that are called rigid may swing against their rotors at high stiffness",
    "reflected_inertia": "damping from a ratio, and the highest stable stiffness, are those of another rotor",
    "motor_damping": "how a motion dies away without the controller's damping is not known",
    "timing": "the highest stable stiffness holds for these rates and delays only",
    "sensors": "noise and the energy that sensing may feign are those of another encoder",
    "contact_detection": "contact may be felt late, or where there is none",
    "gravity_compensation": "the arms fall, or are lifted by their weight taken twice",
    "control_modes": "the robot takes no torques, and nothing of this can be carried out on it",
    "gripper": "the gripper may hold less firmly, open less widely, or take longer than a task relies on",
    "inertia": "links weigh something else: statics, damping and forces are foretold of other links",
}
"""Key of the list ``assumed`` -> what follows where the number is wrong."""


def assumed_numbers(document: Document) -> tuple[AssumedNumber, ...]:
    """Lists what a robot file calls assumed, each with its line; the file is free of schema problems."""
    keys = document.data.get("assumed", [])
    lines = (document.problem(("assumed", index), "").line for index in range(len(keys)))
    return tuple(AssumedNumber(key, line) for key, line in zip(keys, lines, strict=True))


def assumed_notes(robot: RobotSpec) -> tuple[str, ...]:
    """Says of each assumed number where it stands and what follows if it is wrong; nothing of other robots."""
    file = robot.folder / ROBOT_FILE
    return tuple(
        f"{file}:{number.line}: '{number.key}' is assumed; if it is wrong, {CONSEQUENCES[number.key]}"
        for number in robot.assumed
    )


def posture_problems(document: Document) -> Iterator[Problem]:
    """Checks named postures: limbs exist, each gives all of its joints, inside their limits."""
    limbs = document.data["limbs"]
    for name, posture in document.data.get("postures", {}).items():
        for limb, angles in posture.items():
            at = ("postures", name, limb)
            if limb not in limbs:
                message = f"there is no limb '{limb}'{nearest(limb, tuple(limbs))}"
                yield document.problem(at, message, tuple(limbs), at="key")
            else:
                yield from _angle_problems(document, at, limbs[limb]["joints"], angles)


def _angle_problems(
    document: Document, at: tuple[str, ...], joints: Mapping[str, str], angles: Mapping[str, float]
) -> Iterator[Problem]:
    missing = [short for short in joints if short not in angles]
    if missing:
        yield document.problem(at, f"no angle is given for {', '.join(missing)}", at="key")
    for short, angle in angles.items():
        if short not in joints:
            message = f"the limb '{at[-1]}' has no joint '{short}'{nearest(short, tuple(joints))}"
            yield document.problem((*at, short), message, tuple(joints), at="key")
            continue
        limits = _limits(document.data["joints"]["position"], short, joints[short])
        if limits is not None and not limits[0] <= angle <= limits[1]:
            message = f"{angle:g} rad is outside the limits of '{joints[short]}'"
            yield document.problem((*at, short), message, (f"{limits[0]:g} to {limits[1]:g} rad",))


def _limits(table: Mapping[str, Any], short: str, name: str) -> tuple[float, float] | None:
    found = table.get(name, table.get(short))
    return None if found is None else (float(found[0]), float(found[1]))
