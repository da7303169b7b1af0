# SPDX-License-Identifier: BSD-3-Clause
"""Builds a simulated Baxter from a robot folder, posture, patch and options, with the description that it serves."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

from impedance_modules.backends.baxter.position_mode import named_posture
from impedance_modules.backends.baxter.simulator.parameters import SimulatorOptions
from impedance_modules.backends.baxter.simulator.simulated_baxter import SimulatedBaxter
from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.errors import BadInput, nearest
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import PatchSpec
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import RobotSpec


@dataclass(frozen=True)
class BuiltSimulator:
    """A simulated robot, and the URDF that it serves."""

    robot: SimulatedBaxter
    description: str


def build_simulator(
    robot: str, posture: str, patch: PatchSpec | None, options: SimulatorOptions
) -> BuiltSimulator:
    """Builds a simulated Baxter; takes some seconds to compile.

    Args:
        robot: Robot folder.
        posture: Where it stands, see ``named_posture``.
        patch: Effects of the plant that the served description does not have, or None.
        options: Of the simulated robot.

    Raises:
        BadInput, BadFile: Something does not fit.
    """
    spec = read_robot(robot)
    start = named_posture(spec, posture)
    if patch is not None:
        spec = apply_patch(spec, patch)
    text = calibrated_description(spec, options.mount_offset)
    with tempfile.TemporaryDirectory() as folder:
        model = RobotModel(replace(spec, urdf=write_description(text, Path(folder))))
        effects = None if patch is None else apply_to_plant(model, patch)
        return BuiltSimulator(SimulatedBaxter(model, effects, model.position(start), options), text)


def calibrated_description(spec: RobotSpec, mount_offset: Mapping[str, tuple[float, float, float]]) -> str:
    """Returns the URDF of a robot with calibrated mounts.

    Args:
        spec: Of the robot.
        mount_offset: Limb -> (3,) calibrated minus nominal place of its mount, in the parent's axes [m].

    Raises:
        BadInput: An offset is for a limb that the robot does not have, or the limb has no mount to move.
    """
    root = ElementTree.parse(spec.urdf).getroot()
    joints = {str(joint.get("name")): joint for joint in root.iter("joint")}
    for limb, offset in mount_offset.items():
        if limb not in spec.limbs:
            known = tuple(spec.limbs)
            raise BadInput(f"no limb '{limb}' to mount{nearest(limb, known)} (valid: {', '.join(known)})")
        first = next(iter(spec.limbs[limb].joints.values()))
        _move(_mount(joints, first), offset)
    return ElementTree.tostring(root, encoding="unicode")


def _mount(joints: Mapping[str, ElementTree.Element], first: str) -> ElementTree.Element:
    """Returns the fixed joint that carries a limb's first joint."""
    carrier = _link(joints[first], "parent")
    for joint in joints.values():
        if joint.get("type") == "fixed" and _link(joint, "child") == carrier:
            return joint
    raise BadInput(f"joint '{first}' has no fixed mount in the URDF, so no calibration can move it")


def _link(joint: ElementTree.Element, role: str) -> str | None:
    element = joint.find(role)
    return None if element is None else element.get("link")


def _move(mount: ElementTree.Element, offset: tuple[float, float, float]) -> None:
    origin = mount.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(mount, "origin")
    nominal = [float(number) for number in origin.get("xyz", "0 0 0").split()]
    origin.set("xyz", " ".join(repr(a + b) for a, b in zip(nominal, offset, strict=True)))


def write_description(text: str, folder: Path) -> Path:
    """Writes a description to a file, from which a model can be built."""
    path = folder / "served.urdf"
    path.write_text(text)
    return path
