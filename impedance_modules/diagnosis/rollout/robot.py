# SPDX-License-Identifier: BSD-3-Clause
"""The diagnosis's model as a robot that the plant can be: recorded joints only, no hands, no stops."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.spec.robot_spec import (
    CollisionSpec,
    ContactDetectionSpec,
    JointSpec,
    RobotSpec,
    SensorSpec,
    TimingSpec,
)
from impedance_modules.spec.urdf import read_urdf

FAR = 1e6
"""Stands for a limit that no rollout reaches: a window starts where the robot really was."""

RATE = 1000.0
"""Of the robot's own loop [Hz]; the rollouts need no other."""


@contextmanager
def turning_freely(urdf: Path) -> Iterator[Path]:
    """Gives a URDF in which every joint is one number: an endless joint becomes one with limits far away."""
    tree = ET.parse(urdf)
    endless = [joint for joint in tree.getroot().findall("joint") if joint.attrib.get("type") == "continuous"]
    if not endless:
        yield urdf
        return
    for joint in endless:
        joint.attrib["type"] = "revolute"
        for limit in joint.findall("limit"):
            joint.remove(limit)
        ET.SubElement(joint, "limit", lower=str(-FAR), upper=str(FAR), velocity=str(FAR), effort=str(FAR))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / urdf.name
        tree.write(copy)
        yield copy


def robot_of_model(model: NominalModel, urdf: Path, drive: str, gravity_compensation: str) -> RobotSpec:
    """Builds the robot whose plant one kind of recorded torque drives.

    Args:
        model: What the diagnosis believes.
        urdf: Its links, from ``turning_freely``.
        drive: ``command``: the whole joint; ``motor``: rotor and link, stiffly coupled; ``effort``: the link alone.
        gravity_compensation: Of the recording; only a command leaves it to the robot.
    """
    moving = [name for name, joint in read_urdf(urdf).joints.items() if joint.moves]
    return RobotSpec(
        name=model.robot,
        urdf=urdf,
        limbs={},
        joints={name: _joint(model, index, drive) for index, name in enumerate(model.joints)},
        locked={name: 0.0 for name in moving if name not in model.joints},
        mirror=None,
        timing=TimingSpec(RATE, 1.0, RATE, model.command_delay if drive == "command" else 0.0, 1.0),
        sensors=SensorSpec(0.0, 0.0, 0.0, 0.0, 0.0),
        contact_detection=ContactDetectionSpec(FAR, 1.0),
        collision=CollisionSpec((), 0.0),
        gravity_compensation=gravity_compensation if drive == "command" else "none",
        control_modes=("torque",),
        solver="daqp",
        folder=urdf.parent,
    )


def _joint(model: NominalModel, index: int, drive: str) -> JointSpec:
    compliance, limit = float(model.compliance[index]), float(model.effort_max[index])
    whole = JointSpec(
        name=model.joints[index],
        position_min=-FAR,
        position_max=FAR,
        velocity_max=FAR,
        effort_max=limit if np.isfinite(limit) else FAR,
        effort_rate_max=FAR,
        spring_stiffness=1.0 / compliance if compliance > 0.0 else None,
        reflected_inertia=float(model.reflected_inertia[index]),
        motor_damping=float(model.motor_damping[index]),
        spring_damping=float(model.spring_damping[index]),
    )
    if drive == "command":
        return whole
    stiff = replace(whole, spring_stiffness=None)
    return stiff if drive == "motor" else replace(stiff, reflected_inertia=0.0, motor_damping=0.0)
