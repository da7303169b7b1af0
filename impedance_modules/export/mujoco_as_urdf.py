# SPDX-License-Identifier: BSD-3-Clause
r"""The rigid links of a MuJoCo model (MJCF) as a URDF, and what its joints resist with.

A body with joints at anchors c_j about axes a_j, in its own axes, stands in what carries it at

    X_PB(q) = X_0 \prod_j T(c_j) R(a_j, q_j - ref_j) T(-c_j)

(a slide moves by a_j (q_j - ref_j)). Each joint becomes a URDF joint at its anchor, the last one's link has the body's
name. q is MuJoCo's qpos. What MuJoCo would change silently, or what stands in another file, is refused by its line.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadFile
from impedance_modules.export.body_inertia import BodyInertia, rpy_of_rotation
from impedance_modules.export.edited_xml import number, numbers
from impedance_modules.export.geom_inertia import inertia_of_geoms
from impedance_modules.export.mujoco_bodies import orientation, read_inertia, sized
from impedance_modules.export.mujoco_model import ONE_AXIS, MujocoDescription
from impedance_modules.export.mujoco_shapes import MujocoShapes, Placement
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.located_xml import parse_xml
from impedance_modules.spec.robot_spec import UPRIGHT_GRAVITY
from impedance_modules.spec.urdf import MOST_LINKS

MAKERS = ("replicate", "composite", "flexcomp", "attach", "plugin", "flex")
"""Elements of which MuJoCo makes bodies that do not stand in the file."""

SILENT = (("settotalmass", "-1"), ("boundmass", "0"), ("boundinertia", "0"), ("balanceinertia", "false"))
"""Settings of <compiler> that change masses, and what leaves them alone."""

SAME_GRAVITY = 0.02
"""By how much gravity may differ from ours, in each axis [m/s^2]: MuJoCo's is 9.81."""

RESISTANCES = ("armature", "damping", "frictionloss")
FAR = 1e3
"""Range of a slide that states none [m]."""


@dataclass(frozen=True)
class MujocoLinks:
    """A MuJoCo model's links and joints.

    Attributes:
        urdf: The links, as text.
        resistances: ``armature`` [kg.m^2], ``damping`` [N.m.s/rad], ``frictionloss`` [N.m] (kg, N.s/m, N for a slide)
            -> joint -> number, where it is not zero.
        notes: What the model holds beside links, and is not used; sentences.
    """

    urdf: str
    resistances: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...]


def urdf_of_mujoco(path: Path, *, shapes: bool = False) -> MujocoLinks:
    """Reads a MuJoCo model.

    Args:
        path: The model.
        shapes: Whether its geoms become collision shapes; names of mesh files are whole paths then.

    Raises:
        BadInput: The file cannot be read.
        BadFile: It is no MuJoCo model, or its links do not follow from this file alone; all problems, with lines.
    """
    model = MujocoDescription(path)
    _refuse_silent_changes(model)
    if (count := sum(element.tag in ("body", "frame") for element in model.root.iter())) > MOST_LINKS:
        model.faults.add(model.root, f"{count} bodies and frames (valid: at most {MOST_LINKS})")
        raise BadFile(model.faults.problems)
    tree = _Tree(model, MujocoShapes(model) if shapes else None)
    for world in model.root.findall("worldbody"):
        tree.geoms(world, "world", (np.eye(3), np.zeros(3)))
        tree.contents(world, "world", (np.eye(3), np.zeros(3)))
    if not tree.resistances and not model.faults.problems:
        model.faults.add(model.root, "no joint turns about an axis or slides (valid: a robot)")
    if model.faults.problems:
        raise BadFile(model.faults.problems)
    found = {
        kind: {joint: values[kind] for joint, values in tree.resistances.items() if values[kind] != 0.0}
        for kind in RESISTANCES
    }
    return MujocoLinks(ET.tostring(tree.robot, encoding="unicode"), found, tuple(_notes(model, tree)))


@contextmanager
def as_urdf(path: Path) -> Iterator[tuple[Path, MujocoLinks | None]]:
    """Gives a URDF of a description for as long as the block runs: itself, or what a MuJoCo model says.

    Raises:
        BadInput: The file cannot be read, or, of a MuJoCo model, not turned into links.
    """
    root, _ = parse_xml(path)
    if root.tag != "mujoco":
        yield path, None
        return
    links = urdf_of_mujoco(path)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"{path.stem}.urdf"
        copy.write_text(links.urdf, encoding="utf-8")
        yield copy, links


