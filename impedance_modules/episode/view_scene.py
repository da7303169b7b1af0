# SPDX-License-Identifier: BSD-3-Clause
"""What the rerun view shows, as plain data: a `Scene` that never changes, one `ViewSample` per instant, colours.

``runs`` fills these; nothing here knows rerun or a robot. A pose is (7,): position [m], then unit quaternion
(x, y, z, w). Arrays of a sample follow the order of the scene's names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput

Pose7 = tuple[float, float, float, float, float, float, float]
AT_ORIGIN: Pose7 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
Colour = tuple[int, int, int, int]
SERIES: tuple[Colour, ...] = (
    (0, 114, 178, 255),
    (213, 94, 0, 255),
    (0, 158, 115, 255),
    (204, 121, 167, 255),
    (230, 159, 0, 255),
    (86, 180, 233, 255),
    (140, 100, 60, 255),
    (110, 110, 110, 255),
)
BODY: dict[str, Colour] = {
    "robot": (150, 160, 172, 255),
    "object": (214, 158, 60, 255),
    "surface": (120, 140, 120, 130),
}
SPRING: Colour = (240, 228, 66, 255)
FORCE: Colour = (213, 94, 0, 255)
TORQUE: Colour = (204, 121, 167, 255)
LIMIT: Colour = (200, 60, 60, 255)


@dataclass(frozen=True, eq=False)
class DrawnTriangles:
    """Triangles to be drawn: vertices (v, 3) in the shape's axes [m], and three of their indices each, (t, 3)."""

    vertices: Array
    triangles: NDArray[np.int64]


@dataclass(frozen=True)
class BodyShape:
    """A solid that moves with a body.

    Attributes:
        name: Unique within the body.
        kind: ``capsule`` (radius, length of its straight part, along z), ``box`` (full edge lengths),
            ``cylinder`` (radius, full length, along z), ``sphere`` (radius) or ``triangles`` (no size).
        size: As ``kind`` says [m].
        pose: Of the shape's centre in the body.
        drawn: What ``triangles`` are drawn; None for others.
    """

    name: str
    kind: Literal["capsule", "box", "cylinder", "sphere", "triangles"]
    size: tuple[float, ...]
    pose: Pose7 = AT_ORIGIN
    drawn: DrawnTriangles | None = None


@dataclass(frozen=True)
class SceneBody:
    """Something with a pose: a link, a held object, or (without a pose of its own) a surface of the world.

    Attributes:
        name: Unique in the scene.
        shapes: Its solids; a link may have none.
        role: Decides the colour.
    """

    name: str
    shapes: tuple[BodyShape, ...]
    role: Literal["robot", "object", "surface"]


@dataclass(frozen=True)
class EllipsoidStyle:
    """How a 3x3 block (inertia, stiffness ...) at a point is drawn.

    Attributes:
        name: e.g. ``<limb>/inertia``.
        scale: Metres drawn per unit of a half axis (m/kg, m per N/m ...).
    """

    name: str
    scale: float


@dataclass(frozen=True)
class Scene:
    """What does not change during a run.

    Attributes:
        bodies: Moving bodies; a sample has one pose for each.
        surfaces: Bodies that stand still; their shapes' poses are in world.
        springs: Names of the springs drawn as lines.
        wrenches: Names of the wrenches drawn as arrows and as curves.
        ellipsoids: Ellipsoids drawn at points.
        limbs: Limb -> its joints; a sample has one torque ratio per joint, limb after limb.
        tracked: Names of the frames whose distance to their target is plotted.
        constraints: Kinds of QP rows (torque, power, position ...) whose active number is plotted.
        tank_floor: [J].
        tank_max: [J].
    """

    bodies: tuple[SceneBody, ...]
    surfaces: tuple[SceneBody, ...]
    springs: tuple[str, ...]
    wrenches: tuple[str, ...]
    ellipsoids: tuple[EllipsoidStyle, ...]
    limbs: Mapping[str, tuple[str, ...]]
    tracked: tuple[str, ...]
    constraints: tuple[str, ...]
    tank_floor: float
    tank_max: float

    def shapes_of_sample(self) -> dict[str, tuple[int, ...]]:
        """Returns the shape that each array of a `ViewSample` has in this scene."""
        joints = sum(len(names) for names in self.limbs.values())
        return {
            "poses": (len(self.bodies), 7),
            "springs": (len(self.springs), 2, 3),
            "wrench_points": (len(self.wrenches), 3),
            "wrenches": (len(self.wrenches), 6),
            "ellipsoid_poses": (len(self.ellipsoids), 7),
            "half_axes": (len(self.ellipsoids), 3),
            "torque_ratio": (joints,),
            "tracking_error": (len(self.tracked), 2),
            "active_rows": (len(self.constraints),),
        }


@dataclass(frozen=True, eq=False)
class ViewSample:
    """One instant of a run, as the view needs it. World axes throughout; the arrays are not copied.

    Attributes:
        time: Episode time [s].
        poses: (bodies, 7).
        springs: (springs, 2, 3) the frame's point and its equilibrium [m].
        wrench_points: (wrenches, 3) where each wrench acts [m].
        wrenches: (wrenches, 6) force [N], torque [N.m].
        ellipsoid_poses: (ellipsoids, 7) centre and principal axes.
        half_axes: (ellipsoids, 3) principal values, in the ellipsoid's unit; NaN or infinite: nothing to
            draw.
        torque_ratio: (joints,) torque / limit, signed.
        tracking_error: (tracked, 2) distance to the target [m] and angle [rad].
        active_rows: (constraints,) number of active QP rows of each kind.
        tank: Energy [J].
        phase: Name of the phase.
        messages: What happened since the last sample, for the log.
    """

    time: float
    poses: Array
    springs: Array
    wrench_points: Array
    wrenches: Array
    ellipsoid_poses: Array
    half_axes: Array
    torque_ratio: Array
    tracking_error: Array
    active_rows: Array
    tank: float
    phase: str
    messages: tuple[str, ...] = ()


ARRAYS: tuple[str, ...] = tuple(
    field.name for field in fields(ViewSample) if field.name not in ("time", "tank", "phase", "messages")
)


def check_sample(scene: Scene, sample: ViewSample) -> None:
    """Makes sure that a sample has one entry for each thing of the scene.

    Raises:
        BadInput: With the array that does not fit.
    """
    for name, shape in scene.shapes_of_sample().items():
        given = getattr(sample, name).shape
        if given != shape:
            raise BadInput(f"view sample: '{name}' has shape {given} (valid: {shape}, as the scene says)")


def series_colour(index: int) -> Colour:
    """Returns the colour of the ``index``-th line of a plot; repeats after eight."""
    return SERIES[index % len(SERIES)]


def css(colour: Colour) -> str:
    """Returns the colour as ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour[:3])
