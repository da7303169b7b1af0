# SPDX-License-Identifier: BSD-3-Clause
r"""What a description's links imply, asked before there is a robot folder: weights, and whether an arm has an image.

Two arms are mirror images if signs s_i = +-1, and an offset b of the last joint, exist with

    p(s q + b e_n) = P p(q),      R(s q + b e_n) = P R(q) P      for every q,      P = diag(1, -1, 1)

for the plane xz, with p, R of the hand in the axes of its own base.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from impedance_modules.arrays import Array
from impedance_modules.robot.description import rigid_model

SAMPLES = 200
"""Random postures in which weights are looked at."""

MOST_SIGNS = 10
"""Joints up to which all signs are tried."""

SAME = 1e-6
"""By how much the image of a hand may miss [m], [1]."""

QUARTER_TURNS = (0.0, 0.5 * math.pi, -0.5 * math.pi, math.pi)
"""Offsets that are tried for the last joint [rad]: a hand may be mounted at 45 degrees."""


def largest_weight_torques(urdf: Path, joints: Sequence[str]) -> dict[str, float]:
    """Finds the largest torque that the weight of what a joint carries asks for, over random postures.

    Args:
        urdf: The description.
        joints: Names of joints of one axis.

    Returns:
        Joint -> torque [N.m].
    """
    model = rigid_model(urdf)
    data, random = model.createData(), np.random.default_rng(0)
    largest = np.zeros(model.nv)
    for _ in range(SAMPLES):
        weight = pin.computeGeneralizedGravity(model, data, pin.randomConfiguration(_bounded(model, random)))
        largest = np.maximum(largest, np.abs(weight))
    return {name: float(largest[model.joints[model.getJointId(name)].idx_v]) for name in joints}


def _bounded(model: pin.Model, random: np.random.Generator) -> pin.Model:
    """Seeds pinocchio's own random postures, and bounds joints that have no limits to a turn."""
    pin.seed(int(random.integers(1 << 30)))
    model.lowerPositionLimit = np.maximum(model.lowerPositionLimit, -math.pi)
    model.upperPositionLimit = np.minimum(model.upperPositionLimit, math.pi)
    return model


@dataclass(frozen=True)
class ArmFrame:
    """One arm of a description.

    Attributes:
        hand: Link of its hand.
        joints: From the base outwards.
    """

    hand: str
    joints: Sequence[str]


def mirror_signs(
    urdf: Path, arm: ArmFrame, other: ArmFrame | None = None
) -> tuple[tuple[int, ...], float] | None:
    """Finds the joint signs, and the offset of the last joint, that make an arm the mirror image of one in xz.

    Args:
        urdf: The description.
        arm: The one whose image is sought.
        other: The other arm, in the same axes; None for a copy of the first one in its own.

    Returns:
        Signs from the base outwards, and the offset [rad]; None if there are none, or too many joints to try.
    """
    other = arm if other is None else other
    count = len(arm.joints)
    if count > MOST_SIGNS or len(other.joints) != count:
        return None
    model, random = rigid_model(urdf), np.random.default_rng(1)
    data = model.createData()
    postures = [random.uniform(-1.0, 1.0, count) for _ in range(3)]
    images = [_mirrored(*_hand((model, data), arm, q)) for q in postures]
    for signs in itertools.product((1, -1), repeat=count):
        for offset in QUARTER_TURNS:
            last = np.zeros(count)
            last[-1] = offset
            tried = (_hand((model, data), other, np.array(signs) * q + last) for q in postures)
            if all(_same(found, image) for found, image in zip(tried, images, strict=True)):
                return signs, offset
    return None


def _hand(of: tuple[pin.Model, pin.Data], arm: ArmFrame, q: Array) -> tuple[Array, Array]:
    """Rotation and place of an arm's hand; joints of no arm at 0."""
    model, data = of
    whole = pin.neutral(model)
    for name, angle in zip(arm.joints, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        turns = joint.nq == 2  # a joint without limits: cosine and sine
        whole[joint.idx_q : joint.idx_q + joint.nq] = (math.cos(angle), math.sin(angle)) if turns else angle
    pin.forwardKinematics(model, data, whole)
    frame = model.getFrameId(arm.hand, pin.FrameType.BODY)
    placement = pin.updateFramePlacement(model, data, frame)
    return placement.rotation.copy(), placement.translation.copy()


def _mirrored(R: Array, p: Array) -> tuple[Array, Array]:
    P = np.diag([1.0, -1.0, 1.0])
    return P @ R @ P, P @ p


def _same(found: tuple[Array, Array], wanted: tuple[Array, Array]) -> bool:
    return all(bool(np.max(np.abs(a - b)) < SAME) for a, b in zip(found, wanted, strict=True))
