# SPDX-License-Identifier: BSD-3-Clause
"""Bodies and base of a MuJoCo model: what a patch fixes to a body, and gravity in the axes of a base that leans."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.simulator_numbers import Amount
from impedance_modules.export.body_inertia import BodyInertia, about
from impedance_modules.export.carrier import NotCarried
from impedance_modules.export.edited_xml import number, numbers
from impedance_modules.export.mujoco_model import DEGREE, ONE_AXIS, MujocoDescription
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.robot_spec import UPRIGHT_GRAVITY

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
"""Attributes that turn an element in its parent."""

GRAVITY = UPRIGHT_GRAVITY
"""Of a model that does not say [m/s^2]."""


def change_body(model: MujocoDescription, amount: Amount) -> None:
    """Adds ten inertial parameters to a body; its inertia is written in the body's axes then."""
    body = model.bodies[amount.key]
    inertial = body.find("inertial")
    if not _says_its_inertia(model, body, inertial) or inertial is None:
        return
    before = read_inertia(model, inertial)
    if before is None:
        return
    after = before.with_change(amount.numbers)
    if after is None:
        raise NotCarried(
            f"with {amount.numbers[0]:+g} kg and its moments the body '{amount.key}' by itself is no physical body"
        )
    for key in ("diaginertia", *ORIENTATIONS):
        inertial.attrib.pop(key, None)
    inertial.set("pos", numbers(after.centre))
    inertial.set("mass", number(after.mass))
    I = after.about_centre  # noqa: E741 - the field's name
    inertial.set("fullinertia", numbers((I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])))


def _says_its_inertia(model: MujocoDescription, body: ET.Element, inertial: ET.Element | None) -> bool:
    """Notes a fault where MuJoCo would not take a body's inertia from <inertial>."""
    name = body.get("name")
    if inertial is None:
        model.faults.add(
            body,
            f"the body '{name}' has no <inertial>; MuJoCo makes its mass of its geoms, and nothing can be added"
            " (valid: a body with <inertial>, as mujoco.mj_saveLastXML writes it)",
        )
    for key, fine in (("inertiafromgeom", ("auto", "false")), ("settotalmass", ("-1",))):
        section = model.section("compiler", key)
        if section is not None and section.get(key) not in fine:
            model.faults.add(
                section,
                f"<compiler {key}=\"{section.get(key)}\"> overrules the inertia of '{name}' (valid: without)",
            )
            return False
    return inertial is not None


