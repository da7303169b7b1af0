# SPDX-License-Identifier: BSD-3-Clause
r"""Motion of the links: the articulated-body algorithm in world axes.

All twists, wrenches and inertias are six numbers (linear, angular) or 6 x 6, in world axes and at the world's
origin, so that they add from link to link without being carried over. Outwards, for link i on joint axis S_i:

    v_i = v_p + S_i q'_i            c_i = v_i x (S_i q'_i)
    I_i = own spatial inertia       b_i = v_i x* I_i v_i

inwards, every link giving its parent what it does not yield to at its own joint:

    U = I^A S,  D = S . U + armature,  u = tau - S . b^A
    I^A_p += I^A - U U^T / D        b^A_p += b^A + I^A c + U (u - U . c) / D

and outwards again, from the base's a = -g:

    q'' = (u - U . (a_p + c)) / D   a_i = a_p + c + S_i q''

The armature is the reflected inertia I_r of a rigid joint's rotor; an elastic joint's rotor moves by itself.

A link under water takes some along: an added mass W_i, an inertia that is no rigid body's and has no weight
(Kirchhoff's equations): I_i grows by it, and b_i by W_i g, which cancels the weight that a falling base would give it.

Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 7.3. Pinocchio's ``aba`` is the same; a
test compares both. Here it stands in the plant's own language, so that a whole period is one call.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from impedance_modules.compiled import compiled
from impedance_modules.plant.joints import RIGID, joint_kind
from impedance_modules.records import Array3, Matrix, Row, Table, Vector, new_table
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import add_cross, compose, dot, exponential, turn

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

LINK = np.dtype(
    [
        ("parent", np.int64),
        ("rest_rotation", np.float64, (3, 3)),
        ("rest_translation", np.float64, (3,)),
        ("screw", np.float64, (6,)),
        ("armature", np.float64),
        ("mass", np.float64),
        ("centre", np.float64, (3,)),
        ("inertia", np.float64, (3, 3)),
        ("submerged", np.int64),
        ("added_mass", np.float64, (6, 6)),
        ("added_mass_world", np.float64, (6, 6)),
        ("joint_rotation", np.float64, (3, 3)),
        ("rotation", np.float64, (3, 3)),
        ("translation", np.float64, (3,)),
        ("axis", np.float64, (6,)),
        ("twist", np.float64, (6,)),
        ("velocity_product", np.float64, (6,)),
        ("momentum", np.float64, (6,)),
        ("centre_world", np.float64, (3,)),
        ("turned_inertia", np.float64, (3, 3)),
        ("articulated_inertia", np.float64, (6, 6)),
        ("bias_force", np.float64, (6,)),
        ("joint_force", np.float64, (6,)),
        ("joint_inertia", np.float64),
        ("joint_torque", np.float64),
        ("acceleration", np.float64, (6,)),
    ],
    align=True,
)
"""One link: its place on its parent at joint angle 0, its joint's screw and its inertia about its centre of mass,
and its added mass if ``submerged``, all in its own axes; then, in world axes, its pose and the algorithm's S, v, c, b,
I^A, U (``joint_force``), D (``joint_inertia``), u (``joint_torque``) and a.
"""


@compiled
def place_links(links: Table, position: Vector) -> None:
    """Writes each link's pose and its joint's axis at joint positions (n,) [rad]; row 0 is the world."""
    turned, around = np.empty((3, 3)), np.empty(3)
    for i in range(1, links.size):
        link, parent = links[i], links[links[i].parent]
        turn(parent.rotation, link.rest_translation, link.translation)
        compose(parent.rotation, link.rest_rotation, turned)
        for k in range(3):
            link.translation[k] += parent.translation[k]
            around[k] = link.screw[3 + k] * position[i - 1]
        exponential(around, link.joint_rotation)
        compose(turned, link.joint_rotation, link.rotation)
        turn(turned, link.screw[3:], link.axis[3:])
        turn(turned, link.screw[:3], link.axis[:3])
        for k in range(3):
            link.translation[k] += link.axis[k] * position[i - 1]
        add_cross(link.translation, link.axis[3:], link.axis[:3])


@compiled
def place_hands(plant: PlantState) -> None:
    """Writes each hand's pose and its Jacobian (6, n), world axes at the hand, from the links' poses."""
    hands, links = plant.hands, plant.links
    for h in range(hands.size):
        hand, link = hands[h], links[hands[h].link]
        turn(link.rotation, hand.mount_translation, hand.translation)
        compose(link.rotation, hand.mount_rotation, hand.rotation)
        for k in range(3):
            hand.translation[k] += link.translation[k]
        i = hand.link
        while i > 0:
            axis, column = links[i].axis, plant.jacobian[h, :, i - 1]
            for k in range(6):
                column[k] = axis[k]
            add_cross(axis[3:], hand.translation, column)
            i = links[i].parent


@compiled
def accelerate(links: Table, velocity: Vector, torque: Vector, acceleration: Vector) -> None:
    """Writes the joints' acceleration (n,) under a torque (n,) [N.m], the links placed already."""
    for i in range(1, links.size):
        _update_motion(links[i], links[links[i].parent], velocity[i - 1])
        if links[i].submerged:
            _cancel_water_weight(links[i], links[0])
    for i in range(links.size - 1, 0, -1):
        _pass_to_parent(links[i], links[links[i].parent], torque[i - 1])
    for i in range(1, links.size):
        link, parent = links[i], links[links[i].parent]
        rest = link.joint_torque
        for k in range(6):
            link.acceleration[k] = parent.acceleration[k] + link.velocity_product[k]
            rest -= link.joint_force[k] * link.acceleration[k]
        acceleration[i - 1] = rest / link.joint_inertia
        for k in range(6):
            link.acceleration[k] += link.axis[k] * acceleration[i - 1]


