# SPDX-License-Identifier: BSD-3-Clause
"""What a URDF says, as far as checking a robot or task file needs it: links, joints, limits.

Nothing is computed from it here; dynamics are computed in ``robot/``. Elements keep their line, so that a fault in
the URDF is reported at its own place.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.errors import BadFile, Problem, printable
from impedance_modules.spec.located_xml import Faults, parse_xml, read_number
from impedance_modules.spec.mesh_files import missing_mesh
from impedance_modules.spec.urdf_numbers import check_numbers

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
"""What a URDF joint may be."""

MOST_LINKS = 500
"""A robot with more links is refused: no arm has so many, and a chain of them is walked joint by joint."""


@dataclass(frozen=True)
class UrdfLimits:
    """Limits of one joint: [rad] ([m] if prismatic), [rad/s], [N.m]."""

    lower: float
    upper: float
    velocity: float
    effort: float


@dataclass(frozen=True)
class UrdfMimic:
    """A joint that follows another: q = multiplier q_leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """One joint.

    Attributes:
        type: ``revolute``, ``continuous``, ``prismatic``, ``fixed``, ``floating`` or ``planar``.
        parent, child: Link names.
        limits: None where the URDF gives none.
        line: Where its element begins.
        mimic: Which joint it follows; None where it has a drive of its own.
        resists: Whether its <dynamics> states friction or damping.
    """

    type: str
    parent: str
    child: str
    limits: UrdfLimits | None
    line: int
    mimic: UrdfMimic | None = None
    resists: bool = False

    @property
    def has_one_axis(self) -> bool:
        """Whether it turns about an axis or slides along one."""
        return self.type in {"revolute", "continuous", "prismatic"}

    @property
    def moves(self) -> bool:
        """Whether the joint has a degree of freedom."""
        return self.type != "fixed"


@dataclass(frozen=True)
class UrdfFacts:
    """A URDF's tree.

    Attributes:
        path: The file.
        links: Link names, in the file's order.
        joints: Joint name -> joint, in the file's order.
        links_without_inertia: Links without a positive mass and a positive moment about each axis.
        links_with_collision: Links that have at least one collision shape.
        missing_meshes: Link -> name of a mesh of its collision shapes that is not there.
        link_lines: Link name -> line of its element.
    """

    path: Path
    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]
    links_without_inertia: frozenset[str]
    links_with_collision: frozenset[str]
    missing_meshes: Mapping[str, str]
    link_lines: Mapping[str, int]

    def moving_joints(self, link: str) -> tuple[str, ...]:
        """Returns the joints between the root and a link that are not fixed, from the root outwards."""
        above = {joint.child: (name, joint) for name, joint in self.joints.items()}
        chain: list[str] = []
        for _ in self.joints:
            if link not in above:
                break
            name, joint = above[link]
            if joint.moves:
                chain.append(name)
            link = joint.parent
        return tuple(reversed(chain))

    def welded_to(self, link: str) -> frozenset[str]:
        """Returns a link and everything outwards that is fixed to it: one rigid body."""
        body, waiting = set[str](), [link]
        while waiting:
            current = waiting.pop()
            if current not in body:
                body.add(current)
                fixed = (j.child for j in self.joints.values() if not j.moves and j.parent == current)
                waiting.extend(fixed)
        return frozenset(body)

    def problem(self, line: int, message: str) -> Problem:
        """Locates a problem in the URDF."""
        return Problem(self.path, line, 1, "", message)


def read_urdf(path: Path) -> UrdfFacts:
    """Reads a URDF.

    Raises:
        BadInput: The file is missing, no regular file, too large or cannot be read.
        BadFile: It is no well-formed URDF tree; all problems at once.
    """
    root, lines = parse_xml(path)
    faults = Faults(path, lines)
    if root.tag != "robot":
        faults.add(root, f"the top element is <{root.tag}>; a URDF begins with <robot>")
        raise BadFile(faults.problems)
    if (count := max(len(root.findall(tag)) for tag in ("link", "joint"))) > MOST_LINKS:
        faults.add(root, f"{count} links or joints (valid: at most {MOST_LINKS})")
        raise BadFile(faults.problems)
    links = _named(root, "link", faults)
    joints = {
        name: _joint(name, element, links, faults) for name, element in _named(root, "joint", faults).items()
    }
    without_inertia = frozenset(name for name, link in links.items() if not _has_inertia(link, faults))
    _check_tree(links, joints, root, faults)
    check_numbers(root, faults)
    if faults.problems:
        raise BadFile(faults.problems)
    return UrdfFacts(
        path=path,
        links=tuple(links),
        joints=joints,
        links_without_inertia=without_inertia,
        links_with_collision=frozenset(
            name for name, link in links.items() if link.find("collision/geometry") is not None
        ),
        missing_meshes={
            name: missing for name, link in links.items() if (missing := missing_mesh(path, link)) is not None
        },
        link_lines={name: lines[link] for name, link in links.items()},
    )


