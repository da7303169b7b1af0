# SPDX-License-Identifier: BSD-3-Clause
"""Short tasks for the tests of forecasts, on Baxter: two free hands, a wiping hand, a box in both hands."""

from __future__ import annotations

from pathlib import Path

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.prediction.feasibility import TaskPrediction, refuse_infeasible

SOFT_HANDS = """\
arms:
  right:
    posture: {s0: 0.2706, s1: -0.4171, e0: 0.8304, e1: 1.4871, w0: -0.9774, w1: 0.9511, w2: -2.5284}
    joint_bias: {stiffness: {s0: 5, s1: 10, e0: 5, e1: 5, w0: 2, w1: 2, w2: 1}, damping_ratio: 0.7}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {x: 300, y: 300, z: 300, rx: 10, ry: 10, rz: 10}
        damping_ratio: 0.7
  left: {mirror: right}
"""
"""The arms of a task with two soft hands and nothing else."""

HOLD_AND_LIFT = f"""\
format: 1
name: hold-and-lift
robot: baxter
{SOFT_HANDS}\
safety: {{tank: {{initial: 5, max: 10, floor: 0.5}}}}
phases:
  - {{name: hold, duration: 0.5}}
  - {{name: lift, equilibrium: {{right.hand: {{z: 0.15}}, left.hand: {{z: 0.15}}}}, duration: 1.5}}
"""

WIPE = """\
format: 1
name: wipe
robot: baxter
arms:
  right:
    posture: {s0: 0.2706, s1: -0.4171, e0: 0.8304, e1: 1.4871, w0: -0.9774, w1: 0.9511, w2: -2.5284}
    joint_bias: {stiffness: {s0: 2, s1: 2, e0: 2, e1: 2, w0: 1, w1: 1, w2: 1}, damping_ratio: 0.7}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {x: 300, y: 300, z: 200, rx: 5, ry: 5, rz: 5}
        damping_ratio: 0.7
safety: {tank: {initial: 8, max: 12, floor: 0.3}}
environment: [{surface: plane, height: HEIGHT, stiffness: 20000, damping: 50, friction: 0.3}]
phases:
  - {name: touch, equilibrium: {right.hand: {z: DEEP}}, duration: 2.0, until: {contact: true}}
  - {name: press, equilibrium: {right.hand: {z: DEEP}}, duration: 1.0}
  - {name: wipe, equilibrium: {right.hand: {y: {sine: {amplitude: 0.06, frequency: 0.5}}}}, duration: 3}
"""

BOX = """\
format: 1
name: box
robot: baxter
arms:
  right:
    posture: {s0: 0.0974, s1: -0.0042, e0: 0.7974, e1: 1.3809, w0: 0.6399, w1: 1.1361, w2: 0.0}
    joint_bias: {stiffness: {s0: 5, s1: 5, e0: 5, e1: 5, w0: 2, w1: 2, w2: 2}, damping_ratio: 0.3}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {x: 200, y: 200, z: 200, rx: 5, ry: 5, rz: 5}
        damping_ratio: 0.3
  left: {mirror: right}
object:
  {held_by: [left, right], shape: box, mass: 1, size: [0.3, 0.2, 0.2], grasp: weld, squeeze: {force: 10},
   carry_weight: true}
safety: {tank: {initial: 8, max: 12, floor: 0.5}}
environment: [{surface: plane, height: -0.1, stiffness: 20000, damping: 50, friction: 0.3}]
phases:
  - {name: raise, equilibrium: {object: {z: 0.06}}, duration: 1.0}
  - {name: lower, equilibrium: {object: {z: -0.05}}, duration: 1.5}
"""


def write_task(folder: Path, text: str, *changes: tuple[str, str]) -> Path:
    """Writes a task with some texts replaced; every text must be there."""
    for old, new in changes:
        if old not in text:
            raise ValueError(f"'{old}' is not in the task")
        text = text.replace(old, new)
    path = folder / "task.yaml"
    path.write_text(text)
    return path


def assembled(task: str | Path, **changes: object) -> Assembly:
    """A task as ``run`` assembles it without any option."""
    return assemble(str(task), **{"effects": None, "rate": None, "scale": 1.0, "arm": None, **changes})


def predicted(task: str | Path, **changes: object) -> tuple[Assembly, TaskPrediction]:
    """A task and what ``check`` predicts of it, unless it refuses."""
    assembly = assembled(task, **changes)
    return assembly, refuse_infeasible(assembly)


def wipe(folder: Path, *changes: tuple[str, str]) -> Path:
    """A hand that leans on a table 4 cm below its start and wipes; heights from the posture."""
    free = assembled(write_task(folder, WIPE, ("HEIGHT", "-1.0"), ("DEEP", "-0.9")))
    height = float(free.modules.arms[0].springs[0].start.translation[2])
    heights = ("HEIGHT", f"{height - 0.04:.5f}"), ("DEEP", f"{height - 0.08:.5f}")
    return write_task(folder, WIPE, *heights, *changes)
