# SPDX-License-Identifier: BSD-3-Clause
r"""Whether ten inertial parameters belong to a body that could exist.

Mass is spread over space without ever being negative exactly if the pseudo-inertia

    P = [ (tr(I) / 2) 1 - I   h ;   h^T   m ]

has no negative eigenvalue, I about the origin, h = m c (Wensing, Kim and Slotine 2018). That is more than a
positive mass and positive moments of inertia: the moments must also obey the triangle inequality about any axes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TOLERANCE = 1e-6
"""Negative eigenvalue that round-off in a robot description explains, as a part of the largest one."""


def pseudo_inertia(parameters: Array) -> Array:
    r"""Builds P (4, 4) [kg.m^2, kg.m, kg].

    Args:
        parameters: (10,) m, h, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz at one origin.
    """
    m, h = parameters[0], parameters[1:4]
    xx, xy, yy, xz, yz, zz = parameters[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    out = np.empty((4, 4))
    out[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    out[:3, 3] = out[3, :3] = h
    out[3, 3] = m
    return out


def can_exist(nominal: Array, change: Array) -> bool:
    """Says whether a body whose parameters change by (10,) still can exist.

    A description that is itself no body (rounded, or drawn without care) may not become less of one.
    """
    before = np.linalg.eigvalsh(pseudo_inertia(nominal))
    after = np.linalg.eigvalsh(pseudo_inertia(nominal + change))
    return bool(after[0] >= min(0.0, float(before[0])) - TOLERANCE * float(before[-1]))
