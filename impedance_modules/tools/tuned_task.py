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
from impedance_modules.spec.document import Document
from impedance_modules.spec.task_text import changed, task_document
from impedance_modules.spec.yaml_tree import KeyPath
from impedance_modules.tools.spring_tuning import TunedPosture, TuningRequest, named

LARGE_TANK = 50.0
"""Tank with which a task is simulated to find the energy that it needs [J]."""

TANK_RESERVE = 1.3
"""Energy over the need that is put into a tank that was too small."""

RAMP_TIME, HOLD_TIME = 3.0, 12.0
"""Phases of a trial [s]."""


def tuned_task(
    name: str, model: RobotModel, request: TuningRequest, tuned: TunedPosture, share: float
) -> str:
    """Writes the task with the tuned posture and joint springs; the rest is the task's own.

    Args:
        name: Of the task, or its path.
        model: Its robot.
        request: The load case.
        tuned: What was found.
        share: Multiplies the springs; below 1 to see an arm fold.

    Raises:
        BadInput: The arm is written as another one's mirror image.
    """
    document = task_document(name)
    return _with_tank(document, _arm_changes(document, model, request, tuned, share), request, "")


def trial_task(
    name: str, model: RobotModel, request: TuningRequest, tuned: TunedPosture, share: float
) -> str:
    """Writes a task that loads the joint springs while an external force of the same size resists.

    Both follow the same minimum-jerk course, so that the posture is an equilibrium at every moment: what the arm does
    there shows only whether the equilibrium is stable.
    """
    document = task_document(name)
    changes = _arm_changes(document, model, request, tuned, share)
    if request.alone:
        changes[("arms", request.arm)].pop("springs", None)
    limb = model.limbs[request.arm]
    force = max(request.ends, key=abs)
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
                "name": "load",
                "posture": {request.arm: named(rest, limb.short_names, 6)},
                "duration": RAMP_TIME,
            },
            {"name": "hold", "duration": HOLD_TIME},
        ],
        ("pushes",): [
            {
                "target": request.arm,
                "wrench": {
                    axis: round(float(-force * part), 6)
                    for axis, part in zip("xyz", request.direction, strict=True)
                    if part != 0.0
                },
                "start": 0.0,
                "rise": RAMP_TIME,
                "hold": HOLD_TIME,
            }
        ],
    }
    return _with_tank(
        document, changes, request, "# A trial: joint springs are loaded against an external force.\n"
    )


def _arm_changes(
    document: Document, model: RobotModel, request: TuningRequest, tuned: TunedPosture, share: float
) -> dict[KeyPath, Any]:
    arm: Mapping[str, Any] = document.data["arms"][request.arm]
    if "mirror" in arm:
        raise BadInput(
            f"arm '{request.arm}' is the mirror image of '{arm['mirror']}' (valid: --arm {arm['mirror']}; the image"
            " follows)"
        )
    limb = model.limbs[request.arm]
    bias = {
        # A spring without any damping would swing for ever.
        **arm.get("joint_bias", {"damping_ratio": 0.7}),
        "stiffness": named(share * tuned.stiffness, limb.short_names, 6),
    }
    posture = named(tuned.posture.q[limb.joints], limb.short_names, 8)
    return {("arms", request.arm): {**arm, "posture": posture, "joint_bias": bias}}


def _with_tank(document: Document, changes: dict[KeyPath, Any], request: TuningRequest, heading: str) -> str:
    """Fills the tank if what it holds is not enough for the changed task."""
    direction = ", ".join(f"{part:g}" for part in request.direction)
    heading = (
        f"# Written by `impedance tune`: arm {request.arm}, {request.low:g} to {request.high:g} N along"
        f" ({direction}).\n{heading}"
    )
    text = changed(document, changes, heading)
    tank = document.data["safety"]["tank"]
    need = _need(
        changed(document, {**changes, ("safety", "tank"): {**tank, "initial": LARGE_TANK, "max": LARGE_TANK}})
    )
    if need <= tank["initial"]:
        return text
    filled = math.ceil(10.0 * TANK_RESERVE * need) / 10.0
    enough = {**tank, "initial": filled, "max": max(float(tank["max"]), 2.0 * filled)}
    return changed(document, {**changes, ("safety", "tank"): enough}, heading)


def _need(text: str) -> float:
    """Returns the energy that a task's tank needs [J], from a quasi-static simulation."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "task.yaml"
        path.write_text(text, encoding="utf-8")
        assembly = assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)
        return forecast_tank(assembly, Mechanism(assembly), predict_motion(assembly)).need