def _named(root: ET.Element, tag: str, faults: Faults) -> dict[str, ET.Element]:
    """Collects elements by name; a missing or repeated name is a fault."""
    found: dict[str, ET.Element] = {}
    for element in root.findall(tag):
        name = element.get("name", "")
        if not name:
            faults.add(element, f"a <{tag}> has no name")
        elif printable(name) != name:
            faults.add(element, f"the {tag} {name[:60]!r} has control characters in its name (valid: none)")
        elif name in found:
            faults.add(element, f"the {tag} '{name}' is described twice")
        else:
            found[name] = element
    return found


def _joint(name: str, element: ET.Element, links: Mapping[str, ET.Element], faults: Faults) -> UrdfJoint:
    ends = [_end(name, element, tag, links, faults) for tag in ("parent", "child")]
    kind = element.get("type", "")
    if kind not in JOINT_TYPES:
        faults.add(element, f"the joint '{name}' has the type {kind!r} (valid: {', '.join(JOINT_TYPES)})")
    limit = element.find("limit")
    limits = None
    if limit is not None and kind in ("revolute", "prismatic"):
        limits = UrdfLimits(
            *(faults.number(limit, key) for key in ("lower", "upper")),
            *(faults.number(limit, key, least=0.0) for key in ("velocity", "effort")),
        )
        if limits.lower > limits.upper:
            faults.add(limit, f"<limit> has 'lower' {limits.lower:g} above 'upper' {limits.upper:g}")
    return UrdfJoint(
        kind, ends[0], ends[1], limits, faults.lines[element], _mimic(element), _resists(element)
    )


def _mimic(element: ET.Element) -> UrdfMimic | None:
    found = element.find("mimic")
    if found is None:
        return None
    numbers = (
        read_number(found.get(key, default)) for key, default in (("multiplier", "1"), ("offset", "0"))
    )
    multiplier, offset = (math.nan if value is None else value for value in numbers)
    return UrdfMimic(found.get("joint", ""), multiplier, offset)


def _resists(element: ET.Element) -> bool:
    found = element.find("dynamics")
    return found is not None and any(
        read_number(found.get(key, "0")) != 0.0 for key in ("damping", "friction")
    )


def _end(name: str, element: ET.Element, tag: str, links: Mapping[str, ET.Element], faults: Faults) -> str:
    end = element.find(tag)
    link = "" if end is None else end.get("link", "")
    if link not in links:
        faults.add(element, f"the {tag} of the joint '{name}' is {link!r}, which is no link")
    return link


def _check_tree(
    links: Mapping[str, ET.Element], joints: Mapping[str, UrdfJoint], root: ET.Element, faults: Faults
) -> None:
    """A tree has one root, and each other link hangs on exactly one joint."""
    children = [joint.child for joint in joints.values()]
    for name in sorted({child for child in children if children.count(child) > 1} & set(links)):
        faults.add(links[name], f"the link '{name}' hangs on {children.count(name)} joints")
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        found = ", ".join(f"'{name}'" for name in roots) if roots else "none"
        faults.add(root, f"a robot has exactly one root link; found {found}")
        return
    reached = {roots[0]}
    for _ in joints:
        reached |= {joint.child for joint in joints.values() if joint.parent in reached}
    for name in sorted(set(links) - reached):
        faults.add(links[name], f"the link '{name}' does not hang on the root link '{roots[0]}'")


def _has_inertia(link: ET.Element, faults: Faults) -> bool:
    return all(value > 0 for value in _inertia_numbers(link, faults))


def _inertia_numbers(link: ET.Element, faults: Faults) -> Iterator[float]:
    """Mass and principal-axis moments; a single zero where an element is absent."""
    mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
    if mass is None or inertia is None:
        yield 0.0
        return
    yield faults.number(mass, "value", least=0.0)
    for key in ("ixx", "iyy", "izz"):
        yield faults.number(inertia, key)
