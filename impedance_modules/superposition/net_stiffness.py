# SPDX-License-Identifier: BSD-3-Clause
r"""Stiffness and damping of a hand: joint springs and dampers seen through the arm, plus those at the hand.

    K_net = (J (K_j - \Gamma)^-1 J^T)^-1 + K_end,      \Gamma_ij = d(J^T F_b)_i / dq_j       (thesis eq. 4.24)

F_b is the wrench on the hand that the joint springs carry: the sum of everything that acts on the hand,
virtual springs, force axes, environment and object. At rest J^T F_b = K_j (q - q_0). A loaded linkage is
softer or stiffer than a relaxed one because its lever arms turn: that is \Gamma. Relaxed joint springs have
\Gamma = 0. Derivation: K_j dq = \Gamma dq + J^T dF_b (the statics, differentiated), dx = J dq.
The wrench is an argument: with another wrench the same function gives the thesis's eq. 5.1.

K_end is minus the derivative of the end springs' wrench by a small displacement dp and a small world-axes rotation
\delta of the frame. With K_W the declared stiffness in world axes, \phi the spring's rotation vector,
L = d\phi / d\delta and g = K_W (dp, \phi) the gradient,

    K_end = B^T K_W B + diag(0, N L),    B = diag(I, L),    N = d(L(\phi)^T g_w) / d\phi.

The second part is the spring's own geometric stiffness, due to its load; it vanishes with the load.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.modules.spring import Spring, displacement_of
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log_jacobian, skew

SINGULAR = 1e-10
"""Ratio of the smallest to the largest singular value below which a matrix counts as singular."""

SERIES_ANGLE = 0.3
"""Below this angle [rad] a series replaces quotients that would cancel; its error is below 1e-13."""


@dataclass(frozen=True)
class NetStiffness:
    """What a hand's springs amount to at one posture and load; world axes, at the hand.

    Attributes:
        stiffness: (6, 6) K_net, minus the derivative of the hand's wrench by displacement and rotation.
            None where the joint springs are singular, the posture is singular, or the arm folds.
        compliance: (6, 6) J H^-1 J^T, motion of the hand per wrench on it. None where the arm folds or
            some motion of the hand meets no stiffness at all.
        folds: The arm with its hand free, under constant loads, is not in a stable equilibrium: the
            symmetric part of the Hessian H = K_j - Gamma + J^T K_end J has a negative eigenvalue.
        folds_held: Even with the hand held fast, a self-motion of the arm is unstable.
        gamma: (k, k) Gamma [N.m/rad].
        at_hand: (6, 6) the formula's K_net, stable or not, and with the answer that the statics still
            give where K_j is singular; what superposition adds. None only at singular postures.
    """

    stiffness: Array | None
    compliance: Array | None
    folds: bool
    folds_held: bool
    gamma: Array
    at_hand: Array | None


def net_stiffness(
    jacobian: Array, joint_stiffness: Array, end_stiffness: Array, wrench: Array
) -> NetStiffness:
    r"""Computes eq. 4.24 and judges it.

    The Hessian that decides folding, H = K_j - \Gamma + J^T K_end J, is the derivative by q of all torques
    K_j (q - q_0) - J^T (w_end(q) + F_constant) that must balance: its symmetric part must be positive
    definite for the arm to return by itself. Its inverse seen at the hand is the compliance
    J H^-1 J^T = K_net^-1 (the matrix inversion lemma).

    Args:
        jacobian: (6, k) J of the hand, joints from the base outwards.
        joint_stiffness: (k,) or (k, k) K_j [N.m/rad], with whatever acts elsewhere than at the hand.
        end_stiffness: (6, 6) K_end at the hand, world axes, e.g. from ``spring_stiffness``.
        wrench: (6,) F_b [N, N.m], world axes.
    """
    springs = np.diag(joint_stiffness) if joint_stiffness.ndim == 1 else joint_stiffness
    turning = gamma(jacobian, wrench)
    loaded = springs - turning
    hessian = loaded + jacobian.T @ end_stiffness @ jacobian
    folds = _unstable(hessian, float(np.linalg.norm(hessian, 2)))
    joint_part = through_arm(jacobian, loaded)
    at_hand = None if joint_part is None else joint_part + end_stiffness
    hidden = folds or _singular(springs) or _singular(loaded)
    return NetStiffness(
        stiffness=None if hidden else at_hand,
        compliance=None if folds else _compliance(jacobian, hessian),
        folds=folds,
        folds_held=_unstable_when_held(jacobian, hessian),
        gamma=turning,
        at_hand=at_hand,
    )


def gamma(jacobian: Array, wrench: Array) -> Array:
    r"""Gives how the torque of a constant wrench on the hand changes as the joints turn.

    \Gamma_ij = d(J^T F)_i / dq_j with F = (f, t) fixed in world axes at the moving hand. When joint j turns,
    it turns every axis and lever further out with it:

        j <= i:  f . (Jw_j x Jv_i) + t . (Jw_j x Jw_i)           j > i:  f . (Jw_i x Jv_j)

    Args:
        jacobian: (6, k), joints ordered from the base outwards; zero columns for joints beyond the frame.
        wrench: (6,) F, world axes [N, N.m].

    Returns:
        (k, k) [N.m/rad]; symmetric when t = 0.
    """
    linear, angular = jacobian[:3].T, jacobian[3:].T
    force, moment = wrench[:3], wrench[3:]
    # turned[i, j] = f . (Jw_i x Jv_j)
    turned = np.cross(angular[:, None], linear[None, :]) @ force
    twisted = np.cross(angular[:, None], angular[None, :]) @ moment
    return np.tril((turned + twisted).T) + np.triu(turned, 1)


def through_arm(jacobian: Array, joint_matrix: Array) -> Array | None:
    r"""Sees a joint-space stiffness or damping at the hand, (J A^-1 J^T)^-1.

    It is the df of the statics A dq = J^T df, J dq = dx, solved together for every dx; that has an answer
    where A is singular too: a direction which some joint lets go freely has none of the joints' stiffness.

    Args:
        jacobian: (6, k); of several hands, (6 h, k).
        joint_matrix: (k, k) A.

    Returns:
        (6, 6), of several hands (6 h, 6 h), or None where a hand cannot move in some direction (J has not full row
        rank).
    """
    if _singular(jacobian):
        return None
    rows, k = jacobian.shape
    scale = float(np.linalg.norm(joint_matrix, 2))
    if scale == 0.0:
        return np.zeros((rows, rows))
    # Divided by its size, A meets the tolerance of the pseudo-inverse on equal terms with J.
    statics = np.block([[joint_matrix / scale, jacobian.T], [jacobian, np.zeros((rows, rows))]])
    return -scale * np.asarray(np.linalg.pinv(statics, rcond=1e-12)[k:, k:])


def as_joint_stiffness(jacobian: Array, stiffness: Array, wrench: Array) -> Array:
    r"""Turns a spring on another frame of the arm into joint stiffness: J^T K J - \Gamma(w), (k, k).

    Args:
        jacobian: (6, k) of that frame; zero columns for joints beyond it.
        stiffness: (6, 6) of the spring there, world axes.
        wrench: (6,) that the spring exerts there now.
    """
    return jacobian.T @ stiffness @ jacobian - gamma(jacobian, wrench)


def carried_wrench(jacobian: Array, joint_effort: Array) -> Array:
    """Finds the wrench F_b on the hand that balances the joint springs, J^T F_b = K_j (q - q_0), by least squares.

    Args:
        jacobian: (6, k).
        joint_effort: (k,) K_j (q - q_0) [N.m], what the joint springs carry.

    Returns:
        F_b (6,) in world axes [N, N.m]; exact at rest.
    """
    return np.asarray(np.linalg.lstsq(jacobian.T, joint_effort, rcond=None)[0], dtype=np.float64)


def hand_damping(jacobian: Array, joint_damping: Array, end_damping: Array) -> Array | None:
    """Computes the damping at a hand, B = (J D_j^-1 J^T)^-1 + D_end.

    Args:
        jacobian: (6, k) J of the hand.
        joint_damping: (k, k) D_j [N.m.s/rad].
        end_damping: (6, 6) D_end at the hand, world axes.

    Returns:
        (6, 6) [N.s/m, N.s, N.m.s]; None where D_j or the posture is singular.
    """
    if _singular(joint_damping):
        return None
    joint_part = through_arm(jacobian, joint_damping)
    return None if joint_part is None else joint_part + end_damping


def spring_stiffness(spring: Spring, pose: Pose, target: Pose) -> Array:
    """Computes minus the derivative of ``spring.wrench`` by displacement and rotation of the frame.

    Returns:
        (6, 6) in world axes at the frame's origin. Unsymmetric while the spring carries a moment,
        because small world-axes rotations are no coordinates; symmetric otherwise.
    """
    offset = displacement_of(pose, target)
    declared = spring.in_world(spring.stiffness)
    turn = log_jacobian(offset[3:])
    B = np.eye(6)
    B[3:, 3:] = turn
    moment_gradient = declared[3:] @ offset
    K = B.T @ declared @ B
    K[3:, 3:] += _moment_derivative(offset[3:], moment_gradient) @ turn
    return K


def spring_stiffness_without_preload(spring: Spring, pose: Pose, target: Pose) -> Array:
    """Computes what the spring would show at this deflection without its load: B^T K_W B, (6, 6)."""
    B = np.eye(6)
    B[3:, 3:] = log_jacobian(displacement_of(pose, target)[3:])
    return B.T @ spring.in_world(spring.stiffness) @ B


def _compliance(jacobian: Array, hessian: Array) -> Array | None:
    """Gives J H^-1 J^T; where H is singular, only if no free motion of the joints moves the hand."""
    left, values, right = np.linalg.svd(hessian)
    free = values <= SINGULAR * values[0]
    moves = max(_size(jacobian @ right[free].T), _size(jacobian @ left[:, free]))
    if moves > 1e-6:
        return None
    inverse = (right[~free].T / values[~free]) @ left[:, ~free].T
    return np.asarray(jacobian @ inverse @ jacobian.T)


def _unstable_when_held(jacobian: Array, hessian: Array) -> bool:
    """Restricts the Hessian to the self-motions, J dq = 0."""
    _, values, right = np.linalg.svd(jacobian)
    self_motion = right[int(np.sum(values > SINGULAR * values[0])) :]
    return _unstable(self_motion @ hessian @ self_motion.T, float(np.linalg.norm(hessian, 2)))


def _unstable(hessian: Array, scale: float) -> bool:
    """Tells whether the symmetric part has an eigenvalue that is negative beyond rounding."""
    lowest = np.linalg.eigvalsh(0.5 * (hessian + hessian.T))[:1]
    return bool(np.any(lowest < -SINGULAR * scale))


def _singular(matrix: Array) -> bool:
    values = np.linalg.svd(matrix, compute_uv=False)
    return bool(values[-1] <= SINGULAR * values[0])


def _size(matrix: Array) -> float:
    return float(np.max(np.abs(matrix))) if matrix.size else 0.0


def _moment_derivative(phi: Array, gradient: Array) -> Array:
    r"""Differentiates L(\phi)^T g by \phi at constant g.

    L^T g = g + \phi x g / 2 + c(\theta) \phi x (\phi x g), c = (1 - (\theta/2) cot(\theta/2)) / \theta^2.
    """
    second, slope = _second_coefficient(float(np.linalg.norm(phi)))
    across = np.cross(phi, gradient)
    return (
        -0.5 * skew(gradient)
        - second * (skew(across) + skew(phi) @ skew(gradient))
        + slope * np.outer(np.cross(phi, across), phi)
    )


def _second_coefficient(angle: float) -> tuple[float, float]:
    r"""Gives c(\theta) of the inverse left Jacobian, and c'(\theta) / \theta."""
    if angle < SERIES_ANGLE:
        x = angle**2
        second = 1 / 12 + x * (1 / 720 + x * (1 / 30240 + x * (1 / 1209600 + x / 47900160)))
        slope = 1 / 360 + x * (1 / 7560 + x * (1 / 201600 + x * (1 / 5987520 + 691 * x / 130767436800)))
        return second, slope
    half = 0.5 * angle
    cotangent, sine = half / math.tan(half), half / math.sin(half)
    return (1.0 - cotangent) / angle**2, (cotangent + sine**2 - 2.0) / angle**4
