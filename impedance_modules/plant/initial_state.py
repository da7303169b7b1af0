# SPDX-License-Identifier: BSD-3-Clause
"""The plant's start: everything at rest, every spring wound by the weight and squeeze it carries."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.effects.drive_path import DrivePath
from impedance_modules.effects.worn import WornPlant
from impedance_modules.plant.grasp import HeldObject, body_table, prepare_hands, take_hold
from impedance_modules.plant.integrator import Integrator
from impedance_modules.plant.joints import joint_table
from impedance_modules.plant.links import link_table
from impedance_modules.plant.motor_commands import WeightCompensation
from impedance_modules.plant.plant_state import COUNTERS, HAND, IDEAL, OBJECT_SIZE, START, Memory
from impedance_modules.plant.point_contact import (
    Point,
    contact_table,
    hand_point,
    object_points,
    surface_table,
)
from impedance_modules.plant.wood import renew_wood, wood_tables
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.task import SurfaceSpec

Array = NDArray[np.float64]


class Start:
    """Brings a plant's memory to rest at a posture; nothing of what was before remains.

    Attributes:
        on_links: (n,) torque on the links at the start, beside weight, grasp and effects [N.m].
    """

    def __init__(
        self, integrator: Integrator, held: HeldObject | None, worn: WornPlant, weight: WeightCompensation
    ) -> None:
        """Takes the plant's integrator, what its hands hold, what it wears, and what the robot carries itself."""
        self._integrator = integrator
        self._memory = integrator.memory
        self._held = held
        self._worn = worn
        self._weight = weight
        self.on_links: Array = np.zeros(integrator.memory.n)

    def clear(self, position: Array) -> None:
        """Forgets every motion, torque and contact; the joints stand at q (n,) [rad]."""
        memory = self._memory
        memory.state[:] = 0.0
        memory.part("position")[:] = position
        memory.part("motor_position")[:] = position
        for name in ("command", "assist", "extra_motor", "extra_link", "hold_stiffness", "hold_damping"):
            memory.joints[name] = 0.0
        memory.wrench[:] = 0.0
        for name in ("slip", "force", "pressure", "near", "face", "touching"):
            memory.contacts[name] = 0.0
        renew_wood(memory)

    def rest(self, position: Array) -> Array:
        """Puts everything at rest at q (n,) [rad]; returns the command (n,) [N.m] that keeps it there."""
        self.clear(position)
        wrench = self._grasp()
        self._integrator.refresh()
        return self._balance(position, wrench)

    def _grasp(self) -> Array:
        """Places the object and closes the hands on it; returns its wrench on each hand (h, 6)."""
        memory, held = self._memory, self._held
        memory.body["rotation"] = np.eye(3)
        self._integrator.place()
        if held is None:
            return np.zeros((memory.hands.size, 6))
        origins = [hand["translation"] for hand in memory.hands if hand["holds"]]
        start = held.position(origins)
        memory.part("object_position")[:] = start
        return take_hold(memory.hands, memory.body, held, start)

    def _balance(self, position: Array, wrench: Array) -> Array:
        """Winds the joints' springs for the start load and finds the command that carries it."""
        memory, joints = self._memory, self._memory.joints
        load = self._link_weight(position) - self.on_links
        for jacobian, on_hand in zip(memory.jacobian, wrench, strict=True):
            load -= jacobian.T @ on_hand
        joints["assist"] = self._weight.torque(position + self._worn.sensors.offset)
        self._start_effects()
        at_rest = self._integrator.motion(START)
        for effect in self._worn.torques:
            load -= effect.torque(at_rest) if effect.port == "link" else 0.0
        ahead = self._compliance() * load + joints["half_gap"] * np.sign(load)
        memory.part("motor_position")[:] = position + ahead * (joints["kind"] != IDEAL)
        joints["load"] = joints["motor"] = load
        command = self._motor_start(load) / self._worn.drive_gain - joints["assist"]
        joints["command"] = command
        self._start_effects()
        return np.asarray(command)

    def _compliance(self) -> Array:
        """Gives 1 / K of every joint's spring (n,) [rad/(N.m)]; 0 without one."""
        stiffness = self._memory.joints["stiffness"]
        return np.where(stiffness > 0.0, 1.0 / np.where(stiffness > 0.0, stiffness, 1.0), 0.0)

    def _link_weight(self, position: Array) -> Array:
        """Computes the torque that really carries the links (n,) [N.m]."""
        links = self._integrator.links
        return np.array(pin.computeGeneralizedGravity(links, links.createData(), position))

    def _motor_start(self, load: Array) -> Array:
        """Finds what the drives must give at rest (n,) [N.m]: the load, and what effects take on the way."""
        needed = load.copy()
        at_rest = self._integrator.motion(START)
        for effect in self._worn.torques:
            if effect.port == "motor" and not isinstance(effect, DrivePath):
                needed -= effect.torque(at_rest)
        return needed

    def _start_effects(self) -> None:
        """Tells what is worn that everything begins here."""
        at_rest = self._integrator.motion(START)
        for effect in self._worn.torques:
            effect.start(at_rest, self._integrator.step)


def build_memory(
    model: RobotModel,
    links: pin.Model,
    frames: tuple[str, ...],
    surfaces: Sequence[SurfaceSpec],
    held: HeldObject | None,
    *,
    added_mass: Array | None = None,
) -> Memory:
    """Takes the memory once and fills in every constant; ``added_mass`` is (n, 6, 6) of water, or None."""
    n, h = model.n, len(frames)
    hands = np.zeros(h, HAND)
    hands["turn"] = np.eye(3)
    for hand, frame in zip(hands, frames, strict=True):
        mount = links.frames[model.frame_id(frame)]
        hand["link"] = mount.parentJoint
        hand["mount_rotation"] = mount.placement.rotation
        hand["mount_translation"] = mount.placement.translation
    if held is not None:
        prepare_hands(hands, frames, held)
    bodies: list[Sequence[Point]] = [(hand_point(),) for _ in frames]
    if held is not None:
        bodies.append(object_points(held.spec.shape, held.spec.size))
    woods, worn, splinters = wood_tables(surfaces)
    return Memory(
        state=np.zeros((4, 4 * n + OBJECT_SIZE + COUNTERS)),
        joints=joint_table(model),
        links=link_table(links, added_mass),
        hands=hands,
        body=body_table(held, links.gravity.linear),
        contacts=contact_table(surfaces, bodies, woods),
        surfaces=surface_table(surfaces),
        woods=woods,
        worn=worn,
        splinters=splinters,
        jacobian=np.zeros((h, 6, n)),
        motion=np.zeros((h + 1, 2, 6)),
        wrench=np.zeros((h + 1, 3, 6)),
        torque=np.zeros(n),
        acceleration=np.zeros(n),
    )
