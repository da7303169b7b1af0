# SPDX-License-Identifier: BSD-3-Clause
"""A robot description as its maker ships it: a URDF, a xacro file or a MuJoCo model, read into one tree of links.

What the file knows of drives beyond links is kept beside it: rotors and friction of a MuJoCo model, and the attributes
``motor_inertia`` and ``gear_ratio`` that some makers write into ``<dynamics>``.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.errors import BadFile, BadInput
from impedance_modules.export.mujoco_as_urdf import urdf_of_mujoco
from impedance_modules.spec.located_xml import parse_xml, read_number
from impedance_modules.spec.urdf import UrdfFacts, read_urdf

XACRO = "xacro:"
"""Prefix of the elements of a xacro file."""


@dataclass(frozen=True, eq=False)
class SourceDescription:
    """A robot description.

    Attributes:
        path: The file; meshes are looked for from it.
        kind: ``URDF``, ``xacro`` or ``MuJoCo model``.
        root: Its <robot>.
        facts: What it says of links, joints and limits; lines are those of ``path`` for a URDF only.
        rotor_inertia: Joint -> inertia of its rotor seen at the joint, where it is stated [kg.m^2].
        damping: Joint -> viscous friction, where it is stated and not 0 [N.m.s/rad].
        friction: Joint -> dry friction, where it is stated and not 0 [N.m].
        effort: Joint -> largest torque of its actuator, where only that is stated [N.m].
        compensates: Whether it says that the simulated robot carries its weight by itself.
        notes: What it holds beside this, and is not used; sentences.
    """

    path: Path
    kind: str
    root: ET.Element
    facts: UrdfFacts
    rotor_inertia: Mapping[str, float]
    damping: Mapping[str, float]
    friction: Mapping[str, float]
    effort: Mapping[str, float]
    compensates: bool
    notes: tuple[str, ...]


def read_description(path: Path) -> SourceDescription:
    """Reads a URDF, a xacro file or a MuJoCo model.

    Raises:
        BadInput: The file cannot be read, or its kind needs a package that is not installed.
        BadFile: It is no robot description; all problems, each with its line.
    """
    root, _ = parse_xml(path)
    if root.tag == "mujoco":
        return _of_mujoco(path, root)
    if path.suffix == ".xacro" or any(element.tag.startswith(XACRO) for element in root.iter()):
        return _of_urdf(path, "xacro", ET.fromstring(_expanded(path)), None)
    return _of_urdf(path, "URDF", root, read_urdf(path))


def _of_urdf(path: Path, kind: str, root: ET.Element, facts: UrdfFacts | None) -> SourceDescription:
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    rotors = {name: inertia for name, joint in joints.items() if (inertia := _rotor_inertia(joint)) > 0.0}
    return SourceDescription(
        path=path,
        kind=kind,
        root=root,
        facts=_facts_of_text(path, root) if facts is None else facts,
        rotor_inertia=rotors,
        damping=_resistances(joints, "damping"),
        friction=_resistances(joints, "friction"),
        effort={},
        compensates=False,
        notes=(),
    )


def _rotor_inertia(joint: ET.Element) -> float:
    """Inertia of a rotor times the gear ratio squared, as some makers state it in <dynamics> [kg.m^2]."""
    dynamics = joint.find("dynamics")
    if dynamics is None:
        return 0.0
    rotor, ratio = (read_number(dynamics.get(key, "")) or 0.0 for key in ("motor_inertia", "gear_ratio"))
    return rotor * ratio * ratio


def _resistances(joints: Mapping[str, ET.Element], key: str) -> dict[str, float]:
    out = dict[str, float]()
    for name, joint in joints.items():
        dynamics = joint.find("dynamics")
        value = 0.0 if dynamics is None else read_number(dynamics.get(key, "0")) or 0.0
        if value > 0.0:
            out[name] = value
    return out


def _facts_of_text(path: Path, root: ET.Element) -> UrdfFacts:
    """Reads what a description that stands in no file says; a problem is one of the file that it was made of."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "expanded.urdf"
        copy.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
        try:
            return read_urdf(copy)
        except BadFile as error:
            found = "; ".join(problem.message for problem in error.problems)
            raise BadInput(f"{path}: what it expands to is no robot: {found}") from None


def _expanded(path: Path) -> str:
    """Expands a xacro file into the text of a URDF."""
    try:
        from xacrodoc import XacroDoc  # noqa: PLC0415 - an extra, needed for xacro files only
    except ImportError:
        raise BadInput(
            f"{path}: a xacro file is expanded by the package xacrodoc, which is not installed (valid: pip install"
            " 'impedance-modules[xacro]', or a URDF that xacro has written)"
        ) from None
    try:
        return str(XacroDoc.from_file(path).to_urdf_string())
    except Exception as error:  # noqa: BLE001 - a xacro file runs expressions of its author
        words = " ".join(str(error).split())
        raise BadInput(f"{path}: xacro cannot expand it: {type(error).__name__}: {words[:300]}") from None


def _of_mujoco(path: Path, model: ET.Element) -> SourceDescription:
    links = urdf_of_mujoco(path, shapes=True)
    root = ET.fromstring(links.urdf)
    for element in root.iter():
        for key in ("name", "link"):
            if key in element.attrib:
                element.set(key, "_".join(element.get(key, "").split()))
    bodies = model.iter("body")
    return SourceDescription(
        path=path,
        kind="MuJoCo model",
        root=root,
        facts=_facts_of_text(path, root),
        rotor_inertia=links.resistances["armature"],
        damping=links.resistances["damping"],
        friction=links.resistances["frictionloss"],
        effort=_actuator_efforts(model),
        compensates=any((read_number(body.get("gravcomp", "0")) or 0.0) > 0.0 for body in bodies),
        notes=links.notes,
    )


def _actuator_efforts(model: ET.Element) -> dict[str, float]:
    """Joint -> largest torque of its actuator: its range of forces, or of a motor's control, times the gear [N.m]."""
    out = dict[str, float]()
    for section in model.findall("actuator"):
        for actuator in section:
            motor = actuator.get("ctrlrange", "") if actuator.tag == "motor" else ""
            ends = [read_number(word) for word in (actuator.get("forcerange") or motor).split()]
            gear = read_number((actuator.get("gear") or "1").split()[0])
            largest = max((abs(end) for end in ends if end is not None), default=0.0) * abs(gear or 0.0)
            if "joint" in actuator.attrib and largest > 0.0:
                out["_".join(actuator.get("joint", "").split())] = largest
    return out
