# SPDX-License-Identifier: BSD-3-Clause
r"""The hinge of an object in the plant: a stiff bearing, and what acts about its axis, without gain of energy.

The bearing is compliant, as the grasps are: the object keeps its six degrees of freedom and the integrator its state,
two arms and a bearing need no closed chain, and what the bearing carries is read from its deflection. Notation: a the
axis, P its point in the world, both fixed; s the bearing's point in the object's axes, p and R the object's pose, b the
axis of the object's side, \phi the angle between the two sides about a. On the object act at s

    F = -k e - d e',  e = p + R s - P           t = -k_r a x b - d_r (w - (w . a) a) + \tau c
    \tau = -k_s (\phi - \phi_0) - d_s \phi' - f + stops
    f = cut(cut(\sigma z, f_c) + d_f \phi', f_c),  z = \phi - \phi_f
    c = (a + b) / (1 + a . b),   \phi' = c . w

cut(y, h) the number nearest to y that is not beyond h. A stop is a spring-damper beyond its angle whose damper is never
stronger than its spring, so it neither pulls nor begins with a jump.
After each step \phi_f follows an angle that has slipped, until |z| <= f_c / \sigma.

Stored is U = k/2 e^2 + k_r (1 - a . b) + k_s/2 (\phi - \phi_0)^2 + \sigma/2 z^2 + stops >= 0; every term without a
damper is an exact derivative of it, c being that of \phi. Nothing gives more than U loses: dampers oppose their own
velocity; with y = cut(\sigma z, f_c), f is the point of [-f_c, f_c] nearest to y + d_f \phi', so (f - y) \phi' >= 0;
and z only becomes shorter when \phi_f moves.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Flag, Matrix, Record, Scalar, Vector
from impedance_modules.robot.rotation import add_cross, compose, turn, twist_angle

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

BEARING_LINEAR_STIFFNESS = 1e6
"""Of a bearing against moving its point [N/m]: three times that of a grasp."""

BEARING_ANGULAR_STIFFNESS = 2e4
"""Of a bearing against tilting its axis [N.m/rad]: four times that of a grasp."""

BEARING_DAMPING_TIME = 1e-4
"""Damping of a bearing over its stiffness [s], as of a grasp."""

FRICTION_STIFFNESS = 5e3
"""Of the spring through which a hinge that sticks holds its angle [N.m/rad]: 1 N.m turns it by 0.2 mrad."""

FRICTION_DAMPING_TIME = 1e-3
"""Damping of that spring over its stiffness [s]."""

STOP_STIFFNESS = 5e3
"""Of a stop [N.m/rad]."""

STOP_DAMPING_TIME = 1e-3
"""Damping of a stop over its stiffness [s]."""


class HingeState(Record):
    r"""The hinge of the object, or its absence.

    Attributes:
        present: Whether there is one.
        point: (3,) P in world [m].
        frame: (3, 3) R_WE of the hinge's frame at angle 0, z along the axis.
        mount_point: (3,) s, in the object's axes [m].
        mount_rotation: (3, 3) the same frame on the object's side, in its axes.
        friction, friction_rest: f_c [N.m] and \phi_f [rad].
        damping, stiffness, rest: d_s [N.m.s/rad], k_s [N.m/rad], \phi_0 [rad].
        lower, upper: Stops [rad].
        angle: \phi at the step's start [rad], beyond half a turn, too.
        torque: \tau of the last stage [N.m], on the object.
        wrench: (6,) of the last stage on the object at its origin, world axes [N], [N.m].
    """

    present: Flag
    point: Vector
    frame: Matrix
    mount_point: Vector
    mount_rotation: Matrix
    friction: Scalar
    friction_rest: Scalar
    damping: Scalar
    stiffness: Scalar
    rest: Scalar
    lower: Scalar
    upper: Scalar
    angle: Scalar
    torque: Scalar
    wrench: Vector


@compiled
def within(value: float, bound: float) -> float:
    """Gives the number nearest to a value that is not beyond a bound."""
    return min(max(value, -bound), bound)


@compiled
def relative_turn(hinge: HingeState, rotation: Matrix, out: Matrix) -> None:
    """Writes R_EH (3, 3), how the object's side of the hinge is turned where the object's rotation is R_WO."""
    held = np.empty((3, 3))
    compose(rotation, hinge.mount_rotation, held)
    for r in range(3):
        for c in range(3):
            out[r, c] = 0.0
            for k in range(3):
                out[r, c] += hinge.frame[k, r] * held[k, c]


@compiled
def angle_near(relative: Matrix, before: float) -> float:
    """Gives the angle about z of R_EH [rad], in the turn that is nearest to ``before``."""
    found = twist_angle(relative)
    return found + 2.0 * math.pi * round((before - found) / (2.0 * math.pi))


@compiled
def axis_torque(hinge: HingeState, angle: float, rate: float) -> float:
    """Gives what return spring, dampers, friction and stops exert on the object about the axis [N.m]."""
    held = within(FRICTION_STIFFNESS * (angle - hinge.friction_rest), hinge.friction)
    friction = within(held + FRICTION_STIFFNESS * FRICTION_DAMPING_TIME * rate, hinge.friction)
    torque = -hinge.stiffness * (angle - hinge.rest) - hinge.damping * rate - friction
    damped = STOP_STIFFNESS * STOP_DAMPING_TIME * rate
    if angle > hinge.upper:
        stop = STOP_STIFFNESS * (angle - hinge.upper)
        torque -= stop + within(damped, stop)
    if angle < hinge.lower:
        stop = STOP_STIFFNESS * (hinge.lower - angle)
        torque += stop - within(damped, stop)
    return torque


@compiled
def hinge_wrench(plant: PlantState) -> float:
    """Writes the hinge's wrench on the object at the stage; returns its power [W]."""
    hinge, body, held = plant.hinge, plant.body, plant.hands.size
    velocity, spin = plant.stage.object_velocity, plant.twist[held, 3:]
    relative, lever, rate = np.empty((3, 3)), np.empty(3), np.empty(3)
    relative_turn(hinge, body.rotation_now, relative)
    turn(body.rotation_now, hinge.mount_point, lever)
    wrench, local, own = hinge.wrench, np.empty(3), np.empty(3)
    for k in range(3):
        rate[k] = velocity[k]
    add_cross(spin, lever, rate)
    for k in range(3):
        away = plant.stage.object_position[k] + lever[k] - hinge.point[k]
        wrench[k] = -BEARING_LINEAR_STIFFNESS * (away + BEARING_DAMPING_TIME * rate[k])
        wrench[3 + k] = 0.0
        own[k] = hinge.frame[0, k] * spin[0] + hinge.frame[1, k] * spin[1] + hinge.frame[2, k] * spin[2]
    share = 1.0 / (1.0 + relative[2, 2])
    angle = angle_near(relative, hinge.angle)
    turning = own[2]
    for k in range(3):
        turning += relative[k, 2] * own[k]
    turning *= share
    hinge.torque = axis_torque(hinge, angle, turning)
    local[0] = relative[1, 2] - BEARING_DAMPING_TIME * own[0]
    local[1] = -relative[0, 2] - BEARING_DAMPING_TIME * own[1]
    local[2] = hinge.torque
    for k in range(2):
        local[k] = BEARING_ANGULAR_STIFFNESS * local[k] + hinge.torque * share * relative[k, 2]
    turn(hinge.frame, local, own)
    add_cross(lever, wrench[:3], wrench[3:])
    power = 0.0
    for k in range(3):
        wrench[3 + k] += own[k]
        power += wrench[k] * velocity[k] + wrench[3 + k] * spin[k]
    return power


