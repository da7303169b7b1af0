# SPDX-License-Identifier: BSD-3-Clause
"""How a hinge begins: its geometry from the object's start, its bearing deflected by what it carries there.

The start is at rest: the bearing carries the object's weight and whatever wrench the hands leave over, friction holds
what it can of the torque about the axis. What is left turns the object, until the hands' springs hold it.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.modules.hinge import axis_frame, turned
from impedance_modules.plant.hinge_forces import (
    BEARING_ANGULAR_STIFFNESS,
    BEARING_DAMPING_TIME,
    BEARING_LINEAR_STIFFNESS,
    FRICTION_STIFFNESS,
    STOP_STIFFNESS,
    HingeState,
)
from impedance_modules.plant.rigid_object import ObjectBody, ObjectState
from impedance_modules.records import Matrix, Table, Vector
from impedance_modules.robot.pose import carry
from impedance_modules.robot.rotation import exp3


def hinge_state(held: ObjectBody | None) -> HingeState:
    """Makes an object's hinge, or its absence; ``load_hinge`` puts it where the object starts."""
    spec = None if held is None else held.spec.hinge
    known = spec is not None
    state = HingeState(
        present=known,
        point=np.zeros(3),
        frame=np.eye(3),
        mount_point=np.zeros(3),
        mount_rotation=np.eye(3),
        friction=0.0 if spec is None else spec.friction,
        friction_rest=0.0,
        damping=0.0 if spec is None else spec.damping,
        stiffness=0.0 if spec is None else spec.stiffness,
        rest=0.0 if spec is None else spec.rest,
        lower=-math.inf if spec is None else spec.lower,
        upper=math.inf if spec is None else spec.upper,
        angle=0.0,
        torque=0.0,
        wrench=np.zeros(6),
    )
    if spec is not None:
        state.point[:] = spec.point
        state.frame[:] = np.ascontiguousarray(axis_frame(np.array(spec.axis, dtype=float)))
    return state


def load_hinge(
    hinge: HingeState, held: ObjectBody, body: ObjectState, position: Vector, hands: Table, on_hands: Matrix
) -> None:
    """Puts the hinge at the object's start, loaded with weight and the hands' wrenches.

    Args:
        hinge: Overwritten.
        held: With the hinge's angle at the start.
        body: The object, where it starts.
        position: (3,) of its origin in world [m].
        hands: The holding hands, placed.
        on_hands: (h, 6) wrench of the object on each hand [N], [N.m].
    """
    if held.spec.hinge is None:
        return
    rotation, axis = body.rotation, hinge.frame[:, 2]
    load = np.concatenate([body.mass * body.gravity, np.zeros(3)])
    for hand, wrench in zip(hands, on_hands, strict=True):
        load -= carry(hand["translation"] - position).T @ wrench
    load = carry(position - hinge.point).T @ load
    across = load[3:] - (load[3:] @ axis) * axis
    hinge.mount_point[:] = rotation.T @ (hinge.point + load[:3] / BEARING_LINEAR_STIFFNESS - position)
    at_start = hinge.frame @ turned(held.spec.hinge.angle)
    hinge.mount_rotation[:] = rotation.T @ _tilted(across / BEARING_ANGULAR_STIFFNESS) @ at_start
    hinge.angle = held.spec.hinge.angle
    turning = float(load[3:] @ axis) - hinge.stiffness * (hinge.angle - hinge.rest)
    hinge.friction_rest = (
        hinge.angle - float(np.clip(turning, -hinge.friction, hinge.friction)) / FRICTION_STIFFNESS
    )


def _tilted(sine: Vector) -> Matrix:
    """Gives the rotation (3, 3) about a vector whose length is the sine of the angle."""
    length = float(np.linalg.norm(sine))
    return exp3(sine if length == 0.0 else sine * (math.asin(min(1.0, length)) / length))


def hinge_mode(hinge: HingeState, mobility: Matrix) -> complex:
    """Bounds the fastest mode [1/s] of the object, with its mobility (6, 6) in its own axes, on its hinge alone."""
    at_point = carry(hinge.mount_point)
    about = BEARING_ANGULAR_STIFFNESS + STOP_STIFFNESS + FRICTION_STIFFNESS + hinge.stiffness
    root = np.sqrt(np.repeat([BEARING_LINEAR_STIFFNESS, about], 3))
    lightness = at_point @ mobility @ at_point.T
    squared = float(np.linalg.eigvalsh(root[:, None] * lightness * root)[-1])
    damped = 0.5 * BEARING_DAMPING_TIME * squared
    return complex(-damped, math.sqrt(max(0.0, squared - damped**2)))
