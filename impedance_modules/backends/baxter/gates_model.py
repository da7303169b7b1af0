# SPDX-License-Identifier: BSD-3-Clause
"""Whether the robot agrees with our model: its range, where its hands are, what its arms weigh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.backends.baxter.gates_types import Gate
from impedance_modules.backends.baxter.robot_link import RobotLink
from impedance_modules.robot.model import RobotModel

RANGE_MARGIN = 0.01
"""Every joint at least this far inside its range [rad]; a tucked Baxter is outside."""

TIP = 0.025
"""endpoint_state is about the gripper's tip, this far beyond the hand along its z axis [m] (baxter_common)."""

SAME_HAND = 0.005
"""The robot's idea of where its hand is may differ from ours by this much [m]."""

SAME_WEIGHT = 3.0
"""The robot's gravity torque may differ from ours by this much on any joint [N.m]: a gripper that we do not model."""

SAME_EFFORT = 6.0
"""At rest a joint's measured torque may differ from our model's by this much [N.m]."""


def range_gate(link: RobotLink, model: RobotModel, limbs: Sequence[str]) -> Gate:
    """Asks whether the arms are within their ranges."""
    if link.sample is None:
        return Gate("range", False, "no state of the arms", "a robot that has booted")
    q = link.sample.state.position
    low, high = model.column("position_min") + RANGE_MARGIN, model.column("position_max") - RANGE_MARGIN
    joints = np.concatenate([model.limbs[limb].joints for limb in limbs])
    outside = [
        f"{model.joint_names[j]} at {q[j]:.3f} rad (range {low[j]:.3f} to {high[j]:.3f})"
        for j in joints
        if not low[j] <= q[j] <= high[j]
    ]
    if outside:
        remedy = "arms untucked: 'impedance baxter untuck', with power by 'baxter enable --tucked'"
        return Gate("range", False, ", ".join(outside), remedy)
    return Gate("range", True, "all joints inside their ranges", "")


def hand_gate(link: RobotLink, model: RobotModel, limb: str) -> Gate:
    """Asks whether the robot's forward kinematics and ours agree: wrong model, wrong tip, wrong robot."""
    name = f"hand {limb}"
    message = link.endpoint.get(limb)
    if message is None or link.sample is None:
        return Gate(name, None, "the robot does not say where its hand is", "")
    hand = model.pose(link.sample.state.position, model.limbs[limb].hand)
    tip = hand.translation + hand.rotation @ np.array([0.0, 0.0, TIP])
    place = message.pose.position
    off = float(np.linalg.norm(tip - np.array([place.x, place.y, place.z])))
    found = f"{1e3 * off:.1f} mm from where the robot has it"
    return Gate(name, off < SAME_HAND, found, f"below {1e3 * SAME_HAND:g} mm: arms at rest, our model's hand")


def gravity_gate(link: RobotLink, model: RobotModel, limb: str) -> Gate:
    """Asks whether the robot's gravity torque and ours agree; a robot that carries a tool knows, we do not.

    ``gravity_only`` is the weight alone: springs beside the joints that a patch lets the model wear are not in it.
    """
    name = f"weight {limb}"
    message = link.sea.get(limb)
    names = model.limbs[limb].joint_names
    if message is None or link.sample is None or len(message.gravity_only) != len(message.name):
        return Gate(name, None, "the robot does not say what its arm weighs", "")
    said = dict(zip(message.name, message.gravity_only, strict=True))
    if not set(names) <= set(said):
        return Gate(name, None, "the robot does not say what its arm weighs", "")
    q = link.sample.state.position
    ours = (model.gravity(q) - model.winding(q))[model.limbs[limb].joints]
    off = np.abs(ours - np.array([said[joint] for joint in names]))
    worst = int(np.argmax(off))
    found = f"gravity torques differ by at most {off[worst]:.2f} N.m ({names[worst]})"
    remedy = f"below {SAME_WEIGHT:g} N.m: a tool in the model (a patch), or none on the arm"
    return Gate(name, bool(off[worst] < SAME_WEIGHT), found, remedy)


def effort_gate(link: RobotLink, model: RobotModel, limb: str) -> Gate:
    """Asks whether the measured torques at rest are what our model expects; never closed (``contact_gate`` is).

    A Baxter's shoulders have springs beside the drive, which carry part of the arm's weight; our model has
    them only if a patch says so. Without it, a force at the hand is felt where there is none.
    """
    name = f"effort {limb}"
    if link.sample is None:
        return Gate(name, None, "no state of the arms", "")
    joints = model.limbs[limb].joints
    state = link.sample.state
    off = np.abs(state.effort - model.gravity(state.position))[joints]
    worst = int(np.argmax(off))
    found = f"at rest, torques differ from our model's by at most {off[worst]:.1f} N.m"
    if off[worst] <= SAME_EFFORT:
        return Gate(name, True, found, "")
    found += (
        f" ({model.limbs[limb].joint_names[worst]}): a spring beside the joint, a tool, a touch? A task that waits for"
        " contact needs a patch that has it (record, diagnose, run --effects), and is refused without"
    )
    return Gate(name, None, found, "")