def read_inertia(model: MujocoDescription, inertial: ET.Element) -> BodyInertia | None:
    """Reads <inertial>: diagonal in turned axes, or full in the body's; None where it is incomplete, a fault."""
    if lacking := [key for key in ("mass", "pos") if key not in inertial.attrib]:
        model.faults.add(inertial, f"<inertial> has no {' and no '.join(lacking)} (valid: mass and pos)")
        return None
    mass = float(sized(model, inertial, "mass", (0.0,))[0])
    centre = sized(model, inertial, "pos", (0.0, 0.0, 0.0))
    if "fullinertia" in inertial.attrib:
        xx, yy, zz, xy, xz, yz = sized(model, inertial, "fullinertia", (0.0,) * 6)
        return BodyInertia(mass, centre, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    if "diaginertia" not in inertial.attrib:
        model.faults.add(inertial, "<inertial> has neither diaginertia nor fullinertia (valid: one of them)")
        return None
    R = orientation(model, inertial)
    return BodyInertia(mass, centre, R @ np.diag(sized(model, inertial, "diaginertia", (0.0,) * 3)) @ R.T)


def sized(model: MujocoDescription, element: ET.Element, key: str, default: tuple[float, ...]) -> Array:
    """Reads as many numbers as there are in ``default``; another count is a fault of the file."""
    found = model.numbers(element, key, default)
    if found.size == len(default):
        return found
    text = element.get(key, "")[:60]
    model.faults.add(element, f"<{element.tag}> has '{key}' {text!r} (valid: {len(default)} numbers)")
    return np.array(default)


def orientation(model: MujocoDescription, element: ET.Element) -> Array:
    """Computes the rotation (3, 3) of an element in its parent, in whichever of MuJoCo's ways it is written."""
    unit = DEGREE if (model.setting("compiler", "angle") or "degree") == "degree" else 1.0
    if "quat" in element.attrib:
        w, *v = sized(model, element, "quat", (1.0, 0.0, 0.0, 0.0))
        return _turn(np.array(v), 2.0 * math.atan2(math.hypot(*v), w))
    if "axisangle" in element.attrib:
        x, y, z, angle = sized(model, element, "axisangle", (0.0, 0.0, 1.0, 0.0))
        return _turn(np.array([x, y, z]), unit * angle)
    if "euler" in element.attrib:
        return _euler(model, element, unit * sized(model, element, "euler", (0.0,) * 3))
    if "xyaxes" in element.attrib:
        axes = sized(model, element, "xyaxes", (1.0, 0.0, 0.0, 0.0, 1.0, 0.0))
        x = _unit(axes[:3])
        y = _unit(axes[3:] - (axes[3:] @ x) * x)
        return np.stack([x, y, np.cross(x, y)], axis=1)
    z = sized(model, element, "zaxis", (0.0, 0.0, 1.0)) if "zaxis" in element.attrib else np.eye(3)[2]
    return rotation_between(np.eye(3)[2], z)


def orientation_of(model: MujocoDescription, geom: ET.Element) -> Array:
    """Computes the rotation (3, 3) of an element that may take its one way of being turned from a default class."""
    holders = (model.holder(geom, key) for key in ORIENTATIONS)
    return orientation(model, next((holder for holder in holders if holder is not None), geom))


def rotation_between(start: Array, end: Array) -> Array:
    """Computes the smallest rotation (3, 3) that turns one direction into another; half a turn is about x."""
    across = np.cross(start, end)
    return _turn(across, math.atan2(float(np.linalg.norm(across)), float(start @ end)))


def _unit(vector: Array) -> Array:
    """Scales to length 1; zero stays zero, as MuJoCo would refuse it anyway."""
    size = float(np.linalg.norm(vector))
    return vector / size if size > 0.0 else vector


def _turn(axis: Array, angle: float) -> Array:
    """Computes the rotation about a direction, which need not be of length 1; half a turn is about x without one."""
    size = float(np.linalg.norm(axis))
    return exp3(angle / size * axis) if size > 0.0 else about("x", angle)


def _euler(model: MujocoDescription, element: ET.Element, angles: Array) -> Array:
    """Multiplies three rotations: about axes that turn along in small letters, about fixed ones in capitals."""
    sequence = model.setting("compiler", "eulerseq") or "xyz"
    if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
        model.faults.add(element, f"its angles are in the sequence {sequence!r} (valid: three of x, y, z)")
        return np.eye(3)
    out = np.eye(3)
    for letter, angle in zip(sequence, angles, strict=True):
        one = about(letter.lower(), float(angle))
        out = out @ one if letter.islower() else one @ out
    return out


def lean_base(model: MujocoDescription, amount: Amount) -> None:
    r"""Turns gravity into the axes of the leaning base: exp((r_x, r_y, 0))^T g.

    The whole scene leans with the robot, surfaces and objects too, as in the plant. The base's axes must be the
    world's: a body of the world that carries joints may not be turned, unless a joint of its own moves it.
    """
    for base in _bases(model):
        where = f"line {model.faults.lines[base]}: <{base.tag}> '{base.get('name', '')}'"
        if base.find("freejoint") is not None or any(j.get("type") == "free" for j in base.findall("joint")):
            raise NotCarried(f"{where} floats, and does not stand on anything that could lean")
        if not np.allclose(orientation(model, base), np.eye(3), rtol=0.0, atol=1e-12):
            raise NotCarried(
                f"{where} is turned in the world, so gravity in the world's axes is not gravity in the base's"
                " (valid: a base without orientation)"
            )
    gravity = model.section("option", "gravity")
    if gravity is None:
        options = model.root.findall("option")
        gravity = options[0] if options else model.xml.add(model.root, "option")
    lean = exp3(np.array([*amount.numbers, 0.0]))
    gravity.set("gravity", numbers(lean.T @ sized(model, gravity, "gravity", GRAVITY)))


def _bases(model: MujocoDescription) -> Iterator[ET.Element]:
    """Yields what robots stand on: bodies of the world without a joint of one axis that carry some, and their frames.

    A body of the world with such a joint stands on the world itself: its orientation is the joint's.
    """
    waiting = [top for world in model.root.findall("worldbody") for top in world]
    while waiting:
        top = waiting.pop()
        moving = [joint for joint in top.iter("joint") if model.joint_type(joint) in ONE_AXIS]
        if top.tag not in ("body", "frame") or not moving or any(joint in moving for joint in top):
            continue
        yield top
        waiting.extend(top if top.tag == "frame" else ())