class _Tree:
    """Walks outwards through the bodies and writes a link and a joint for each."""

    def __init__(self, model: MujocoDescription, shapes: MujocoShapes | None) -> None:
        self.shapes = shapes
        self.robot = ET.Element("robot", name=model.root.get("model") or "mujoco")
        self.resistances: dict[str, dict[str, float]] = {}
        self.unused: dict[str, list[str]] = {}
        self._model = model
        self._count = 0
        self._standing = {"world"}
        ET.SubElement(self.robot, "link", name="world")

    def contents(self, element: ET.Element, link: str, placed: Placement) -> None:
        """Adds the bodies that stand in an element, which is fixed to a link."""
        for child in element:
            if child.tag in MAKERS:
                self._model.faults.add(
                    child,
                    f"<{child.tag}> makes bodies that do not stand in the file (valid: a file as"
                    " mujoco.mj_saveLastXML writes it)",
                )
            elif child.tag in ("body", "frame"):
                inside = self._placed(child, placed)
                if child.tag == "frame":
                    self.contents(child, link, inside)
                else:
                    self._body(child, link, inside)

    def _placed(self, element: ET.Element, placed: Placement) -> Placement:
        R, p = placed
        return R @ orientation(self._model, element), p + R @ sized(self._model, element, "pos", (0.0,) * 3)

    def _body(self, body: ET.Element, link: str, placed: Placement) -> None:
        self._count += 1
        name = body.get("name") or f"body {self._count}"
        joints = [child for child in body if child.tag in ("joint", "freejoint")]
        for index, joint in enumerate(joints):
            last = index == len(joints) - 1
            after = name if last else f"{name} behind joint {index + 1}"
            placed = self._joint(joint, f"{name} joint {index + 1}", (link, after), placed)
            link = after
        if not joints:
            self._add_joint(f"{name} on {link}", "fixed", (link, name), placed)
            placed = np.eye(3), np.zeros(3)
        if not joints and link in self._standing:
            self._standing.add(name)
        # What is fixed to the world needs no inertia, so none is asked of shapes whose volume is not known.
        if name not in self._standing or body.find("inertial") is not None:
            self._inertial(name, self._inertia(body), placed)
        self.geoms(body, name, placed)
        if np.any(sized(self._model, body, "gravcomp", (0.0,))):
            self.unused.setdefault("gravcomp", []).append(name)
        self.contents(body, name, placed)

    def _joint(self, joint: ET.Element, unnamed: str, links: tuple[str, str], placed: Placement) -> Placement:
        """Adds a joint and the link behind it; returns where the body stands in that link."""
        model, (R, p) = self._model, placed
        kind = "free" if joint.tag == "freejoint" else model.joint_type(joint)
        name = joint.get("name") or unnamed
        if kind not in ONE_AXIS:
            self._add_joint(name, "floating", links, placed)
            return np.eye(3), np.zeros(3)
        anchor = self._vector(joint, "pos", (0.0, 0.0, 0.0))
        axis = self._vector(joint, "axis", (0.0, 0.0, 1.0))
        size = float(np.linalg.norm(axis))
        if size == 0.0:
            model.faults.add(joint, f"the joint '{name}' has an axis of length 0")
            axis, size = np.eye(3)[2], 1.0
        axis = axis / size
        start = model.angle_unit(joint) * self._number(joint, "ref")
        slid = np.zeros(3) if kind == "hinge" else start * axis
        turned = R @ exp3(-start * axis) if kind == "hinge" else R
        origin = turned, p + R @ (anchor - slid)
        self._add_one_axis(joint, name, links, origin, axis)
        self.resistances[name] = {key: self._number(joint, key) for key in RESISTANCES}
        if self._number(joint, "stiffness") != 0.0:
            self.unused.setdefault("stiffness", []).append(name)
        return np.eye(3), -anchor

    def _vector(self, element: ET.Element, key: str, default: tuple[float, ...]) -> Array:
        found = self._model.numbers(element, key, default)
        if found.size != len(default):
            self._model.faults.add(element, f"<{element.tag}> needs {len(default)} numbers as '{key}'")
            return np.array(default)
        return found

    def _number(self, element: ET.Element, key: str) -> float:
        return float(self._model.numbers(element, key, (0.0,))[0])

    def _add_one_axis(
        self, joint: ET.Element, name: str, links: tuple[str, str], origin: Placement, axis: Array
    ) -> None:
        ends = self._range(joint)
        slides = self._model.joint_type(joint) == "slide"
        kind = "prismatic" if slides else "revolute" if ends is not None else "continuous"
        element = self._add_joint(name, kind, links, origin)
        ET.SubElement(element, "axis", xyz=numbers(axis))
        if ends is None and slides:
            ends = -FAR, FAR
        if ends is not None:
            lower, upper = (number(end) for end in ends)
            ET.SubElement(
                element, "limit", lower=lower, upper=upper, velocity="0", effort=self._effort(joint)
            )

    def _range(self, joint: ET.Element) -> tuple[float, float] | None:
        """Lowest and highest position [rad] or [m]; None where the joint is not limited."""
        limited = self._model.value(joint, "limited") or "auto"
        by_hand = self._model.setting("compiler", "autolimits") == "false"
        if (
            limited == "false"
            or (limited == "auto" and by_hand)
            or self._model.holder(joint, "range") is None
        ):
            return None
        lower, upper = self._model.angle_unit(joint) * self._vector(joint, "range", (0.0, 0.0))
        return float(lower), float(upper)

    def _effort(self, joint: ET.Element) -> str:
        """Largest torque of the joint's actuators where it is stated [N.m], else 0: unknown."""
        found = self._model.numbers(joint, "actuatorfrcrange", (0.0,))
        return number(float(np.max(np.abs(found))))

    def _add_joint(self, name: str, kind: str, links: tuple[str, str], origin: Placement) -> ET.Element:
        parent, child = links
        ET.SubElement(self.robot, "link", name=child)
        joint = ET.SubElement(self.robot, "joint", name=name, type=kind)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        R, p = origin
        ET.SubElement(joint, "origin", xyz=numbers(p), rpy=numbers(rpy_of_rotation(R)))
        return joint

    def _inertia(self, body: ET.Element) -> BodyInertia | None:
        inertial = body.find("inertial")
        source = self._model.setting("compiler", "inertiafromgeom") or "auto"
        if inertial is not None and source != "true":
            return read_inertia(self._model, inertial)
        if source == "false":
            return None
        return inertia_of_geoms(self._model, [*self._geoms(body, (np.eye(3), np.zeros(3)))])

    def geoms(self, element: ET.Element, link: str, placed: Placement) -> None:
        """Adds the geoms of an element, which stands in a link, as collision shapes, where they are asked for."""
        if self.shapes is not None:
            for geom, *inside in self._geoms(element, placed):
                self.shapes.add(self._link(link), geom, (inside[0], inside[1]))

    def _link(self, name: str) -> ET.Element:
        return next(one for one in self.robot.findall("link") if one.get("name") == name)

    def _geoms(self, element: ET.Element, placed: Placement) -> Iterator[tuple[ET.Element, Array, Array]]:
        for child in element:
            if child.tag == "geom":
                yield child, *placed
            elif child.tag == "frame":
                yield from self._geoms(child, self._placed(child, placed))

    def _inertial(self, link: str, inertia: BodyInertia | None, placed: Placement) -> None:
        """Writes a body's inertia into its link, in whose axes the body stands at ``placed``."""
        if inertia is None or inertia.mass <= 0.0:
            return
        R, p = placed
        inertial = ET.SubElement(self._link(link), "inertial")
        ET.SubElement(inertial, "origin", xyz=numbers(p + R @ inertia.centre), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=number(inertia.mass))
        about = R @ inertia.about_centre @ R.T
        places = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        ET.SubElement(inertial, "inertia", {key: number(float(about[at])) for key, at in places.items()})


