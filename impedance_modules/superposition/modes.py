# SPDX-License-Identifier: BSD-3-Clause
r"""Modes of an arm, or of two arms on one object, in joint space: (M + I_r) qdd + D_q qd + K_q q = 0.

A seven-joint arm has a mode that no 6x6 triple shows. Between arms that hold one object the joints are not
free: N spans the joint motions that keep every grasp together, and all matrices are seen through it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.robot.pose import carry


@dataclass(frozen=True)
class JointSpace:
    """Inertia, stiffness and damping over k joints [kg.m^2, N.m/rad, N.m.s/rad], each (k, k)."""

    inertia: Array
    stiffness: Array
    damping: Array

    def seen_through(self, motion: Array) -> JointSpace:
        """Restricts to joint motions q = N y, N (k, m): N^T (.) N."""
        return JointSpace(
            *(motion.T @ part @ motion for part in (self.inertia, self.stiffness, self.damping))
        )


def block_diagonal(matrices: Sequence[Array]) -> Array:
    """Puts square matrices along the diagonal: what several arms do that share no joint."""
    ends = np.cumsum([len(matrix) for matrix in matrices])
    found = np.zeros((ends[-1], ends[-1]))
    for end, matrix in zip(ends, matrices, strict=True):
        place = slice(end - len(matrix), end)
        found[place, place] = matrix
    return found


@dataclass(frozen=True)
class VibrationMode:
    """One way in which a system moves by itself.

    Attributes:
        frequency: Natural frequency |s| [rad/s].
        damping_ratio: -Re(s) / |s|: 1 settles without swinging, 0 swings for ever, negative grows.
            None for a free motion, s = 0.
        shape: (k,) complex joint amplitudes, largest 1.
    """

    frequency: float
    damping_ratio: float | None
    shape: NDArray[np.complex128]


def joint_space_stiffness(
    jacobian: Array, joint_stiffness: Array, end_stiffness: Array, gamma: Array
) -> Array:
    r"""Sums K_q = K_j - \Gamma + J^T K_end J, (k, k); K_j (k,) or (k, k)."""
    springs = np.diag(joint_stiffness) if joint_stiffness.ndim == 1 else joint_stiffness
    return springs - gamma + jacobian.T @ end_stiffness @ jacobian


def longest_time_constant(modes: Sequence[VibrationMode]) -> float:
    r"""Gives 1 / |Re s| = 1 / (\zeta |s|) of the mode that decays most slowly [s]; infinite if one does not decay."""
    slowest = min(mode.frequency * (mode.damping_ratio or 0.0) for mode in modes)
    return 1.0 / slowest if slowest > 0.0 else float("inf")


def natural_modes(system: JointSpace) -> tuple[VibrationMode, ...]:
    """Finds the modes of M qdd + D qd + K q = 0, slowest first.

    An oscillation is listed once; a motion that does not swing gives one mode per eigenvalue.
    """
    k = len(system.inertia)
    solved = np.linalg.solve(system.inertia, np.hstack([system.stiffness, system.damping]))
    first_order = np.block([[np.zeros((k, k)), np.eye(k)], [-solved[:, :k], -solved[:, k:]]])
    values, vectors = np.linalg.eig(first_order)
    return modes_of(values, vectors[:k])


def modes_of(values: NDArray[np.complex128], shapes: NDArray[np.complex128]) -> tuple[VibrationMode, ...]:
    """Lists modes from eigenvalues s (m,) and shapes (k, m), conjugate pairs once, slowest first."""
    # A free motion is a double zero, which rounding splits into a pair of about sqrt(1e-16).
    free = 1e-6 * float(np.max(np.abs(values)))
    found = []
    for value, shape in zip(values, shapes.T, strict=True):
        if value.imag < 0.0:
            continue
        frequency = float(abs(value))
        ratio = None if frequency < free else float(-value.real / frequency)
        largest = shape[np.argmax(np.abs(shape))]
        scaled = shape / largest if largest != 0.0 else shape
        found.append(VibrationMode(0.0 if ratio is None else frequency, ratio, scaled))
    return tuple(sorted(found, key=lambda mode: mode.frequency))


def least_damped(modes: Sequence[VibrationMode]) -> VibrationMode | None:
    """Picks the mode with the smallest damping ratio; None if all motions are free."""
    bound = [
        (mode.damping_ratio, index) for index, mode in enumerate(modes) if mode.damping_ratio is not None
    ]
    return modes[min(bound)[1]] if bound else None


@dataclass(frozen=True)
class HeldTogether:
    """Joint motions of several arms that keep a rigid object in all their hands.

    Attributes:
        motion: (k, m) N, orthonormal: q = N y over the stacked joints of all arms.
        twist: (6, m) E: the object's twist is E yd, world axes at its origin.
    """

    motion: Array
    twist: Array

    def system(self, arms: JointSpace, object_inertia: Array, turning: Array) -> JointSpace:
        """Sees stacked arms and their object in the motions that are left.

        Args:
            arms: Block diagonal over the stacked joints; Gamma with everything that acts on each hand.
            object_inertia: (6, 6) at the object's origin, world axes.
            turning: (6, 6) sum of ``lever_arm_stiffness`` over the hands.
        """
        free = arms.seen_through(self.motion)
        return JointSpace(
            inertia=free.inertia + self.twist.T @ object_inertia @ self.twist,
            stiffness=free.stiffness + self.twist.T @ turning @ self.twist,
            damping=free.damping,
        )


def hold_together(
    jacobians: Sequence[Array], offsets: Sequence[Array], bearing: Array | None = None
) -> HeldTogether:
    """Finds the motions in which every hand agrees on the object's twist, X_i^-1 J_i qd_i = V_O.

    Args:
        jacobians: (6, k_i) of each hand over its own limb's joints.
        offsets: (3,) from the object's origin to each hand [m], world axes.
        bearing: (5, 6) what a hinge forbids of the object's twist; None for a free object.
    """
    at_object = [carry(-offset) @ J for J, offset in zip(jacobians, offsets, strict=True)]
    starts = np.cumsum([0] + [J.shape[1] for J in at_object])
    rows = np.zeros((6 * (len(at_object) - 1), starts[-1]))
    for index, J in enumerate(at_object[1:]):
        block = slice(6 * index, 6 * index + 6)
        rows[block, : starts[1]] = at_object[0]
        rows[block, starts[index + 1] : starts[index + 2]] = -J
    if bearing is not None:
        held = np.zeros((len(bearing), starts[-1]))
        held[:, : starts[1]] = bearing @ at_object[0]
        rows = np.vstack([rows, held])
    motion = _null_space(rows)
    return HeldTogether(motion, at_object[0] @ motion[: starts[1]])


def _null_space(rows: Array) -> Array:
    """Returns (k, m) orthonormal motions that the rows (r, k) forbid nothing of."""
    if not rows.size:
        return np.eye(rows.shape[1])
    _, values, right = np.linalg.svd(rows)
    return np.asarray(right[int(np.sum(values > 1e-10 * values[0])) :].T)
