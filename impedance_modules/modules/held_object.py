# SPDX-License-Identifier: BSD-3-Clause
"""The rigid object between the hands: where each hand holds it, what it weighs, and how hard it is squeezed.

Notation: O the object's origin, its centre, with axes along the world's at the start; H_i hand i. The grasps are
rigid: squeeze and shares of the weight are fixed in the object's axes, and turn with the first hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.hinge import Hinge
from impedance_modules.records import Array3, Indices, Matrix, Record, Vector
from impedance_modules.robot.kinematics import ArmGeometry
from impedance_modules.robot.pose import Pose, carry
from impedance_modules.robot.rotation import compose, skew
from impedance_modules.spec.robot_spec import STANDARD_GRAVITY
from impedance_modules.spec.task import ObjectSpec

OBJECT = "object"
"""Name by which a target refers to the held object."""


class ObjectLoads(Record):
    """What each hand adds for the object: constants in the object's axes O, and the torques they become.

    Attributes:
        squeeze: (hands, 6) wrench of each hand on the object [N, N.m].
        weight: (hands, 6, 3) wrench of each hand per force that holds the object up.
        lift: Force that holds it up, m g, along z of the world [N]; 0 when the weight is not carried.
        frame: (hands,) place of each hand among the cycle's frames.
        turn: (3, 3) R_HO of the first hand, from which the object's axes are known.
        grip: Part in [0, 1] of squeeze and carried weight that is in force.
        squeeze_effort: (n,) torque of the squeeze [N.m].
        weight_effort: (n,) torque that carries the weight [N.m].
    """

    squeeze: Matrix
    weight: Array3
    lift: float
    frame: Indices
    turn: Matrix
    grip: float
    squeeze_effort: Vector
    weight_effort: Vector


@compiled
def object_efforts(loads: ObjectLoads, arms: ArmGeometry) -> None:
    """Writes J^T of every hand's squeeze and weight wrench into the two torques, times ``grip`` [N.m]."""
    loads.squeeze_effort[:] = 0.0
    loads.weight_effort[:] = 0.0
    if loads.frame.size == 0:
        return
    R_WO, share = np.empty((3, 3)), np.empty(6)
    compose(arms.rotation[loads.frame[0]], loads.turn, R_WO)
    for h in range(loads.frame.size):
        f = loads.frame[h]
        first, last = arms.moved_by[0, f], arms.moved_by[1, f]
        for i in range(6):
            share[i] = 0.0
            for k in range(3):
                share[i] += loads.weight[h, i, k] * R_WO[2, k] * loads.lift
        _add_effort(R_WO, loads.squeeze[h], arms.jacobian[f], first, last, loads.squeeze_effort)
        _add_effort(R_WO, share, arms.jacobian[f], first, last, loads.weight_effort)
    for j in range(loads.squeeze_effort.size):
        loads.squeeze_effort[j] *= loads.grip
        loads.weight_effort[j] *= loads.grip


@compiled
def _add_effort(R_WO: Array, wrench: Array, jacobian: Array, first: int, last: int, effort: Array) -> None:
    """Adds J^T (R_WO wrench)."""
    for i in range(3):
        force, moment = 0.0, 0.0
        for k in range(3):
            force += R_WO[i, k] * wrench[k]
            moment += R_WO[i, k] * wrench[3 + k]
        for j in range(first, last):
            effort[j] += jacobian[i, j] * force + jacobian[3 + i, j] * moment


@dataclass(frozen=True)
class HeldObject:
    """An object and its grasps, frozen at the start posture.

    Attributes:
        spec: What the task file says.
        start: X_WO at the start: its position, world axes.
        limbs: Names of the arms that hold it.
        hands: Their hand frames, in the same order.
        grasps: X_OH of each hand, the relative pose at the start.
        springs: Names of the springs that an ``object`` target moves: those whose frame is rigidly
            attached to a holding hand.
        hinge: About which alone it turns; None for a free object.
    """

    spec: ObjectSpec
    start: Pose
    limbs: tuple[str, ...]
    hands: tuple[str, ...]
    grasps: tuple[Pose, ...]
    springs: tuple[str, ...]
    hinge: Hinge | None = None

    def pose_from(self, hand_poses: tuple[Pose, ...]) -> Pose:
        """Locates the object from its hands: the first hand's axes, the mean of the origins.

        With rigid grasps every hand gives the same X_WO = X_WH X_OH^-1.
        """
        found = [hand @ grasp.inverse() for hand, grasp in zip(hand_poses, self.grasps, strict=True)]
        return Pose(found[0].rotation, np.mean([pose.translation for pose in found], axis=0))

    @property
    def weight(self) -> Array:
        """Force of gravity m g (3,) on the object, in world [N]."""
        return np.array([0.0, 0.0, -self.spec.mass * STANDARD_GRAVITY])

    @property
    def weight_on_hands(self) -> Array:
        """The part of the weight (3,) in world [N] that only hands and surroundings can carry: none on a hinge."""
        return self.weight if self.hinge is None else np.zeros(3)

    def bearing_force(self, wrench: Array) -> Array:
        """Gives the force (3,) [N] on a bearing, in world, by the hands' wrench (6,) on the object and its weight."""
        return wrench[:3] + self.weight

    def inertia(self, rotation: Array) -> Array:
        """Computes the object's own inertia diag(m I, R I_O R^T), (6, 6) at O in world axes.

        Args:
            rotation: (3, 3) R_WO.
        """
        found = np.zeros((6, 6))
        found[:3, :3] = self.spec.mass * np.eye(3)
        moments = moments_of_inertia(self.spec.shape, self.spec.mass, self.spec.size)
        found[3:, 3:] = rotation @ np.diag(moments) @ rotation.T
        return found


