# SPDX-License-Identifier: BSD-3-Clause
"""A robot folder and a task for the simulated FR3 of franky-sim: its own URDF, one arm or a pair, as plain text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

POSTURE = (0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785)
"""Where the tasks begin [rad]."""

SPACING = 0.8
"""Between the bases of a pair, along y [m]."""

RANGES = (
    [-2.9, 2.9],
    [-1.83, 1.83],
    [-2.9, 2.9],
    [-3.07, -0.117],
    [-2.87, 2.87],
    [0.44, 4.62],
    [-3.05, 3.05],
)
"""Of the joints, a little inside the simulator's [rad]."""

JOINTS = tuple(f"j{k}" for k in range(1, 8))


def assets() -> Path:
    """Folder of franky-sim's model."""
    spec = find_spec("franky_sim")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("franky_sim")
    return Path(spec.origin).parent / "assets"


def write_robot(folder: Path, limbs: tuple[str, ...], gravity: str = "robot", joints: int = 7) -> Path:
    """Writes robots/NAME; returns its folder.

    Args:
        folder: Of ``robot.yaml``.
        limbs: Names; one arm stands at the origin, two left and right of it.
        gravity: What the robot file says of it.
        joints: Of each limb; fewer than seven are the wrong robot.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arms.urdf").write_text(urdf_of(limbs))
    (folder / "robot.yaml").write_text(yaml_of(folder.name, limbs, gravity, joints))
    return folder


def urdf_of(limbs: tuple[str, ...]) -> str:
    """Puts one copy of the arm per limb on a common base; its hand of 0.73 kg is a link like any other."""
    root = ElementTree.Element("robot", name="arms")
    ElementTree.SubElement(root, "link", name="base_of_all")
    for k, limb in enumerate(limbs):
        tree = ElementTree.parse(assets() / "fr3_clean.urdf").getroot()
        for part in [*tree.iter("link"), *tree.iter("joint")]:
            for shape in [*part.findall("visual"), *part.findall("collision")]:
                part.remove(shape)
        text = ElementTree.tostring(tree, encoding="unicode")
        text = re.sub(r'(name|link)="([a-z]\w*)"', rf'\1="{limb}_\2"', text)
        tree = ElementTree.fromstring(text)
        for part in [*tree.findall("link"), *tree.findall("joint")]:
            root.append(part)
        y = SPACING * (k - 0.5 * (len(limbs) - 1))
        root.append(ElementTree.fromstring(
            f'<joint name="{limb}_mount" type="fixed"><parent link="base_of_all"/><child link="{limb}_base"/>'
            f'<origin xyz="0 {y} 0" rpy="0 0 0"/></joint>'
        ))  # fmt: skip
        root.append(ElementTree.fromstring(
            f'<link name="{limb}_palm"><inertial><origin xyz="-0.01 0 0.03" rpy="0 0 0"/><mass value="0.73"/>'
            '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.0025" iyz="0" izz="0.0017"/></inertial></link>'
        ))  # fmt: skip
        root.append(ElementTree.fromstring(
            f'<joint name="{limb}_flange" type="fixed"><parent link="{limb}_link8"/><child link="{limb}_palm"/>'
            '<origin xyz="0 0 0" rpy="0 0 0"/></joint>'
        ))  # fmt: skip
    return ElementTree.tostring(root, encoding="unicode")


def yaml_of(name: str, limbs: tuple[str, ...], gravity: str, joints: int) -> str:
    """The robot file; motors and friction are the simulator's."""
    used = JOINTS[:joints]

    def table(values: Sequence[object]) -> str:
        return "{" + ", ".join(f"{j}: {v}" for j, v in zip(used, values, strict=False)) + "}"

    limb_lines = "\n".join(
        f"  {limb}:\n    hand: {limb}_palm\n    joints: {{"
        + ", ".join(f"{j}: {limb}_joint{k + 1}" for k, j in enumerate(used))
        + "}\n    gripper: {kind: franka-hand, opening: [0, 0.08], force: 70, speed: 0.1, time_out: 8}"
        for limb in limbs
    )
    held = ", ".join(f"{limb}_joint{k}: {POSTURE[k - 1]}" for limb in limbs for k in range(joints + 1, 8))
    return f"""format: 1
name: {name}
urdf: arms.urdf
limbs:
{limb_lines}
{f"locked: {{{held}}}" if held else ""}
joints:
  position: {table(RANGES)}
  velocity: {table([2.62] * 4 + [5.26, 4.18, 5.26])}
  effort: {table([87] * 4 + [12] * 3)}
  effort_rate: {table([1000] * 7)}
  spring_stiffness: {table(["rigid"] * 7)}
  spring_damping: {table([0] * 7)}
  reflected_inertia: {table([0.195] * 4 + [0.074] * 3)}
  motor_damping: {table([0.21] * 7)}
timing: {{rate: 1000, rate_min: 100, rate_max: 1000, command_delay: 0.001, command_timeout: 0.02}}
sensors:
  position_resolution: 1.0e-06
  effort_resolution: 0.001
  position_noise: 1.0e-06
  effort_noise: 0.01
  velocity_filter: 0.001
contact_detection: {{force: 8, time: 0.05}}
collision: {{margin: 0.02, pairs: []}}
gravity_compensation: {gravity}
control_modes: [torque, position]
solver: daqp
"""


def write_task(path: Path, robot: Path, limbs: tuple[str, ...], seconds: float = 2.0) -> Path:
    """Writes a task in which the arms lean to one side, against the simulator's dry friction of 1.1 N.m.

    Returns:
        Its path.
    """
    posture = "{" + ", ".join(f"{j}: {q}" for j, q in zip(JOINTS, POSTURE, strict=True)) + "}"
    arms = "".join(
        f"""  {limb}:
    posture: {posture}
    joint_bias: {{stiffness: {{j1: 60, j2: 60, j3: 40, j4: 40, j5: 10, j6: 10, j7: 10}}, damping_ratio: 0.7}}
    springs:
      - name: {limb}_spring
        frame: {limb}_palm
        expressed_in: world
        stiffness: {{x: 50, y: 50, z: 50, rx: 2, ry: 2, rz: 2}}
        damping_ratio: 0.7
"""
        for limb in limbs
    )
    goal = ", ".join(f"{limb}: {{j1: 0.15, j4: -1.9}}" for limb in limbs)
    path.write_text(
        f"""format: 1
name: {path.stem}
description: Soft springs, for a simulated robot.
robot: {robot}
arms:
{arms}safety: {{tank: {{initial: 3, max: 6, floor: 0.3}}}}
phases:
  - {{name: hold, duration: {0.25 * seconds}}}
  - {{name: lean, posture: {{{goal}}}, duration: {0.5 * seconds}}}
  - {{name: rest, duration: {0.25 * seconds}}}
"""
    )
    return path
