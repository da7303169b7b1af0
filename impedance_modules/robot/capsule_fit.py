# SPDX-License-Identifier: BSD-3-Clause
r"""The capsule around a mesh: few numbers in place of many triangles, and never less room than the mesh needs.

A capsule of radius r about the straight line c + s a, s_0 <= s <= s_1, holds a corner at (s, rho) from the line if

    s - sqrt(r^2 - rho^2) <= s_1      and      s + sqrt(r^2 - rho^2) >= s_0

The line runs along one of the three principal axes of the corners' hull, through the middle of their extent, and r is
the largest rho; of the three capsules the one of the least volume is taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput


@dataclass(frozen=True, eq=False)
class Capsule:
    """A cylinder with a half-sphere on each end.

    Attributes:
        radius: [m].
        length: Of the straight part [m].
        centre: (3,) in the mesh's axes [m].
        axis: (3,) unit vector along the straight part.
    """

    radius: float
    length: float
    centre: Array
    axis: Array

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return math.pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius)


def capsule_of_mesh(path: Path, scale: Array) -> Capsule:
    """Fits a capsule around the mesh in a file.

    Args:
        path: STL, OBJ or Collada.
        scale: (3,) metres per unit along each axis.

    Raises:
        BadInput: It is no mesh that can be read.
    """
    try:
        mesh = coal.MeshLoader().load(str(path), scale)
    except (ValueError, RuntimeError) as error:
        raise BadInput(f"{path}: no mesh that can be read: {error}") from None
    corners = np.array(mesh.vertices()).reshape(-1, 3)
    if len(corners) == 0 or not np.all(np.isfinite(corners)):
        raise BadInput(f"{path}: a mesh without corners, or with corners that are not finite")
    return capsule_of_points(corners)


def capsule_of_points(corners: Array) -> Capsule:
    """Fits a capsule around points (m, 3) [m]."""
    _, _, axes = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=True)
    return min((_along(corners, axes, index) for index in range(3)), key=lambda found: found.volume)


def _along(corners: Array, axes: Array, index: int) -> Capsule:
    """The capsule along one of three axes, the rows of a rotation (3, 3)."""
    seen = corners @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    across = [i for i in range(3) if i != index]
    off = np.linalg.norm(seen[:, across] - middle[across], axis=1)
    radius = float(off.max())
    bulge = np.sqrt(np.maximum(radius**2 - off**2, 0.0))
    upper = float(np.max(seen[:, index] - bulge))
    lower = float(np.min(seen[:, index] + bulge))
    if upper < lower:
        upper = lower = 0.5 * (upper + lower)
    middle[index] = 0.5 * (lower + upper)
    return Capsule(radius, upper - lower, middle @ axes, axes[index].copy())
