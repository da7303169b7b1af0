# SPDX-License-Identifier: BSD-3-Clause
r"""The rate of the plant's state: springs, rotors, stops, contact, grasp, object and links together.

    links    M(q) v' + C(q, v) + g(q) = tau_s + stops + effects + sum J_h^T (contact + grasp + push)  (thesis eq. 3.1)
    rotors   I_r w' + D w = tau_m - tau_s,  tau_s = K (theta - q) + B (w - v)                         (``joints``)
    object   m u' = m g + f,  L' = t,  w_O = R I^-1 R^T L                          (``rigid_object``, ``hinge_forces``)

J_h is a hand's Jacobian. Within a step, bodies move linearly from where they stood at its start: a hand by
J_h (q - q_start), contact points and couplings with their bodies.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.plant.grasp import grasp_forces
from impedance_modules.plant.hinge_forces import add_hinge, hinge_wrench
from impedance_modules.plant.joints import joint_torque
from impedance_modules.plant.links import accelerate, place_links
from impedance_modules.plant.plant_state import WORK_SIZE, PlantState
from impedance_modules.plant.point_contact import contact_forces
from impedance_modules.plant.rigid_object import object_motion, object_rate


@compiled
def evaluate_rate(plant: PlantState) -> None:
    """Writes the rate of the stage and the links' acceleration."""
    place_links(plant.links, plant.stage.position)
    evaluate_forces(plant)
    accelerate(plant.links, plant.stage.velocity, plant.torque, plant.acceleration)


@compiled
def evaluate_forces(plant: PlantState) -> None:
    """Writes the rate of everything but the links' velocity, and the torque on the links."""
    rate, present = plant.rate, plant.body.present
    rate.whole[-WORK_SIZE:] = 0.0
    for i in range(plant.joints.size):
        plant.torque[i] = joint_torque(plant, i)
    pushed = bool(np.any(plant.push_wrench != 0.0))
    if plant.contacts.size == 0 and not present and not pushed:
        return
    hand_motion(plant)
    plant.contact_wrench[:] = 0.0
    plant.grasp_wrench[:] = 0.0
    work = rate.work[0]
    if present:
        object_motion(plant)
        work.grasp_work = grasp_forces(plant)
        if plant.hinge.present:
            work.hinge_work = hinge_wrench(plant)
    work.contact_work = contact_forces(plant)
    if pushed:
        work.push_work = _push_power(plant)
    if present:
        object_rate(plant)
        if plant.hinge.present:
            add_hinge(plant)
    _add_hand_torques(plant)


@compiled
def hand_motion(plant: PlantState) -> None:
    """Writes each hand's displacement J (q - q_start) and twist J v."""
    jacobian, start, stage = plant.jacobian, plant.start, plant.stage
    for h in range(jacobian.shape[0]):
        for r in range(6):
            moved, speed = 0.0, 0.0
            for i in range(jacobian.shape[2]):
                moved += jacobian[h, r, i] * (stage.position[i] - start.position[i])
                speed += jacobian[h, r, i] * stage.velocity[i]
            plant.displacement[h, r], plant.twist[h, r] = moved, speed


@compiled
def _push_power(plant: PlantState) -> float:
    """Gives what pushes do on hands and object [W]: wrench times twist."""
    power, bodies = 0.0, plant.hands.size + (1 if plant.body.present else 0)
    for b in range(bodies):
        for r in range(6):
            power += plant.push_wrench[b, r] * plant.twist[b, r]
    return power


@compiled
def _add_hand_torques(plant: PlantState) -> None:
    """Adds J^T (contact + grasp + push wrench) of every hand to the torque on the links."""
    jacobian, torque = plant.jacobian, plant.torque
    for h in range(jacobian.shape[0]):
        for r in range(6):
            total = plant.contact_wrench[h, r] + plant.grasp_wrench[h, r] + plant.push_wrench[h, r]
            if total != 0.0:
                for i in range(torque.size):
                    torque[i] += jacobian[h, r, i] * total
