# SPDX-License-Identifier: BSD-3-Clause
"""Second engine: Drake's multibody equations under an integrator of our own, in a process that never sees MuJoCo.

With A bar = the mean of A over the step of length h, M, C and g at the middle position, the step solves

    M (v' - v) / h + C + g = tau_s + tau_l,   I (w' - w) / h + D w_bar = tau_m - tau_s,
    tau_s = K (theta - q + h/2 (w_bar - v_bar) - slack) + B (w_bar - v_bar)

for v', w'; in a rigid drive w = v and both equations are added.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    MultibodyForces,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
    WeldJoint,
)

from benchmarks.blind.arm_model import Link
from benchmarks.wide.plan import STEP, Plan

Array = NDArray[np.float64]


class Rigid:
    """Rigid links in Drake: torques of a motion, mass matrix and bias."""

    def __init__(self, links: tuple[Link, ...], hand: str, gravity: Array) -> None:
        """Takes links, parents first, and gravity (3,) in the world [m/s^2]."""
        plant = MultibodyPlant(time_step=0.0)
        frames = {links[0].parent: plant.world_frame()}
        for link in links:
            frames[link.name] = _add(plant, frames[link.parent], link)
        plant.mutable_gravity_field().set_gravity_vector(gravity)
        plant.Finalize()
        self.plant, self._context = plant, plant.CreateDefaultContext()
        self._forces, self._none = MultibodyForces(plant), MultibodyForces(plant)
        self._hand = plant.GetFrameByName(hand)

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Returns the joints' torques (n,) of one state [N.m]."""
        self._set(q, v)
        self._none.SetZero()
        force = self.plant.CalcInverseDynamics(self._context, a, self._none)
        return np.asarray(force - self.plant.CalcGravityGeneralizedForces(self._context))

    def terms(self, q: Array, v: Array, force: Array) -> tuple[Array, Array]:
        """Returns M (n, n) and C v + g - J^T F (n,) at a state, F (3,) the force on the hand [N]."""
        self._set(q, v)
        mass = self.plant.CalcMassMatrix(self._context)
        bias = self.plant.CalcBiasTerm(self._context)
        bias = bias - self.plant.CalcGravityGeneralizedForces(self._context)
        if force.any():
            bias = bias - self._jacobian().T @ force
        return mass, bias

    def _jacobian(self) -> Array:
        from pydrake.multibody.tree import JacobianWrtVariable

        plant, world = self.plant, self.plant.world_frame()
        centre = self._hand.body().CalcCenterOfMassInBodyFrame(self._context)
        return np.asarray(
            plant.CalcJacobianTranslationalVelocity(
                self._context, JacobianWrtVariable.kV, self._hand, centre, world, world
            )
        )

    def _set(self, q: Array, v: Array) -> None:
        self.plant.SetPositions(self._context, q)
        self.plant.SetVelocities(self._context, v)


class DrakeEngine:
    """An arm with its drives; `sensed` is the coupling torque that joint sensors read."""

    def __init__(self, plan: Plan) -> None:
        """Builds the equations of a plan's true arm."""
        self._true = Rigid(plan.links, plan.hand, plan.gravity)
        self.believed = Rigid(plan.believed, plan.hand, np.array([0.0, 0.0, -9.81]))
        self._joints, self._rigid, n = plan.joints, plan.rigid, plan.reference.shape[1]
        self.q, self.v, self.theta, self.w = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        self._speeding, self.sensed = np.zeros(n), np.zeros(n)

    def start(self, q: Array, v: Array) -> None:
        """Puts the arm at a position and speed with its springs loaded by the weight."""
        joints = self._joints
        rest = self._true.torque(q, np.zeros(q.size), np.zeros(q.size))
        self.q, self.v = q.astype(float), v.astype(float)
        if self._rigid:
            self.theta, self.w = self.q, self.v
        else:
            self.theta = self.q + rest / joints.stiffness + 0.5 * np.sign(rest) * joints.gap
            self.w = self.v.copy()
        self.sensed[:] = rest

    def step(self, link: Array, motor: Array, levels: Array, force: Array) -> None:  # noqa: ARG002
        """Goes on by one step of the physics under torques on links and motors, and a force on the hand."""
        h = STEP
        middle, speed = self.q + 0.5 * h * self.v, self.v + 0.5 * h * self._speeding
        mass, bias = self._true.terms(middle, speed, force)
        after = (
            self._rigid_step(mass, bias, link, motor) if self._rigid else self._step(mass, bias, link, motor)
        )
        self._speeding = (after - self.v) / h
        self.q = self.q + 0.5 * h * (self.v + after)
        self.v = after
        if self._rigid:
            self.theta, self.w = self.q, self.v
        else:
            self.sensed[:] = self._joints.stiffness * self._stretch(self.theta - self.q)

    def _rigid_step(self, mass: Array, bias: Array, link: Array, motor: Array) -> Array:
        inertia, damping = self._joints.rotor_inertia, self._joints.motor_damping
        whole = mass + np.diag(inertia + 0.5 * STEP * damping)
        change = np.linalg.solve(whole, STEP * (link + motor - bias - damping * self.v))
        rotor = inertia * change / STEP + damping * (self.v + 0.5 * change)
        self.sensed[:] = motor - rotor
        return np.asarray(self.v + change)

    def _step(self, mass: Array, bias: Array, link: Array, motor: Array) -> Array:
        h, joints = STEP, self._joints
        length = self.theta - self.q
        inside = np.abs(length + 0.5 * h * (self.w - self.v)) < 0.5 * joints.gap
        stiffness = np.where(inside, 0.0, joints.stiffness)
        hard = 0.25 * h * stiffness + 0.5 * joints.damping  # of tau_s by the change of w - v
        now = stiffness * (length - 0.5 * joints.gap * np.sign(length) + 0.5 * h * (self.w - self.v))
        now = now + joints.damping * (self.w - self.v)
        rotor = joints.rotor_inertia / h + 0.5 * joints.motor_damping + hard
        push = motor - now - joints.motor_damping * self.w
        whole = mass / h + np.diag(hard - hard * hard / rotor)
        change = np.linalg.solve(whole, link - bias + now + hard * push / rotor)
        turn = (push + hard * change) / rotor
        self.theta = self.theta + h * (self.w + 0.5 * turn)
        self.w = self.w + turn
        return np.asarray(self.v + change)

    def _stretch(self, length: Array) -> Array:
        return np.asarray(np.sign(length) * np.maximum(np.abs(length) - 0.5 * self._joints.gap, 0.0))


def _add(plant: MultibodyPlant, parent: object, link: Link) -> object:
    body = plant.AddRigidBody(link.name, _inertia(link))
    place = RigidTransform(RollPitchYaw(*link.rpy), link.position)
    if link.joint is None:
        plant.AddJoint(WeldJoint(f"weld_{link.name}", parent, body.body_frame(), place))
    else:
        mount = plant.AddFrame(FixedOffsetFrame(f"mount_{link.name}", parent, place))
        plant.AddJoint(RevoluteJoint(link.joint, mount, body.body_frame(), link.axis))
    return body.body_frame()


def _inertia(link: Link) -> SpatialInertia:
    part = link.inertial
    if part is None or part.mass <= 0.0:
        return SpatialInertia.Zero()
    tensor, m = part.inertia, part.mass
    moments = (tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2])
    unit = UnitInertia(*(number / m for number in moments))
    about = unit.ShiftFromCenterOfMass(part.com)
    return SpatialInertia(m, part.com, about, skip_validity_check=True)
