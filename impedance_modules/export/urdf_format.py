# SPDX-License-Identifier: BSD-3-Clause
r"""A patch in a URDF: bodies, friction, limits, the zero of an encoder, a base that leans.

A joint of a URDF is rigid and has neither rotor, nor spring, nor drive; <dynamics> is read by few simulators
(docs/export.md). X_J is a joint's <origin>, a pose in its parent link.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.patch_check import PatchTarget
from impedance_modules.effects.simulator_numbers import Amount
from impedance_modules.export.body_inertia import BodyInertia, rotation_of_rpy, rpy_of_rotation
from impedance_modules.export.carrier import Carrier, Format, NotCarried
from impedance_modules.export.edited_xml import EditedXml, number, numbers
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.located_xml import Faults, read_number, read_xml
from impedance_modules.spec.urdf import UrdfFacts, read_urdf

UPRIGHT, LEAN = "_upright", "_lean"
"""What the link and the joint are called that a leaning base hangs on, behind the base's own name."""


class UrdfDescription:
    """A URDF that is to be changed.

    Attributes:
        xml: Its tree.
        faults: What is wrong with it for a patch.
        target: What a patch may name in it.
        facts: Its links and joints.
    """

    def __init__(self, path: Path) -> None:
        """Reads it; ``BadFile`` with every problem of it."""
        self.facts: UrdfFacts = read_urdf(path)
        document = read_xml(path)
        self.xml = EditedXml(document)
        self.faults = Faults(path, document.lines)
        self.target = PatchTarget.of_urdf(path, self.facts)

    def joint(self, name: str) -> ET.Element:
        """Finds a joint's element."""
        return next(e for e in self.xml.document.root.findall("joint") if e.get("name") == name)

    def link(self, name: str) -> ET.Element:
        """Finds a link's element."""
        return next(e for e in self.xml.document.root.findall("link") if e.get("name") == name)

    @property
    def root_link(self) -> str:
        """Name of the link that hangs on no joint."""
        children = {joint.child for joint in self.facts.joints.values()}
        return next(name for name in self.facts.links if name not in children)


def read_description(path: Path, out: Path) -> UrdfDescription:
    """Reads a URDF that is to be written elsewhere, where it must find its meshes again.

    Raises:
        BadInput: The file cannot be read.
        BadFile: It is no URDF, or names files that would not be found from there.
    """
    description = UrdfDescription(path)
    moved = path.resolve().parent != out.resolve().parent
    for element in description.xml.document.root.iter() if moved else ():
        name = element.get("filename")
        if name is not None and "://" not in name and not name.startswith("/"):
            description.faults.add(
                element,
                f"<{element.tag}> names the file {name[:60]!r}, which is found from this folder only"
                f" (valid: --out in {path.parent}, or a whole path or package:// here)",
            )
    return description


def numbers_of(element: ET.Element | None, key: str, default: tuple[float, ...]) -> Array:
    """Reads numbers that ``read_urdf`` has checked."""
    text = None if element is None else element.get(key)
    if text is None:
        return np.array(default)
    return np.array([value for word in text.split() if (value := read_number(word)) is not None])


def _pose(origin: ET.Element | None) -> tuple[Array, Array]:
    """Reads rotation (3, 3) and translation (3,) of an <origin>."""
    zero = (0.0, 0.0, 0.0)
    angles = numbers_of(origin, "rpy", zero)
    return rotation_of_rpy(tuple(map(float, angles))), numbers_of(origin, "xyz", zero)


def _add_dynamics(description: UrdfDescription, amount: Amount, key: str) -> None:
    dynamics = description.xml.child(description.joint(amount.key), "dynamics")
    before = float(numbers_of(dynamics, key, (0.0,))[0])
    dynamics.set(key, number(before + amount.numbers[0]))


def add_friction(description: UrdfDescription, amount: Amount) -> None:
    """Adds F to a joint's dry friction [N.m]."""
    _add_dynamics(description, amount, "friction")


def add_damping(description: UrdfDescription, amount: Amount) -> None:
    """Adds D to a joint's viscous friction [N.m.s/rad]."""
    _add_dynamics(description, amount, "damping")


def limit_effort(description: UrdfDescription, amount: Amount) -> None:
    """Lowers a joint's effort limit [N.m]; a joint without limits would need one of its speed, too."""
    joint = description.joint(amount.key)
    limit = joint.find("limit")
    if limit is None:
        description.faults.add(
            joint,
            f"the joint '{amount.key}' has no <limit> to write a torque limit into, and a <limit> needs a"
            ' velocity that a patch does not say (valid: <limit effort="..." velocity="..."/>)',
        )
        return
    before = float(numbers_of(limit, "effort", (np.inf,))[0])
    limit.set("effort", number(min(before, amount.numbers[0])))


