# SPDX-License-Identifier: BSD-3-Clause
"""Task files with what was tuned: the task with its new posture and joint springs, and a trial under load."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.control.assembly import assemble
from impedance_modules.errors import BadInput
from impedance_modules.prediction.energy_need import forecast_tank
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.change import Steps, changed, task_document
from impedance_modules.spec.source import Document
from impedance_modules.tools.tune.tune import Question, Tuned, named

AMPLE = 50.0
"""Tank with which a task is rehearsed to find what it needs [J]."""

SPARE = 1.3
"""Times the need, what goes into a tank that was too small."""

WINDING, HOLDING = 3.0, 12.0
"""Phases of a trial [s]."""


def tuned_task(name: str, model: RobotModel, question: Question, tuned: Tuned, share: float) -> str:
    """Writes the task with the tuned posture and joint springs; the rest is the task's own.

    Args:
        name: Of the task, or its path.
        model: Its robot.
        question: What was asked.
        tuned: What was found.
        share: Multiplies the springs; below 1 to see an arm fold.

    Raises:
        BadInput: The arm is written as another one's mirror image.
    """
    document = task_document(name)
    return _with_tank(document, _arm_changes(document, model, question, tuned, share), question, "")


def trial_task(name: str, model: RobotModel, question: Question, tuned: Tuned, share: float) -> str:
    """Writes a task that winds the joint springs while somebody resists with the same force.

    Both follow the same minimum-jerk course, so that the posture is an equilibrium at every moment: what the arm does
    there shows only whether the equilibrium is stable.
    """
    document = task_document(name)
    changes = _arm_changes(document, model, question, tuned, share)
    if question.alone:
        changes[("arms", question.arm)].pop("springs", None)
    limb = model.limbs[question.arm]
    force = max(question.ends, key=abs)
    rest = tuned.posture.q[limb.joints] + tuned.torque / (share * tuned.stiffness)
    low, high = (model.column(side)[limb.joints] for side in ("position_min", "position_max"))
    if np.any(rest < low) or np.any(rest > high):
        joint = limb.joint_names[int(np.argmax(np.maximum(low - rest, rest - high)))]
        raise BadInput(
            f"--share {share:g}: such soft springs would rest beyond the limit of {joint} (valid: a share nearer to 1)"
        )
    changes |= {
        ("name",): f"{document.data['name']}-trial"[:64],
        ("phases",): [
            {
                "name": "wind",
                "posture": {question.arm: named(rest, limb.short_names, 6)},
                "duration": WINDING,
            },
            {"name": "hold", "duration": HOLDING},
        ],
        ("pushes",): [
            {
                "target": question.arm,
                "wrench": {
                    axis: round(float(-force * part), 6)
                    for axis, part in zip("xyz", question.direction, strict=True)
                    if part != 0.0
                },
                "start": 0.0,
                "rise": WINDING,
                "hold": HOLDING,
            }
        ],
    }
    return _with_tank(
        document, changes, question, "# A trial: joint springs are wound while somebody resists.\n"
    )


def _arm_changes(
    document: Document, model: RobotModel, question: Question, tuned: Tuned, share: float
) -> dict[Steps, Any]:
    arm: Mapping[str, Any] = document.data["arms"][question.arm]
    if "mirror" in arm:
        raise BadInput(
            f"arm '{question.arm}' is the mirror image of '{arm['mirror']}' (valid: --arm {arm['mirror']}; the image"
            " follows)"
        )
    limb = model.limbs[question.arm]
    bias = {
        # A spring without any damping would swing for ever.
        **arm.get("joint_bias", {"damping_ratio": 0.7}),
        "stiffness": named(share * tuned.stiffness, limb.short_names, 6),
    }
    posture = named(tuned.posture.q[limb.joints], limb.short_names, 8)
    return {("arms", question.arm): {**arm, "posture": posture, "joint_bias": bias}}


def _with_tank(document: Document, changes: dict[Steps, Any], question: Question, heading: str) -> str:
    """Fills the tank if what it holds is not enough for the changed task."""
    direction = ", ".join(f"{part:g}" for part in question.direction)
    heading = (
        f"# Written by `impedance tune`: arm {question.arm}, {question.low:g} to {question.high:g} N along"
        f" ({direction}).\n{heading}"
    )
    text = changed(document, changes, heading)
    tank = document.data["safety"]["tank"]
    need = _need(changed(document, {**changes, ("safety", "tank"): {**tank, "initial": AMPLE, "max": AMPLE}}))
    if need <= tank["initial"]:
        return text
    filled = math.ceil(10.0 * SPARE * need) / 10.0
    enough = {**tank, "initial": filled, "max": max(float(tank["max"]), 2.0 * filled)}
    return changed(document, {**changes, ("safety", "tank"): enough}, heading)


def _need(text: str) -> float:
    """Rehearses a task and says what its tank needs [J]."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "task.yaml"
        path.write_text(text, encoding="utf-8")
        assembly = assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)
        return forecast_tank(assembly, Mechanism(assembly), predict_motion(assembly)).need
