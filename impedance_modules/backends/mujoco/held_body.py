# SPDX-License-Identifier: BSD-3-Clause
r"""The held object in MuJoCo: a free body or one on a hinge, welded to the hands or pressed between two palms.

A weld is MuJoCo's, between the hand's frame and its place on the object, with the stiffness of the built-in plant's
coupling: so it begins with the same small deflection, which carries squeeze and weight. A palm of a friction grasp is a
small sphere that presses on the object's face, with sliding friction and, for a patch of radius r, friction against
turning and tilting of \mu r. A hinge is one of MuJoCo's joints, without the play of a bearing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.mujoco.contact_law import GRASP_IMPEDANCE, softness
from impedance_modules.backends.mujoco.robot_bodies import OWN, quaternion
from impedance_modules.backends.mujoco.surroundings import (
    GEOMETRIES,
    HandMount,
    TouchingPair,
    add_pair,
    geometry_size,
    hand_name,
    surface_name,
)
from impedance_modules.plant.grasp import (
    GRASP_ANGULAR_STIFFNESS,
    GRASP_DAMPING_TIME,
    GRASP_LINEAR_STIFFNESS,
    HAND,
    PALM_RADIUS,
)
from impedance_modules.plant.grasp_start import load_couplings, set_up_couplings
from impedance_modules.plant.rigid_object import ObjectBody, object_state, principal_inertia
from impedance_modules.records import Table, new_table
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.hinge_spec import HingeSpec
from impedance_modules.spec.task import SurfaceSpec

OBJECT_NAME = f"{OWN}object"

PALM_SPHERE = 5e-3
"""Radius of the sphere that a palm presses with [m]."""

FACE_POINTS = 4
"""Points with which a face of the object lies on a surface."""


@dataclass(frozen=True)
class GraspStart:
    """How the hands hold the object at the start.

    Attributes:
        position: (3,) of the object's origin in world [m]; its axes are the world's.
        hands: (h,) of ``HAND``: each coupling's rest, in the object's axes.
        wrench: (h, 6) of the object on each hand, world axes at the hand [N], [N.m].
    """

    position: Array
    hands: Table
    wrench: Array


def grasp_start(held: ObjectBody, frames: tuple[str, ...], poses: list[Pose], gravity: Array) -> GraspStart:
    """Finds the static equilibrium in which a run begins, as the built-in plant does (``plant/grasp_start.py``).

    Args:
        held: The object.
        frames: Of all hands.
        poses: Of these at the start posture.
        gravity: (3,) [m/s^2].

    Raises:
        BadInput: A hand is at the object's centre.
    """
    hands = new_table(len(frames), HAND)
    hands["rest_rotation"] = np.eye(3)
    set_up_couplings(hands, frames, held)
    for hand, pose in zip(hands, poses, strict=True):
        hand["translation"], hand["rotation"] = pose.translation, pose.rotation
    position = held.position([hand["translation"] for hand in hands if hand["holds"]])
    wrench = load_couplings(hands, object_state(held, gravity), held, position + held.centre)
    hands["rest_point"] += held.centre
    return GraspStart(position, hands, np.asarray(wrench))


def add_object(spec: mujoco.MjSpec, held: ObjectBody, start: GraspStart) -> None:
    """Adds the object's body where it starts, with its inertia, a homogeneous body's about its centre of mass."""
    shape = held.spec
    body = spec.worldbody.add_body(
        name=OBJECT_NAME,
        pos=start.position,
        ipos=held.centre,
        mass=shape.mass,
        inertia=principal_inertia(shape.shape, shape.size, shape.mass),
        explicitinertial=True,
    )
    body.add_geom(
        name=OBJECT_NAME,
        type=GEOMETRIES[shape.shape],
        size=geometry_size(shape.size),
        contype=0,
        conaffinity=0,
    )
    if shape.hinge is None:
        body.add_freejoint(name=OBJECT_NAME)
    else:
        _add_hinge(body, shape.hinge, start.position)


def _add_hinge(body: mujoco.MjsBody, hinge: HingeSpec, origin: Array) -> None:
    joint = body.add_joint(
        name=OBJECT_NAME,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        pos=np.array(hinge.point) - origin,
        axis=hinge.axis,
        ref=hinge.angle,
        damping=[hinge.damping, 0.0, 0.0],
        stiffness=[hinge.stiffness, 0.0, 0.0],
        springref=hinge.rest,
        frictionloss=hinge.friction,
    )
    if math.isfinite(hinge.lower) or math.isfinite(hinge.upper):
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = [max(hinge.lower, -1e3), min(hinge.upper, 1e3)]


def add_grasps(spec: mujoco.MjSpec, start: GraspStart, mounts: tuple[HandMount, ...]) -> list[TouchingPair]:
    """Couples the holding hands to the object; returns the palms' contacts, none of welds."""
    pairs = []
    for hand, mount in zip(start.hands, mounts, strict=True):
        if not hand["holds"]:
            continue
        if hand["slips"]:
            pairs.append(_add_palm(spec, hand, mount))
            continue
        spec.body(OBJECT_NAME).add_site(
            name=weld_name(mount.frame), pos=hand["rest_point"], quat=quaternion(hand["rest_rotation"])
        )
        weld = spec.add_equality(name=weld_name(mount.frame), type=mujoco.mjtEq.mjEQ_WELD)
        weld.objtype = mujoco.mjtObj.mjOBJ_SITE
        weld.name1, weld.name2 = hand_name(mount.frame), weld_name(mount.frame)
    return pairs


