# SPDX-License-Identifier: BSD-3-Clause
"""The plant's start: its state laid out, everything at rest, every spring deflected by the load that it carries."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from impedance_modules.effects.drive_path import DrivePath
from impedance_modules.effects.joint_motion import CompiledTorque
from impedance_modules.effects.plant_builder import PlantEffects
from impedance_modules.plant.effect_torques import effect_torques
from impedance_modules.plant.grasp import HAND
from impedance_modules.plant.grasp_start import load_couplings, set_up_couplings
from impedance_modules.plant.hinge_start import hinge_state, load_hinge
from impedance_modules.plant.integrator import Integrator
from impedance_modules.plant.joints import IDEAL, joint_table
from impedance_modules.plant.links import link_table
from impedance_modules.plant.motor_commands import WeightCompensation
from impedance_modules.plant.plant_state import PlantState, state_vector
from impedance_modules.plant.point_contact import (
    Point,
    contact_table,
    hand_point,
    object_points,
)
from impedance_modules.plant.rigid_object import ObjectBody, object_state
from impedance_modules.plant.surfaces import surface_tables
from impedance_modules.plant.wood import renew_wood, wood_tables
from impedance_modules.records import Matrix, Vector, new_table
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.task import SurfaceSpec


def build_plant_state(
    model: RobotModel,
    links: pin.Model,
    frames: tuple[str, ...],
    surfaces: Sequence[SurfaceSpec],
    held: ObjectBody | None,
    effects: PlantEffects,
) -> PlantState:
    """Makes the state and fills in every constant."""
    n, h = model.n, len(frames)
    start, stage = state_vector(n), state_vector(n)
    count = sum(isinstance(torque, CompiledTorque) for torque in effects.torques)
    hands = new_table(h, HAND)
    hands["rest_rotation"] = np.eye(3)
    for hand, frame in zip(hands, frames, strict=True):
        mount = links.frames[model.frame_id(frame)]
        hand["link"] = mount.parentJoint
        hand["mount_rotation"] = mount.placement.rotation
        hand["mount_translation"] = mount.placement.translation
    if held is not None:
        set_up_couplings(hands, frames, held)
    bodies: list[Sequence[Point]] = [(hand_point(),) for _ in frames]
    if held is not None:
        points = object_points(held.spec.shape, held.spec.size)
        bodies.append([(place - held.centre, radius) for place, radius in points])
    woods, friction_work, splinters = wood_tables(surfaces)
    table, mesh_nodes, triangles = surface_tables(surfaces)
    table_of_links = link_table(links, effects.added_mass)
    return PlantState(
        start=start,
        stage=stage,
        rate=state_vector(n),
        rate_sum=state_vector(n),
        joints=joint_table(model),
        links=table_of_links,
        hands=hands,
        body=object_state(held, links.gravity.linear),
        hinge=hinge_state(held),
        contacts=contact_table(surfaces, bodies, woods),
        surfaces=table,
        mesh_nodes=mesh_nodes,
        triangles=triangles,
        woods=woods,
        friction_work=friction_work,
        splinters=splinters,
        jacobian=np.zeros((h, 6, n)),
        displacement=np.zeros((h + 1, 6)),
        twist=np.zeros((h + 1, 6)),
        contact_wrench=np.zeros((h + 1, 6)),
        grasp_wrench=np.zeros((h + 1, 6)),
        push_wrench=np.zeros((h + 1, 6)),
        torque=np.zeros(n),
        acceleration=np.zeros(n),
        effects=effect_torques(count, start, stage, links=table_of_links, coupling=effects.coupling),
    )


class StartAtRest:
    """Brings a plant's state to rest at a posture; nothing of what was before remains."""

    def __init__(
        self,
        integrator: Integrator,
        held: ObjectBody | None,
        effects: PlantEffects,
        weight: WeightCompensation,
    ) -> None:
        """Takes the plant's integrator, what its hands hold, its effects, and what the robot carries itself."""
        self._integrator = integrator
        self._plant = integrator.plant
        self._held = held
        self._effects = effects
        self._weight = weight

    def clear(self, position: Vector) -> None:
        """Forgets every motion, torque and contact; the joints stand at q (n,) [rad]."""
        plant = self._plant
        for state in (plant.start, plant.stage, plant.rate, plant.rate_sum):
            state.whole[:] = 0.0
        plant.start.position[:] = position
        plant.start.motor_position[:] = position
        for name in ("command", "assist", "effect_motor", "effect_link", "hold_stiffness", "hold_damping"):
            plant.joints[name] = 0.0
        for wrench in (plant.contact_wrench, plant.grasp_wrench, plant.push_wrench):
            wrench[:] = 0.0
        for name in ("stretch", "force", "normal_force", "near", "face", "touching"):
            plant.contacts[name] = 0.0
        renew_wood(plant)

    def rest(self, position: Vector) -> Vector:
        """Puts everything at rest at q (n,) [rad]; returns the command (n,) [N.m] that keeps it there."""
        self.clear(position)
        wrench = self._grasp()
        self._integrator.refresh()
        return self._balance(position, wrench)

    def _grasp(self) -> Matrix:
        """Places the object and closes the hands on it; returns its wrench on each hand (h, 6)."""
        plant, held = self._plant, self._held
        plant.body.rotation[:] = np.eye(3)
        self._integrator.place()
        if held is None:
            return np.zeros((plant.hands.size, 6))
        origins = [hand["translation"] for hand in plant.hands if hand["holds"]]
        start = held.position(origins) + held.centre
        plant.start.object_position[:] = start
        wrench = load_couplings(plant.hands, plant.body, held, start)
        load_hinge(plant.hinge, held, plant.body, start, plant.hands, wrench)
        return wrench

    def _balance(self, position: Vector, wrench: Matrix) -> Vector:
        """Deflects the joints' springs by the start load and finds the command that carries it."""
        plant, joints = self._plant, self._plant.joints
        load = self._link_weight(position)
        for jacobian, on_hand in zip(plant.jacobian, wrench, strict=True):
            load -= jacobian.T @ on_hand
        joints["assist"] = self._weight.torque(position + self._effects.sensors.offset)
        self._integrator.start_effects()
        at_rest = self._integrator.motion()
        for effect in self._effects.torques:
            load -= effect.torque(at_rest) if effect.port == "link" else 0.0
        lead = self._compliance() * load + joints["half_gap"] * np.sign(load)
        plant.start.motor_position[:] = position + lead * (joints["kind"] != IDEAL)
        joints["load"] = joints["motor"] = load
        command = self._asked(self._motor_start(load)) - joints["assist"]
        joints["command"] = command
        self._integrator.start_effects()
        return np.asarray(command)

    def _asked(self, given: Vector) -> Vector:
        """Finds what must be asked of drives (n,) [N.m] that give a share of what is asked of others."""
        gain, crosstalk = self._effects.drive_gain, self._effects.drive_crosstalk
        if not crosstalk.any():
            return np.asarray(given / gain)
        return np.asarray(np.linalg.solve(np.diag(gain) + crosstalk, given))

    def _compliance(self) -> Vector:
        """Gives 1 / K of every joint's spring (n,) [rad/(N.m)]; 0 without one."""
        stiffness = self._plant.joints["stiffness"]
        return np.where(stiffness > 0.0, 1.0 / np.where(stiffness > 0.0, stiffness, 1.0), 0.0)

    def _link_weight(self, position: Vector) -> Vector:
        """Computes the torque that really carries the links (n,) [N.m]."""
        links = self._integrator.links
        return np.array(pin.computeGeneralizedGravity(links, links.createData(), position))

    def _motor_start(self, load: Vector) -> Vector:
        """Finds what the drives must give at rest (n,) [N.m]: the load, and what effects take on the way."""
        needed = load.copy()
        at_rest = self._integrator.motion()
        for effect in self._effects.torques:
            if effect.port == "motor" and not isinstance(effect, DrivePath):
                needed -= effect.torque(at_rest)
        return needed
