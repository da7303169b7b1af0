# SPDX-License-Identifier: BSD-3-Clause
"""Steps the plant: compiled from end to end, but for questions to coal and for effects worn."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.compiled import compiled, use_machine_code
from impedance_modules.effects.motion import JointMotion, JointTorque
from impedance_modules.plant import integrator as compiled_step
from impedance_modules.plant.equations_of_motion import evaluate, hand_motion, spring
from impedance_modules.plant.grasp import (
    object_motion,
    place_grasps,
    settle_grasps,
    settle_object,
)
from impedance_modules.plant.links import accelerate, mobility_under_water, place_hands, place_links
from impedance_modules.plant.plant_state import (
    COUNTERS,
    ELASTIC,
    IDEAL,
    OBJECT_SIZE,
    RATE,
    RIGID,
    STAGE,
    START,
    SUM,
    Memory,
    Table,
)
from impedance_modules.plant.point_contact import NEAR, Surfaces, find_near, place_contacts, settle_contacts
from impedance_modules.plant.wood import roughen, settle_wood

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


@compiled
def live(
    done: int,
    steps: int,
    step: float,
    near: float,
    surfaces: Table,
    woods: Table,
    worn: Array,
    splinters: Table,
    joints: Table,
    links: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    state: Array,
    jacobian: Array,
    motion: Array,
    wrench: Array,
    torque: Array,
    acceleration: Array,
) -> int:
    """Takes steps from the ``done``-th on, up to all ``steps`` or until coal has to be asked; returns how many."""
    n = joints.size
    while done < steps:
        if place(near, surfaces, links, hands, body, contacts, state, jacobian) > 0:
            return done
        open_step(state, hands, body, contacts, surfaces, woods, worn)
        for index in range(1, 5):
            if index > 1:
                place_links(links, state[STAGE, :n])
            evaluate(surfaces, joints, hands, body, contacts, state, jacobian, motion, wrench, torque)
            accelerate(links, state[STAGE, n : 2 * n], torque, acceleration)
            absorb(index, step, joints, state, acceleration)
        close_step(step, joints, hands, body, contacts, woods, worn, splinters, state, jacobian, motion)
        done += 1
    return done


@compiled
def place(
    near: float,
    surfaces: Table,
    links: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    state: Array,
    jacobian: Array,
) -> int:
    """Brings links, hands and points to the step's start; returns how many points wait for coal.

    ``near`` is the clearance below which coal is asked [m].
    """
    first = state.shape[1] - OBJECT_SIZE - COUNTERS
    place_links(links, state[START, : links.size - 1])
    place_hands(hands, links, jacobian)
    if contacts.size == 0:
        return 0
    return int(find_near(contacts, surfaces, hands, body, state[START, first : first + 3], near))


@compiled
def rate(
    surfaces: Table,
    joints: Table,
    links: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    state: Array,
    jacobian: Array,
    motion: Array,
    wrench: Array,
    torque: Array,
    acceleration: Array,
) -> None:
    """Writes the rate of the stage row and the links' acceleration, for whoever steps outside ``live``."""
    n = joints.size
    place_links(links, state[STAGE, :n])
    evaluate(surfaces, joints, hands, body, contacts, state, jacobian, motion, wrench, torque)
    accelerate(links, state[STAGE, n : 2 * n], torque, acceleration)


@compiled
def open_step(
    state: Array, hands: Table, body: Table, contacts: Table, surfaces: Table, woods: Table, worn: Array
) -> None:
    """Starts a step: stage one is the start, and couplings and contacts are placed exactly."""
    first = state.shape[1] - OBJECT_SIZE - COUNTERS
    state[STAGE] = state[START]
    position = state[START, first : first + 3]
    place_contacts(surfaces, contacts, hands, position)
    if woods.size > 0:
        roughen(contacts, surfaces, woods, worn)
    if body[0].present:
        place_grasps(hands, body, position)


@compiled
def absorb(index: int, step: float, joints: Table, state: Array, acceleration: Array) -> None:
    """Takes the links' acceleration of stage ``index`` (1 to 4) and moves on to the next stage."""
    n = joints.size
    start, stage, rate, total = state[START], state[STAGE], state[RATE], state[SUM]
    for i in range(n):
        rate[n + i] = acceleration[i]
        if joints[i].kind != ELASTIC:
            rate[3 * n + i] = acceleration[i]
    weight = 1.0 if index in {1, 4} else 2.0
    reach = step if index == 3 else 0.5 * step
    for k in range(state.shape[1]):
        total[k] = (total[k] if index > 1 else 0.0) + weight * rate[k]
        stage[k] = start[k] + (reach * rate[k] if index < 4 else step / 6.0 * total[k])


@compiled
def close_step(
    step: float,
    joints: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    woods: Table,
    worn: Array,
    splinters: Table,
    state: Array,
    jacobian: Array,
    motion: Array,
) -> None:
    """Ends a step: friction springs, wood, slipping palms and the object's rotation are brought up to date."""
    n = joints.size
    if contacts.size > 0 or body[0].present:
        hand_motion(jacobian, state, motion)
        if body[0].present:
            final = state[STAGE, 4 * n : 4 * n + OBJECT_SIZE]
            object_motion(body[0], state[START, 4 * n : 4 * n + 3], final, motion[hands.size])
            settle_grasps(hands, body, motion)
            settle_object(body[0], final)
        settle_contacts(contacts, motion)
        if woods.size > 0:
            settle_wood(contacts, woods, worn, splinters, step)
    state[START] = state[STAGE]
    _read_loads(joints, state)


@compiled
def _read_loads(joints: Table, state: Array) -> None:
    """Writes the torque between each joint's gear and link at the step's end [N.m]."""
    n = joints.size
    for i in range(n):
        joint = joints[i]
        if joint.kind == ELASTIC:
            wound = state[START, 2 * n + i] - state[START, i]
            speed = state[START, 3 * n + i] - state[START, n + i]
            joint.load = spring(joint, wound, speed)
        elif joint.kind == RIGID:
            joint.load -= joint.reflected_inertia * state[RATE, n + i]
        elif joint.kind == IDEAL:
            joint.load = joint.motor
