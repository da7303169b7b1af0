# SPDX-License-Identifier: BSD-3-Clause
r"""The arms of a task, the object in their hands and the surfaces around, at one state.

All vectors are over the stacked joints of the task's arms, (k,); the object moves with the hands that hold it.
Held by several hands, only those joint motions are possible that keep every grasp,

    A qd = 0,     A_i = X_i^-1 J_i - X_1^-1 J_1        (object's twist as hand i and as the first hand say it)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.between_spring import relative_jacobian, springs_at
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import Equilibrium, PhaseMotion
from impedance_modules.modules.held_object import HeldObject
from impedance_modules.modules.obstacle import obstacles_at
from impedance_modules.modules.sum import (
    lay_out,
    sum_modules,
    write_equilibrium,
    write_gains,
    write_target_motion,
)
from impedance_modules.plant.point_contact import hand_point, object_points
from impedance_modules.plant.pushes import push_wrench
from impedance_modules.prediction.contact_geometry import Contact, find_contacts, place_surface
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose, carry
from impedance_modules.robot.rotation import log3

ROUNDING = 1e-12
"""Largest entry of a row of the hinge's bearing in which no joint moves the object [m], [1]."""


@dataclass(frozen=True)
class Setting:
    """What pulls on a mechanism: modules with the gains of a phase, their equilibria, their dampers.

    ``friction_rest`` is where the friction of the object's hinge has slipped to [rad]; None leaves that friction out.
    ``motion`` and ``clock`` [s] say how fast the equilibria move; None for equilibria at rest.
    """

    modules: TaskModules
    targets: Equilibrium
    damping: Damping
    friction_rest: float | None = None
    motion: PhaseMotion | None = None
    clock: float = 0.0