def move_encoder_zero(description: UrdfDescription, amount: Amount) -> None:
    r"""Lets the joint's coordinate be what the encoder reports, q + q_e.

    X_J' = X_J Rot(a, -q_e), or Trans(-q_e a) for a joint that slides; both limits move by q_e.
    """
    joint, offset = description.joint(amount.key), amount.numbers[0]
    _refuse_mimic(description, amount.key)
    axis = numbers_of(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
    axis = axis / np.linalg.norm(axis)
    rotation, translation = _pose(joint.find("origin"))
    origin = description.xml.child(joint, "origin")
    if joint.get("type") == "prismatic":
        origin.set("xyz", numbers(translation - offset * (rotation @ axis)))
    else:
        origin.set("rpy", numbers(rpy_of_rotation(rotation @ exp3(-offset * axis))))
    limit = joint.find("limit")
    for key in ("lower", "upper") if limit is not None and joint.get("type") != "continuous" else ():
        if limit is not None and key in limit.attrib:
            limit.set(key, number(float(numbers_of(limit, key, (0.0,))[0]) + offset))


def _refuse_mimic(description: UrdfDescription, joint: str) -> None:
    for element in description.xml.document.root.findall("joint"):
        mimic = element.find("mimic")
        if mimic is not None and joint in (element.get("name"), mimic.get("joint")):
            raise NotCarried(
                f"the joint '{element.get('name')}' follows '{mimic.get('joint')}' by its true angle (<mimic>)"
            )


def change_body(description: UrdfDescription, amount: Amount) -> None:
    """Adds ten inertial parameters to a link; the axes in which its inertia is written stay."""
    link = description.link(amount.key)
    inertial = link.find("inertial")
    if amount.key in description.facts.links_without_inertia or inertial is None:
        description.faults.add(
            link,
            f"the link '{amount.key}' has no <inertial> with mass and moments, and what the patch fixes to it is"
            " no body by itself (valid: a link with <inertial>, e.g. the one that this one is fixed to)",
        )
        return
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    axes, centre = _pose(inertial.find("origin"))
    if mass is None or inertia is None:
        return
    xx, xy, xz, yy, yz, zz = (
        float(numbers_of(inertia, key, (0.0,))[0]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    before = BodyInertia(float(numbers_of(mass, "value", (0.0,))[0]), centre, axes @ own @ axes.T)
    after = before.with_change(amount.numbers)
    if after is None:
        raise NotCarried(
            f"with {amount.numbers[0]:+g} kg and its moments the link '{amount.key}' by itself is no physical body"
        )
    mass.set("value", number(after.mass))
    description.xml.child(inertial, "origin").set("xyz", numbers(after.centre))
    turned = axes.T @ after.about_centre @ axes
    for row, first in enumerate("xyz"):
        for column in range(row, 3):
            inertia.set(f"i{first}{'xyz'[column]}", number(float(turned[row, column])))


def lean_base(description: UrdfDescription, amount: Amount) -> None:
    r"""Turns the robot by exp((r_x, r_y, 0)) in the simulator's world, in which gravity points down.

    A root link that is nothing but a frame stays upright, and the joints on it are turned: X_J' = (R, 0) X_J. Any
    other root link hangs on a new one from then on.
    """
    lean = exp3(np.array([*amount.numbers, 0.0]))
    root = description.root_link
    link = description.link(root)
    joints = [name for name, joint in description.facts.joints.items() if joint.parent == root]
    if not any(link.find(tag) is not None for tag in ("inertial", "visual", "collision")):
        for name in joints:
            joint = description.joint(name)
            rotation, translation = _pose(joint.find("origin"))
            origin = description.xml.child(joint, "origin")
            origin.set("xyz", numbers(lean @ translation))
            origin.set("rpy", numbers(rpy_of_rotation(lean @ rotation)))
        return
    _hang_root(description, root, lean)


def _hang_root(description: UrdfDescription, root: str, lean: Array) -> None:
    upright, joint = root + UPRIGHT, root + LEAN
    for name, known in ((upright, description.facts.links), (joint, description.facts.joints)):
        if name in known:
            raise NotCarried(f"the file has a '{name}' already, as the leaning base's frame would be called")
    top = description.xml.document.root
    description.xml.add(top, "link", name=upright)
    added = description.xml.add(top, "joint", name=joint, type="fixed")
    description.xml.add(added, "parent", link=upright)
    description.xml.add(added, "child", link=root)
    description.xml.add(added, "origin", xyz="0 0 0", rpy=numbers(rpy_of_rotation(lean)))


NO_DRIVE = "a URDF has no drive, only a joint's largest effort; do it where your simulator applies commands"

URDF: Format[UrdfDescription] = Format(
    words="a URDF",
    read=read_description,
    carriers={
        "dry friction": Carrier("<joint><dynamics friction>", "friction + F", add_friction),
        "viscous friction": Carrier("<joint><dynamics damping>", "damping + D", add_damping),
        "torque limit": Carrier("<joint><limit effort>", "min(effort, L)", limit_effort),
        "encoder zero": Carrier(
            "<joint><origin>, <limit lower upper>",
            "X_J Rot(a, -q_e); lower + q_e, upper + q_e",
            move_encoder_zero,
        ),
        "body inertia": Carrier(
            "<link><inertial>", "mass + m; m c and inertia about the link's origin likewise", change_body
        ),
        "base lean": Carrier(
            "<origin> of the joints on a bare root link; else a new root link and a fixed joint",
            "exp((r_x, r_y, 0)) X_J",
            lean_base,
        ),
    },
    refused={
        "drag": "<dynamics> has friction and damping, nothing that grows with the square of the speed",
        "rotor inertia": "a URDF has no rotors; as a link's inertia it would load all joints before it as well",
        "joint spring": "a joint of a URDF has no spring",
        "drive gain": NO_DRIVE,
        "drive lag": NO_DRIVE,
        "late command": NO_DRIVE,
        "servo gains": "a URDF has no controller",
    },
    apart={},
)
