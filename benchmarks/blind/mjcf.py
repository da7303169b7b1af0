# SPDX-License-Identifier: BSD-3-Clause
"""Writes one arm as an MJCF model: links on hinges, rotors beside them, a spring tendon between each pair.

    M(q) v' + C + g = tau_s,    I_r w' + D w = tau_m - tau_s,    tau_s = K (theta - q) + B (w - v)

The rotors hang on the world, so that they only store energy about their own axis; `springlength` of a tendon
may be an interval, which is a backlash.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Drive, Link

Array = NDArray[np.float64]

GRAVITY = 9.81
STEP = 0.0005


@dataclass(frozen=True)
class Joints:
    """What lies between motors and links: (n,) rotor inertia, motor damping, spring K and B, backlash gap."""

    rotor_inertia: Array
    motor_damping: Array
    stiffness: Array
    damping: Array
    gap: Array

    @classmethod
    def nominal(cls, drive: Drive) -> Joints:
        """Returns the joints of robot.yaml."""
        gap = np.zeros(len(drive.joints))
        return cls(
            drive.rotor_inertia, drive.motor_damping, drive.spring_stiffness, drive.spring_damping, gap
        )


@dataclass(frozen=True)
class Surface:
    """A soft floor for the hand: height [m], time constant [s] and damping ratio of MuJoCo's contact."""

    height: float
    time_constant: float
    damping_ratio: float
    friction: float


def write_mjcf(
    links: Sequence[Link],
    joints: Joints | None,
    gravity: Array,
    hand: str,
    surface: Surface | None = None,
) -> str:
    """Returns the model as XML; without ``joints`` the arm is rigid: its links alone.

    Args:
        links: Parents first, the first one's parent being the base.
        joints: Drive numbers, or None.
        gravity: (3,) [m/s^2].
        hand: Link that carries the contact sphere and the site ``hand``.
        surface: Floor under the hand, or None.
    """
    root = ET.Element("mujoco", model="arm")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    option = {"timestep": str(STEP), "integrator": "implicitfast", "gravity": _text(gravity)}
    if joints is not None and surface is None:
        option |= {"iterations": "1"}
    ET.SubElement(root, "option", option)
    world = ET.SubElement(root, "worldbody")
    bodies = {links[0].parent: world}
    for link in links:
        bodies[link.name] = _body(bodies[link.parent], link)
    ET.SubElement(bodies[hand], "site", name="hand", pos="0 0 0")
    if surface is not None:
        _add_surface(world, bodies[hand], surface)
    names = [link.joint for link in links if link.joint is not None]
    if joints is not None:
        _add_drives(root, world, names, joints)
    return ET.tostring(root, encoding="unicode")


def _body(parent: ET.Element, link: Link) -> ET.Element:
    body = ET.SubElement(
        parent, "body", name=link.name, pos=_text(link.position), quat=_text(_quaternion(link.rpy))
    )
    if link.inertial is not None:
        tensor = link.inertial.inertia
        full = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        place = {"pos": _text(link.inertial.com), "mass": repr(float(link.inertial.mass))}
        ET.SubElement(body, "inertial", place | {"fullinertia": _text(np.array(full))})
    if link.joint is not None:
        ET.SubElement(body, "joint", name=link.joint, type="hinge", axis=_text(link.axis))
    return body


def _add_drives(root: ET.Element, world: ET.Element, names: Sequence[str], joints: Joints) -> None:
    tendons = ET.SubElement(root, "tendon")
    for i, name in enumerate(names):
        rotor = ET.SubElement(world, "body", name=f"rotor_{i}", pos="0 0 0")
        inertia = repr(float(joints.rotor_inertia[i]))
        ET.SubElement(rotor, "inertial", pos="0 0 0", mass="0.001", diaginertia=" ".join([inertia] * 3))
        damping = repr(float(joints.motor_damping[i]))
        ET.SubElement(rotor, "joint", name=f"motor_{i}", type="hinge", axis="0 0 1", damping=damping)
        half = 0.5 * float(joints.gap[i])
        numbers = {"stiffness": joints.stiffness[i], "damping": joints.damping[i]}
        shape = {key: repr(float(value)) for key, value in numbers.items()}
        tendon = ET.SubElement(tendons, "fixed", shape | {"springlength": f"{-half!r} {half!r}"})
        ET.SubElement(tendon, "joint", joint=name, coef="-1")
        ET.SubElement(tendon, "joint", joint=f"motor_{i}", coef="1")


def _add_surface(world: ET.Element, hand: ET.Element, surface: Surface) -> None:
    contact = {"solref": f"{surface.time_constant} {surface.damping_ratio}", "solimp": "0.9 0.95 0.002 0.5 2"}
    contact |= {"friction": f"{surface.friction} 0.005 0.0001"}
    ET.SubElement(
        world, "geom", contact | {"type": "plane", "pos": f"0 0 {surface.height}", "size": "3 3 0.1"}
    )
    ET.SubElement(hand, "geom", contact | {"type": "sphere", "size": "0.02", "mass": "0"})


def _quaternion(rpy: Array) -> Array:
    """Returns w, x, y, z of Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy / 2), np.cos(rpy / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def _text(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)