class Mechanism:
    """Geometry and inertia of everything that moves in a task.

    Attributes:
        model: The robot.
        modules: With the gains at the start of the task.
        joints: (k,) indices of the arms' joints in the model's vectors.
        parts: Limb name -> its columns among the k.
        kinematics: Of the last ``update``.
    """

    def __init__(self, assembly: Assembly) -> None:
        self.model: RobotModel = assembly.model
        self.modules: TaskModules = assembly.modules
        self._surfaces = tuple(place_surface(surface) for surface in assembly.task.environment)
        self._pushes = assembly.task.pushes
        self._arm_inertia: Array | None = None
        self._inertia: Array | None = None
        self._in_force: Setting | None = None
        self._object: tuple[Pose, Array] | None = None
        self.kinematics = Kinematics(self.model, self.modules.frames)
        self.joints = np.concatenate([arm.limb.joints for arm in self.modules.arms])
        starts = np.cumsum([0] + [len(arm.limb.joints) for arm in self.modules.arms])
        self.parts = {
            arm.limb.name: slice(int(first), int(last))
            for arm, first, last in zip(self.modules.arms, starts, starts[1:], strict=False)
        }
        self._sum = lay_out(self.modules, self.model.n)
        held = self.modules.held
        self._object_points = () if held is None else object_points(held.spec.shape, held.spec.size)

    @property
    def k(self) -> int:
        """Number of joints of all arms of the task."""
        return len(self.joints)

    def update(self, q: Array, v: Array) -> None:
        """Moves to positions q [rad] and velocities v [rad/s], both (n,)."""
        self.kinematics.update(q, v)
        self._arm_inertia, self._inertia, self._object = None, None, None

    def jacobian(self, frame: str) -> Array:
        """Gives J of a frame over the stacked joints, (6, k), world axes."""
        return self.kinematics.jacobian_of(frame)[:, self.joints]

    def arm_inertia(self) -> Array:
        """Gives M + I_r of the arms alone, (k, k) [kg.m^2]."""
        if self._arm_inertia is None:
            block = self.kinematics.inverse_inertia[np.ix_(self.joints, self.joints)]
            self._arm_inertia = np.linalg.inv(block)
        return self._arm_inertia

    def inertia(self) -> Array:
        """Gives M + I_r of the arms and the held object, (k, k) [kg.m^2]."""
        if self._inertia is None:
            found, held = self.arm_inertia(), self.modules.held
            if held is not None:
                J = self.object_jacobian()
                found = found + J.T @ held.inertia(self.object_pose().rotation) @ J
            self._inertia = np.asarray(0.5 * (found + found.T))
        return self._inertia

    def gains(
        self, modules: TaskModules, damping: Damping, targets: Equilibrium | None = None
    ) -> tuple[Array, Array]:
        """Gives the declared stiffness and damping of all modules in joint space, (k, k) each.

        ``targets`` are the rests of springs between arms; None for their first ones.
        """
        stiffness, dampers = np.zeros((self.k, self.k)), np.zeros((self.k, self.k))
        for arm in modules.arms:
            part = self.parts[arm.limb.name]
            if arm.bias is not None:
                stiffness[part, part] += np.diag(arm.bias.stiffness)
                dampers[part, part] += damping.of_joints(arm.limb.name)
            for spring in arm.springs:
                J = self.jacobian(spring.frame)[:, part]
                stiffness[part, part] += J.T @ spring.world_stiffness @ J
                dampers[part, part] += J.T @ damping.of_spring(spring) @ J
        for between, J in zip(modules.between, self.relative_jacobians(modules, targets), strict=True):
            stiffness += J.T @ between.spec.stiffness @ J
            dampers += J.T @ damping.of_between(between) @ J
        for along, k, b in self._obstacle_pushes(modules):
            stiffness += k * np.outer(along, along)
            dampers += b * np.outer(along, along)
        return stiffness, dampers

    def relative_jacobians(self, modules: TaskModules, targets: Equilibrium | None = None) -> list[Array]:
        """Gives G J of every spring between arms over the stacked joints, (6, k) each."""
        rests = {spring.name: spring.start for spring in modules.between}
        found = springs_at(modules.between, self.kinematics, rests if targets is None else targets.springs)
        arms = self.kinematics.arms
        return [relative_jacobian(found, arms, s)[:, self.joints] for s in range(len(modules.between))]

    def _obstacle_pushes(self, modules: TaskModules) -> Iterator[tuple[Array, float, float]]:
        """Lists n^T J (k,) of every frame that an obstacle pushes now, with stiffness [N/m] and damping [N.s/m]."""
        found = obstacles_at(modules.obstacles, self.kinematics)
        for p, (o, f) in enumerate(zip(found.obstacle, found.frame, strict=True)):
            part = (found.distance[o] - found.clearance[p]) / found.distance[o]
            if part > 0.0:
                along = found.normal[p] @ self.kinematics.jacobian[f][:3, self.joints]
                rising = float(found.stiffness[o]) if part < 1.0 else 0.0
                yield along, rising, float(found.damping[o]) * min(part, 1.0)

    def module_efforts(
        self, setting: Setting, q: Array, v: Array, *, force_share: float = 1.0
    ) -> tuple[Array, float]:
        """Sums what the modules ask for at the state of the last ``update``, by the law of the control loop.

        Args:
            setting: Gains and equilibria.
            q: (n,) [rad].
            v: (n,) [rad/s].
            force_share: Part in [0, 1] of the hybrid axes' forces that is in force.

        Returns:
            (n,) torque [N.m], and the energy of all springs [J].
        """
        found = self._sum
        before = self._in_force
        if before is None or before.modules is not setting.modules or before.damping is not setting.damping:
            write_gains(found, setting.modules, setting.damping)
        self._in_force = setting if force_share == 1.0 else None
        found.springs.force[:] *= force_share
        write_equilibrium(found, setting.modules, setting.targets)
        write_target_motion(found, setting.modules, setting.motion, setting.clock)
        energy = sum_modules(found, self.kinematics.arms, q, v, 1.0)
        return found.desired.copy(), energy

    def object_pose(self) -> Pose:
        """Gives X_WO as the first holding hand says it."""
        return self._held_object()[0]

    def object_jacobian(self) -> Array:
        """Gives the object's twist per joint velocity by its first hand, (6, k), world axes at its origin."""
        return self._held_object()[1]

    def _held_object(self) -> tuple[Pose, Array]:
        if self._object is None:
            held = self._holding()
            hand = self.kinematics.pose(held.hands[0])
            pose = hand @ held.grasps[0].inverse()
            self._object = pose, carry(pose.translation - hand.translation) @ self.jacobian(held.hands[0])
        return self._object

    def object_load(self) -> Array:
        """Gives the torque of the held object's weight, (k,) [N.m]; the modules may carry it."""
        held = self.modules.held
        if held is None:
            return np.zeros(self.k)
        return held.weight @ self.object_jacobian()[:3]

    def push_load(self, time: float) -> Array:
        """Gives the torque of whoever pushes hands or object at a time [s], (k,) [N.m]."""
        found = np.zeros(self.k)
        hands = {arm.limb.name: arm.limb.hand for arm in self.modules.arms}
        for target in {push.target for push in self._pushes}:
            J = self.jacobian(hands[target]) if target in hands else self.object_jacobian()
            found += J.T @ push_wrench(self._pushes, target, time)
        return found

    def grasp_rows(self) -> tuple[Array, Array]:
        """Gives A (r, k), and by how much hands and hinge disagree on the object's pose [m, rad].

        There are r = 6 (h - 1) rows, and 5 of a hinge, less those in which no joint moves any hand: planar arms keep
        them by themselves.
        """
        held = self.modules.held
        if held is None or (len(held.hands) < 2 and held.hinge is None):
            return np.zeros((0, self.k)), np.zeros(0)
        first, origin = self.object_pose(), self.object_pose().translation
        rows, errors = [], []
        base = self.object_jacobian()
        if held.hinge is not None:
            bearing, away = held.hinge.rows(first, base)
            moving = np.max(np.abs(bearing), axis=1) > ROUNDING
            rows.append(bearing[moving])
            errors.append(away[moving])
        for hand, grasp in zip(held.hands[1:], held.grasps[1:], strict=True):
            pose = self.kinematics.pose(hand)
            other = pose @ grasp.inverse()
            rows.append(carry(origin - pose.translation) @ self.jacobian(hand) - base)
            turn = log3(other.rotation @ first.rotation.T)
            errors.append(np.concatenate([other.translation - origin, turn]))
        agree, gap = np.vstack(rows), np.concatenate(errors)
        moved = np.any(agree != 0.0, axis=1)
        return agree[moved], gap[moved]

    def hinge_motion(self) -> tuple[float, Array]:
        """Gives the angle of the object's hinge [rad] and its derivative by the joints (k,)."""
        hinge = self._holding().hinge
        if hinge is None:
            raise ValueError("the object of this task has no hinge: it has no angle")
        return hinge.angle(self.object_pose()), hinge.axis @ self.object_jacobian()[3:]

    def contacts(self, near: float) -> list[tuple[Contact, Array]]:
        """Lists every contact point with its Jacobian (3, k): hands first, then the object's points."""
        found = []
        if not self._surfaces:
            return []
        bodies = [(arm.limb.hand, (hand_point(),)) for arm in self.modules.arms]
        for index, (hand, points) in enumerate(bodies):
            touching = find_contacts(index, self.kinematics.pose(hand), points, self._surfaces, near)
            found += [(contact, contact.jacobian(self.jacobian(hand))) for contact in touching]
        if self._object_points:
            pose = self.object_pose()
            touching = find_contacts(len(bodies), pose, self._object_points, self._surfaces, near)
            found += [(contact, contact.jacobian(self.object_jacobian())) for contact in touching]
        return found

    def _holding(self) -> HeldObject:
        held = self.modules.held
        if held is None:
            raise ValueError("no arm holds an object in this task: it has no object's pose or motion")
        return held
