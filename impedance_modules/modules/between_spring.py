# SPDX-License-Identifier: BSD-3-Clause
r"""A virtual spring between two frames of two arms, and a damper of their relative motion: internal forces only.

Notation: A and B the frames, at (R_A, p_A) and (R_B, p_B). Each carries a copy of the spring's axes, Q_A = R_A S_A and
Q_B = R_B S_B, which coincide where the spring's rotation is relaxed. C are the axes in the middle of the two:

    \phi = log(Q_B^T Q_A),     C = Q_B exp(\phi / 2) = Q_A exp(-\phi / 2),     r = p_A - p_B
    e = [C^T r - d;  \phi],    U = 1/2 e^T K e,     de = G (dp_A, \delta_A, dp_B, \delta_B)

d is the relaxed distance. With \delta small world rotations and \theta = |\phi|, a = C \phi tan(\theta / 4) / \theta,

    \delta_C = (\delta_A + \delta_B) / 2 - a x (\delta_A - \delta_B) / 2
    G = [ C^T   C^T [r] (1 - [a]) / 2   -C^T   C^T [r] (1 + [a]) / 2 ]
        [ 0     M C^T                    0    -M C^T                 ],     M = 1 + k (\theta^2 1 - \phi \phi^T)

k = (\theta / (2 sin(\theta / 2)) - 1) / \theta^2. Wrenches on both frames, and torques of the joints of both arms:

    (w_A, w_B) = -G^T (K e + D e'),     e' = G (V_A, V_B),     \tau = J_A^T w_A + J_B^T w_B = -dU/dq - (G J)^T D G J q'

G moves with the pair and is zero for a motion of both as one body. So the wrenches sum to zero about any point, the
damper takes energy or none, and A and B may be exchanged (d and \phi change their sign with them). Continuous up to
half a turn of A against B.

Sources: Hogan, Impedance control, J. Dyn. Sys. Meas. Control 107 (1985); the axes in the middle: Fasse and Broenink, A
spatial impedance controller for robotic manipulation, IEEE Trans. Robotics and Automation 13 (1997); springs between
two hands: Wimboeck, Ott and Hirzinger, Impedance behaviors for two-handed manipulation, ICRA 2007.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, Indices, Matrix, Record
from impedance_modules.robot.kinematics import ArmGeometry, Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import compose, exp3, exponential, logarithm
from impedance_modules.spec.between_spec import BETWEEN, BetweenSpec, FrameOfArm
from impedance_modules.spec.task import AXES

SMALL_TURN = 1e-3
"""Below this angle [rad] series replace quotients; their error is then below 1e-14."""


class BetweenSprings(Record):
    """All springs between two arms as they are in force now, and what they ask for.

    Attributes:
        stiffness: (springs, 6, 6) K in the axes C [N/m, N, N.m/rad].
        damping: (springs, 6, 6) D in the axes C [N.s/m, N.m.s/rad].
        first, second: (springs,) places of A and B among the cycle's frames.
        first_axes, second_axes: (springs, 3, 3) S_A, S_B with which the rotation is relaxed at the start posture.
        rest_rotation: (springs, 3, 3) relaxed rotation of A against B, counted from the start posture.
        rest_translation: (springs, 3) d [m].
        error: (springs, 6) e [m, rad].
        gradient: (springs, 6, 12) G.
        wrench: (springs, 12) on A, then on B, each at its origin in world axes [N, N.m].
        effort: (springs, n) what each asks of the joints [N.m].
    """

    stiffness: Array3
    damping: Array3
    first: Indices
    second: Indices
    first_axes: Array3
    second_axes: Array3
    rest_rotation: Array3
    rest_translation: Matrix
    error: Matrix
    gradient: Array3
    wrench: Matrix
    effort: Matrix


@compiled
def middle_axes(springs: BetweenSprings, arms: ArmGeometry, s: int, axes: Array, phi: Array) -> None:
    r"""Writes C (3, 3) and \phi (3,) [rad] of spring ``s``.

    A rest rotation exp(\phi_0) is shared by both frames' axes: Q_A = R_A S_A exp(-\phi_0 / 2), Q_B = R_B S_B
    exp(\phi_0 / 2).
    """
    a, b = springs.first[s], springs.second[s]
    half, turned = np.empty((3, 3)), np.empty((3, 3))
    on_first, on_second, relative = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    logarithm(springs.rest_rotation[s], phi)
    for k in range(3):
        phi[k] *= 0.5
    exponential(phi, half)
    compose(springs.second_axes[s], half, turned)
    compose(arms.rotation[b], turned, on_second)
    for k in range(3):
        phi[k] = -phi[k]
    exponential(phi, half)
    compose(springs.first_axes[s], half, turned)
    compose(arms.rotation[a], turned, on_first)
    for i in range(3):
        for j in range(3):
            relative[i, j] = 0.0
            for k in range(3):
                relative[i, j] += on_second[k, i] * on_first[k, j]
    logarithm(relative, phi)
    for k in range(3):
        phi[k] *= 0.5
    exponential(phi, half)
    compose(on_second, half, axes)
    for k in range(3):
        phi[k] *= 2.0


@compiled
def stretch(springs: BetweenSprings, arms: ArmGeometry, s: int) -> None:
    """Writes e and G of spring ``s``, the equations of the module."""
    a, b = springs.first[s], springs.second[s]
    error, gradient = springs.error[s], springs.gradient[s]
    C, phi, lever, tilt = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    middle_axes(springs, arms, s, C, phi)
    square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    angle = math.sqrt(square)
    if angle < SMALL_TURN:
        quarter, widening = 0.25 + square / 192.0, 1.0 / 24.0 + 7.0 * square / 5760.0
    else:
        quarter = math.tan(0.25 * angle) / angle
        widening = (0.5 * angle / math.sin(0.5 * angle) - 1.0) / square
    along = 0.0
    for k in range(3):
        lever[k] = arms.translation[a, k] - arms.translation[b, k]
        tilt[k] = quarter * (C[k, 0] * phi[0] + C[k, 1] * phi[1] + C[k, 2] * phi[2])
    for k in range(3):
        along += lever[k] * tilt[k]
    for i in range(3):
        error[i], error[3 + i] = -springs.rest_translation[s, i], phi[i]
        for k in range(3):
            error[i] += C[k, i] * lever[k]
            # Row i of C^T [r], and of C^T [r] [a] = C^T (a r^T - (r . a) 1).
            before, after = (k + 2) % 3, (k + 1) % 3
            turned = C[after, i] * lever[before] - C[before, i] * lever[after]
            shared = -along * C[k, i]
            spread = (1.0 + widening * square) * C[k, i]
            for m in range(3):
                shared += C[m, i] * tilt[m] * lever[k]
                spread -= widening * phi[i] * phi[m] * C[k, m]
            gradient[i, k], gradient[i, 6 + k] = C[k, i], -C[k, i]
            gradient[i, 3 + k], gradient[i, 9 + k] = 0.5 * (turned - shared), 0.5 * (turned + shared)
            gradient[3 + i, k], gradient[3 + i, 6 + k] = 0.0, 0.0
            gradient[3 + i, 3 + k], gradient[3 + i, 9 + k] = spread, -spread


@compiled
def between_energies(springs: BetweenSprings, arms: ArmGeometry) -> float:
    """Sums U of all springs, undiminished by the tank [J]."""
    total = 0.0
    for s in range(springs.first.size):
        stretch(springs, arms, s)
        for i in range(6):
            for j in range(6):
                total += 0.5 * springs.error[s, i] * springs.stiffness[s, i, j] * springs.error[s, j]
    return total


@compiled
def between_efforts(springs: BetweenSprings, arms: ArmGeometry, velocity: Array, scale: float) -> float:
    r"""Writes wrenches and torque of every spring, -G^T (r K e + D e'); returns their energy r U [J].

    Args:
        springs: In force; ``error``, ``gradient``, ``wrench`` and ``effort`` are overwritten.
        arms: At the state.
        velocity: (n,) that dampers act on [rad/s].
        scale: r in [0, 1]: relaxes the potential, not the dampers.
    """
    total = 0.0
    rate, load = np.empty(6), np.empty(6)
    for s in range(springs.first.size):
        stretch(springs, arms, s)
        error, gradient, wrench = springs.error[s], springs.gradient[s], springs.wrench[s]
        relative_rate(springs, arms, s, velocity, rate)
        for i in range(6):
            load[i] = 0.0
            for j in range(6):
                pull = scale * springs.stiffness[s, i, j] * error[j]
                total += 0.5 * error[i] * pull
                load[i] += pull + springs.damping[s, i, j] * rate[j]
        for k in range(12):
            wrench[k] = 0.0
            for i in range(6):
                wrench[k] -= gradient[i, k] * load[i]
        springs.effort[s, :] = 0.0
        for end in range(2):
            f = springs.first[s] if end == 0 else springs.second[s]
            for i in range(6):
                for j in range(arms.moved_by[0, f], arms.moved_by[1, f]):
                    springs.effort[s, j] += arms.jacobian[f, i, j] * wrench[6 * end + i]
    return total


@compiled
def relative_rate(springs: BetweenSprings, arms: ArmGeometry, s: int, velocity: Array, rate: Array) -> None:
    """Writes e' = G (V_A, V_B) (6,) of spring ``s`` [m/s, rad/s], after ``stretch``."""
    for i in range(6):
        rate[i] = 0.0
    for end in range(2):
        f = springs.first[s] if end == 0 else springs.second[s]
        for k in range(6):
            twist = 0.0
            for j in range(arms.moved_by[0, f], arms.moved_by[1, f]):
                twist += arms.jacobian[f, k, j] * velocity[j]
            for i in range(6):
                rate[i] += springs.gradient[s, i, 6 * end + k] * twist


@dataclass(frozen=True)
class BetweenSpring:
    """One such spring as a task declares it, with what is frozen at the start posture.

    Attributes:
        spec: What the task file says.
        first_axes, second_axes: (3, 3) S_A, S_B: the spring's axes at the start posture, as A and B have them.
        start: First rest: rotation of A against B from the start posture, and d [m].
    """

    spec: BetweenSpec
    first_axes: Array
    second_axes: Array
    start: Pose

    @property
    def name(self) -> str:
        """Name by which phases move its rest."""
        return self.spec.name

    @property
    def module(self) -> str:
        """Name of its torque in recordings."""
        return f"{BETWEEN}.{self.spec.name}"

    @property
    def reference(self) -> Pose:
        """Coordinates of its rest count from here: from nothing."""
        return Pose.identity()

    @property
    def frames(self) -> tuple[str, str]:
        """A and B."""
        return self.spec.first.frame, self.spec.second.frame

    @property
    def limbs(self) -> tuple[str, str]:
        """Arms that move A and B."""
        return self.spec.first.limb, self.spec.second.limb


def build_between_spring(spec: BetweenSpec, model: RobotModel, posture: Array) -> BetweenSpring:
    """Freezes a spring's axes and its first rest at the start posture (n,) [rad]."""
    first, second = (model.pose(posture, end.frame) for end in (spec.first, spec.second))
    axes = _axes(spec.expressed_in, model, posture)
    here = np.concatenate([axes.T @ (first.translation - second.translation), np.zeros(3)])
    rest = np.array([spec.rest.get(axis, value) for axis, value in zip(AXES, here, strict=True)])
    start = Pose(exp3(rest[3:]), rest[:3])
    return BetweenSpring(spec, first.rotation.T @ axes, second.rotation.T @ axes, start)


def _axes(frame: FrameOfArm | None, model: RobotModel, posture: Array) -> Array:
    return np.eye(3) if frame is None else model.pose(posture, frame.frame).rotation


def lay_out_between(
    springs: Sequence[BetweenSpring],
    frames: tuple[str, ...],
    rest: tuple[Array, Array],
    effort: Array,
) -> BetweenSprings:
    """Takes the memory of all springs between arms; stiffness is in force, dampers are 0.

    Args:
        springs: Of the task.
        frames: Of the cycle.
        rest: (springs, 3, 3) and (springs, 3) that equilibria are written to.
        effort: (springs, n), overwritten in every cycle.
    """
    count = len(springs)
    return BetweenSprings(
        stiffness=np.array([spring.spec.stiffness for spring in springs]).reshape(count, 6, 6),
        damping=np.zeros((count, 6, 6)),
        first=np.array([frames.index(spring.frames[0]) for spring in springs], dtype=np.int64),
        second=np.array([frames.index(spring.frames[1]) for spring in springs], dtype=np.int64),
        first_axes=np.array([spring.first_axes for spring in springs]).reshape(count, 3, 3),
        second_axes=np.array([spring.second_axes for spring in springs]).reshape(count, 3, 3),
        rest_rotation=rest[0],
        rest_translation=rest[1],
        error=np.zeros((count, 6)),
        gradient=np.zeros((count, 6, 12)),
        wrench=np.zeros((count, 12)),
        effort=effort,
    )


def springs_at(
    springs: Sequence[BetweenSpring], kinematics: Kinematics, rests: Mapping[str, Pose]
) -> BetweenSprings:
    """Gives all springs at the state of ``kinematics``: e, G and the wrenches of their potentials.

    Args:
        springs: Of the task.
        kinematics: Of a robot's state; it has the springs' frames.
        rests: Spring name -> its rest.
    """
    count, n = len(springs), kinematics.model.n
    rotations = np.array([rests[spring.name].rotation for spring in springs]).reshape(count, 3, 3)
    distances = np.array([rests[spring.name].translation for spring in springs]).reshape(count, 3)
    found = lay_out_between(springs, kinematics.frames, (rotations, distances), np.zeros((count, n)))
    between_efforts(found, kinematics.arms, np.zeros(n), 1.0)
    return found


def relative_jacobian(springs: BetweenSprings, arms: ArmGeometry, s: int) -> Array:
    """Gives G J (6, n) of spring ``s``: e' = G J q', after ``stretch``."""
    stacked = np.vstack([arms.jacobian[springs.first[s]], arms.jacobian[springs.second[s]]])
    return np.asarray(springs.gradient[s] @ stacked)
