# SPDX-License-Identifier: BSD-3-Clause
r"""A palm that presses on a held object and keeps it by friction: slip, loss and new contact, without gain of energy.

The hand's origin stands at x = R^T (p_H - p) in the object's axes, d beneath the object's nearest face, counted as
``palm_offset`` further out; n points into the object. While d > 0 the force -N n + f and the moment t act on the hand:

    N = k d + min(max(c d', -k d), k d)
    f = cut(cut(k e, mu N) - c v_t, mu N)                           e = (1 - n n^T) R (s - x)
    t = cut(cut(k_r e_r, mu N r) + c_r (w_O - w_H), mu N r)         e_r = log(R R_OH R_H^T)

v_t is how fast the hand moves along the face, w_H and w_O how hand and object turn, r the palm's radius, and cut(y, b)
the vector nearest to y that is no longer than b. At d <= 0 there is no wrench. After each step the rest follows a palm
that has slipped: s and R_OH move until e <= mu N / k and e_r <= mu N r / k_r, N the least of the step; without contact
that is all the way, so that a palm that returns touches with relaxed friction springs.

Stored is U = k/2 max(0, d)^2 + k/2 e^2 + k_r/2 e_r^2 >= 0. Nothing gives more than U loses:

- d is continuous in x and depends on it alone, also across an edge, where another face becomes the nearest;
- N - k d has the sign of d', so normal damping takes energy, also where it is limited;
- with z = cut(k e, mu N), f is the point of the disc of radius mu N nearest to z - c v_t, and z lies in that disc:
  (f - z) . v_t <= 0, so tangential damping takes energy, also where friction limits it; t likewise;
- e and e_r only become shorter when the rest moves, and z . e' is at least what k/2 e^2 gains up to the least bound.

A face without an edge would let the lever p_H - p grow without end, and with it the mobility r^2 / I of the object
where it is touched: at 1.2 m a box of 1.2 kg on 300 kN/m vibrates too fast for a step of 0.25 ms.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.plant.rigid_object import ObjectState, depth_beneath_face
from impedance_modules.records import Matrix, Row, Vector
from impedance_modules.robot.rotation import add_cross, compose, dot, exponential, turn, turn_back

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState


@compiled
def place_palm(plant: PlantState, i: int) -> None:
    """Writes where palm i stands on the object at the step's start."""
    hand, position = plant.hands[i], plant.start.object_position
    for k in range(3):
        hand.lever[k] = hand.translation[k] - position[k]
    _meet_face(hand, plant.body, plant.body.rotation, hand.lever)


@compiled
def _meet_face(hand: Row, body: ObjectState, rotation: Matrix, lever: Vector) -> None:
    """Writes depth [m], normal, and the stretch of the friction spring along the face (3,), world axes [m]."""
    point, stretch = np.empty(3), np.empty(3)
    turn_back(rotation, lever, point)
    hand.depth = depth_beneath_face(body, hand.palm_offset, point, hand.normal)
    for k in range(3):
        stretch[k] = hand.rest_point[k] - point[k]
    along = dot(stretch, hand.normal)
    for k in range(3):
        stretch[k] -= along * hand.normal[k]
    turn(rotation, stretch, hand.deflection)


@compiled
def palm_wrench(plant: PlantState, i: int, lever: Vector) -> None:
    """Writes the wrench on palm i, and ``lever``, from the object's origin to where it acts [m]."""
    hand, held, displacement = plant.hands[i], plant.hands.size, plant.displacement
    for k in range(3):
        lever[k] = hand.lever[k] + displacement[i, k] - displacement[held, k]
    _meet_face(hand, plant.body, plant.body.rotation_now, lever)
    velocity, normal = np.zeros(3), np.empty(3)
    turn(plant.body.rotation_now, hand.normal, normal)
    add_cross(lever, plant.twist[held, 3:], velocity)
    for k in range(3):
        velocity[k] += plant.twist[i, k] - plant.twist[held, k]
    approach = dot(velocity, normal)
    push = hand.linear_stiffness * max(0.0, hand.depth)
    hand.normal_force = push + min(max(hand.linear_damping * approach, -push), push)
    hand.least_normal_force = min(hand.least_normal_force, hand.normal_force)
    if hand.normal_force > 0.0:
        for k in range(3):
            velocity[k] -= approach * normal[k]
        _friction(plant, i, velocity)
        for k in range(3):
            plant.grasp_wrench[i, k] -= hand.normal_force * normal[k]