@compiled
def _update_motion(link: Row, parent: Row, speed: float) -> None:
    """Writes a link's twist v, its velocity product c, its inertia and its bias force b."""
    axis, twist, product = link.axis, link.twist, link.velocity_product
    for k in range(6):
        twist[k] = parent.twist[k] + axis[k] * speed
        product[k] = 0.0
    add_cross(twist[3:], axis[3:], product[3:])
    add_cross(twist[3:], axis[:3], product[:3])
    add_cross(twist[:3], axis[3:], product[:3])
    for k in range(6):
        product[k] *= speed
    _own_inertia(link)
    if link.submerged:
        _add_water_inertia(link)
    momentum, force = link.momentum, link.bias_force
    for r in range(6):
        total = 0.0
        for k in range(6):
            total += link.articulated_inertia[r, k] * twist[k]
        momentum[r], force[r] = total, 0.0
    add_cross(twist[3:], momentum[:3], force[:3])
    add_cross(twist[3:], momentum[3:], force[3:])
    add_cross(twist[:3], momentum[:3], force[3:])


@compiled
def _own_inertia(link: Row) -> None:
    """Writes a link's spatial inertia at the world's origin, [[m, -m [c]], [m [c], I - m [c] [c]]]."""
    inertia, turned, centre, mass = (
        link.articulated_inertia,
        link.turned_inertia,
        link.centre_world,
        link.mass,
    )
    turn(link.rotation, link.centre, centre)
    for k in range(3):
        centre[k] += link.translation[k]
    compose(link.rotation, link.inertia, turned)
    square = mass * dot(centre, centre)
    for r in range(3):
        for c in range(r + 1):
            inertia[r, c] = inertia[c, r] = 0.0
            value = dot(turned[r], link.rotation[c]) - mass * centre[r] * centre[c]
            inertia[3 + r, 3 + c] = inertia[3 + c, 3 + r] = value
        inertia[r, r] = mass
        inertia[3 + r, 3 + r] += square
        inertia[r, 3 + r] = inertia[3 + r, r] = 0.0
    x, y, z = mass * centre[0], mass * centre[1], mass * centre[2]
    inertia[3, 1] = inertia[1, 3] = -z
    inertia[3, 2] = inertia[2, 3] = y
    inertia[4, 0] = inertia[0, 4] = z
    inertia[4, 2] = inertia[2, 4] = -x
    inertia[5, 0] = inertia[0, 5] = -y
    inertia[5, 1] = inertia[1, 5] = x


@compiled
def _add_water_inertia(link: Row) -> None:
    """Adds X^T W X to a link's inertia, X = [[R^T, -R^T [p]], [0, R^T]] from the world's origin to its own axes."""
    R, p, W, out = link.rotation, link.translation, link.added_mass, link.added_mass_world
    X, half = np.zeros((6, 6)), np.zeros((6, 6))
    for r in range(3):
        for c in range(3):
            X[r, c] = X[3 + r, 3 + c] = R[c, r]
        X[r, 3] = R[2, r] * p[1] - R[1, r] * p[2]
        X[r, 4] = R[0, r] * p[2] - R[2, r] * p[0]
        X[r, 5] = R[1, r] * p[0] - R[0, r] * p[1]
    for r in range(6):
        for c in range(6):
            for k in range(6):
                half[r, c] += W[r, k] * X[k, c]
    for r in range(6):
        for c in range(6):
            total = 0.0
            for k in range(6):
                total += X[k, r] * half[k, c]
            out[r, c] = total
            link.articulated_inertia[r, c] += total


