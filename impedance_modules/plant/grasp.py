# SPDX-License-Identifier: BSD-3-Clause
r"""The stiff couplings by which hands hold a rigid object: welds, and palms that only friction keeps (``palm``).

A weld is an isotropic spring-damper on position and rotation, its force at the hand's origin [N], [N.m]:

    f = k e + d e',  e = p + R s - p_H        t = k_r e_r + d_r (w_O - w_H),  e_r = log(R R_OH R_H^T)

p, R, w_O the object's position, rotation and angular velocity, p_H, R_H, w_H the hand's, s and R_OH the coupling's
rest in the object's axes. On the object act the opposite force and moment, at the same point.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.plant.palm import palm_wrench, place_palm
from impedance_modules.records import Vector
from impedance_modules.robot.rotation import add_cross, compose, dot, logarithm, turn

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

GRASP_LINEAR_STIFFNESS = 3e5
"""Of the coupling between a hand and a held object [N/m]: a thousand times a task's 300 N/m."""

GRASP_ANGULAR_STIFFNESS = 5e3
"""Of the same coupling [N.m/rad]: several hundred times a task's 10 N.m/rad."""

GRASP_DAMPING_TIME = 1e-4
"""Damping of the coupling over its stiffness [s]: a tenth of critical at 2000 rad/s."""

PALM_RADIUS = 0.03
"""Of the patch through which a friction grasp passes torque, at most mu N PALM_RADIUS [m]."""

HAND = np.dtype(
    [
        ("link", np.int64),
        ("mount_translation", np.float64, (3,)),
        ("mount_rotation", np.float64, (3, 3)),
        ("holds", np.int64),
        ("slips", np.int64),
        ("translation", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("linear_stiffness", np.float64),
        ("angular_stiffness", np.float64),
        ("linear_damping", np.float64),
        ("angular_damping", np.float64),
        ("friction", np.float64),
        ("palm_radius", np.float64),
        ("palm_offset", np.float64),
        ("rest_point", np.float64, (3,)),
        ("rest_rotation", np.float64, (3, 3)),
        ("normal", np.float64, (3,)),
        ("lever", np.float64, (3,)),
        ("deflection", np.float64, (3,)),
        ("angular_deflection", np.float64, (3,)),
        ("depth", np.float64),
        ("normal_force", np.float64),
        ("least_normal_force", np.float64),
    ],
    align=True,
)
"""One hand: where it sits on its link, its pose at the step's start, and its coupling.

``rest_point`` is s and ``rest_rotation`` R_OH, ``normal`` points into the object, all in the object's axes; ``lever``
is R s, ``deflection`` e [m] and ``angular_deflection`` e_r [rad], at the step's start, world axes.

Of a palm that ``slips``, ``lever`` is p_H - p instead, ``deflection`` the stretch of its friction spring along the face
and ``depth`` how far it presses in [m]; its surface lies ``palm_offset`` before the hand's origin [m].
``least_normal_force`` is the smallest of the step's stages so far [N].
"""


@compiled
def place_couplings(plant: PlantState) -> None:
    """Writes each coupling's deflection at the step's start [m], [rad], exactly."""
    hands, body, position = plant.hands, plant.body, plant.start.object_position
    partly, relative = np.empty((3, 3)), np.empty((3, 3))
    for i in range(hands.size):
        hand = hands[i]
        if not hand.holds:
            continue
        compose(body.rotation, hand.rest_rotation, partly)
        for r in range(3):
            for c in range(3):
                relative[r, c] = dot(partly[r], hand.rotation[c])
        logarithm(relative, hand.angular_deflection)
        if hand.slips:
            hand.least_normal_force = math.inf
            place_palm(plant, i)
            continue
        turn(body.rotation, hand.rest_point, hand.lever)
        for k in range(3):
            hand.deflection[k] = position[k] + hand.lever[k] - hand.translation[k]


@compiled
def grasp_forces(plant: PlantState) -> float:
    """Adds each coupling's wrench to its hand and the object; returns the power they receive [W]."""
    hands, twist = plant.hands, plant.twist
    power, held = 0.0, hands.size
    lever = np.empty(3)
    for i in range(hands.size):
        hand = hands[i]
        if not hand.holds:
            continue
        if hand.slips:
            palm_wrench(plant, i, lever)
        else:
            _weld_wrench(plant, i, lever)
        force, reaction = plant.grasp_wrench[i], plant.grasp_wrench[held]
        for k in range(3):
            reaction[k] -= force[k]
            reaction[3 + k] -= force[3 + k]
            power += force[k] * twist[i, k] + force[3 + k] * (twist[i, 3 + k] - twist[held, 3 + k])
            power -= force[k] * twist[held, k]
        moment = np.zeros(3)
        add_cross(force[:3], lever, moment)
        for k in range(3):
            reaction[3 + k] += moment[k]
            power += moment[k] * twist[held, 3 + k]
    return power


@compiled
def _weld_wrench(plant: PlantState, i: int, lever: Vector) -> None:
    """Writes the wrench of a weld on hand i, and ``lever``, from the object's origin to where it acts [m]."""
    hand, held, displacement, twist = plant.hands[i], plant.hands.size, plant.displacement, plant.twist
    wrench, rate, deflection = plant.grasp_wrench[i], np.empty(3), np.empty(3)
    turn(plant.body.step_rotation, hand.lever, lever)
    for k in range(3):
        moved = displacement[held, k] + lever[k] - hand.lever[k] - displacement[i, k]
        deflection[k] = hand.deflection[k] + moved
        rate[k] = twist[held, k] - twist[i, k]
    add_cross(twist[held, 3:], lever, rate)
    for k in range(3):
        wrench[k] = hand.linear_stiffness * deflection[k] + hand.linear_damping * rate[k]
        angle = hand.angular_deflection[k] + displacement[held, 3 + k] - displacement[i, 3 + k]
        spin = twist[held, 3 + k] - twist[i, 3 + k]
        wrench[3 + k] = hand.angular_stiffness * angle + hand.angular_damping * spin
        lever[k] -= deflection[k]
