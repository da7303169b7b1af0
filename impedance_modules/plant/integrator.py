# SPDX-License-Identifier: BSD-3-Clause
"""Steps the plant: compiled from end to end, but for questions to coal and for effects worn."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.compiled import use_machine_code
from impedance_modules.plant import runge_kutta as compiled_step
from impedance_modules.plant.contact.surfaces import NEAR, Surfaces
from impedance_modules.effects.motion import JointMotion, JointTorque
from impedance_modules.plant.links import mobility_under_water
from impedance_modules.plant.plant_state import ELASTIC, RATE, STAGE, START, Memory

Array = NDArray[np.float64]


class Integrator:
    """One step of all bodies, on the plant's memory.

    Attributes:
        step: Integration step [s].
        links: Pinocchio model whose armature holds only the rotors fixed to their links.
        torques: Effects that add torque at motors or links, in the order in which they are asked.
        aim, aim_velocity: (n,) the joint motion that the controller aims at, for effects that know it.
        time: Since the start [s].
        tables: Arguments of the compiled step, in their order.
    """

    def __init__(
        self, links: pin.Model, memory: Memory, *, surfaces: Surfaces, step: float, coupling: Array
    ) -> None:
        use_machine_code()
        self.step = step
        self.memory = memory
        self.surfaces = surfaces
        self.links = links
        self.time = 0.0
        self.torques: list[JointTorque] = []
        self.aim, self.aim_velocity = np.zeros(memory.n), np.zeros(memory.n)
        self._coupling = coupling
        self._load = np.zeros(memory.n)
        self._worn = bool(coupling.any())
        self._data = links.createData()
        m = memory
        self._placed = (m.surfaces, m.links, m.hands, m.body, m.contacts, m.state, m.jacobian)
        bodies = (m.joints, m.links, m.hands, m.body, m.contacts)
        self.tables = (m.surfaces, *bodies, m.state, m.jacobian, m.motion, m.wrench, m.torque, m.acceleration)
        self._command, self._assist = m.joints["command"], m.joints["assist"]
        self._extra_motor, self._extra_link = m.joints["extra_motor"], m.joints["extra_link"]
        self._motions = {row: self._watched(row) for row in (START, STAGE)}
        self._lived = (m.surfaces, m.woods, m.worn, m.splinters, *self.tables[1:])
        self._inlets = (m.state, m.hands, m.body, m.contacts, m.surfaces, m.woods, m.worn)
        wood = (m.woods, m.worn, m.splinters)
        self._outlets = (m.joints, m.hands, m.body, m.contacts, *wood, m.state, m.jacobian, m.motion)

    def place(self) -> None:
        """Brings hand poses and Jacobians, contact geometry and couplings to the present state."""
        if compiled_step.place(NEAR, *self._placed):
            self.surfaces.measure()

    def refresh(self) -> None:
        """Brings couplings too, for whoever reads the tables between steps."""
        self.place()
        compiled_step.open_step(*self._inlets)

    def advance(self, steps: int) -> None:
        """Moves on by some steps."""
        if self.torques or self._worn:
            for _ in range(steps):
                self._advance_with_effects()
            return
        done = 0
        while True:
            done = compiled_step.live(done, steps, self.step, NEAR, *self._lived)
            if done == steps:
                break
            self.surfaces.measure()
        self.time += steps * self.step

    def link_mobility(self) -> Array:
        """Computes the inverse mass matrix (n, n) of the links without elastic rotors."""
        data = self.links.createData()
        return mobility_under_water(self.links, self.memory.links, data, self.memory.part("position"))

    def rate(self) -> Array:
        """Writes the rate of the stage row, effects included; returns the links' acceleration (n,)."""
        self._ask_effects()
        compiled_step.rate(*self.tables)
        if self._worn:
            self._couple(self.memory.acceleration)
            compiled_step.rate(*self.tables)
        return self.memory.acceleration

    def _couple(self, links: Array) -> None:
        r"""Adds the torque with which one rotor's acceleration loads another motor, at the stage row.

        e = -C \ddot z, with \ddot z = (1 + S C)^{-1} \ddot z_0: z are the motors of elastic joints and the links
        of all others, S what a torque on them accelerates.
        """
        joints, n = self.memory.joints, self.memory.n
        elastic = joints["kind"] == ELASTIC
        alone = np.where(elastic, self.memory.part("motor_velocity", RATE), links)
        lightness = np.where(np.outer(elastic, elastic), 0.0, self.stage_mobility())
        lightness[elastic] = lightness[:, elastic] = 0.0
        lightness[np.diag_indices(n)] += elastic / np.where(elastic, joints["reflected_inertia"], 1.0)
        together = np.linalg.solve(np.eye(n) + lightness @ self._coupling, alone)
        joints["extra_motor"] -= self._coupling @ together

    def stage_mobility(self) -> Array:
        """Computes the inverse mass matrix (n, n) of the links without elastic rotors at the stage row."""
        position = self.memory.part("position", STAGE)
        return mobility_under_water(self.links, self.memory.links, self._data, position)

    def _advance_with_effects(self) -> None:
        """Takes the same step with effects asked before each stage."""
        memory, joints = self.memory, self.memory.joints
        self._load[:] = joints["load"]
        self.place()
        compiled_step.open_step(*self._inlets)
        for index in range(1, 5):
            acceleration = self.rate()
            compiled_step.absorb(index, self.step, joints, memory.state, acceleration)
        compiled_step.close_step(self.step, *self._outlets)
        self.time += self.step
        motion = self.motion(START)
        for effect in self.torques:
            effect.settle(motion)

    def _ask_effects(self) -> None:
        """Writes what effects add at the stage row."""
        self._extra_motor[:], self._extra_link[:] = 0.0, 0.0
        if not self.torques:
            return
        motion = self.motion(STAGE)
        for effect in self.torques:
            extra = self._extra_motor if effect.port == "motor" else self._extra_link
            extra += effect.torque(motion)

    def motion(self, row: int) -> JointMotion:
        """Gives what effects are told, at a row of the state; the same object every time."""
        motion = self._motions[row]
        motion.time = self.time
        np.add(self._command, self._assist, out=motion.drive)
        return motion

    def _watched(self, row: int) -> JointMotion:
        """Takes the views of a row that effects are told."""
        part, joints = self.memory.part, self.memory.joints
        return JointMotion(
            time=self.time,
            position=part("position", row),
            velocity=part("velocity", row),
            motor_position=part("motor_position", row),
            motor_velocity=part("motor_velocity", row),
            command=self._command,
            load=joints["load"] if row == START else self._load,
            drive=np.zeros(self.memory.n),
            position_command=self.aim,
            velocity_command=self.aim_velocity,
        )