@compiled
def _cancel_water_weight(link: Row, world: Row) -> None:
    """Adds W g to a link's bias force; the world's acceleration is -g."""
    for r in range(6):
        for k in range(6):
            link.bias_force[r] -= link.added_mass_world[r, k] * world.acceleration[k]


@compiled
def _pass_to_parent(link: Row, parent: Row, torque: float) -> None:
    """Adds a link's articulated inertia and bias force to its parent's, less what its joint yields."""
    axis, push, inertia, product = (
        link.axis,
        link.joint_force,
        link.articulated_inertia,
        link.velocity_product,
    )
    along, rest, carried = link.armature, torque, 0.0
    for r in range(6):
        total = 0.0
        for c in range(6):
            total += inertia[r, c] * axis[c]
        push[r] = total
        along += axis[r] * total
        rest -= axis[r] * link.bias_force[r]
        carried += total * product[r]
    link.joint_inertia, link.joint_torque = along, rest
    if link.parent == 0:
        return
    handed, force, scale = parent.articulated_inertia, parent.bias_force, 1.0 / along
    for r in range(6):
        share, total = push[r] * scale, 0.0
        for c in range(6):
            total += inertia[r, c] * product[c]
            handed[r, c] += inertia[r, c] - share * push[c]
        force[r] += link.bias_force[r] + total + share * (rest - carried)


def link_model(model: RobotModel, gravity: Vector) -> pin.Model:
    """Builds the links alone: of the rotors only those fixed to their links, as armature.

    Args:
        model: The robot.
        gravity: (3,) acceleration in world axes [m/s^2].
    """
    links = pin.Model(model.pin_model)
    fixed = [joint_kind(joint) == RIGID for joint in model.joints]
    links.armature = np.where(fixed, model.reflected_inertia, 0.0)
    links.gravity.linear = gravity
    return links


def link_table(links: pin.Model, added_mass: Array3 | None = None) -> Table:
    """Tabulates the links, row 0 the world at rest and falling up; joint i moves row i + 1.

    Args:
        links: From ``link_model``.
        added_mass: (n, 6, 6) of water that each link takes along, in its joint's axes; None for none.
    """
    table = new_table(links.njoints, LINK)
    table["rotation"] = np.eye(3)
    table[0]["acceleration"][:3] = -links.gravity.linear
    data = links.createData()
    pin.computeJointJacobians(links, data, pin.neutral(links))
    for i in range(1, links.njoints):
        row, placement, body = table[i], links.jointPlacements[i], links.inertias[i]
        row["parent"], row["armature"] = links.parents[i], links.armature[i - 1]
        row["rest_rotation"], row["rest_translation"] = placement.rotation, placement.translation
        own_axes = pin.getJointJacobian(links, data, i, pin.ReferenceFrame.LOCAL)
        row["screw"] = own_axes.reshape(6, -1)[:, i - 1]
        row["mass"], row["centre"], row["inertia"] = body.mass, body.lever, body.inertia
        if added_mass is not None:
            row["added_mass"] = added_mass[i - 1]
            row["submerged"] = bool(added_mass[i - 1].any())
    return table


def water_inertia(links: pin.Model, table: Table, q: Vector) -> Matrix:
    """Sums sum J_i^T W_i J_i of the water that the links take along, (n, n) [kg.m^2]; without gravity."""
    data, total = links.createData(), np.zeros((links.nv, links.nv))
    pin.computeJointJacobians(links, data, q)
    for i in np.flatnonzero(table["submerged"]):
        J = pin.getJointJacobian(links, data, int(i), pin.ReferenceFrame.LOCAL)
        total += J.T @ table[i]["added_mass"] @ J
    return total


def mobility_under_water(links: pin.Model, table: Table, data: pin.Data, q: Vector) -> Matrix:
    """Computes (M + A)^-1 (n, n) of the links at q (n,), A of the water that they take along."""
    dry = np.array(pin.computeMinverse(links, data, q))
    if not table["submerged"].any():
        return dry
    water = water_inertia(links, table, q)
    return np.asarray(np.linalg.solve(np.eye(q.size) + dry @ water, dry))