@compiled
def add_hinge(plant: PlantState) -> None:
    """Adds the hinge's wrench to the rate of the object's velocity and momentum."""
    rate, wrench = plant.rate, plant.hinge.wrench
    for k in range(3):
        rate.object_velocity[k] += wrench[k] / plant.body.mass
        rate.object_momentum[k] += wrench[3 + k]


@compiled
def update_hinge(plant: PlantState) -> None:
    """Ends a step: takes over the angle, and lets the rest of friction follow an angle that has slipped.

    Runs before ``update_object_rotation``, with the motion of the whole step.
    """
    hinge, relative = plant.hinge, np.empty((3, 3))
    relative_turn(hinge, plant.body.rotation_now, relative)
    hinge.angle = angle_near(relative, hinge.angle)
    bent = within(hinge.angle - hinge.friction_rest, hinge.friction / FRICTION_STIFFNESS)
    hinge.friction_rest = hinge.angle - bent


@compiled
def hinge_energy(hinge: HingeState, rotation: Matrix, position: Vector) -> float:
    """Gives what the hinge stores [J] with the object at R_WO (3, 3) and p (3,) [m]."""
    relative, lever = np.empty((3, 3)), np.empty(3)
    relative_turn(hinge, rotation, relative)
    turn(rotation, hinge.mount_point, lever)
    square = 0.0
    for k in range(3):
        square += (position[k] + lever[k] - hinge.point[k]) ** 2
    angle = angle_near(relative, hinge.angle)
    # 1 - a . b of a tilt too small for the cosine to show.
    tilt = (relative[0, 2] ** 2 + relative[1, 2] ** 2) / (1.0 + relative[2, 2])
    stopped = max(angle - hinge.upper, 0.0) ** 2 + max(hinge.lower - angle, 0.0) ** 2
    stored = 0.5 * BEARING_LINEAR_STIFFNESS * square + BEARING_ANGULAR_STIFFNESS * tilt
    stored += 0.5 * hinge.stiffness * (angle - hinge.rest) ** 2 + 0.5 * STOP_STIFFNESS * stopped
    return float(stored + 0.5 * FRICTION_STIFFNESS * (angle - hinge.friction_rest) ** 2)
