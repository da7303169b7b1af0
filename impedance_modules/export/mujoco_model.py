# SPDX-License-Identifier: BSD-3-Clause
"""A MuJoCo model (MJCF) as its author wrote it: joints, bodies, actuators by name, and default classes.

An attribute that an element leaves out comes from its default class: its own, or the ``childclass`` of the closest
body or frame around it, or the top one; and from the classes around that class. Angles of hinge joints are in degrees
unless <compiler angle="radian"/> says otherwise.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.patch_check import PatchTarget
from impedance_modules.errors import BadFile
from impedance_modules.export.carrier import NotCarried
from impedance_modules.export.edited_xml import EditedXml, number
from impedance_modules.spec.located_xml import LARGEST_NUMBER, Faults, read_number, read_xml

ONE_AXIS = ("hinge", "slide")
"""Types of joints that a patch may name."""

ACTUATORS = ("general", "motor", "position", "velocity")
"""Actuators whose force is a gain times the control plus a bias that is linear in the joint's motion."""

DEGREE = math.pi / 180.0


class MujocoDescription:
    """A MuJoCo model that is to be changed.

    Attributes:
        xml: Its tree.
        faults: What is wrong with it for a patch.
        target: What a patch may name in it.
        bodies, joints: Name -> element, those within <replicate> left out: MuJoCo names the copies.
    """

    def __init__(self, path: Path) -> None:
        """Reads it.

        Raises:
            BadInput: The file cannot be read.
            BadFile: It is no MJCF, or not all of it is in this file, or a name is given twice.
        """
        document = read_xml(path)
        self.xml = EditedXml(document)
        self.faults = Faults(path, document.lines)
        self._refuse_other_files()
        self.bodies = self._named("body")
        self.joints = self._named("joint")
        if self.faults.problems:
            raise BadFile(self.faults.problems)
        joints = tuple(name for name, joint in self.joints.items() if self.joint_type(joint) in ONE_AXIS)
        sliding = frozenset(name for name in joints if self.joint_type(self.joints[name]) == "slide")
        self.target = PatchTarget(
            words=str(path),
            joints=joints,
            sliding=sliding,
            bodies=tuple(self.bodies),
            motor_damping=dict.fromkeys(joints, np.inf),
        )

    @property
    def root(self) -> ET.Element:
        """The top element."""
        return self.xml.document.root

    def joint_type(self, joint: ET.Element) -> str:
        """Says what kind of joint it is."""
        return self.value(joint, "type") or "hinge"

    def section(self, tag: str, key: str) -> ET.Element | None:
        """Finds the last of the top-level sections of a kind that has an attribute: that one counts."""
        found = [element for element in self.root.findall(tag) if key in element.attrib]
        return found[-1] if found else None

    def setting(self, tag: str, key: str) -> str | None:
        """Gives an attribute of the sections of a kind."""
        found = self.section(tag, key)
        return None if found is None else found.get(key)

    def angle_unit(self, joint: ET.Element) -> float:
        """Gives the radians in a unit of a joint's angles; 1 where it slides."""
        in_degrees = (self.setting("compiler", "angle") or "degree") == "degree"
        return DEGREE if in_degrees and self.joint_type(joint) == "hinge" else 1.0

    def value(self, element: ET.Element, key: str) -> str | None:
        """Gives an attribute of an element, its own or its default class's."""
        holder = self.holder(element, key)
        return None if holder is None else holder.get(key)

    def holder(self, element: ET.Element, key: str) -> ET.Element | None:
        """Finds the element that an attribute comes from: itself, one of a default class, or none."""
        if key in element.attrib:
            return element
        for default in self.classes(element):
            found = default.find(element.tag)
            if found is not None and key in found.attrib:
                return found
        return None

    def numbers(self, element: ET.Element, key: str, default: tuple[float, ...]) -> Array:
        """Reads numbers of an attribute; a text that is none is a fault of the file."""
        holder = self.holder(element, key)
        if holder is None:
            return np.array(default)
        found = [read_number(word) for word in holder.get(key, "").split()]
        values = [value for value in found if value is not None and abs(value) <= LARGEST_NUMBER]
        if len(values) < len(found) or not values:
            text = holder.get(key, "")[:60]
            self.faults.add(
                holder,
                f"<{holder.tag}> has '{key}' {text!r} (valid: numbers, at most {LARGEST_NUMBER:g} in size)",
            )
            return np.array(default)
        return np.array(values)

    def classes(self, element: ET.Element) -> Iterator[ET.Element]:
        """Yields the <default> elements that an element takes attributes from, the closest first."""
        name = self._class_name(element)
        top = self.root.findall("default")
        chosen = [default for one in top for default in one.iter("default") if default.get("class") == name]
        if name is not None and not chosen and name != "main":
            self.faults.add(element, f"there is no default class '{name}'")
        for default in chosen:
            while default is not self.root:
                if default not in top:
                    yield default
                default = self.xml.parents[default]  # noqa: PLW2901 - outwards
        yield from reversed(top)

    def _class_name(self, element: ET.Element) -> str | None:
        if "class" in element.attrib:
            return element.get("class")
        around = element
        while around in self.xml.parents:
            around = self.xml.parents[around]
            if "childclass" in around.attrib:
                return around.get("childclass")
        return None

    def acting_on(self, joint: str) -> list[ET.Element]:
        """Finds whatever in <actuator> names a joint."""
        every = (element for section in self.root.findall("actuator") for element in section)
        return [e for e in every if joint in (e.get("joint"), e.get("jointinparent"))]

    def driving(self, joint: str) -> list[ET.Element]:
        """Finds the same; ``NotCarried`` if there is nothing."""
        found = self.acting_on(joint)
        if not found:
            raise NotCarried(
                f"the model has no actuator on the joint '{joint}'; whatever drives it must do it"
            )
        return found

    def actuators(self, joint: str) -> list[ET.Element]:
        """Finds the actuators that drive a joint; ``NotCarried`` if a patch cannot change what they give it."""
        found = self.driving(joint)
        for element in found:
            if element.tag not in ACTUATORS:
                raise NotCarried(
                    f"line {self.faults.lines[element]}: '{joint}' is driven by a <{element.tag}>, whose force is"
                    f" not a number times its control (valid: {', '.join(ACTUATORS)})"
                )
            self._refuse_mixed_class(element)
        return found

    def _refuse_mixed_class(self, element: ET.Element) -> None:
        """All kinds of actuators share one set of defaults in MuJoCo; here each kind is looked up by itself."""
        for default in self.classes(element):
            for other in default:
                if other.tag in ACTUATORS and other.tag != element.tag:
                    raise NotCarried(
                        f"line {self.faults.lines[element]}: a <{element.tag}> takes defaults from the <{other.tag}>"
                        f" of line {self.faults.lines[other]} (valid: a class of its own)"
                    )

    def switched_off(self, *flags: str) -> str | None:
        """Names the one of some flags by which the model switches a kind of force off."""
        for option in self.root.findall("option"):
            for flag in option.findall("flag"):
                for name in flags:
                    if flag.get(name) == "disable":
                        return f'line {self.faults.lines[flag]}: <flag {name}="disable"/>'
        return None

    def set_number(self, element: ET.Element, key: str, value: float) -> None:
        """Writes one number into the element itself, whatever its default class says."""
        element.set(key, number(value))

    def _named(self, tag: str) -> dict[str, ET.Element]:
        found: dict[str, ET.Element] = {}
        copies = {inside for copy in self.root.iter("replicate") for inside in copy.iter()}
        for world in self.root.findall("worldbody"):
            for element in world.iter(tag):
                name = element.get("name")
                if name is None or element in copies:
                    continue
                if name in found:
                    self.faults.add(element, f"the {tag} '{name}' is described twice")
                found[name] = element
        return found

    def _refuse_other_files(self) -> None:
        """All of a model must be in the one file that is read."""
        if self.root.tag != "mujoco":
            hint = "; a URDF goes with --urdf" if self.root.tag == "robot" else ""
            self.faults.add(
                self.root, f"the top element is <{self.root.tag}>; a MuJoCo model begins with <mujoco>{hint}"
            )
            raise BadFile(self.faults.problems)
        for include in self.root.iter("include"):
            self.faults.add(
                include,
                f"<include> of {include.get('file', '')[:60]!r}: what stands there is not seen"
                " (valid: one file, as mujoco.mj_saveLastXML writes it)",
            )


def read_model(path: Path, out: Path) -> MujocoDescription:
    """Reads a MuJoCo model that is to be written elsewhere, where it must find its meshes again.

    Raises:
        BadInput: The file cannot be read.
        BadFile: It is no MuJoCo model, or names files that would not be found from there.
    """
    model = MujocoDescription(path)
    if path.resolve().parent == out.resolve().parent:
        return model
    folders = [model.setting("compiler", key) for key in ("assetdir", "meshdir", "texturedir")]
    if any(folder is not None and folder.startswith("/") for folder in folders):
        return model
    for element in model.root.iter():
        for key, name in element.attrib.items():
            if key.startswith("file") and not name.startswith("/"):
                model.faults.add(
                    element,
                    f"<{element.tag}> names the file {name[:60]!r}, which is found from this folder only"
                    f" (valid: --out in {path.parent}, or a whole path here)",
                )
    return model
