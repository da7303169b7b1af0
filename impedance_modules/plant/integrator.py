# SPDX-License-Identifier: BSD-3-Clause
r"""Steps of the plant: the classical Runge-Kutta method on springs, links, contacts and object at once.

Over a step h, for the state x and its rate f:

    x_1 = x,  x_2 = x + h/2 f(x_1),  x_3 = x + h/2 f(x_2),  x_4 = x + h f(x_3)
    x(t + h) = x + h/6 (f(x_1) + 2 f(x_2) + 2 f(x_3) + f(x_4))

A whole period is one law, left only to query coal for distances. Effects are evaluated within it at each stage
(``effect_torques``); for one that is written in Python the law is left at every stage, and the rest is the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import pinocchio as pin

from impedance_modules.compiled import Law, compiled, want_machine_code
from impedance_modules.effects.joint_motion import (
    CompiledTorque,
    EffectTorque,
    JointHistory,
    JointMotion,
    JointTorque,
    take_from_history,
)
from impedance_modules.plant.effect_torques import (
    begin_effects,
    connect,
    couple_motors,
    end_effects,
    evaluate_effects,
    observe_joints,
    observe_links,
    remember_history,
)
from impedance_modules.plant.equations_of_motion import evaluate_forces, hand_motion
from impedance_modules.plant.grasp import place_couplings
from impedance_modules.plant.hinge_forces import update_hinge
from impedance_modules.plant.joints import ELASTIC, update_loads
from impedance_modules.plant.links import accelerate, mobility_under_water, place_hands, place_links
from impedance_modules.plant.palm import update_slipping_palms
from impedance_modules.plant.plant_state import PlantState
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
            evaluate_effects(plant)
            accelerate_all(plant)
            next_stage(plant, stage, step)
        end_step(plant, step)
        done += 1
    return done


@compiled
def accelerate_all(plant: PlantState) -> None:
    """Writes the rate of the stage and the links' acceleration, the links placed and the effects evaluated."""
    evaluate_forces(plant)
    accelerate(plant.links, plant.stage.velocity, plant.torque, plant.acceleration)
    if plant.effects.coupled.size > 0:
        direct = couple_motors(plant)
        evaluate_forces(plant)
        if direct:
            accelerate(plant.links, plant.stage.velocity, plant.torque, plant.acceleration)


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
    begin_effects(plant)


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
    end_effects(plant, step)


class Integrator:
    """Steps of all bodies.

    Attributes:
        plant: What it steps.
        step: Integration step [s].
        distances: Distances of points from surfaces, by coal.
        links: Pinocchio model whose armature holds only the rotors fixed to their links.
        effects: Of a patch, that add torque at motors or links.
        torques: Those of them that are written in Python, and others of the same kind that were appended.
        aim, aim_velocity: (n,) the joint motion that the controller aims at, for effects that know it.
    """

    def __init__(
        self,
        links: pin.Model,
        plant: PlantState,
        *,
        distances: SurfaceDistances,
        step: float,
        effects: Sequence[EffectTorque],
    ) -> None:
        """Takes the plant, how to step it, and its effects."""
        want_machine_code()
        self.plant = plant
        self.step = step
        self.distances = distances
        self.links = links
        self.effects = tuple(effects)
        self.torques: list[JointTorque] = [e for e in effects if not isinstance(e, CompiledTorque)]
        self._compiled = [e for e in effects if isinstance(e, CompiledTorque)]
        self._connected: bool | None = None
        seen, joints = plant.effects.at_stage, plant.joints
        self.aim, self.aim_velocity = seen.position_command, seen.velocity_command
        self._effect_motor, self._effect_link = joints["effect_motor"], joints["effect_link"]

    @property
    def time(self) -> float:
        """Since the start [s]."""
        return float(self.plant.effects.at_stage.time)

    @time.setter
    def time(self, value: float) -> None:
        self.plant.effects.at_stage.time = self.plant.effects.at_step.time = value

    @property
    def has_effects(self) -> bool:
        """Whether effects add torque or couple motors."""
        return bool(self.effects or self.torques or self.plant.effects.coupled.size)

    def place(self) -> None:
        """Brings hand poses and Jacobians and contact geometry to the present state."""
        if place(self.plant, CLEARANCE):
            self.distances.measure()

    def refresh(self) -> None:
        """Brings couplings too, for whoever reads the tables between steps."""
        self.place()
        begin_step(self.plant)

    def start_effects(self, motion: JointMotion | None = None) -> None:
        """Tells the effects that everything begins here, or at another motion."""
        at_rest = self.motion() if motion is None else motion
        for effect in self.effects:
            effect.start(at_rest, self.step)
        self._connected = None

    def follow_past(self, past: JointHistory) -> None:
        """Lets the effects begin at the first motion of a history and follow it; overwrites the joints' state."""
        motion = self.plant.effects.at_step
        take_from_history(past, 0, motion)
        self.start_effects(motion)
        self._connect()
        remember_history(self.plant.effects, past)
        for effect in self.torques:
            for k in range(1, past.time.size):
                take_from_history(past, k, motion)
                effect.settle(motion)

    def advance(self, steps: int) -> None:
        """Moves on by some steps."""
        self._connect()
        if self.torques:
            for _ in range(steps):
                self._advance_with_python()
            return
        done = 0
        while True:
            done = advance_steps(self.plant, done, steps, self.step, CLEARANCE)
            if done == steps:
                break
            self.distances.measure()
        if not self.plant.effects.watched:
            self.time += steps * self.step

    def _connect(self) -> None:
        """Looks up where the effects' laws are, if they began anew or laws run in another way than before."""
        if self._connected is None or self._connected is not Law.in_machine_code:
            connect(self.plant.effects, self._compiled)
            self.plant.effects.watched = self.has_effects
            self._connected = Law.in_machine_code

    def link_mobility(self) -> Matrix:
        """Computes the inverse mass matrix (n, n) of the links without elastic rotors."""
        plant = self.plant
        return mobility_under_water(self.links, plant.links, self.links.createData(), plant.start.position)

    def rate(self) -> Vector:
        """Writes the rate of the stage, effects included; returns the links' acceleration (n,)."""
        self._connect()
        place_links(self.plant.links, self.plant.stage.position)
        evaluate_effects(self.plant)
        self._add_python_torques()
        accelerate_all(self.plant)
        return self.plant.acceleration

    def _advance_with_python(self) -> None:
        """Takes the same step, and asks Python's effects before each stage."""
        plant = self.plant
        self.place()
        begin_step(plant)
        for stage in range(1, 5):
            self.rate()
            next_stage(plant, stage, self.step)
        end_step(plant, self.step)
        for effect in self.torques:
            effect.settle(plant.effects.at_step)

    def _add_python_torques(self) -> None:
        """Adds what Python's effects give at the stage to that of the others."""
        for effect in self.torques:
            extra = self._effect_motor if effect.port == "motor" else self._effect_link
            extra += effect.torque(self.plant.effects.at_stage)

    def motion(self) -> JointMotion:
        """Gives the joint motion that effects see at the step's start; the same object every time."""
        motion = self.plant.effects.at_step
        place_links(self.plant.links, self.plant.start.position)
        observe_links(self.plant, motion.links)
        observe_joints(self.plant, motion)
        return motion
