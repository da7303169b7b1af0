# SPDX-License-Identifier: BSD-3-Clause
"""The object that the hands of a recording hold, as its task has it, and its inertial parameters at a hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.spec.task import ObjectSpec


@dataclass(frozen=True, eq=False)
class CarriedObject:
    """An object that hands hold rigidly, as the task has it.

    Attributes:
        spec: Of the task.
        hand: Link of the first hand that holds it.
        origin: (3,) of the object in that hand's frame [m].
        rotation: (3, 3) R_HO from the object's axes to the hand's.
        about_centre: (3,) principal moments of inertia about its centre of mass, its own axes [kg.m^2].
        rows: (N,) samples of a recording in which it is held, and touches nothing else.
    """

    spec: ObjectSpec
    hand: str
    origin: Array
    rotation: Array
    about_centre: Array
    rows: NDArray[np.bool_]

    def columns(self, centre: Array) -> Array:
        r"""Computes the map (10, 4) from m and h = m c to the inertial parameters about the hand's origin.

            \Sigma = m (p p^T + S) + p h^T + h p^T + c_0 h^T + h c_0^T - m c_0 c_0^T,   I = tr(\Sigma) 1 - \Sigma

        p is the object's origin, c_0 the present guess of c, about which h h^T / m is linear.

        Args:
            centre: (3,) c_0 in the object's axes [m].
        """
        guess, p = self.rotation @ centre, self.origin
        spread = 0.5 * np.sum(self.about_centre) * np.eye(3) - np.diag(self.about_centre)
        own = self.rotation @ spread @ self.rotation.T / self.spec.mass
        out = np.zeros((10, 4))
        out[0, 0], out[1:4, 0] = 1.0, p
        out[4:, 0] = _six(np.outer(p, p) + own - np.outer(guess, guess))
        for k, h in enumerate(self.rotation.T):
            both = np.outer(p + guess, h)
            out[1:4, 1 + k], out[4:, 1 + k] = h, _six(both + both.T)
        return out

    def nominal(self) -> Array:
        """Ten inertial parameters about the hand's origin, as the task has them."""
        centre = np.array(self.spec.centre)
        return self.columns(centre) @ (self.spec.mass * np.array([1.0, *centre]))


def _six(second: Array) -> Array:
    r"""Turns second moments \Sigma (3, 3) into the inertia xx, xy, yy, xz, yz, zz [kg.m^2]."""
    whole = np.trace(second) * np.eye(3) - second
    return np.array([whole[0, 0], whole[0, 1], whole[1, 1], whole[0, 2], whole[1, 2], whole[2, 2]])