@compiled
def _friction(plant: PlantState, i: int, slide: Vector) -> None:
    """Writes friction's force and moment on palm i, which moves along the face with a velocity (3,) [m/s]."""
    hand, held, wrench = plant.hands[i], plant.hands.size, plant.grasp_wrench[i]
    displacement, twist = plant.displacement, plant.twist
    bound = hand.friction * hand.normal_force
    for k in range(3):
        wrench[k] = hand.linear_stiffness * hand.deflection[k]
        angle = hand.angular_deflection[k] + displacement[held, 3 + k] - displacement[i, 3 + k]
        wrench[3 + k] = hand.angular_stiffness * angle
    _cut(wrench[:3], bound)
    _cut(wrench[3:], bound * hand.palm_radius)
    for k in range(3):
        wrench[k] -= hand.linear_damping * slide[k]
        wrench[3 + k] += hand.angular_damping * (twist[held, 3 + k] - twist[i, 3 + k])
    _cut(wrench[:3], bound)
    _cut(wrench[3:], bound * hand.palm_radius)


@compiled
def _cut(vector: Vector, longest: float) -> None:
    """Shortens a vector (3,) to a length."""
    share = _share_within(vector, longest)
    for k in range(3):
        vector[k] *= share


@compiled
def _share_within(vector: Vector, longest: float) -> float:
    """Gives the factor, at most 1, that makes a vector (3,) no longer than a length."""
    length = math.sqrt(dot(vector, vector))
    return longest / length if length > longest else 1.0


@compiled
def update_slipping_palms(plant: PlantState) -> None:
    """Moves the rest of palms: what deflects beyond the least bound of friction in the step becomes the new rest.

    Runs before ``update_object_rotation``, with the motion of the whole step.
    """
    hands, displacement, lever = plant.hands, plant.displacement, np.empty(3)
    held = hands.size
    for i in range(hands.size):
        hand = hands[i]
        if not (hand.holds and hand.slips):
            continue
        for k in range(3):
            lever[k] = hand.lever[k] + displacement[i, k] - displacement[held, k]
            hand.angular_deflection[k] += displacement[held, 3 + k] - displacement[i, 3 + k]
        _meet_face(hand, plant.body, plant.body.rotation_now, lever)
        bound = hand.friction * hand.least_normal_force
        _slip_along(hand, plant.body.rotation_now, lever, bound)
        _slip_about(hand, plant.body.rotation_now, bound * hand.palm_radius)


@compiled
def _slip_along(hand: Row, rotation: Matrix, lever: Vector, bound: float) -> None:
    """Shifts the rest point along the face, s becoming x + R^T e; friction bears at most ``bound`` [N]."""
    stretch, point = np.empty(3), np.empty(3)
    share = _share_within(hand.deflection, bound / hand.linear_stiffness)
    turn_back(rotation, lever, point)
    turn_back(rotation, hand.deflection, stretch)
    for k in range(3):
        hand.rest_point[k] = point[k] + share * stretch[k]


@compiled
def _slip_about(hand: Row, rotation: Matrix, bound: float) -> None:
    """Turns the rest rotation, R_OH becoming R^T exp(-excess) R R_OH; friction bears at most ``bound`` [N.m]."""
    share = _share_within(hand.angular_deflection, bound / hand.angular_stiffness)
    if share == 1.0:
        return
    excess, back = np.empty(3), np.empty(3)
    change, rest = np.empty((3, 3)), np.empty((3, 3))
    for k in range(3):
        excess[k] = (share - 1.0) * hand.angular_deflection[k]
    turn_back(rotation, excess, back)
    exponential(back, change)
    compose(change, hand.rest_rotation, rest)
    for r in range(3):
        for c in range(3):
            hand.rest_rotation[r, c] = rest[r, c]
