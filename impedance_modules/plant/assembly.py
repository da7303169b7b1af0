# SPDX-License-Identifier: BSD-3-Clause
"""Lays out the plant's memory for one robot, its surfaces and its object."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.plant.contact.points import Point, hand_point, object_points
from impedance_modules.plant.contact.surfaces import contact_table, surface_table
from impedance_modules.plant.wood import wood_tables
from impedance_modules.plant.grasp.coupling import body_table, prepare_hands
from impedance_modules.plant.grasp import HeldObject
from impedance_modules.plant.joints import joint_table
from impedance_modules.plant.links import link_table
from impedance_modules.plant.plant_state import COUNTERS, HAND, OBJECT_SIZE, Memory
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.task import SurfaceSpec

Array = NDArray[np.float64]


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
