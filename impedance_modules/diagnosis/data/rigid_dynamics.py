# SPDX-License-Identifier: BSD-3-Clause
r"""Inverse dynamics of all samples at once, linear in the bodies' inertial parameters.

The recursive Newton-Euler equations, outwards for each body's motion and inwards for its wrench:

    f = m \ddot p + \dot\omega \times mc + \omega \times (\omega \times mc)
    n = I \dot\omega + \omega \times I \omega + mc \times \ddot p,          \tau_j = s_j \cdot n  (or s_j \cdot f)

with gravity as an acceleration of the base. Each wrench is kept as a matrix over the ten parameters, so that
\tau = Y(q, v, a) \pi. Written for arrays of samples: a minute of a seven-joint arm takes tens of milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.rigid_tree import Body, RigidTree
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.spec.robot_spec import UPRIGHT_GRAVITY


class BatchedRigidModel(RigidModel):
    """The effects' `RigidModel`, computed for all samples at once: the same numbers, many times faster.

    Attributes:
        tree: The rigid bodies.
    """

    tree: RigidTree
    _kept: tuple[tuple[Array, Array, Array], Array] | None = None
    _keeping: bool = False

    @classmethod
    def of_tree(cls, urdf: Path, tree: RigidTree) -> BatchedRigidModel:
        """Takes a URDF and its tree of recorded joints."""
        model = cls.from_urdf(urdf, tree.joints)
        if not isinstance(model, BatchedRigidModel):
            raise TypeError("RigidModel.from_urdf builds the class it is called on")
        model.tree = tree
        return model

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Computes ID(q, v, a), (N, n) [N.m]."""
        return inverse_dynamics(self.tree, q, v, a)

    def weight(self, q: Array) -> Array:
        """Computes g(q), (N, n) [N.m]."""
        rest = np.zeros_like(q)
        return inverse_dynamics(self.tree, q, rest, rest)

    def weight_columns(self, q: Array) -> Array:
        """Computes dg(q) / d(gravity), (N, n, 3): the weight is linear in gravity's acceleration."""
        rest = np.zeros_like(q)
        return np.stack([inverse_dynamics(self.tree, q, rest, rest, axis) for axis in np.eye(3)], axis=2)

    def body_columns(self, body: str, q: Array, v: Array, a: Array) -> Array:
        r"""Computes d ID / d\pi of a link, (N, n, 10)."""
        links = [item.link for item in self.tree.bodies]
        if body not in links:
            return super().body_columns(body, q, v, a)
        first = 10 * links.index(body)
        return self._whole(q, v, a)[:, :, first : first + 10]

    def body_inertia(self, body: str) -> Array:
        """Ten nominal inertial parameters of what moves with a link."""
        links = [item.link for item in self.tree.bodies]
        return self.tree.bodies[links.index(body)].inertia if body in links else super().body_inertia(body)

    def link_inertia(self, link: str) -> Array:
        """Ten nominal inertial parameters of a link itself, without what is fixed to it."""
        links = [item.link for item in self.tree.bodies]
        return self.tree.bodies[links.index(link)].own if link in links else super().link_inertia(link)

    @contextmanager
    def remembering(self) -> Iterator[None]:
        """Keeps the regressor (N, n, 10 n) of the motion that is used next; it is too large to be kept for longer."""
        self._keeping = True
        try:
            yield
        finally:
            self._kept, self._keeping = None, False

    def _whole(self, q: Array, v: Array, a: Array) -> Array:
        motion = (q, v, a)
        if self._kept is not None and all(old is new for old, new in zip(self._kept[0], motion, strict=True)):
            return self._kept[1]
        whole = inertial_regressor(self.tree, q, v, a)
        if self._keeping and self._kept is None:
            self._kept = (motion, whole)
        return whole


def inverse_dynamics(tree: RigidTree, q: Array, v: Array, a: Array, gravity: Array | None = None) -> Array:
    r"""Computes Y \pi without Y, (N, n) [N.m]: each body's wrench is added to its carrier's on the way inwards.

    Takes what `inertial_regressor` takes.
    """
    turns, shifts, motions = _outwards(tree, q, v, a, gravity)
    wrenches = [_own_wrench(body.inertia, *motion) for body, motion in zip(tree.bodies, motions, strict=True)]
    torque = np.zeros(q.shape)
    for index in reversed(range(len(tree.bodies))):
        body, (force, moment) = tree.bodies[index], wrenches[index]
        torque[:, index] = (force if body.prismatic else moment) @ body.axis
        if body.parent is None:
            continue
        turn, (carried, turning) = turns[index], wrenches[body.parent]
        passed = np.einsum("nij,nj->ni", turn, force)
        twisted = np.einsum("nij,nj->ni", turn, moment) + _cross(shifts[index], passed)
        wrenches[body.parent] = (carried + passed, turning + twisted)
    return torque


def inertial_regressor(tree: RigidTree, q: Array, v: Array, a: Array, gravity: Array | None = None) -> Array:
    r"""Computes Y with \tau = Y \pi: torque that carries and accelerates the bodies.

    Args:
        tree: n bodies.
        q: (N, n) positions [rad].
        v: (N, n) velocities [rad/s].
        a: (N, n) accelerations [rad/s^2].
        gravity: (3,) [m/s^2]; None takes `UPRIGHT_GRAVITY`.

    Returns:
        (N, n, 10 n) [N.m per parameter].
    """
    samples, n = q.shape
    turns, shifts, motions = _outwards(tree, q, v, a, gravity)
    regressor = np.zeros((samples, n, 10 * n))
    for index in range(n):
        force, moment = _wrench(*motions[index])
        here: int | None = index
        while here is not None:
            body = tree.bodies[here]
            part = force if body.prismatic else moment
            regressor[:, here, 10 * index : 10 * index + 10] = np.einsum("i,nik->nk", body.axis, part)
            force = turns[here] @ force
            moment = turns[here] @ moment + np.cross(shifts[here][:, :, None], force, axis=1)
            here = body.parent
    return regressor


