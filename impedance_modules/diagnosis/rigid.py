# SPDX-License-Identifier: BSD-3-Clause
"""The effects' rigid model, computed for all samples at once: the same numbers, many times sooner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.rigid_dynamics import inertial_regressor, inverse_dynamics
from impedance_modules.diagnosis.data.rigid_tree import RigidTree
from impedance_modules.effects.rigid_model import RigidModel

Array = NDArray[np.float64]


class BatchedRigidModel(RigidModel):
    """A `RigidModel` whose inverse dynamics and body columns come from `dynamics`.

    Attributes:
        tree: The rigid bodies.
    """

    tree: RigidTree
    _kept: tuple[Array, Array] | None = None
    _keeping: bool = False

    @classmethod
    def of_tree(cls, urdf: Path, tree: RigidTree) -> BatchedRigidModel:
        """Takes a URDF and its tree of recorded joints."""
        model = cls.from_urdf(urdf, tree.joints)
        if not isinstance(model, BatchedRigidModel):
            raise TypeError("RigidModel.from_urdf builds the class it is called on")
        model.tree = tree
        return model

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Computes ID(q, v, a), (N, n) [N.m]."""
        return inverse_dynamics(self.tree, q, v, a)

    def weight(self, q: Array) -> Array:
        """Computes g(q), (N, n) [N.m]."""
        still = np.zeros_like(q)
        return inverse_dynamics(self.tree, q, still, still)

    def body_columns(self, body: str, q: Array, v: Array, a: Array) -> Array:
        r"""Computes d ID / d\pi of a link, (N, n, 10)."""
        links = [item.link for item in self.tree.bodies]
        if body not in links:
            return super().body_columns(body, q, v, a)
        first = 10 * links.index(body)
        return self._whole(q, v, a)[:, :, first : first + 10]

    def body_inertia(self, body: str) -> Array:
        """Ten nominal inertial parameters of what moves with a link."""
        links = [item.link for item in self.tree.bodies]
        return self.tree.bodies[links.index(body)].inertia if body in links else super().body_inertia(body)

    def link_inertia(self, link: str) -> Array:
        """Ten nominal inertial parameters of a link itself, without what is fixed to it."""
        links = [item.link for item in self.tree.bodies]
        return self.tree.bodies[links.index(link)].own if link in links else super().link_inertia(link)

    def keep(self) -> None:
        """Remembers the regressor (N, n, 10 n) of the motion that is asked for last, until told to forget."""
        self._keeping = True

    def forget(self) -> None:
        """Gives the remembered regressor's memory back."""
        self._kept, self._keeping = None, False

    def _whole(self, q: Array, v: Array, a: Array) -> Array:
        if self._kept is not None and self._kept[0] is q:
            return self._kept[1]
        whole = inertial_regressor(self.tree, q, v, a)
        if self._keeping:
            self._kept = (q, whole)
        return whole
