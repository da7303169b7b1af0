# SPDX-License-Identifier: BSD-3-Clause
"""Joint springs that pull an arm to a posture, unprojected and part of the declared stiffness (eq. 4.25)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointBias:
    """One torsion spring and damper per joint of a limb.

    The springs are not projected into a null space: they add to the hand's stiffness, and
    ``superposition.stiffness`` says by how much.

    Attributes:
        limb: Arm whose joints feel it.
        joints: (k,) their indices in the model's vectors, from the base outwards.
        stiffness: (k,) [N.m/rad]; 0 leaves a joint free.
        rest: (k,) angles at rest at the start [rad].
        damping: (k,) explicit damping [N.m.s/rad].
        damping_ratio: Zeta of the damping that follows from (K_j, M + I_r); None adds none.
    """

    limb: str
    joints: NDArray[np.intp]
    stiffness: Array
    rest: Array
    damping: Array
    damping_ratio: float | None

    @property
    def name(self) -> str:
        """Name in lists of terms, ``<arm>.joint_bias``."""
        return f"{self.limb}.joint_bias"

    def energy(self, q: Array, rest: Array) -> float:
        """Gives the stored energy 1/2 (q - q_0)^T K_j (q - q_0) [J]; q (n,), rest (k,) [rad]."""
        offset = q[self.joints] - rest
        return 0.5 * float(offset @ (self.stiffness * offset))

    def effort(self, q: Array, rest: Array) -> Array:
        """Gives the torque -K_j (q - q_0) on the limb's joints, (k,) [N.m]; q (n,), rest (k,) [rad]."""
        return -self.stiffness * (q[self.joints] - rest)
