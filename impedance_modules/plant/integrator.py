# SPDX-License-Identifier: BSD-3-Clause
r"""Steps of the plant: the classical Runge-Kutta method on springs, links, contacts and object at once.

Over a step h, for the state x and its rate f:

    x_1 = x,  x_2 = x + h/2 f(x_1),  x_3 = x + h/2 f(x_2),  x_4 = x + h f(x_3)
    x(t + h) = x + h/6 (f(x_1) + 2 f(x_2) + 2 f(x_3) + f(x_4))

A whole period is one law, left only to query coal for distances. Where effects add torque, they are evaluated in Python
before each stage, between the same laws.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from impedance_modules.compiled import compiled, want_machine_code
from impedance_modules.effects.joint_motion import JointMotion, JointTorque
from impedance_modules.plant.equations_of_motion import evaluate_forces, evaluate_rate, hand_motion
from impedance_modules.plant.grasp import place_couplings
from impedance_modules.plant.hinge_forces import update_hinge
from impedance_modules.plant.joints import ELASTIC, update_loads
from impedance_modules.plant.links import accelerate, mobility_under_water, place_hands, place_links
from impedance_modules.plant.palm import update_slipping_palms
from impedance_modules.plant.plant_state import PlantState, StateVector
from impedance_modules.plant.point_contact import (
    CLEARANCE,
    SurfaceDistances,
    find_near_points,
    place_contacts,
    update_friction_springs,
)
from impedance_modules.plant.rigid_object import object_motion, update_object_rotation
from impedance_modules.plant.wood import apply_wood_texture, update_wood
from impedance_modules.records import Matrix, Vector


@compiled
def advance_steps(plant: PlantState, done: int, steps: int, step: float, clearance: float) -> int:
    """Takes steps [s] from the ``done``-th on, up to ``steps`` or until coal has to be queried; returns how many."""
    while done < steps:
        if place(plant, clearance) > 0:
            return done
        begin_step(plant)
        for stage in range(1, 5):
            if stage > 1:
                place_links(plant.links, plant.stage.position)
            evaluate_forces(plant)
            accelerate(plant.links, plant.stage.velocity, plant.torque, plant.acceleration)
            next_stage(plant, stage, step)
        end_step(plant, step)
        done += 1
    return done


@compiled
def place(plant: PlantState, clearance: float) -> int:
    """Brings links, hands and points to the step's start; returns how many points wait for coal.

    ``clearance`` is what a point must be closer than for coal to be queried [m].
    """
    place_links(plant.links, plant.start.position)
    place_hands(plant)
    return find_near_points(plant, clearance) if plant.contacts.size > 0 else 0


@compiled
def begin_step(plant: PlantState) -> None:
    """Starts a step: stage one is the start, and couplings and contacts are placed exactly."""
    plant.stage.whole[:] = plant.start.whole
    place_contacts(plant)
    if plant.woods.size > 0:
        apply_wood_texture(plant)
    if plant.body.present:
        place_couplings(plant)


@compiled
def next_stage(plant: PlantState, stage: int, step: float) -> None:
    """Takes the links' acceleration of a stage (1 to 4) into its rate and moves on to the next stage."""
    rate, start, now, total = plant.rate, plant.start.whole, plant.stage.whole, plant.rate_sum.whole
    for i in range(plant.joints.size):
        rate.velocity[i] = plant.acceleration[i]
        if plant.joints[i].kind != ELASTIC:
            rate.motor_velocity[i] = plant.acceleration[i]
    weight = 1.0 if stage in {1, 4} else 2.0
    reach = step if stage == 3 else 0.5 * step
    for k in range(start.size):
        total[k] = (total[k] if stage > 1 else 0.0) + weight * rate.whole[k]
        now[k] = start[k] + (reach * rate.whole[k] if stage < 4 else step / 6.0 * total[k])


@compiled
def end_step(plant: PlantState, step: float) -> None:
    """Ends a step: friction springs, wood, slipping palms, hinge and the object's rotation are brought up to date."""
    if plant.contacts.size > 0 or plant.body.present:
        hand_motion(plant)
        if plant.body.present:
            object_motion(plant)
            update_slipping_palms(plant)
            if plant.hinge.present:
                update_hinge(plant)
            update_object_rotation(plant)
        update_friction_springs(plant)
        if plant.woods.size > 0:
            update_wood(plant, step)
    plant.start.whole[:] = plant.stage.whole
    update_loads(plant)


