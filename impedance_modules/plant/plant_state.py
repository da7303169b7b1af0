# SPDX-License-Identifier: BSD-3-Clause
r"""The plant's memory: one table per kind of part, shared by the compiled loop and the plain reference.

The state is one row of ``4 n + 12 + 9`` numbers:

    q (n) link positions, v (n), theta (n) motor positions, w (n) motor velocities,
    p (3) object position, phi (3) its rotation since the step began, u (3) its velocity,
    L (3) its angular momentum, all in world axes; then the work counters named below [J].

The object's angular momentum, not its angular velocity, is the state: without torque it is a constant,
and the integrator keeps constants exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Table = NDArray[np.void]
Row = Any
"""One row of a table; its fields are those of the table's type below."""

START, STAGE, RATE, SUM = 0, 1, 2, 3
"""Rows of the state: at the step's start, at the Runge-Kutta stage, its rate, the weighted sum of rates."""

ELASTIC, RIGID, IDEAL = 0, 1, 2
"""Kinds of joint: spring and rotor; rotor fixed to the link; torque source without a rotor."""

COMMAND, ROBOT, EFFECT, MOTOR_LOSS, SPRING_LOSS, STOP, GRASP, CONTACT, PUSH = range(9)
"""Work counters: by command, robot's own torque and effects; lost in damping; done on bodies by the rest."""

PUSH_ROW = 2
"""Of the wrenches on a body, beside those from contact (0) and from the grasp (1)."""

CELL = 0.01
"""Distance of the nodes at which wood remembers what was rubbed off [m]."""

WAVES = 8
"""Ripples that make up a texture."""

COUNTERS = 9

MAX_SPANS = 16
"""Most spans of one sheet: room in its row."""

OBJECT_SIZE = 12

JOINT = np.dtype(
    [
        ("kind", np.int64),
        ("stiffness", np.float64),
        ("half_gap", np.float64),
        ("spring_damping", np.float64),
        ("motor_damping", np.float64),
        ("reflected_inertia", np.float64),
        ("effort_max", np.float64),
        ("lower", np.float64),
        ("upper", np.float64),
        ("stop_stiffness", np.float64),
        ("stop_damping", np.float64),
        ("command", np.float64),
        ("assist", np.float64),
        ("extra_motor", np.float64),
        ("extra_link", np.float64),
        ("hold_stiffness", np.float64),
        ("hold_damping", np.float64),
        ("hold_position", np.float64),
        ("motor", np.float64),
        ("load", np.float64),
    ],
    align=True,
)
"""One joint: its drive, its limits, the torques that act now [N.m], and the torque through its gear."""

LINK = np.dtype(
    [
        ("parent", np.int64),
        ("rest_rotation", np.float64, (3, 3)),
        ("rest_translation", np.float64, (3,)),
        ("screw", np.float64, (6,)),
        ("armature", np.float64),
        ("mass", np.float64),
        ("centre", np.float64, (3,)),
        ("inertia", np.float64, (3, 3)),
        ("wet", np.int64),
        ("water", np.float64, (6, 6)),
        ("water_now", np.float64, (6, 6)),
        ("joint_rotation", np.float64, (3, 3)),
        ("rotation", np.float64, (3, 3)),
        ("translation", np.float64, (3,)),
        ("axis", np.float64, (6,)),
        ("velocity", np.float64, (6,)),
        ("drift", np.float64, (6,)),
        ("momentum", np.float64, (6,)),
        ("centre_now", np.float64, (3,)),
        ("turned_inertia", np.float64, (3, 3)),
        ("articulated", np.float64, (6, 6)),
        ("force", np.float64, (6,)),
        ("push", np.float64, (6,)),
        ("inertia_along", np.float64),
        ("torque", np.float64),
        ("acceleration", np.float64, (6,)),
    ],
    align=True,
)
"""One link: its place on its parent at joint angle 0, its joint's screw and its inertia about its centre of mass,
and the water it takes along if ``wet``, all in its own axes; then, in world axes, its pose and what the
articulated-body algorithm writes down.
"""

