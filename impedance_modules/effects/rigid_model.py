# SPDX-License-Identifier: BSD-3-Clause
r"""The rigid model of the links as the diagnosis needs it: torque, and what it is linear in.

    ID(q, v, a) = M(q) a + C(q, v) v + g(q) = Y(q, v, a) \pi

without rotors; \pi are ten numbers per body (mass, first moments, inertia at the body's origin). Joints may
be revolute, continuous or prismatic. Every method takes whole recordings, (N, n), one sample per row.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput, nearest
from impedance_modules.robot.description import name_apart, rigid_model
from impedance_modules.robot.model import RobotModel

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def sliding_joints(model: pin.Model) -> NDArray[np.bool_]:
    """Finds which velocities of a model (nv,) are those of prismatic joints."""
    out = np.zeros(model.nv, dtype=bool)
    for joint in model.joints[1:]:
        out[joint.idx_v] = joint.shortname().startswith(
            ("JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPrismatic")
        )
    return out


class RigidModel:
    """Inverse dynamics of the links and its derivatives, sample by sample.

    Attributes:
        joint_names: Names of the n joints, in the order of every column.
        bodies: Links that the joints move or carry.
        gravity: Acceleration [m/s^2] in the robot's base axes.
        sliding: (n,) whether a joint is prismatic.
    """

    def __init__(self, model: pin.Model, joint_names: Sequence[str]) -> None:
        """Takes a pinocchio model whose joints are exactly those named, in any order."""
        self._model = pin.Model(model)
        self._model.armature = np.zeros(model.nv)
        self._data = self._model.createData()
        self.joint_names = tuple(joint_names)
        ids = [self._model.getJointId(name) for name in self.joint_names]
        self._columns = np.array([self._model.joints[i].idx_v for i in ids], dtype=np.intp)
        self._places = [(self._model.joints[i].idx_q, self._model.joints[i].nq) for i in ids]
        self.sliding = sliding_joints(self._model)[self._columns]
        self.bodies = tuple(
            frame.name
            for frame in self._model.frames
            if frame.type == pin.FrameType.BODY and frame.parentJoint > 0
        )

    def __getstate__(self) -> dict[str, Any]:
        """What another process is sent: what pinocchio computes with is made there."""
        return {name: value for name, value in self.__dict__.items() if name != "_data"}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Takes what was sent."""
        self.__dict__.update(state)
        self._data = self._model.createData()

    @classmethod
    def of_robot(cls, model: RobotModel) -> RigidModel:
        """Takes the links of a robot folder, all its joints."""
        return cls(model.pin_model, model.joint_names)

    @classmethod
    def from_urdf(cls, urdf: Path, joint_names: Sequence[str]) -> RigidModel:
        """Reads a URDF and keeps the named joints; every other joint is fixed at its neutral angle.

        Raises:
            BadInput: The file is no URDF, or lacks a joint.
        """
        full = rigid_model(urdf)
        known = tuple(full.names)[1:]
        for name in joint_names:
            if name not in known:
                raise BadInput(
                    f"{urdf}: has no joint '{name}'{nearest(name, known)} (valid: {', '.join(known)})"
                )
        others = [full.getJointId(name) for name in known if name not in joint_names]
        name_apart(full, others)
        try:
            reduced = pin.buildReducedModel(full, others, pin.neutral(full))
        except (ValueError, RuntimeError) as error:  # two frames of one name, say
            raise BadInput(f"{urdf}: its joints cannot be fixed: {error}") from None
        return cls(reduced, joint_names)

    def body_inertia(self, body: str) -> Array:
        """Ten nominal inertial parameters of what moves with a link, about the link's origin and in its axes."""
        frame = self._model.frames[self._model.getFrameId(body, pin.FrameType.BODY)]
        return np.asarray(
            frame.placement.actInv(self._model.inertias[frame.parentJoint]).toDynamicParameters()
        )

    def link_inertia(self, link: str) -> Array:
        """Ten nominal inertial parameters of a link itself, without what is fixed to it, where that is known apart."""
        return self.body_inertia(link)

    @property
    def gravity(self) -> Array:
        """Gravity's acceleration (3,) in base axes [m/s^2]."""
        return np.array(self._model.gravity.linear)

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Computes ID(q, v, a), (N, n) [N.m]."""
        out = np.empty_like(q)
        for i, (x, u, w) in enumerate(self._rows(q, v, a)):
            out[i] = pin.rnea(self._model, self._data, x, u, w)[self._columns]
        return out

    def weight(self, q: Array) -> Array:
        """Computes g(q), (N, n) [N.m]."""
        still = np.zeros_like(q)
        return self.torque(q, still, still)

    def weight_columns(self, q: Array) -> Array:
        """Computes dg(q) / d(gravity), (N, n, 3): the weight is linear in gravity's acceleration."""
        axes = pin.Model(self._model)
        out = np.empty((*q.shape, 3))
        still = np.zeros(self._model.nv)
        for axis in range(3):
            axes.gravity.linear = np.eye(3)[axis]
            for i, (x, _, _) in enumerate(self._rows(q, q, q)):
                out[i, :, axis] = pin.rnea(axes, self._data, x, still, still)[self._columns]
        return out

    def position_derivative(self, q: Array, v: Array, a: Array) -> Array:
        """Computes d ID / dq, (N, n, n); entry [:, i, j] is joint i's torque by joint j's angle."""
        out = np.empty((*q.shape, q.shape[1]))
        pick = np.ix_(self._columns, self._columns)
        for i, (x, u, w) in enumerate(self._rows(q, v, a)):
            pin.computeRNEADerivatives(self._model, self._data, x, u, w)
            out[i] = self._data.dtau_dq[pick]
        return out

    def inertia_diagonal(self, q: Array) -> Array:
        """Computes the diagonal of M(q), (N, n) [kg.m^2]."""
        out = np.empty_like(q)
        for i, (x, _, _) in enumerate(self._rows(q, q, q)):
            out[i] = np.diag(pin.crba(self._model, self._data, x))[self._columns]
        return out

    def body_columns(self, body: str, q: Array, v: Array, a: Array) -> Array:
        r"""Computes d ID / d\pi of a link, (N, n, 10).

        \pi = (m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) in the link's frame, inertia at its
        origin.

        Raises:
            BadInput: The robot has no such link, or it never moves.
        """
        frame = self._model.frames[self._frame(body)]
        onto_joint = _carried(frame.placement)
        first = 10 * (frame.parentJoint - 1)
        out = np.empty((*q.shape, 10))
        for i, (x, u, w) in enumerate(self._rows(q, v, a)):
            whole = pin.computeJointTorqueRegressor(self._model, self._data, x, u, w)
            out[i] = whole[self._columns, first : first + 10] @ onto_joint
        return out

    def place(self, body: str, q: Array) -> Array:
        """Computes where a link's origin is in base axes, (N, 3) [m]."""
        index = self._frame(body)
        out = np.empty((len(q), 3))
        for i, (x, _, _) in enumerate(self._rows(q, q, q)):
            pin.forwardKinematics(self._model, self._data, x)
            out[i] = pin.updateFramePlacement(self._model, self._data, index).translation
        return out

    def rotation(self, body: str, q: Array) -> Array:
        """Rotation (N, 3, 3) from a link's axes to the base's."""
        frame, out = self._frame(body), np.empty((len(q), 3, 3))
        for i, (row, _, _) in enumerate(self._rows(q, q, q)):
            pin.framesForwardKinematics(self._model, self._data, row)
            out[i] = self._data.oMf[frame].rotation
        return out

    def jacobian(self, body: str, q: Array) -> Array:
        """Computes J of a link's origin in base axes, (N, 6, n), linear then angular."""
        index = self._frame(body)
        out = np.empty((q.shape[0], 6, q.shape[1]))
        for i, (x, _, _) in enumerate(self._rows(q, q, q)):
            J = pin.computeFrameJacobian(self._model, self._data, x, index, WORLD_AXES)
            out[i] = J.reshape(6, -1)[:, self._columns]  # of one joint the library gives (6,)
        return out

    def point_jacobian(self, body: str, point: Array, q: Array) -> Array:
        """Computes J (N, 3, n) of a point (3,) [m] in a link's frame, linear, in base axes."""
        return np.asarray(self.rotation(body, q) @ self._at_point(self._own_jacobian(body, q), point)[:, :3])

    def centre(self, body: str) -> Array:
        """Gives a link's nominal centre of mass (3,) in its frame [m]; its origin if it has no mass.

        Of a link that is fixed to another, its own; of one that a joint moves, as `link_inertia`.
        """
        own = self._model.frames[self._frame(body)].inertia
        if own.mass > 0.0:
            return np.array(own.lever)
        mass, *first = self.link_inertia(body)[:4]
        return np.array(first) / mass if mass > 0.0 else np.zeros(3)

    def weight_of_body(self, body: str, q: Array) -> Array:
        r"""Computes d g / d(m, m c_x, m c_y, m c_z) of a link, (N, n, 4), in its frame.

        Raises:
            BadInput: The robot has no such link, or it never moves.
        """
        still = np.zeros_like(q)
        return self.body_columns(body, q, still, still)[:, :, :4]

    def motion_of_point(self, body: str, point: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Computes J (N, 3, n) and velocity (N, 3) [m/s] of a point fixed to a link, all in the link's axes."""
        J = self._at_point(self._own_jacobian(body, q), point)[:, :3]
        return J, np.einsum("ijk,ik->ij", J, v)

    def taken_along(self, body: str, point: Array, q: Array, v: Array, a: Array) -> Array:
        r"""Computes the torque per unit of each diagonal entry of an added mass, (N, n, 6).

        J^T (E a_c + v_c x* E v_c), E = 1 at one entry of (linear, angular) in the link's axes at a point of it;
        a_c is the spatial acceleration there, without gravity (Kirchhoff's equations).
        """
        index, count = self._frame(body), len(self.joint_names)
        twist, rate, J = np.empty((len(q), 6)), np.empty((len(q), 6)), self._own_jacobian(body, q)
        for i, (x, u, w) in enumerate(self._rows(q, v, a)):
            pin.forwardKinematics(self._model, self._data, x, u, w)
            own = pin.ReferenceFrame.LOCAL
            twist[i] = pin.getFrameVelocity(self._model, self._data, index, own).vector
            rate[i] = pin.getFrameAcceleration(self._model, self._data, index, own).vector
        J = self._at_point(J, point)
        twist, rate = (self._at_point(x[:, :, None], point)[:, :, 0] for x in (twist, rate))
        out = np.empty((len(q), count, 6))
        for k, unit in enumerate(np.eye(6)):
            momentum, force = twist[:, [k]] * unit, rate[:, [k]] * unit
            force[:, :3] += np.cross(twist[:, 3:], momentum[:, :3])
            force[:, 3:] += np.cross(twist[:, 3:], momentum[:, 3:]) + np.cross(twist[:, :3], momentum[:, :3])
            out[:, :, k] = np.einsum("ijk,ij->ik", J, force)
        return out

    def _own_jacobian(self, body: str, q: Array) -> Array:
        """Computes J of a link's origin in its own axes (N, 6, n)."""
        index = self._frame(body)
        out = np.empty((len(q), 6, q.shape[1]))
        for i, (x, _, _) in enumerate(self._rows(q, q, q)):
            J = pin.computeFrameJacobian(self._model, self._data, x, index, pin.ReferenceFrame.LOCAL)
            out[i] = J.reshape(6, -1)[:, self._columns]  # of one joint the library gives (6,)
        return out

    @staticmethod
    def _at_point(motion: Array, point: Array) -> Array:
        """Moves the columns of motions (N, 6, k) of a link's origin to a point of it, its axes kept."""
        linear = motion[:, :3] + np.cross(motion[:, 3:], point[None, :, None], axis=1)
        return np.concatenate([linear, motion[:, 3:]], axis=1)

    def _frame(self, body: str) -> int:
        if body not in self.bodies:
            raise BadInput(
                f"the robot moves no link '{body}'{nearest(body, self.bodies)} (valid: {', '.join(self.bodies)})"
            )
        return int(self._model.getFrameId(body, pin.FrameType.BODY))

    def _rows(self, q: Array, v: Array, a: Array) -> Iterator[tuple[Array, Array, Array]]:
        """Walks through the samples in pinocchio's own order and coordinates."""
        x, u, w = np.zeros(self._model.nq), np.zeros(self._model.nv), np.zeros(self._model.nv)
        for angles, speeds, pushes in zip(q, v, a, strict=True):
            for (place, size), angle in zip(self._places, angles, strict=True):
                # A continuous joint is a point on the unit circle.
                x[place : place + size] = angle if size == 1 else (np.cos(angle), np.sin(angle))
            u[self._columns], w[self._columns] = speeds, pushes
            yield x, u, w


def _carried(placement: pin.SE3) -> Array:
    """Gives the (10, 10) map of inertial parameters from a frame to the frame it is placed in."""
    out = np.empty((10, 10))
    T = placement.homogeneous
    for k, unit in enumerate(np.eye(10)):
        matrix = T @ pin.PseudoInertia.FromDynamicParameters(unit).toMatrix() @ T.T
        out[:, k] = pin.PseudoInertia.FromMatrix(matrix).toDynamicParameters()
    return out
