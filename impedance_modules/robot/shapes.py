# SPDX-License-Identifier: BSD-3-Clause
"""The robot's collision shapes as plain numbers, and where every link is: what a picture of it needs."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose


@dataclass(frozen=True)
class LinkShape:
    """One solid of a link.

    Attributes:
        link: Name of the link.
        kind: ``capsule`` (radius, length of the straight part, along z), ``cylinder`` (radius, length, along z),
            ``box`` (edge lengths) or ``sphere`` (radius).
        size: As ``kind`` says [m].
        pose: Of the shape's centre in the link's frame.
    """

    link: str
    kind: str
    size: tuple[float, ...]
    pose: Pose


def link_shapes(model: RobotModel) -> tuple[LinkShape, ...]:
    """Lists the shapes of all links; a mesh is drawn as the box around it, one that is not there is left out.

    Raises:
        BadInput: A link's shape is of a kind that cannot be drawn.
    """
    return tuple(_link_shape(model, shape) for shape in model.geometry().geometryObjects)


def _link_shape(model: RobotModel, shape: pin.GeometryObject) -> LinkShape:
    frame = model.pin_model.frames[shape.parentFrame]
    # Shapes are placed in their joint; people think of them in their link.
    X_LS = frame.placement.inverse() * shape.placement
    if isinstance(shape.geometry, coal.ConvexBase):
        box = shape.geometry.aabb_local
        X_LC = X_LS * pin.SE3(np.eye(3), 0.5 * (box.max_ + box.min_))
        edges = tuple(map(float, box.max_ - box.min_))
        return LinkShape(frame.name, "box", edges, Pose(X_LC.rotation.copy(), X_LC.translation.copy()))
    kind, size = _kind_and_size(shape)
    return LinkShape(frame.name, kind, size, Pose(X_LS.rotation.copy(), X_LS.translation.copy()))


def _kind_and_size(shape: pin.GeometryObject) -> tuple[str, tuple[float, ...]]:
    solid = shape.geometry
    if isinstance(solid, coal.Capsule):
        return "capsule", (float(solid.radius), 2.0 * float(solid.halfLength))
    if isinstance(solid, coal.Cylinder):
        return "cylinder", (float(solid.radius), 2.0 * float(solid.halfLength))
    if isinstance(solid, coal.Sphere):
        return "sphere", (float(solid.radius),)
    if isinstance(solid, coal.Box):
        return "box", tuple(2.0 * float(edge) for edge in solid.halfSide)
    raise BadInput(
        f"collision shape '{shape.name}' is a {type(solid).__name__} (valid: capsule, cylinder, sphere, box)"
    )


class LinkPoses:
    """Where chosen links are, for a joint position at a time.

    Attributes:
        rotation: (links, 3, 3) R_WL of the last position.
        translation: (links, 3) their origins [m].
    """

    def __init__(self, model: RobotModel, links: tuple[str, ...]) -> None:
        self._model = model.pin_model
        self._data = self._model.createData()
        # Views of pinocchio's own memory, taken once.
        placements = [self._data.oMf[model.frame_id(link)] for link in links]
        self._placements = [(X_WL.rotation, X_WL.translation) for X_WL in placements]
        self.rotation: Array = np.zeros((len(links), 3, 3))
        self.translation: Array = np.zeros((len(links), 3))

    def update(self, q: Array) -> None:
        """Moves to q (n,) [rad]; overwrites the arrays."""
        pin.framesForwardKinematics(self._model, self._data, q)
        for link, (rotation, translation) in enumerate(self._placements):
            self.rotation[link], self.translation[link] = rotation, translation