HAND = np.dtype(
    [
        ("link", np.int64),
        ("mount_translation", np.float64, (3,)),
        ("mount_rotation", np.float64, (3, 3)),
        ("holds", np.int64),
        ("slips", np.int64),
        ("translation", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("linear_stiffness", np.float64),
        ("angular_stiffness", np.float64),
        ("linear_damping", np.float64),
        ("angular_damping", np.float64),
        ("friction", np.float64),
        ("palm_radius", np.float64),
        ("point", np.float64, (3,)),
        ("turn", np.float64, (3, 3)),
        ("normal", np.float64, (3,)),
        ("arm", np.float64, (3,)),
        ("stretch", np.float64, (3,)),
        ("twist", np.float64, (3,)),
        ("pressure", np.float64),
    ],
    align=True,
)
"""One hand: where it sits on its link, its pose at the step's start, its coupling (rest in the object's axes)."""

BODY = np.dtype(
    [
        ("present", np.int64),
        ("mass", np.float64),
        ("inertia", np.float64, (3,)),
        ("gravity", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("change", np.float64, (3, 3)),
        ("turned", np.float64, (3, 3)),
    ],
    align=True,
)
"""The object: principal inertia [kg.m^2], rotation at the step's start, since then, and both together."""

CONTACT_POINT = np.dtype(
    [
        ("near", np.int64),
        ("face", np.int64),
        ("stale", np.int64),
        ("touching", np.int64),
        ("body", np.int64),
        ("surface", np.int64),
        ("centre", np.float64, (3,)),
        ("radius", np.float64),
        ("stiffness", np.float64),
        ("normal_stiffness", np.float64),
        ("damping", np.float64),
        ("friction", np.float64),
        ("position", np.float64, (3,)),
        ("asked", np.float64, (3,)),
        ("measured", np.float64),
        ("normal", np.float64, (3,)),
        ("distance", np.float64),
        ("arm", np.float64, (3,)),
        ("slip", np.float64, (3,)),
        ("move", np.float64, (3,)),
        ("force", np.float64, (3,)),
        ("pressure", np.float64),
        ("slid", np.float64),
        ("wood", np.int64),
        ("on_wood", np.int64),
        ("caught", np.int64),
        ("local", np.float64, (3,)),
    ],
    align=True,
)
"""One small sphere of a body against one surface.

Coal ``measured`` the distance where it was last ``asked``; ``distance`` follows the present position from
there, exactly while the same ``face`` is nearest (``contact.compiled_contact``). On a sheet the distance is the gap
above its shape at rest, and ``normal_stiffness`` what it opposes to the depth there; elsewhere it is ``stiffness``.
``slip`` is the stretch of the tangential spring, ``slid`` by how much the last step has drawn it along [m]. ``wood`` is
the surface's piece of wood or -1, ``caught`` the splinter that holds the point or -1, ``local`` the point in the box's
axes while it is ``on_wood``.
"""

SURFACE = np.dtype(
    [
        ("flat", np.int64),
        ("translation", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("half", np.float64, (3,)),
        ("span_count", np.int64),
        ("spans", np.float64, (MAX_SPANS, 9)),
        ("softness", np.float64),
    ],
    align=True,
)
"""One surface as far as the search for near points needs it; the distance of planes and boxes is coal's.

A sheet has spans (``contact.sheet``) and a softness 1 / EI [1/(N.m^2)]; other surfaces have none.
"""


WOOD = np.dtype(
    [
        ("surface", np.int64),
        ("half", np.float64, (2,)),
        ("friction", np.float64),
        ("rough_friction", np.float64),
        ("height", np.float64),
        ("wear", np.float64),
        ("waves", np.float64, (WAVES, 3)),
        ("nodes", np.int64, (2,)),
        ("first_node", np.int64),
        ("reach", np.float64),
        ("endurance", np.float64),
        ("first_splinter", np.int64),
        ("last_splinter", np.int64),
        ("rubbed", np.float64),
        ("broken", np.float64),
    ],
    align=True,
)
"""One piece of wood (``contact.compiled_wood``): its texture, its part of the grid and of the splinters, and the
work of friction and of breaking splinters on it [J].
"""

SPLINTER = np.dtype(
    [
        ("u", np.float64),
        ("v", np.float64),
        ("force", np.float64),
        ("damage", np.float64),
        ("broken", np.int64),
    ],
    align=True,
)
"""One splinter: its place in the box's axes [m], its breaking force [N], its damage (1 breaks it)."""


@dataclass(frozen=True)
class Memory:
    """All tables of one plant.

    Attributes:
        state: (4, 4 n + 20) rows START, STAGE, RATE, SUM.
        joints: (n,) of ``JOINT``.
        links: (n + 1,) of ``LINK``; row 0 is the world.
        hands: (h,) of ``HAND``.
        body: (1,) of ``BODY``.
        contacts: (points x surfaces,) of ``CONTACT_POINT``.
        surfaces: Of ``SURFACE``.
        woods: Of ``WOOD``.
        worn: (nodes,) friction work per area of all wood [J/m^2].
        splinters: Of ``SPLINTER``.
        jacobian: (h, 6, n) hand Jacobians at the step's start, world axes.
        motion: (h + 1, 2, 6) displacement since the step's start, and twist, of each hand and the object.
        wrench: (h + 1, 3, 6) on each body at its own origin: from contact, from the grasp, from pushes.
        torque: (n,) what acts on the links [N.m].
        acceleration: (n,) of the links at the stage [rad/s^2].
    """

    state: Array
    joints: Table
    links: Table
    hands: Table
    body: Table
    contacts: Table
    surfaces: Table
    woods: Table
    worn: Array
    splinters: Table
    jacobian: Array
    motion: Array
    wrench: Array
    torque: Array
    acceleration: Array

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.torque.size)

    def part(self, name: str, row: int = START) -> Array:
        """Gives a live view of one part of the state, e.g. ``part("motor_position")``."""
        return self.state[row, _parts(self.n)[name]]


@lru_cache
def _parts(n: int) -> dict[str, slice]:
    """Says where the parts of a state of n joints lie."""
    return {
        "position": slice(0, n),
        "velocity": slice(n, 2 * n),
        "motor_position": slice(2 * n, 3 * n),
        "motor_velocity": slice(3 * n, 4 * n),
        "object_position": slice(4 * n, 4 * n + 3),
        "object_turn": slice(4 * n + 3, 4 * n + 6),
        "object_velocity": slice(4 * n + 6, 4 * n + 9),
        "object_momentum": slice(4 * n + 9, 4 * n + 12),
        "work": slice(4 * n + 12, 4 * n + 12 + COUNTERS),
    }
