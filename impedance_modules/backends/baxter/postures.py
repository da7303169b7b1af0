# SPDX-License-Identifier: BSD-3-Clause
"""Postures of both arms that have a name: Rethink's own, and the starts of tasks."""

from __future__ import annotations

from collections.abc import Mapping

from impedance_modules.errors import BadInput
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task_reader import read_task

NEUTRAL: Mapping[str, float] = {
    "s0": 0.0,
    "s1": -0.55,
    "e0": 0.0,
    "e1": 0.75,
    "w0": 0.0,
    "w1": 1.26,
    "w2": 0.0,
}
"""Rethink's neutral posture [rad] [sdk]."""

TUCKED: Mapping[str, float] = {
    "s0": -1.0,
    "s1": -2.175,
    "e0": 3.0,
    "e1": 2.55,
    "w0": 0.0,
    "w1": 0.01,
    "w2": 0.0,
}
UNTUCKED: Mapping[str, float] = {
    "s0": -0.08,
    "s1": -1.0,
    "e0": -1.19,
    "e1": 1.94,
    "w0": 0.67,
    "w1": 1.03,
    "w2": -0.50,
}
"""Of the left arm [rad] [sdk]; the right one mirrors them. Tucked, s1 lies outside its published range."""

MIRRORED: Mapping[str, int] = {"s0": -1, "s1": 1, "e0": -1, "e1": 1, "w0": -1, "w1": 1, "w2": -1}
"""Sign with which the right arm takes the left one's angles."""

POSTURES: Mapping[str, Mapping[str, float]] = {"neutral": NEUTRAL, "tucked": TUCKED, "untucked": UNTUCKED}
"""Of the arm whose angles are not mirrored."""


def named_posture(spec: RobotSpec, name: str) -> dict[str, dict[str, float]]:
    """Finds the posture of every limb by a name of ``POSTURES`` or by a task, limb -> short name -> [rad].

    A limb that the task leaves out stands at the neutral posture.

    Raises:
        BadInput: Neither; or the task is for another robot.
    """
    # The last limb of the mirror's pair carries the numbers, the others their mirror image.
    plain = min(spec.limbs)
    by_name = POSTURES.get(name, NEUTRAL)
    found = {
        limb: {
            short: by_name[short] if limb == plain else MIRRORED[short] * by_name[short]
            for short in spec.limbs[limb].joints
        }
        for limb in spec.limbs
    }
    if name in POSTURES:
        return found
    try:
        task, robot = read_task(name)
    except BadInput as error:
        raise BadInput(f"posture '{name}': {error} (valid besides tasks: {', '.join(POSTURES)})") from None
    if robot.name != spec.name:
        raise BadInput(
            f"posture '{name}': the task is for robot '{robot.name}' (valid: one for '{spec.name}')"
        )
    found.update({arm: dict(task.arms[arm].posture) for arm in task.arms})
    return found