def moments_of_inertia(shape: str, mass: float, size: tuple[float, ...]) -> Array:
    """Computes the principal moments (3,) [kg.m^2] of a uniform solid about its centre.

    box (a, b, c): m (b^2 + c^2) / 12 and so on; cylinder (diameter d, length l along z):
    m (3 (d/2)^2 + l^2) / 12 twice, m (d/2)^2 / 2; sphere (diameter d): 2/5 m (d/2)^2.
    """
    if shape == "box":
        a, b, c = (edge**2 for edge in size)
        return mass / 12.0 * np.array([b + c, a + c, a + b])
    radius = 0.5 * size[0]
    if shape == "cylinder":
        across = mass * (3.0 * radius**2 + size[1] ** 2) / 12.0
        return np.array([across, across, 0.5 * mass * radius**2])
    return np.full(3, 0.4 * mass * radius**2)


def distance_to_surface(shape: str, size: tuple[float, ...], point: Array) -> float:
    """Measures how far a point is from a solid's surface [m]; negative inside.

    Args:
        shape: ``box``, ``cylinder`` (along z) or ``sphere``.
        size: As in ``ObjectSpec``.
        point: (3,) in the solid's axes, from its centre [m].
    """
    if shape == "sphere":
        return float(np.linalg.norm(point)) - 0.5 * size[0]
    if shape == "box":
        excess = np.abs(point) - 0.5 * np.asarray(size)
    else:
        excess = np.array([np.hypot(point[0], point[1]) - 0.5 * size[0], abs(point[2]) - 0.5 * size[1]])
    outside = float(np.linalg.norm(np.maximum(excess, 0.0)))
    return outside + min(float(np.max(excess)), 0.0)


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


def share_wrench(offsets: Array, wrench: Array) -> Array:
    """Splits a wrench at the object's origin over the hands, with the least effort.

    Minimises sum (|f_i|^2 + |t_i|^2 / l^2) subject to sum X_i^T w_i = W, exactly; l is the mean distance
    of the hands, which makes forces and moments comparable.

    Args:
        offsets: (h, 3) from the object's origin to each hand [m], world axes.
        wrench: (6,) W at the origin, world axes [N, N.m].

    Returns:
        (h, 6) wrench that each hand puts on the object, at the hand, world axes.
    """
    length = float(np.mean(np.linalg.norm(offsets, axis=1)))
    # A hand at the very origin has no lever: any length then gives the same split.
    scale = np.array([1.0] * 3 + [length if length > 0.0 else 1.0] * 3)
    grasp_map = np.hstack([carry(offset).T * scale for offset in offsets])
    solution = np.linalg.pinv(grasp_map) @ wrench
    return np.asarray(solution.reshape(len(offsets), 6) * scale)


def carry_weight(offsets: Array, mass: float) -> Array:
    """Shares the wrench m g upwards that holds the object's weight; (h, 6) as ``share_wrench``."""
    return share_wrench(offsets, np.array([0.0, 0.0, mass * STANDARD_GRAVITY, 0.0, 0.0, 0.0]))


def object_loads(held: HeldObject | None, frames: tuple[str, ...], efforts: Array) -> ObjectLoads:
    """Lays out the loads of a task's object; without an object there are no hands in them.

    Args:
        held: The object, or None.
        frames: Of the cycle, in order.
        efforts: (2, n) rows that become the torques of squeeze and weight.
    """
    common = {"grip": 1.0, "squeeze_effort": efforts[0], "weight_effort": efforts[1]}
    if held is None:
        nobody = np.zeros(0, dtype=np.int64)
        return ObjectLoads(
            squeeze=np.zeros((0, 6)),
            weight=np.zeros((0, 6, 3)),
            lift=0.0,
            frame=nobody,
            turn=np.eye(3),
            **common,
        )
    offsets = np.array([grasp.translation for grasp in held.grasps])
    squeeze = np.zeros((len(offsets), 6))
    if held.spec.squeeze > 0.0:
        squeeze[:, :3] = squeeze_forces(offsets, held.spec.squeeze)
    columns = [share_wrench(offsets, np.eye(6)[axis]) for axis in range(3)]
    return ObjectLoads(
        squeeze=squeeze,
        weight=np.ascontiguousarray(np.stack(columns, axis=2)),
        lift=held.spec.mass * STANDARD_GRAVITY if held.spec.carry_weight else 0.0,
        frame=np.array([frames.index(hand) for hand in held.hands], dtype=np.int64),
        turn=np.ascontiguousarray(held.grasps[0].rotation.T),
        **common,
    )