class Integrator:
    """Steps of all bodies.

    Attributes:
        plant: What it steps.
        step: Integration step [s].
        distances: Distances of points from surfaces, by coal.
        links: Pinocchio model whose armature holds only the rotors fixed to their links.
        torques: Effects that add torque at motors or links, in the order in which they are evaluated.
        aim, aim_velocity: (n,) the joint motion that the controller aims at, for effects that know it.
        time: Since the start [s].
    """

    def __init__(
        self,
        links: pin.Model,
        plant: PlantState,
        *,
        distances: SurfaceDistances,
        step: float,
        motor_coupling: Matrix,
    ) -> None:
        """Takes the plant and how to step it; ``motor_coupling`` (n, n) [kg.m^2] is that of rotors, or zero."""
        want_machine_code()
        self.plant = plant
        self.step = step
        self.distances = distances
        self.links = links
        self.time = 0.0
        self.torques: list[JointTorque] = []
        self.aim, self.aim_velocity = np.zeros(plant.n), np.zeros(plant.n)
        self._motor_coupling = motor_coupling
        self._coupled = bool(motor_coupling.any())
        self._start_load = np.zeros(plant.n)
        self._data = links.createData()
        joints = plant.joints
        self._command, self._assist, self._load = joints["command"], joints["assist"], joints["load"]
        self._effect_motor, self._effect_link = joints["effect_motor"], joints["effect_link"]
        self._at_start = self._observed(plant.start, self._load)
        self._at_stage = self._observed(plant.stage, self._start_load)

    @property
    def has_effects(self) -> bool:
        """Whether effects add torque or couple motors."""
        return bool(self.torques) or self._coupled

    def place(self) -> None:
        """Brings hand poses and Jacobians and contact geometry to the present state."""
        if place(self.plant, CLEARANCE):
            self.distances.measure()

    def refresh(self) -> None:
        """Brings couplings too, for whoever reads the tables between steps."""
        self.place()
        begin_step(self.plant)

    def advance(self, steps: int) -> None:
        """Moves on by some steps."""
        if self.has_effects:
            for _ in range(steps):
                self._advance_with_effects()
            return
        done = 0
        while True:
            done = advance_steps(self.plant, done, steps, self.step, CLEARANCE)
            if done == steps:
                break
            self.distances.measure()
        self.time += steps * self.step

    def link_mobility(self) -> Matrix:
        """Computes the inverse mass matrix (n, n) of the links without elastic rotors."""
        plant = self.plant
        return mobility_under_water(self.links, plant.links, self.links.createData(), plant.start.position)

    def rate(self) -> Vector:
        """Writes the rate of the stage, effects included; returns the links' acceleration (n,)."""
        self._evaluate_effects()
        evaluate_rate(self.plant)
        if self._coupled:
            self._couple_motors()
            evaluate_rate(self.plant)
        return self.plant.acceleration

    def _couple_motors(self) -> None:
        r"""Adds the torque with which one rotor's acceleration loads another motor, at the stage.

        e = -C \ddot z, with \ddot z = (1 + S C)^{-1} \ddot z_0: z are the motors of elastic joints and the links
        of all others, S what a torque on them accelerates.
        """
        plant, joints, n = self.plant, self.plant.joints, self.plant.n
        elastic = joints["kind"] == ELASTIC
        alone = np.where(elastic, plant.rate.motor_velocity, plant.acceleration)
        lightness = np.where(np.outer(elastic, elastic), 0.0, self._stage_mobility())
        lightness[elastic] = lightness[:, elastic] = 0.0
        lightness[np.diag_indices(n)] += elastic / np.where(elastic, joints["reflected_inertia"], 1.0)
        together = np.linalg.solve(np.eye(n) + lightness @ self._motor_coupling, alone)
        self._effect_motor -= self._motor_coupling @ together

    def _stage_mobility(self) -> Matrix:
        """Computes the inverse mass matrix (n, n) of the links without elastic rotors at the stage."""
        return mobility_under_water(self.links, self.plant.links, self._data, self.plant.stage.position)

    def _advance_with_effects(self) -> None:
        """Takes the same step with effects evaluated before each stage."""
        plant = self.plant
        self._start_load[:] = self._load
        self.place()
        begin_step(plant)
        for stage in range(1, 5):
            self.rate()
            next_stage(plant, stage, self.step)
        end_step(plant, self.step)
        self.time += self.step
        motion = self.motion()
        for effect in self.torques:
            effect.settle(motion)

    def _evaluate_effects(self) -> None:
        """Writes what effects add at the stage."""
        self._effect_motor[:], self._effect_link[:] = 0.0, 0.0
        if not self.torques:
            return
        motion = self._timed(self._at_stage)
        for effect in self.torques:
            extra = self._effect_motor if effect.port == "motor" else self._effect_link
            extra += effect.torque(motion)

    def motion(self) -> JointMotion:
        """Gives the joint motion that effects see at the step's start; the same object every time."""
        return self._timed(self._at_start)

    def _timed(self, motion: JointMotion) -> JointMotion:
        motion.time = self.time
        np.add(self._command, self._assist, out=motion.drive)
        return motion

    def _observed(self, state: StateVector, load: Vector) -> JointMotion:
        """Takes the views of a state that effects see."""
        return JointMotion(
            time=self.time,
            position=state.position,
            velocity=state.velocity,
            motor_position=state.motor_position,
            motor_velocity=state.motor_velocity,
            command=self._command,
            load=load,
            drive=np.zeros(self.plant.n),
            position_command=self.aim,
            velocity_command=self.aim_velocity,
        )
