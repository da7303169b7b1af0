# SPDX-License-Identifier: BSD-3-Clause
"""The state of the plant: what moves, what acts, and what all of it is made of, in one record.

Laws take it whole (``plant.joints[i].kind``, ``plant.stage.velocity[i]``) or the row that they need. The rows of its
tables are defined beside their laws: ``joints``, ``links``, ``grasp``, ``point_contact``, ``surfaces``,
``mesh_surface``, ``sheet``, ``wood``.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from impedance_modules.plant.effect_torques import EffectTorques
from impedance_modules.plant.grasp import HAND
from impedance_modules.plant.hinge_forces import HingeState
from impedance_modules.plant.joints import JOINT
from impedance_modules.plant.links import LINK
from impedance_modules.plant.mesh_surface import NODE, TRIANGLE
from impedance_modules.plant.point_contact import CONTACT_POINT
from impedance_modules.plant.rigid_object import ObjectState
from impedance_modules.plant.surfaces import SURFACE
from impedance_modules.plant.wood import SPLINTER, WOOD
from impedance_modules.records import Array3, Matrix, Record, Table, Vector

WORK = np.dtype(
    [
        ("command_work", np.float64),
        ("robot_work", np.float64),
        ("effect_work", np.float64),
        ("motor_loss", np.float64),
        ("spring_loss", np.float64),
        ("stop_work", np.float64),
        ("grasp_work", np.float64),
        ("contact_work", np.float64),
        ("hinge_work", np.float64),
        ("push_work", np.float64),
    ],
    align=True,
)
"""Work counters [J], named as in ``energy_balance.EnergyBook``; in a rate, powers [W]."""

WORK_SIZE = len(WORK.names or ())
OBJECT_SIZE = 12


class StateVector(Record):
    """What the integrator integrates, as one vector of 4 n + 22 numbers and its named parts; or the rate of it.

    The object's angular momentum, not its angular velocity, is integrated: without torque it is a constant, and the
    integrator keeps constants exactly.

    Attributes:
        whole: (4 n + 22,) all of it.
        position, velocity: (n,) of the links [rad], [rad/s].
        motor_position, motor_velocity: (n,) of the rotors, seen at the joint [rad], [rad/s].
        object_position: (3,) [m], world axes, as all of the object.
        object_rotation: (3,) rotation vector since the step's start [rad].
        object_velocity: (3,) [m/s].
        object_momentum: (3,) angular [N.m.s].
        work: (1,) work counters.
    """

    whole: Vector
    position: Vector
    velocity: Vector
    motor_position: Vector
    motor_velocity: Vector
    object_position: Vector
    object_rotation: Vector
    object_velocity: Vector
    object_momentum: Vector
    work: Annotated[Table, WORK]

    def __reduce__(self) -> tuple[Any, ...]:
        return StateVector.over, (self.whole,)

    @classmethod
    def over(cls, whole: Vector) -> StateVector:
        """Names the parts of a vector (4 n + 22,); they share its memory."""
        n = (whole.size - OBJECT_SIZE - WORK_SIZE) // 4
        parts: list[Any] = np.split(whole, np.cumsum([n, n, n, n, 3, 3, 3, 3]))
        parts[-1] = parts[-1].view(WORK)
        names = (field.name for field in cls._layout.fields)
        return cls(**dict(zip(names, (whole, *parts), strict=True)))


class PlantState(Record):
    """Everything that the laws of the plant read and write.

    Bodies are the h hands, then the object; their twists and wrenches are (linear, angular), in world axes, at the
    origin of the hand's frame or of the object.

    Attributes:
        start: State at the step's start.
        stage: State at the present Runge-Kutta stage.
        rate: Its rate.
        rate_sum: Weighted sum of the stages' rates.
        joints: (n,) of ``JOINT``.
        links: (n + 1,) of ``LINK``; row 0 is the world.
        hands: (h,) of ``HAND``.
        body: The object.
        hinge: About which alone the object turns, or its absence.
        contacts: (points x surfaces,) of ``CONTACT_POINT``.
        surfaces: Of ``SURFACE``.
        mesh_nodes: Of ``NODE``: the boxes around the triangles of all meshes.
        triangles: Of ``TRIANGLE``: those of all meshes.
        woods: Of ``WOOD``.
        friction_work: (nodes,) per area, of all wood [J/m^2].
        splinters: Of ``SPLINTER``.
        jacobian: (h, 6, n) of the hands at the step's start.
        displacement: (h + 1, 6) of each body since the step's start [m], [rad].
        twist: (h + 1, 6) of each body [m/s], [rad/s].
        contact_wrench, grasp_wrench, push_wrench: (h + 1, 6) on each body [N], [N.m].
        torque: (n,) on the links, from everything but their own weight and inertia [N.m].
        acceleration: (n,) of the links at the stage [rad/s^2].
        effects: That act as torques on joints, and what they see.
    """

    start: StateVector
    stage: StateVector
    rate: StateVector
    rate_sum: StateVector
    joints: Annotated[Table, JOINT]
    links: Annotated[Table, LINK]
    hands: Annotated[Table, HAND]
    body: ObjectState
    hinge: HingeState
    contacts: Annotated[Table, CONTACT_POINT]
    surfaces: Annotated[Table, SURFACE]
    mesh_nodes: Annotated[Table, NODE]
    triangles: Annotated[Table, TRIANGLE]
    woods: Annotated[Table, WOOD]
    friction_work: Vector
    splinters: Annotated[Table, SPLINTER]
    jacobian: Array3
    displacement: Matrix
    twist: Matrix
    contact_wrench: Matrix
    grasp_wrench: Matrix
    push_wrench: Matrix
    torque: Vector
    acceleration: Vector
    effects: EffectTorques

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.torque.size)


def state_vector(n: int) -> StateVector:
    """Makes the state of n joints and an object, all zero."""
    return StateVector.over(np.zeros(4 * n + OBJECT_SIZE + WORK_SIZE))
