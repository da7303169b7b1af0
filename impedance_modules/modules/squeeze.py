# SPDX-License-Identifier: BSD-3-Clause
"""Squeeze: a constant internal force that holds the object between the hands and does not move it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.rotation import skew

Array = NDArray[np.float64]


def squeeze_forces(offsets: Array, force: float) -> Array:
    """Presses every hand towards the object's origin so that nothing is left over at the object.

    The presses that point straight at the origin are projected on the internal forces, those with
    sum f_i = 0 and sum r_i x f_i = 0, and scaled so that the hands press with ``force`` on average.
    Two hands press along the line between them, each with exactly ``force``. The directions follow the
    hands, so the squeeze turns with the object and its wrench on it stays zero.

    Args:
        offsets: (h, 3) r_i from the object's origin to each hand [m], h >= 2, world axes.
        force: Mean magnitude [N], not negative.

    Returns:
        (h, 3) force of each hand on the object [N], world axes. All zero where the geometry allows no
        internal press, e.g. two hands at one point.
    """
    distances = np.linalg.norm(offsets, axis=1, keepdims=True)
    towards = -offsets / np.where(distances > 0.0, distances, 1.0)
    balance = np.hstack([np.vstack([np.eye(3), skew(offset)]) for offset in offsets])
    pressed = towards.reshape(-1)
    internal = (pressed - np.linalg.pinv(balance, rcond=1e-10) @ (balance @ pressed)).reshape(-1, 3)
    mean = float(np.mean(np.linalg.norm(internal, axis=1)))
    if mean < 1e-9:
        return np.zeros_like(offsets)
    return internal * (force / mean)