def weld_name(frame: str) -> str:
    """Names the weld of a hand."""
    return f"{OWN}weld/{frame}"


def _add_palm(spec: mujoco.MjSpec, hand: Table, mount: HandMount) -> TouchingPair:
    """Puts a palm's sphere where it presses as deep as its start load says: the hand frame may stand off the face."""
    inward = hand["rotation"].T @ hand["normal"]
    # The plant counts its faces ``palm_offset`` further out; here the sphere reaches that far ahead of the hand.
    centre = (float(hand["palm_offset"]) - PALM_SPHERE) * inward
    name = f"{OWN}palm/{mount.frame}"
    spec.body(mount.body).add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[PALM_SPHERE, 0.0, 0.0],
        pos=mount.translation + mount.rotation @ centre,
        contype=0,
        conaffinity=0,
    )
    friction = float(hand["friction"])
    pair = add_pair(spec, name, OBJECT_NAME, friction)
    if friction > 0.0:
        turning = friction * PALM_RADIUS
        pair.condim, pair.friction = 6, [friction, friction, turning, turning, turning]
    return TouchingPair(pair.name, GRASP_LINEAR_STIFFNESS, GRASP_LINEAR_STIFFNESS * GRASP_DAMPING_TIME, 1)


def add_object_contacts(spec: mujoco.MjSpec, surfaces: tuple[SurfaceSpec, ...]) -> list[TouchingPair]:
    """Lets the object touch every surface."""
    found = []
    for index, surface in enumerate(surfaces):
        pair = add_pair(spec, OBJECT_NAME, surface_name(index), surface.friction)
        found.append(TouchingPair(pair.name, surface.stiffness, surface.damping, FACE_POINTS))
    return found


def stiffen_welds(compiled: mujoco.MjModel, held: ObjectBody, mounts: tuple[HandMount, ...]) -> None:
    r"""Gives every weld the plant's stiffness, critically damped.

    MuJoCo writes the rotation as s \theta / 2, s its ``torquescale``: its stiffness is s^2/4 times that along, times
    the ratio of the inverse mass to the inverse inertia.
    """
    for mount in mounts:
        if mount.frame not in held.hands or (
            held.spec.friction is not None and held.spec.grasp == "friction"
        ):
            continue
        weld = compiled.equality(weld_name(mount.frame)).id
        bodies = (compiled.body(mount.body).id, compiled.body(OBJECT_NAME).id)
        along, about = compiled.body_invweight0[bodies, :].sum(axis=0)
        swing = math.sqrt(GRASP_LINEAR_STIFFNESS * (1.0 - GRASP_IMPEDANCE) * along)
        critical = 2.0 * GRASP_LINEAR_STIFFNESS / swing
        soft = softness(GRASP_LINEAR_STIFFNESS, critical, along, GRASP_IMPEDANCE)
        compiled.eq_solref[weld], compiled.eq_solimp[weld] = soft.solref, soft.solimp
        ratio = GRASP_ANGULAR_STIFFNESS * about / (GRASP_LINEAR_STIFFNESS * along)
        compiled.eq_data[weld, 10] = 2.0 * math.sqrt(ratio)