def _refuse_silent_changes(model: MujocoDescription) -> None:
    """Notes settings that make other links than those of the file, or another gravity than ours."""
    for key, fine in SILENT:
        section = model.section("compiler", key)
        if section is not None and section.get(key) != fine:
            model.faults.add(
                section, f'<compiler {key}="{section.get(key)}"> changes masses (valid: without)'
            )
    option = model.section("option", "gravity")
    gravity = np.array(UPRIGHT_GRAVITY)
    if option is not None:
        gravity = sized(model, option, "gravity", UPRIGHT_GRAVITY)
    if np.any(np.abs(gravity - UPRIGHT_GRAVITY) > SAME_GRAVITY):
        model.faults.add(
            model.root if option is None else option,
            f"gravity is {numbers(gravity)} m/s^2 (valid: 0 0 -9.81, with the base as it stands)",
        )
    if (flag := model.switched_off("gravity")) is not None:
        model.faults.add(model.root, f"gravity is switched off in {flag} (valid: with gravity)")


def _notes(model: MujocoDescription, tree: _Tree) -> Iterator[str]:
    """Says what of a model is not used."""
    words = {"stiffness": "the springs of its joints", "gravcomp": "the gravity compensation of its bodies"}
    for key, names in tree.unused.items():
        yield f"{words[key]} are not part of the model: {', '.join(names)}"
    sections = [tag for tag in ("equality", "tendon", "contact") if model.root.find(tag) is not None]
    if sections:
        yield f"not read: {', '.join(f'<{tag}>' for tag in sections)}"
    if tree.shapes is not None:
        yield from tree.shapes.notes()
