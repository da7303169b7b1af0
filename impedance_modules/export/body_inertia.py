# SPDX-License-Identifier: BSD-3-Clause
r"""A body's ten inertial parameters between what files write and what adds up.

Files write mass m, centre of mass c, and the inertia I_c about it, in the body's axes or in turned ones. What adds is
(m, h, I_o): first moments h = m c, and the inertia about the body's origin I_o = I_c + m (c^T c 1 - c c^T). A body is
physical if its pseudo-inertia [[tr(I_o)/2 1 - I_o, h], [h^T, m]] is positive semidefinite (Wensing, Kim & Slotine
2018); a thin disc's has an eigenvalue of zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array

GIMBAL_LOCK = 1e-9
"""Cosine of the pitch below which roll and yaw turn about one axis."""

ROUNDING = 1e-9
"""Negative eigenvalue over the largest one that decimal numbers in a file can make."""


@dataclass(frozen=True)
class BodyInertia:
    """Inertia of a body.

    Attributes:
        mass: [kg].
        centre: (3,) centre of mass [m].
        about_centre: (3, 3) inertia about it in the body's axes [kg.m^2].
    """

    mass: float
    centre: Array
    about_centre: Array

    def with_change(self, change: Sequence[float]) -> BodyInertia | None:
        """Adds ten parameters (m, h, I_o as xx, xy, yy, xz, yz, zz); None if what results is no physical body."""
        mass = self.mass + change[0]
        moments = self.mass * self.centre + np.array(change[1:4])
        xx, xy, yy, xz, yz, zz = change[4:]
        about_origin = self.about_centre + steiner(self.mass, self.centre)
        about_origin = about_origin + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        pseudo = np.empty((4, 4))
        pseudo[:3, :3] = 0.5 * np.trace(about_origin) * np.eye(3) - about_origin
        pseudo[3, :3] = pseudo[:3, 3] = moments
        pseudo[3, 3] = mass
        smallest, *_, largest = np.linalg.eigvalsh(pseudo)
        if mass <= 0.0 or smallest < -ROUNDING * largest:
            return None
        centre = moments / mass
        return BodyInertia(mass, centre, about_origin - steiner(mass, centre))


def steiner(mass: float, centre: Array) -> Array:
    """Computes m (c^T c 1 - c c^T), a point mass's inertia about the origin (3, 3)."""
    return np.asarray(mass * (float(centre @ centre) * np.eye(3) - np.outer(centre, centre)))


def rotation_of_rpy(angles: Sequence[float]) -> Array:
    """Computes R = R_z(yaw) R_y(pitch) R_x(roll), as a URDF means it."""
    roll, pitch, yaw = angles
    return about("z", yaw) @ about("y", pitch) @ about("x", roll)


def about(axis: str, angle: float) -> Array:
    """Computes the rotation (3, 3) about a coordinate axis."""
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = math.cos(angle)
    out[j, i] = math.sin(angle)
    out[i, j] = -out[j, i]
    return out


def rpy_of_rotation(R: Array) -> tuple[float, float, float]:
    """The inverse of ``rotation_of_rpy``; at a pitch of 90 degrees the roll is 0."""
    across = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], across)
    if across < GIMBAL_LOCK:
        return 0.0, pitch, math.atan2(-R[0, 1], R[1, 1])
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])
