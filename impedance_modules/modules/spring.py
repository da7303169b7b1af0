# SPDX-License-Identifier: BSD-3-Clause
r"""A virtual spring between a frame of an arm and its moving equilibrium: a potential and its gradient.

Notation: F the spring's frame at X_WF = (R, p), D its equilibrium at (R_d, p_d), A the spring's axes,
frozen in world at the start posture. The stretch of the spring, in its own axes, is

    e = [A^T (p - p_d);  A^T \phi],     \phi = log(R R_d^T)   (rotation vector, world axes)

and everything else follows from the stored energy U = 1/2 e^T K e.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.pose import Pose, rotate_six
from impedance_modules.robot.rotation import log3, log_jacobian
from impedance_modules.spec.task import AXES, HybridAxis, SpringSpec

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spring:
    """A six-dimensional spring with its dampers and its constant hybrid-axis forces.

    Attributes:
        spec: What the task file says of it now.
        limb: Arm whose joints feel it.
        reference: X_WE of ``expressed_in`` at the start posture, frozen; its rotation A turns the
            spring's axes into the world's, its origin is where absolute coordinates count from.
        start: X_WF at the start posture, the first equilibrium.
    """

    spec: SpringSpec
    limb: str
    reference: Pose
    start: Pose

    @property
    def name(self) -> str:
        """Name that targets use, ``<arm>.<spring>``."""
        return f"{self.limb}.{self.spec.name}"

    @property
    def frame(self) -> str:
        """Frame of the robot that feels the spring."""
        return self.spec.frame

    @property
    def axes(self) -> Array:
        """(3, 3) A, from the spring's axes to the world's."""
        return self.reference.rotation

    @property
    def stiffness(self) -> Array:
        """(6, 6) K in the spring's axes [N/m, N, N.m/rad]."""
        return self.spec.stiffness

    @property
    def damping_ratio(self) -> float | None:
        """Zeta of the damping that follows from the inertia; None adds none."""
        return self.spec.damping_ratio

    @cached_property
    def force(self) -> Array:
        """(6,) what the hand exerts along each hybrid axis, in the spring's axes [N, N.m]."""
        return np.array([self.spec.axes[axis].force if axis in self.spec.axes else 0.0 for axis in AXES])

    @property
    def hybrid(self) -> bool:
        """Whether any axis carries a constant force."""
        return bool(np.any(self.force))

    @property
    def damping(self) -> Array:
        """(6, 6) explicit damping in the spring's axes [N.s/m, N.m.s/rad].

        The declared matrix plus |force| / speed_limit on each hybrid axis: an axis that loses contact
        then runs no faster than its speed limit.
        """
        declared = np.zeros((6, 6)) if self.spec.damping is None else self.spec.damping
        return declared + np.diag([_speed_limiting(self.spec.axes.get(axis)) for axis in AXES])

    @cached_property
    def world_stiffness(self) -> Array:
        """(6, 6) K in world axes."""
        return self.in_world(self.stiffness)

    def in_world(self, matrix: Array) -> Array:
        """Turns a (6, 6) matrix from the spring's axes into world axes."""
        turn = rotate_six(self.axes)
        return turn @ matrix @ turn.T

    def stretch(self, pose: Pose, target: Pose) -> Array:
        """Measures how far the frame is from its equilibrium, e (6,) in the spring's axes [m, rad]."""
        return rotate_six(self.axes).T @ displacement(pose, target)

    def energy(self, pose: Pose, target: Pose) -> float:
        """Gives the energy stored in the spring, U = 1/2 e^T K e [J]; hybrid forces store none."""
        stretch = self.stretch(pose, target)
        return 0.5 * float(stretch @ self.stiffness @ stretch)

    def wrench(self, pose: Pose, target: Pose) -> Array:
        r"""Pulls the frame towards its equilibrium with exactly minus the gradient of the energy.

        w = -[g_v; L^T g_w],   g = A K e,   L = d\phi / d\delta (inverse left Jacobian of the log),

        so that dU = -w . (dp, \delta) for every small motion. L turns the gradient by the rotation
        vector into a moment; it matters as soon as the rotational stiffness is anisotropic or coupled
        to translation. Continuous up to the cut at half a turn, where \phi changes sign.

        Returns:
            (6,) wrench on the frame, world axes, at its origin [N, N.m].
        """
        offset = displacement(pose, target)
        gradient = self.world_stiffness @ offset
        moment = log_jacobian(offset[3:]).T @ gradient[3:]
        return -np.concatenate([gradient[:3], moment])

    def axis_force(self) -> Array:
        """Gives the constant wrench of the hybrid axes, (6,) in world axes [N, N.m] (thesis eq. 4.35)."""
        return rotate_six(self.axes) @ self.force

    def with_gains(self, axes: Mapping[str, HybridAxis], stiffness: Array | None) -> Spring:
        """Returns the spring with some hybrid axes replaced, and its stiffness where one is given."""
        kept = self.spec.stiffness if stiffness is None else stiffness
        return replace(self, spec=replace(self.spec, axes={**self.spec.axes, **axes}, stiffness=kept))


def displacement(pose: Pose, target: Pose) -> Array:
    """Gives where ``pose`` is, seen from ``target``: (p - p_d, log(R R_d^T)), (6,) in world axes."""
    return np.concatenate([pose.translation - target.translation, log3(pose.rotation @ target.rotation.T)])


def _speed_limiting(axis: HybridAxis | None) -> float:
    if axis is None or axis.speed_limit is None:
        return 0.0
    return abs(axis.force) / axis.speed_limit
