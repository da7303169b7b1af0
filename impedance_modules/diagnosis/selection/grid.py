# SPDX-License-Identifier: BSD-3-Clause
r"""Noise of an encoder's grid that repeats do not show, because it repeats with the motion.

Two runs that agree to less than a count are rounded alike: their difference does not hold the rounding, the
residual does. A grid of step g, crossed often, is white noise of variance g^2 / 12 per sample; differentiated twice
it moves the links. What the grid alone would make of the accelerations, less what the repeats show of it, is added
to the repeats' difference:

    \delta r_link = -M(q) \delta a,      \delta r_actuator = -I_r \delta a,      \delta r_velocity = -\delta v
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.dynamics import mass_matrix
from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.diagnosis.selection.candidates import Group
from impedance_modules.effects.residuals import COVERS, uses_motion
from impedance_modules.effects.signals import differentiate

Array = NDArray[np.float64]

LACKING = 0.5
"""Repeats that show less than this part of a grid's noise are taken to have repeated its rounding."""


@dataclass(frozen=True, eq=False)
class Rounding:
    """Rounding that the repeats do not show, made up for one recording.

    Attributes:
        acceleration: (M, n) in the band [rad/s^2].
        velocity: (M, n) in the band [rad/s].
        torque: (M, n) what the links would need for that acceleration [N.m].
        rotor: (M, n) what the rotors would [N.m].
    """

    acceleration: Array
    velocity: Array
    torque: Array
    rotor: Array

    @property
    def power(self) -> Array:
        """(n,) of the accelerations' noise [rad^2/s^4]."""
        return np.asarray(np.mean(self.acceleration**2, axis=0))

    def of(self, group: Group) -> Array:
        """(M,) what it adds to a residual."""
        residual, joint = group
        if residual == "velocity":
            return np.asarray(-self.velocity[:, joint])
        drive = self.rotor[:, joint] if "actuator" in COVERS[residual] else 0.0
        links = self.torque[:, joint] if uses_motion(residual) else 0.0
        return np.asarray(-(links + drive) * np.ones(len(self.velocity)))


def unseen_rounding(item: Prepared, seen: Array, seed: int) -> Rounding | None:
    """Makes up the rounding that repeats lack; None where they show as much as there is.

    Args:
        item: One of the repeats.
        seen: (n,) power of the accelerations' noise that the repeats show [rad^2/s^4].
        seed: Of the made-up noise.
    """
    log = item.log
    if log.grid is None or not log.grid.any():
        return None
    size = log.grid * np.sqrt(log.rate / 12.0)
    noise = size * np.random.default_rng(seed).standard_normal(log.position.shape)
    v = differentiate(item.band.smooth(noise), np.arange(log.samples) / log.rate)
    a = differentiate(v, np.arange(log.samples) / log.rate)
    speed, acceleration = item.band.condense(v), item.band.condense(a)
    whole = np.mean(acceleration**2, axis=0)
    lacking = np.where(seen < LACKING * whole, 1.0 - seen / np.maximum(whole, 1e-300), 0.0)
    if not lacking.any():
        return None
    speed, acceleration = speed * np.sqrt(lacking), acceleration * np.sqrt(lacking)
    inertia = mass_matrix(item.tree, item.position)
    torque = np.einsum("mij,mj->mi", inertia, acceleration)
    return Rounding(acceleration, speed, torque, item.signals.reflected_inertia * acceleration)
