# SPDX-License-Identifier: BSD-3-Clause
"""Steps the plant: pinocchio's articulated-body algorithm between compiled Runge-Kutta stages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.plant import compiled_stage
from impedance_modules.plant.contact.compiled_contact import find_near
from impedance_modules.plant.contact.surfaces import NEAR, Surfaces
from impedance_modules.plant.effects_port import JointMotion, JointTorque
from impedance_modules.plant.records import ELASTIC, RATE, RIGID, STAGE, START, Memory
from impedance_modules.robot.kinematics import WORLD_AXES
from impedance_modules.robot.model import RobotModel

Array = NDArray[np.float64]


class Integrator:
    """One step of all bodies, on the plant's memory.

    Attributes:
        step: Integration step [s].
        links: Pinocchio model whose armature holds only the rotors fixed to their links.
        torques: Effects that add torque at motors or links, in the order in which they are asked.
        aim, aim_velocity: (n,) the joint motion that the controller aims at, for effects that know it.
        time: Since the start [s].
        tables, arrays: Arguments of the compiled stages, in their order.
    """

    def __init__(
        self,
        model: RobotModel,
        memory: Memory,
        *,
        frames: Sequence[str],
        surfaces: Surfaces,
        step: float,
        gravity: Array,
        coupling: Array,
    ) -> None:
        self.step = step
        self.memory = memory
        self.surfaces = surfaces
        self.time = 0.0
        self.torques: list[JointTorque] = []
        self.aim, self.aim_velocity = np.zeros(model.n), np.zeros(model.n)
        self._coupling = coupling
        self._load = np.zeros(model.n)
        self._worn = bool(coupling.any())
        self.links = pin.Model(model.pin_model)
        fixed = memory.joints["kind"] == RIGID
        self.links.armature = np.where(fixed, model.reflected_inertia, 0.0)
        self.links.gravity.linear = gravity
        self._data, self._pose_data = self.links.createData(), self.links.createData()
        self._ids = tuple(model.frame_id(frame) for frame in frames)
        placements = [self._pose_data.oMf[index] for index in self._ids]
        # Views taken once: into pinocchio's results, and into the tables that take them.
        rotations, translations = memory.hands["rotation"], memory.hands["translation"]
        self._poses = [
            (
                index,
                placement.rotation,
                placement.translation,
                rotations[i],
                translations[i],
                memory.jacobian[i],
            )
            for i, (index, placement) in enumerate(zip(self._ids, placements, strict=True))
        ]
        self._contact_tables = (memory.contacts, memory.surfaces, memory.hands, memory.body)
        self.tables = (memory.joints, memory.hands, memory.body, memory.contacts, memory.state)
        self.arrays = (memory.jacobian, memory.motion, memory.wrench, memory.torque)
        self._q, self._v = memory.part("position", STAGE), memory.part("velocity", STAGE)
        self._start_position = memory.part("position")
        self._object_position = memory.part("object_position")
        self._has_contacts = bool(memory.contacts.size)
        self._touches = bool(memory.contacts.size or memory.body[0]["present"])

    def place(self) -> None:
        """Brings hand poses and Jacobians, contact geometry and couplings to the present state."""
        links, data = self.links, self._pose_data
        pin.computeJointJacobians(links, data, self._start_position)
        for index, rotation, translation, hand_rotation, hand_translation, jacobian in self._poses:
            pin.updateFramePlacement(links, data, index)
            jacobian[:] = pin.getFrameJacobian(links, data, index, WORLD_AXES)
            hand_rotation[:] = rotation
            hand_translation[:] = translation
        if self._has_contacts and find_near(*self._contact_tables, self._object_position, NEAR):
            self.surfaces.measure()

    def refresh(self) -> None:
        """Brings couplings too, for whoever reads the tables between steps."""
        self.place()
        memory = self.memory
        compiled_stage.open_step(memory.state, memory.hands, memory.body, memory.contacts)

    def advance(self) -> None:
        """Moves on by one step."""
        if self._touches:
            self.place()
        if self.torques or self._worn:
            self._advance_with_effects()
            return
        stage, aba, links, data = compiled_stage.stage, pin.aba, self.links, self._data
        q, v, torque, step = self._q, self._v, self.memory.torque, self.step
        acceleration = torque
        for index in range(5):
            stage(index, step, *self.tables, *self.arrays, acceleration)
            if index < 4:
                acceleration = aba(links, data, q, v, torque)
        self.time += step

    def link_mobility(self) -> Array:
        """Computes the inverse mass matrix (n, n) of the links without elastic rotors."""
        data = self.links.createData()
        return np.array(pin.computeMinverse(self.links, data, self.memory.part("position")))

    def rate(self) -> Array:
        """Writes the rate of the stage row, effects included; returns the links' acceleration (n,)."""
        self._ask_effects()
        compiled_stage.evaluate(*self.tables, *self.arrays)
        if self._worn:
            self._couple(self.acceleration())
            compiled_stage.evaluate(*self.tables, *self.arrays)
        return self.acceleration()

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
        return np.array(pin.computeMinverse(self.links, self._data, self._q))

    def acceleration(self) -> Array:
        """Computes the links' acceleration (n,) at the stage row under the torque now on them."""
        return np.asarray(pin.aba(self.links, self._data, self._q, self._v, self.memory.torque))

    def _advance_with_effects(self) -> None:
        """Takes the same step with effects asked before each stage."""
        memory, joints = self.memory, self.memory.joints
        self._load = joints["load"].copy()
        compiled_stage.open_step(memory.state, memory.hands, memory.body, memory.contacts)
        for index in range(1, 5):
            acceleration = self.rate()
            compiled_stage.absorb(index, self.step, joints, memory.state, acceleration)
        compiled_stage.close_step(*self.tables, memory.jacobian, memory.motion)
        self.time += self.step
        motion = self.motion(START)
        for effect in self.torques:
            effect.settle(motion)

    def _ask_effects(self) -> None:
        joints = self.memory.joints
        joints["extra_motor"], joints["extra_link"] = 0.0, 0.0
        if not self.torques:
            return
        motion = self.motion(STAGE)
        for effect in self.torques:
            port = "extra_motor" if effect.port == "motor" else "extra_link"
            joints[port] += effect.torque(motion)

    def motion(self, row: int) -> JointMotion:
        """Gives what effects are told, at a row of the state."""
        part, joints = self.memory.part, self.memory.joints
        return JointMotion(
            time=self.time,
            position=part("position", row),
            velocity=part("velocity", row),
            motor_position=part("motor_position", row),
            motor_velocity=part("motor_velocity", row),
            command=joints["command"],
            load=joints["load"] if row == START else self._load,
            drive=joints["command"] + joints["assist"],
            position_command=self.aim,
            velocity_command=self.aim_velocity,
        )
