# SPDX-License-Identifier: BSD-3-Clause
r"""A virtual spring between a frame of an arm and its moving equilibrium: a potential and its gradient.

Notation: F the spring's frame at X_WF = (R, p), D its equilibrium at (R_d, p_d), A the spring's axes,
frozen in world at the start posture. The stretch of the spring, in its own axes, is

    e = [A^T (p - p_d);  A^T \phi],     \phi = log(R R_d^T)   (rotation vector, world axes)

and everything else follows from the stored energy U = 1/2 e^T K e. With dampers D on the twist V and the constant
forces F of the hybrid axes, the spring puts on its frame, in world axes, and asks of the joints

    w = -dU/dx + F - D (V - V_d),     \tau = J^T w                               (thesis eq. 4.8, 4.35)

with V_d = 0 for dampers against the world, as in the thesis, or the equilibrium's twist (``modules.target_motion``).

The laws below are what runs in every cycle, over all springs of a task; ``Spring`` says what a task file declares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, Indices, Matrix, Record
from impedance_modules.robot.kinematics import ArmGeometry
from impedance_modules.robot.pose import Pose, rotate_six
from impedance_modules.robot.rotation import log_curvature, logarithm
from impedance_modules.spec.task import AXES, HybridAxis, SpringSpec


class Springs(Record):
    """All springs of a task as they are in force now, and what they ask for; world axes.

    Attributes:
        stiffness: (springs, 6, 6) K [N/m, N, N.m/rad].
        damping: (springs, 6, 6) D [N.s/m, N.m.s/rad].
        force: (springs, 6) F of the hybrid axes [N, N.m].
        frame: (springs,) place of each spring's frame among the cycle's frames.
        target_rotation: (springs, 3, 3) R_d.
        target_translation: (springs, 3) p_d [m].
        target_twist: (springs, 6) V_d [m/s, rad/s].
        wrench: (springs, 6) what each puts on its frame, at the frame's origin [N, N.m].
        effort: (springs, n) what each asks of the joints [N.m].
    """

    stiffness: Array3
    damping: Array3
    force: Matrix
    frame: Indices
    target_rotation: Array3
    target_translation: Matrix
    target_twist: Matrix
    wrench: Matrix
    effort: Matrix


@compiled
def displacement(
    rotation: Array, translation: Array, target_rotation: Array, target_translation: Array, error: Array
) -> None:
    r"""Writes where a frame is, seen from its equilibrium, (6,) in world axes [m, rad].

    e = [p - p_d; \phi],     \phi = log(R R_d^T)
    """
    product = np.empty((3, 3))
    for i in range(3):
        error[i] = translation[i] - target_translation[i]
        for j in range(3):
            product[i, j] = 0.0
            for k in range(3):
                product[i, j] += rotation[i, k] * target_rotation[j, k]
    logarithm(product, error[3:])


@compiled
def add_energy(stiffness: Array, error: Array, total: float) -> float:
    """Returns ``total`` plus the energy stored in a spring, U = 1/2 e^T K e [J]; hybrid forces store none."""
    for i in range(6):
        for j in range(6):
            total += 0.5 * error[i] * stiffness[i, j] * error[j]
    return total


@compiled
def turn_moment(error: Array, gradient: Array) -> None:
    r"""Replaces the gradient by the rotation vector \phi with the one by a small world rotation, a moment [N.m].

    m -> L^T m, L = I - [\phi]/2 + c [\phi]^2 the Jacobian of the logarithm (``robot.rotation.log_jacobian``), so
    L^T m = m + \phi x m / 2 + c \phi x (\phi x m). It matters as soon as the rotational stiffness is
    anisotropic or coupled to translation. Continuous up to the cut at half a turn, where \phi changes sign.
    """
    a, b, c = error[3], error[4], error[5]
    second = log_curvature(a * a + b * b + c * c)
    x, y, z = gradient[3], gradient[4], gradient[5]
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    gradient[3] = x + 0.5 * u + second * (b * w - c * v)
    gradient[4] = y + 0.5 * v + second * (c * u - a * w)
    gradient[5] = z + 0.5 * w + second * (a * v - b * u)


@compiled
def spring_energies(springs: Springs, arms: ArmGeometry) -> float:
    """Sums the energy of all springs, undiminished by the tank [J]."""
    total = 0.0
    error = np.empty(6)
    for s in range(springs.frame.size):
        f = springs.frame[s]
        displacement(
            arms.rotation[f],
            arms.translation[f],
            springs.target_rotation[s],
            springs.target_translation[s],
            error,
        )
        total = add_energy(springs.stiffness[s], error, total)
    return total


@compiled
def spring_efforts(springs: Springs, arms: ArmGeometry, velocity: Array, scale: float) -> float:
    r"""Writes the wrench and the torque of every spring; returns their energy [J].

    w = -s [g_v; L^T g_w] + F - D (J v - V_d),   g = K e,     \tau = J^T w

    so that dU = -w . (dp, \delta) for every small motion, \delta a small world rotation (``turn_moment``).

    Args:
        springs: In force; ``wrench`` and ``effort`` are overwritten (the latter where a joint moves the frame).
        arms: At the state.
        velocity: (n,) that dampers act on [rad/s].
        scale: s in [0, 1]: relaxes the potential, not dampers or axis forces.
    """
    total = 0.0
    error, gradient, twist = np.empty(6), np.empty(6), np.empty(6)
    for s in range(springs.frame.size):
        f = springs.frame[s]
        first, last = arms.moved_by[0, f], arms.moved_by[1, f]
        jacobian, wrench, effort = arms.jacobian[f], springs.wrench[s], springs.effort[s]
        displacement(
            arms.rotation[f],
            arms.translation[f],
            springs.target_rotation[s],
            springs.target_translation[s],
            error,
        )
        for i in range(6):
            twist[i] = 0.0 - springs.target_twist[s, i]
            for j in range(first, last):
                twist[i] += jacobian[i, j] * velocity[j]
        for i in range(6):
            gradient[i] = 0.0
            for j in range(6):
                gradient[i] += scale * springs.stiffness[s, i, j] * error[j]
            total += 0.5 * error[i] * gradient[i]
        turn_moment(error, gradient)
        for i in range(6):
            wrench[i] = springs.force[s, i] - gradient[i]
            for j in range(6):
                wrench[i] -= springs.damping[s, i, j] * twist[j]
        effort[first:last] = 0.0
        for i in range(6):
            for j in range(first, last):
                effort[j] += jacobian[i, j] * wrench[i]
    return total


@dataclass(frozen=True)
class Spring:
    """A six-dimensional spring with its dampers and its constant hybrid-axis forces.

    Attributes:
        spec: What the task file says of it now.
        limb: Arm on whose joints it acts.
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
        """Frame of the robot on which the spring acts."""
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

    def wrench(self, pose: Pose, target: Pose) -> Array:
        """Pulls the frame towards its equilibrium with minus the gradient of the energy.

        Returns:
            (6,) wrench on the frame, world axes, at its origin [N, N.m]; see ``spring_efforts``.
        """
        offset = displacement_of(pose, target)
        gradient = self.world_stiffness @ offset
        turn_moment(offset, gradient)
        return -gradient

    def axis_force(self) -> Array:
        """Gives the constant wrench of the hybrid axes, (6,) in world axes [N, N.m] (thesis eq. 4.35)."""
        return rotate_six(self.axes) @ self.force

    def with_gains(self, axes: Mapping[str, HybridAxis], stiffness: Array | None) -> Spring:
        """Returns the spring with some hybrid axes replaced, and its stiffness where one is given."""
        kept = self.spec.stiffness if stiffness is None else stiffness
        return replace(self, spec=replace(self.spec, axes={**self.spec.axes, **axes}, stiffness=kept))


def displacement_of(pose: Pose, target: Pose) -> Array:
    """Gives where ``pose`` is, seen from ``target``, (6,) in world axes [m, rad]; the law is ``displacement``."""
    error = np.empty(6)
    displacement(pose.rotation, pose.translation, target.rotation, target.translation, error)
    return error


def _speed_limiting(axis: HybridAxis | None) -> float:
    if axis is None or axis.speed_limit is None:
        return 0.0
    return abs(axis.force) / axis.speed_limit
