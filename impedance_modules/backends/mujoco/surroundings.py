# SPDX-License-Identifier: BSD-3-Clause
"""The task's surfaces around a robot in MuJoCo, and which of them MuJoCo has no shape for.

Planes, boxes, cylinders, spheres and convex meshes are MuJoCo's own shapes. A hand touches them with the origin of its
frame, as in the built-in plant; the held object with its whole shape. Nothing else touches: links pass through.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from impedance_modules.arrays import Array
from impedance_modules.backends.mujoco.robot_bodies import OWN, quaternion
from impedance_modules.errors import BadFile, Problem
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import MeshSpec, SurfaceSpec, TaskSpec

POINT_RADIUS = 1e-3
"""Of the sphere at a hand's frame; contacts begin this much deeper, where its centre meets the surface [m]."""

HOLLOW = 0.01
"""By which part of its volume a mesh may be smaller than its convex hull."""

PLANT_ONLY = "(valid: --backend sim, whose built-in plant has it)"

GEOMETRIES = {
    "plane": mujoco.mjtGeom.mjGEOM_PLANE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "mesh": mujoco.mjtGeom.mjGEOM_MESH,
}


@dataclass(frozen=True)
class HandMount:
    """Where a hand's frame is fixed.

    Attributes:
        frame: Its name in the robot's URDF.
        body: MuJoCo's body that carries it.
        rotation: (3, 3) of the frame in the body's axes.
        translation: (3,) [m].
    """

    frame: str
    body: str
    rotation: Array
    translation: Array


@dataclass(frozen=True)
class TouchingPair:
    """Two shapes that touch, and by which law.

    Attributes:
        name: Of the pair.
        stiffness, damping: Of each point of contact [N/m], [N.s/m].
        points: How many points at most share one face.
    """

    name: str
    stiffness: float
    damping: float
    points: int


def surface_name(index: int) -> str:
    """Names the shape of a task's surface."""
    return f"{OWN}surface{index}"


def hand_name(frame: str) -> str:
    """Names the point and the site of a hand."""
    return f"{OWN}hand/{frame}"


def refuse_surfaces(task: TaskSpec) -> None:
    """Refuses what MuJoCo has no shape for.

    Raises:
        BadFile: Every such surface with its line.
    """
    problems = list(_surface_problems(task))
    if problems:
        raise BadFile(problems)


def _surface_problems(task: TaskSpec) -> Iterator[Problem]:
    for index, surface in enumerate(task.environment):
        if surface.surface not in GEOMETRIES:
            message = f"MuJoCo has no shape for a surface '{surface.surface}' {PLANT_ONLY}"
            yield task.document.problem(("environment", index, "surface"), message)
        if surface.wood is not None:
            message = f"MuJoCo's contact knows neither splinters nor wear {PLANT_ONLY}"
            yield task.document.problem(("environment", index, "wood"), message)
        if surface.mesh is not None and (missing := _hollow(surface.mesh)) > HOLLOW:
            message = (
                f"MuJoCo fills the hollows of a mesh: its convex hull is {missing:.0%} larger {PLANT_ONLY[:-1]};"
                " or a convex mesh)"
            )
            yield task.document.problem(("environment", index, "file"), message)


def _hollow(mesh: MeshSpec) -> float:
    """Gives by which part of the mesh's volume its convex hull is larger."""
    corners = mesh.vertices[mesh.triangles]
    volume = float(np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6.0
    return float(ConvexHull(mesh.vertices).volume) / volume - 1.0


def add_surfaces(spec: mujoco.MjSpec, surfaces: tuple[SurfaceSpec, ...]) -> None:
    """Adds the shapes of a task's surfaces; they touch only what ``add_pair`` says."""
    for index, surface in enumerate(surfaces):
        geom = spec.worldbody.add_geom(
            name=surface_name(index),
            type=GEOMETRIES[surface.surface],
            pos=_place(surface),
            quat=quaternion(exp3(np.array(surface.rotation))),
            contype=0,
            conaffinity=0,
        )
        if surface.mesh is not None:
            mesh = spec.add_mesh(name=surface_name(index))
            mesh.uservert, mesh.userface = surface.mesh.vertices.ravel(), surface.mesh.triangles.ravel()
            geom.meshname = surface_name(index)
        else:
            geom.size = geometry_size(surface.size)


def _place(surface: SurfaceSpec) -> Array:
    if surface.position is None:
        return np.array([0.0, 0.0, surface.height or 0.0])
    return np.array(surface.position)


def geometry_size(size: tuple[float, ...] | None) -> Array:
    """Gives MuJoCo's three sizes of a shape, half edges [m], of full edges or diameter and length; of a plane, None."""
    if size is None:
        return np.array([0.0, 0.0, 1.0])  # a plane without an edge
    half = np.zeros(3)
    half[: len(size)] = 0.5 * np.array(size)
    return half


def add_hands(spec: mujoco.MjSpec, hands: tuple[HandMount, ...]) -> None:
    """Puts a site and a point of contact at the frame of every hand."""
    for hand in hands:
        body, name = spec.body(hand.body), hand_name(hand.frame)
        body.add_site(name=name, pos=hand.translation, quat=quaternion(hand.rotation))
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[POINT_RADIUS, 0.0, 0.0],
            pos=hand.translation,
            contype=0,
            conaffinity=0,
        )


def add_hand_contacts(
    spec: mujoco.MjSpec, hands: tuple[HandMount, ...], surfaces: tuple[SurfaceSpec, ...]
) -> list[TouchingPair]:
    """Lets every hand's point touch every surface."""
    found = []
    for hand in hands:
        for index, surface in enumerate(surfaces):
            pair = add_pair(spec, hand_name(hand.frame), surface_name(index), surface.friction)
            pair.margin = -POINT_RADIUS
            found.append(TouchingPair(pair.name, surface.stiffness, surface.damping, 1))
    return found


def add_pair(spec: mujoco.MjSpec, first: str, second: str, friction: float) -> mujoco.MjsPair:
    """Lets two shapes touch, with Coulomb friction; their softness is set once the model is compiled."""
    return spec.add_pair(
        name=f"{first}|{second}",
        geomname1=first,
        geomname2=second,
        condim=3 if friction > 0.0 else 1,
        friction=[friction, friction, 0.0, 0.0, 0.0],
    )
