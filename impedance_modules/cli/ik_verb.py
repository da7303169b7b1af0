# SPDX-License-Identifier: BSD-3-Clause
"""``impedance ik``: the joint angles that bring a hand to a pose, as YAML for a task."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.plain_lines import say
from impedance_modules.errors import BadInput, nearest

if TYPE_CHECKING:
    from impedance_modules.robot.model import RobotModel
    from impedance_modules.spec.robot_spec import RobotSpec
    from impedance_modules.spec.task import HandPosture


@click.command("ik")
@click.argument("robot", metavar="ROBOT_OR_TASK")
@click.option("--arm", metavar="NAME", help="Limb of the robot  [default: its only one].")
@click.option(
    "--hand",
    metavar="X,Y,Z[,RX,RY,RZ]",
    help="Pose of the hand in world: m, and a rotation vector in rad.  [default: as the arms of TASK have it]",
)
@click.option("--elbow", type=float, metavar="RAD", help="Angle of the elbow, 0 below the line to the hand.")
def ik_command(robot: str, arm: str | None, hand: str | None, elbow: float | None) -> int:
    """Print the joint angles that bring a hand of ROBOT_OR_TASK to a pose, as a posture for a task.

    ROBOT_OR_TASK is a robot's name or folder, or a task, whose robot it then is; without --hand, the postures of all
    arms of the task are printed. Of several postures, the one whose joints are farthest from their limits. Exit: 0
    found, 2 bad input or out of reach.
    """
    if hand is None:
        if arm is not None or elbow is not None:
            raise BadInput("--arm and --elbow go with --hand (valid: --hand X,Y,Z or X,Y,Z,RX,RY,RZ)")
        return _print_task(robot)
    from impedance_modules.robot.hand_postures import find_posture, joint_angles, what_is_missed
    from impedance_modules.robot.model import RobotModel

    model = RobotModel(_robot(robot))
    limb, asked = _limb(model, arm), _asked(hand, elbow)
    found = find_posture(model, limb, asked)
    missed = " ".join(what_is_missed(found, asked)).strip()
    if missed:
        raise BadInput(f"--hand {hand}: '{limb}' does not come there: {missed} (valid: a pose within reach)")
    _print(limb, joint_angles(model, limb, found))
    if found.elbow is not None:
        say(f"# the elbow is at {found.elbow:.4f} rad")
    return 0


def _print_task(name: str) -> int:
    """Prints the postures of a task's arms as joint angles."""
    from impedance_modules.robot.hand_postures import with_joint_angles
    from impedance_modules.spec.task_reader import read_task

    task = with_joint_angles(*read_task(name))
    for limb, arm in task.arms.items():
        _print(limb, dict(arm.posture))
    return 0


def _print(limb: str, angles: dict[str, float]) -> None:
    inside = ", ".join(f"{short}: {angle:.6f}" for short, angle in angles.items())
    say(f"{limb}: {{posture: {{{inside}}}}} # rad")


def _robot(name: str) -> RobotSpec:
    """Reads a robot by name or folder, or the robot of a task."""
    from impedance_modules.spec.locate import find_robot
    from impedance_modules.spec.robot_reader import read_robot
    from impedance_modules.spec.task_reader import read_task

    try:
        folder = find_robot(name, beside=Path.cwd() / "task.yaml")
    except BadInput as no_robot:
        try:
            return read_task(name)[1]
        except BadInput as no_task:
            raise BadInput(f"{no_robot}\n{no_task}") from None
    return read_robot(folder)


def _limb(model: RobotModel, arm: str | None) -> str:
    names = tuple(model.limbs)
    if arm is None and len(names) == 1:
        return names[0]
    if arm not in names:
        said = (
            "is missing: the robot has several limbs"
            if arm is None
            else f"{arm}: no such limb{nearest(arm, names)}"
        )
        raise BadInput(f"--arm {said} (valid: {', '.join(names)})")
    return arm


def _asked(hand: str, elbow: float | None) -> HandPosture:
    """Reads the options."""
    from impedance_modules.spec.task import HandPosture

    try:
        numbers = [float(part) for part in hand.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in {3, 6} or not all(map(math.isfinite, numbers)):
        raise BadInput(
            f"--hand {hand}: not three or six numbers (valid: X,Y,Z or X,Y,Z,RX,RY,RZ in m and rad)"
        )
    if elbow is not None and not abs(elbow) <= 2.0 * math.pi:
        raise BadInput(f"--elbow {elbow:g}: no such angle (valid: -6.28 to 6.28 rad)")
    x, y, z = numbers[:3]
    turn = (numbers[3], numbers[4], numbers[5]) if len(numbers) == 6 else None
    return HandPosture((x, y, z), turn, elbow)