def gravity_regressor(tree: RigidTree, q: Array) -> Array:
    """Computes the static part of `inertial_regressor`, (N, n, 10 n)."""
    return inertial_regressor(tree, q, np.zeros_like(q), np.zeros_like(q))


def mass_matrix(tree: RigidTree, q: Array) -> Array:
    """Computes the links' inertia M(q) column by column, (N, n, n) [kg.m^2]."""
    samples, n = q.shape
    columns = []
    for index in range(n):
        unit = np.zeros((samples, n))
        unit[:, index] = 1.0
        columns.append(inverse_dynamics(tree, q, np.zeros_like(q), unit, np.zeros(3)))
    return np.stack(columns, axis=2)


def _outwards(
    tree: RigidTree, q: Array, v: Array, a: Array, gravity: Array | None
) -> tuple[list[Array], list[Array], list[tuple[Array, Array, Array]]]:
    """Placements of all bodies in their carriers, and their motions."""
    samples = len(q)
    field = np.array(UPRIGHT_GRAVITY) if gravity is None else gravity
    base = (np.zeros((samples, 3)), np.zeros((samples, 3)), np.tile(-field, (samples, 1)))
    turns: list[Array] = []
    shifts: list[Array] = []
    motions: list[tuple[Array, Array, Array]] = []
    for index, body in enumerate(tree.bodies):
        turn, shift = _placement(body, q[:, index])
        carrier = base if body.parent is None else motions[body.parent]
        motions.append(_motion(body, carrier, turn, shift, v[:, index], a[:, index]))
        turns.append(turn)
        shifts.append(shift)
    return turns, shifts, motions


def _placement(body: Body, q: Array) -> tuple[Array, Array]:
    """Rotation (N, 3, 3) and translation (N, 3) of the body in its carrier."""
    if body.prismatic:
        turn = np.broadcast_to(body.rotation, (len(q), 3, 3))
        return turn, body.translation + np.outer(q, body.rotation @ body.axis)
    K = _skew(body.axis[None])[0]
    sine, cosine = np.sin(q)[:, None, None], np.cos(q)[:, None, None]
    turn = body.rotation @ (np.eye(3) + sine * K + (1.0 - cosine) * (K @ K))
    return turn, np.broadcast_to(body.translation, (len(q), 3))


def _motion(
    body: Body, carrier: tuple[Array, Array, Array], turn: Array, shift: Array, v: Array, a: Array
) -> tuple[Array, Array, Array]:
    """Angular velocity, angular acceleration and acceleration of the origin, in the body's axes."""
    omega, alpha, acceleration = carrier
    moved = acceleration + _cross(alpha, shift) + _cross(omega, _cross(omega, shift))
    omega, alpha, moved = (np.einsum("nji,nj->ni", turn, x) for x in (omega, alpha, moved))
    along_v, along_a = np.outer(v, body.axis), np.outer(a, body.axis)
    if body.prismatic:
        return omega, alpha, moved + along_a + 2.0 * _cross(omega, along_v)
    return omega + along_v, alpha + along_a + _cross(omega, along_v), moved


def _wrench(omega: Array, alpha: Array, acceleration: Array) -> tuple[Array, Array]:
    """Force and moment of one body as (N, 3, 10) over its parameters."""
    spin = _skew(omega)
    force = np.zeros((len(omega), 3, 10))
    moment = np.zeros((len(omega), 3, 10))
    force[:, :, 0] = acceleration
    force[:, :, 1:4] = _skew(alpha) + spin @ spin
    moment[:, :, 1:4] = -_skew(acceleration)
    moment[:, :, 4:] = _second(alpha) + spin @ _second(omega)
    return force, moment


def _own_wrench(inertia: Array, omega: Array, alpha: Array, acceleration: Array) -> tuple[Array, Array]:
    """Force and moment (N, 3) that move one body of known parameters (10,)."""
    mass, first = inertia[0], np.broadcast_to(inertia[1:4], omega.shape)
    xx, xy, yy, xz, yz, zz = inertia[4:]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    force = mass * acceleration + _cross(alpha, first) + _cross(omega, _cross(omega, first))
    moment = alpha @ tensor + _cross(omega, omega @ tensor) + _cross(first, acceleration)
    return force, moment


def _cross(x: Array, y: Array) -> Array:
    """Cross products of rows (N, 3); several times as fast as the general one."""
    out = np.empty(np.broadcast_shapes(x.shape, y.shape))
    out[:, 0] = x[:, 1] * y[:, 2] - x[:, 2] * y[:, 1]
    out[:, 1] = x[:, 2] * y[:, 0] - x[:, 0] * y[:, 2]
    out[:, 2] = x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]
    return out


def _skew(x: Array) -> Array:
    out = np.zeros((len(x), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -x[:, 2], x[:, 1], -x[:, 0]
    return out - out.transpose(0, 2, 1)


def _second(x: Array) -> Array:
    """L(x) with I x = L(x) (I_xx, I_xy, I_yy, I_xz, I_yz, I_zz)."""
    out = np.zeros((len(x), 3, 6))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 3] = x.T
    out[:, 1, 1], out[:, 1, 2], out[:, 1, 4] = x.T
    out[:, 2, 3], out[:, 2, 4], out[:, 2, 5] = x.T
    return out
