# SPDX-License-Identifier: BSD-3-Clause
r"""Apparent mass of the thesis's planar arm (3.3), with and without reflected inertia."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel

Array = NDArray[np.float64]

RELATIVE = (3 * math.pi / 4, 3 * math.pi / 4, math.pi / 2)
"""The stated angles, taken as angles of the joints [rad]."""
ABSOLUTE = (3 * math.pi / 4, 0.0, -math.pi / 4)
"""The stated angles, taken as angles of the links against the ground [rad], as the caption says."""


@dataclass(frozen=True)
class Masses:
    """Apparent masses at one posture.

    Attributes:
        angles: (3,) of the joints that move, from the shoulder outwards [rad].
        inverse: Name (with, without) -> (2, 2) inverse of the translational apparent inertia in the plane [1/kg].
    """

    angles: tuple[float, float, float]
    inverse: dict[str, Array]

    def extremes(self, robot: str) -> tuple[float, float]:
        """Largest and smallest apparent mass [kg]: the eigenvalues of Lambda."""
        values = np.linalg.eigvalsh(self.inverse[robot])
        return float(1.0 / values[0]), float(1.0 / values[1])


def planar_masses(
    model: RobotModel, limb: str, joints: Sequence[str], angles: tuple[float, float, float]
) -> Masses:
    r"""Computes the planar apparent inertia.

    \Lambda^-1 = J (M + I_r)^-1 J^T, J (2, 3) in the plane, once with I_r and once with zero (thesis 3.15).

    Args:
        model: The robot.
        limb: Name of the arm.
        joints: Short names of the three that may move, from the shoulder outwards; the others stand at zero,
            so that all motion stays in one upright plane.
        angles: Of these [rad].
    """
    arm = model.limbs[limb]
    moving = [arm.joints[arm.short_names.index(name)] for name in joints]
    q = np.zeros(model.n)
    q[moving] = angles
    kinematics = Kinematics(model, (arm.hand,))
    kinematics.update(q, np.zeros(model.n))
    jacobian = kinematics.jacobian_of(arm.hand)[:, moving]
    outwards = np.cross(jacobian[3:, 0], [0.0, 0.0, 1.0])
    plane = np.vstack([outwards / np.linalg.norm(outwards), [0.0, 0.0, 1.0]]) @ jacobian[:3]
    whole = model.mass_matrix(q)[np.ix_(moving, moving)]
    links = whole - np.diag(model.reflected_inertia[moving])
    inverse = {
        "with": plane @ np.linalg.solve(whole, plane.T),
        "without": plane @ np.linalg.solve(links, plane.T),
    }
    return Masses(angles, inverse)
