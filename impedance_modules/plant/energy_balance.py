# SPDX-License-Identifier: BSD-3-Clause
r"""The plant's energy, kind by kind, and the work that came in and went out.

    stored(t) - stored(0) = work in - dissipated

holds along any run up to the integrator's error: tests use it as a law, a run's summary as a check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.plant.hinge_forces import hinge_energy
from impedance_modules.plant.joints import spring_deflections
from impedance_modules.plant.plant_state import WORK, PlantState


@dataclass(frozen=True)
class EnergyBook:
    """Energies and works [J] since ``reset``.

    Attributes:
        links, rotors, body: Kinetic energy of links with the water they take along, rotors and the object.
        gravity: Potential of links and object.
        springs: In the series-elastic springs.
        stops, grasp, contact, hinge: In joint stops, couplings, surfaces with their friction springs, and the
            object's hinge with its bearing.
        command_work: By the commanded torque on the motors: the motor port of the passivity claim.
        robot_work: By the robot's own gravity compensation and position hold.
        effect_work: By effects.
        push_work: By whoever pushes hands or object.
        motor_loss, spring_loss: In motor and spring damping.
        stop_work, grasp_work, contact_work, hinge_work: Done on the bodies by stops, couplings, surfaces and hinge.
    """

    links: float
    rotors: float
    body: float
    gravity: float
    springs: float
    stops: float
    grasp: float
    contact: float
    hinge: float
    command_work: float
    robot_work: float
    effect_work: float
    push_work: float
    motor_loss: float
    spring_loss: float
    stop_work: float
    grasp_work: float
    contact_work: float
    hinge_work: float

    @property
    def kinetic(self) -> float:
        """Kinetic energy of everything [J]."""
        return self.links + self.rotors + self.body

    @property
    def stored(self) -> float:
        """Kinetic and potential energy of everything [J]."""
        held = self.stops + self.grasp + self.contact + self.hinge
        return self.kinetic + self.gravity + self.springs + held

    def dissipated(self, before: EnergyBook) -> dict[str, float]:
        """Gives what each damper has turned into heat since ``before`` [J]."""
        lost = {
            "motors": self.motor_loss - before.motor_loss,
            "springs": self.spring_loss - before.spring_loss,
        }
        for name in ("stop", "grasp", "contact", "hinge"):
            kept = f"{name}s" if name == "stop" else name
            done = getattr(self, f"{name}_work") - getattr(before, f"{name}_work")
            lost[kept] = -done - (getattr(self, kept) - getattr(before, kept))
        return lost

    def imbalance(self, before: EnergyBook) -> float:
        """Gives the energy that no term accounts for since ``before`` [J]; the integrator's error."""
        work = sum(
            getattr(self, name) - getattr(before, name)
            for name in ("command_work", "robot_work", "effect_work", "push_work")
        )
        return float(self.stored - before.stored - work + sum(self.dissipated(before).values()))


def potential_energies(plant: PlantState) -> dict[str, float]:
    """Computes the energy in springs, stops, couplings, contacts and hinge [J] from the tables as they stand."""
    joints, hands, contacts, q = plant.joints, plant.hands, plant.contacts, plant.start.position
    beyond = np.maximum(q - joints["upper"], 0.0) + np.maximum(joints["lower"] - q, 0.0)
    deflection = np.empty(plant.n)
    spring_deflections(plant, deflection)
    held = hands[hands["holds"] == 1]
    squared = np.sum(held["deflection"] ** 2, axis=1) + np.maximum(held["depth"], 0.0) ** 2
    grasp = held["linear_stiffness"] * squared
    grasp = grasp + held["angular_stiffness"] * np.sum(held["angular_deflection"] ** 2, axis=1)
    near = contacts[contacts["near"] == 1]
    depth = np.maximum(-near["distance"], 0.0)
    touch = near["normal_stiffness"] * depth**2 + near["stiffness"] * np.sum(near["stretch"] ** 2, axis=1)
    hinge = 0.0
    if plant.hinge.present:
        hinge = hinge_energy(plant.hinge, plant.body.rotation, plant.start.object_position)
    return {
        "hinge": hinge,
        "springs": 0.5 * float(np.sum(joints["stiffness"] * deflection**2)),
        "stops": 0.5 * float(np.sum(joints["stop_stiffness"] * beyond**2)),
        "grasp": 0.5 * float(np.sum(grasp)),
        "contact": 0.5 * float(np.sum(touch)),
    }


def works(plant: PlantState) -> dict[str, float]:
    """Names the work counters [J]."""
    return {name: float(plant.start.work[name][0]) for name in WORK.names or ()}
