# SPDX-License-Identifier: BSD-3-Clause
"""All steps of a probe in order: what is open, where to begin, which motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.experiment_design.probe_choice import Chooser, Proposal
from impedance_modules.diagnosis.experiment_design.clearance import Clearance
from impedance_modules.diagnosis.experiment_design.follow import Follower, spring_stiffness
from impedance_modules.diagnosis.experiment_design.probe_questions import Brief, brief_of, general_brief
from impedance_modules.diagnosis.experiment_design.motion_limits import EFFORT_SHARE, Room, room_of_model, room_of_robot
from impedance_modules.diagnosis.experiment_design.start import choose_start
from impedance_modules.diagnosis.rigid import BatchedRigidModel
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.spec.robot_spec import RobotSpec

NOISE_SHARE = 0.002
"""Noise that is assumed without a diagnosis, over a joint's torque limit."""

GAP_SHARE = 2.0
"""Times the gap's rms that may resist a probe all its way."""

NOISE_UNSTATED = 0.05
"""The same where no limit is stated [N.m]."""


@dataclass(frozen=True, eq=False)
class Probe:
    """What `impedance probe` writes down."""

    brief: Brief
    follower: Follower
    proposal: Proposal


def propose_probe(
    answer: Mapping[str, Any] | None,
    model: NominalModel,
    urdf: Path,
    spec: RobotSpec | None,
    progress: Callable[[str], None] = lambda _: None,
) -> Probe:
    """Finds the next motion to record.

    Args:
        answer: A diagnosis JSON, or None.
        model: Of all joints that may move.
        urdf: Its links.
        spec: The robot's folder; None for a bare URDF, whose links are not measured for collisions.
        progress: Called with a sentence for each step.

    Raises:
        BadInput: The diagnosis and the model do not fit, or no motion is safe.
    """
    room = room_of_model(model) if spec is None else room_of_robot(spec, model.joints)
    brief = general_brief(model.joints, _assumed(room)) if answer is None else brief_of(answer, model.tree)
    clearance = None if spec is None else Clearance(spec, model.joints)
    rigid = BatchedRigidModel.of_tree(urdf, model.tree)
    start = choose_start(room, brief.start, clearance, rigid.weight)
    sensor = "motor" if {"motor", "whole", "drive"} & set(brief.residuals) else "joint_sensor"
    follower = Follower(model, rigid, start, spring_stiffness(model, start), sensor)
    return Probe(brief, follower, Chooser(brief, follower, room, clearance, progress).choose())


def resisting_work(probe: Probe) -> float:
    r"""Work [J] that the gap itself may take out of the energy tank, friction at worst: \sum 2 gap_j \int |dq_j|."""
    _, position = probe.follower.position(probe.proposal.motion)
    way = np.sum(np.abs(np.diff(position, axis=0)), axis=0)
    joints = probe.follower.model.joints
    return float(sum(GAP_SHARE * gap * way[joints.index(joint)] for joint, gap in probe.brief.gap.items()))


def _assumed(room: Room) -> dict[tuple[Residual, str], float]:
    """Noise of torques compared at both ports, a little of each joint's limit."""
    out: dict[tuple[Residual, str], float] = {}
    for joint, effort in zip(room.joints, room.effort / EFFORT_SHARE, strict=True):
        size = NOISE_SHARE * float(effort) if np.isfinite(effort) else NOISE_UNSTATED
        out["actuator", joint] = out["link", joint] = size
    return out
