# SPDX-License-Identifier: BSD-3-Clause
"""The mirror image of an arm: posture by joint signs, stiffness and forces by diag(P, -P).

A reflection P of space (P = diag(1, -1, 1) for the plane xz) takes a twist (v, w) to (P v, -P w): w is a
pseudo-vector. With D = diag(P, -P), a stiffness becomes D K D and a wrench D w. The same D holds in the axes
of a hand, because the image of a frame with axes R has the axes P R P.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.spec.robot_spec import LimbSpec, MirrorSpec
from impedance_modules.spec.task import AXES, HybridAxis, Matrix, SpringSpec
from impedance_modules.spec.urdf import UrdfFacts

WORLD = "world"


def twist_signs(plane: str) -> NDArray[np.float64]:
    """Diagonal (6,) of D for the planes ``xy``, ``xz`` and ``yz``, linear then angular."""
    reflected = np.array([1.0 if axis in plane else -1.0 for axis in "xyz"])
    return np.concatenate([reflected, -reflected])


def mirrored_posture(posture: Mapping[str, float], mirror: MirrorSpec) -> Mapping[str, float]:
    """Joint angles [rad] of the mirror image; joints without a sign are left out."""
    signs = mirror.joint_sign
    return {joint: signs[joint] * angle + 0.0 for joint, angle in posture.items() if joint in signs}


def mirrored_frames(source: LimbSpec, image: LimbSpec, urdf: UrdfFacts) -> Mapping[str, str]:
    """Which frame of one limb is the image of which frame of the other.

    The hands, the links that joints of the same short name move, and the world.
    """
    frames = {WORLD: WORLD, source.hand: image.hand}
    for short, joint in source.joints.items():
        if short in image.joints and joint in urdf.joints and image.joints[short] in urdf.joints:
            frames[urdf.joints[joint].child] = urdf.joints[image.joints[short]].child
    return frames


def mirrored_spring(spring: SpringSpec, frames: Mapping[str, str], plane: str) -> SpringSpec:
    """The image of a spring; its ``frame`` and ``expressed_in`` must be keys of ``frames``."""
    signs = twist_signs(plane)
    return replace(
        spring,
        frame=frames[spring.frame],
        expressed_in=frames[spring.expressed_in],
        stiffness=_mirrored_matrix(spring.stiffness, signs),
        damping=None if spring.damping is None else _mirrored_matrix(spring.damping, signs),
        axes={axis: _mirrored_axis(axis, given, signs) for axis, given in spring.axes.items()},
    )


def _mirrored_axis(axis: str, given: HybridAxis, signs: NDArray[np.float64]) -> HybridAxis:
    return replace(given, force=float(signs[AXES.index(axis)]) * given.force + 0.0)


def _mirrored_matrix(matrix: Matrix, signs: NDArray[np.float64]) -> Matrix:
    image: Matrix = signs[:, None] * matrix * signs[None, :] + 0.0  # + 0.0 turns -0.0 into 0.0
    image.setflags(write=False)
    return image
