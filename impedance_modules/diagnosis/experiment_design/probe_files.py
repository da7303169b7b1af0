# SPDX-License-Identifier: BSD-3-Clause
"""A probe as files: the task that `impedance run` carries out, or tables for a robot without a folder."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.experiment_design.open_reasons import CHI_SQUARE
from impedance_modules.diagnosis.experiment_design.probe_choice import SHARE, Probe, Proposal
from impedance_modules.diagnosis.experiment_design.separation import RATIO, MotionPredictor
from impedance_modules.spec.robot_spec import LimbSpec, RobotSpec

TANK_SHARE = 1.4
"""Energy in the tank over the need that the quasi-static prediction states."""

TANK_FLOOR = 0.3
"""Energy that stays in the tank [J]."""


def task_text(
    proposal: Proposal, predictor: MotionPredictor, spec: RobotSpec, purpose: str, *, robot: str, need: float
) -> str:
    """Writes the task file: joint springs on every arm, whose rest posture makes the strokes.

    Args:
        proposal: What to do.
        predictor: Its start and joint springs.
        spec: The robot; arms whose joints do not move hold their posture.
        purpose: Why, in words.
        robot: Name or folder by which the task names it.
        need: What the tank needs at least [J].
    """
    joints = predictor.model.joints
    initial = max(TANK_SHARE * need, 2.0 * TANK_FLOOR)
    lines = [
        "# yaml-language-server: $schema=../schemas/task.schema.json",
        f"# A probe, written by `impedance probe`: {', '.join(proposal.motion.kinds)}.",
        f"# To {purpose}.",
        "format: 1",
        "name: probe",
        f"description: {', '.join(proposal.motion.kinds)}.",
        f"robot: {robot}",
        "arms:",
    ]
    for limb in spec.limbs.values():
        lines += [
            f"  {limb.name}:",
            f"    posture: {_mapping(limb, joints, predictor.start)} # rad",
            "    joint_bias:",
            f"      stiffness: {_mapping(limb, joints, predictor.stiffness)} # N.m/rad",
            f"      damping_ratio: {RATIO:g}",
        ]
    tank = f"{{initial: {initial:.3g}, max: {2.0 * initial:.3g}, floor: {TANK_FLOOR:g}}}"
    lines += [f"safety: {{tank: {tank}}} # J", "phases:", "  - {name: begin, duration: 1}"]
    for number, stroke in enumerate(proposal.motion.strokes, start=1):
        goal = _goals(stroke.goal, spec, joints)
        posture = f", posture: {{{goal}}}" if goal else ""
        lines.append(f"  - {{name: stroke-{number}{posture}, duration: {stroke.duration:.3f}}}")
    return "\n".join(lines) + "\n"


def motion_table(proposal: Proposal, predictor: MotionPredictor) -> str:
    """Writes the predicted motion as a CSV: time [s] and position [rad] of every joint."""
    time, position = predictor.position(proposal.motion)
    head = ",".join(["time", *(f"position.{joint}" for joint in predictor.model.joints)])
    rows = (",".join(f"{value:.6f}" for value in (t, *q)) for t, q in zip(time, position, strict=True))
    return "\n".join([head, *rows]) + "\n"


def posture_table(proposal: Proposal, predictor: MotionPredictor) -> str:
    """Writes the strokes as a CSV: when each begins, how long it takes, and the posture it ends in."""
    joints = predictor.model.joints
    place, began = predictor.start.copy(), 0.0
    rows = [",".join(["begin", "duration", *joints]), _row(0.0, 0.0, place)]
    for stroke in proposal.motion.strokes:
        for joint, angle in stroke.goal.items():
            place[joint] = angle
        rows.append(_row(began, stroke.duration, place))
        began += stroke.duration
    return "\n".join(rows) + "\n"


def probe_object(probe: Probe) -> dict[str, Any]:
    """Builds the JSON object; a distance that was not measured is null."""
    proposal, joints = probe.proposal, probe.predictor.model.joints
    return {
        "format": 1,
        "purpose": probe.request.purpose,
        "robot": probe.predictor.model.robot,
        "motions": list(proposal.motion.kinds),
        "joints": [joints[index] for index in proposal.motion.moved],
        "duration_s": proposal.motion.duration,
        "start": dict(zip(joints, probe.predictor.start.tolist(), strict=True)),
        "nearest_m": proposal.nearest if math.isfinite(proposal.nearest) else None,
        "threshold": {"chi_square": CHI_SQUARE, "share": SHARE},
        "questions": [
            {
                "question": item.question.name,
                "chi_square": item.separation.chi_square,
                "share": item.separation.share,
                "answered": item.met,
                "reason": item.reason or None,
            }
            for item in proposal.expected
        ],
    }


def _row(began: float, duration: float, place: Array) -> str:
    return ",".join(f"{value:.4f}" for value in (began, duration, *place))


def _mapping(limb: LimbSpec, joints: Sequence[str], values: Array) -> str:
    return (
        "{"
        + ", ".join(f"{short}: {values[joints.index(joint)]:.4g}" for short, joint in limb.joints.items())
        + "}"
    )


def _goals(goal: Mapping[int, float], spec: RobotSpec, joints: Sequence[str]) -> str:
    named = {joints[index]: angle for index, angle in goal.items()}
    parts = []
    for limb in spec.limbs.values():
        inside = {short: named[joint] for short, joint in limb.joints.items() if joint in named}
        if inside:
            parts.append(f"{limb.name}: {{{', '.join(f'{k}: {v:.4f}' for k, v in inside.items())}}}")
    return ", ".join(parts)
