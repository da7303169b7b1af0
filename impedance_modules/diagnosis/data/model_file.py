# SPDX-License-Identifier: BSD-3-Clause
r"""The description that recordings are compared with, as its maker ships it, made plain: what moves, and what stands.

A joint that stands at q_0 becomes a fixed one: its origin X_PC is X_PC(0) R(a, q_0), or X_PC(0) T(a q_0) if it slides.
That is done with joints whose position was stated, and with joints that follow another one (mimic): they have no drive
of their own, so no torque of theirs can be compared. What is assumed is said in the notes.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import NominalModel, model_of_urdf
from impedance_modules.effects.joint_friction import CoulombFriction
from impedance_modules.effects.patch_check import PatchTarget
from impedance_modules.errors import BadInput, nearest
from impedance_modules.export.body_inertia import rotation_of_rpy, rpy_of_rotation
from impedance_modules.export.edited_xml import numbers
from impedance_modules.export.mujoco_as_urdf import MujocoLinks, as_urdf
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.patch_file import EffectSpec, PatchQuantity
from impedance_modules.spec.urdf import UrdfFacts, UrdfJoint, read_urdf

LISTED = 8
"""Names that a sentence lists."""


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """A nominal model with the file of its links.

    Attributes:
        model: For the recorded joints that move by themselves.
        urdf: Its links, plain; there as long as the block of ``compared_model`` runs.
        target: Finds what a patch of it may name: all joints and links of the description, recorded or not.
        known_effects: What the description states beyond links: dry friction of a MuJoCo model.
    """

    model: NominalModel
    urdf: Path
    target: Callable[[], PatchTarget]
    known_effects: tuple[EffectSpec, ...]


@contextmanager
def compared_model(
    path: Path, recorded: Mapping[str, float], held: Mapping[str, float]
) -> Iterator[ComparedModel]:
    """Reads a URDF or a MuJoCo model.

    Args:
        path: The file.
        recorded: Recorded joint -> its mean position [rad] ([m] if prismatic).
        held: Joint that was not recorded -> the position at which it stood.

    Raises:
        BadInput: The file cannot be read, lacks a joint, or a held joint cannot be held there.
    """
    _refuse_missing(path)
    with as_urdf(path) as (urdf, mujoco):
        facts = read_urdf(urdf)
        _check_recorded(path, facts, recorded)
        _check_held(path, facts, recorded, held)
        follows = _following(facts, recorded, held)
        still = {**held, **follows}
        joints = [joint for joint in recorded if joint not in follows]
        if not joints:
            raise BadInput(
                f"{path}: all recorded joints follow another one (valid: recordings of driven joints)"
            )
        with _standing(urdf, still) as plain:
            model = model_of_urdf(plain, joints)
            notes = [
                *_held_notes(path, facts, held, follows, recorded),
                *_other_joints(path, facts, model, still),
                *_resistance_notes(path, facts, model, mujoco),
            ]
            if mujoco is not None:
                model = _with_rotors(model, mujoco)
            model = replace(model, notes=tuple(notes))
            target = partial(PatchTarget.of_urdf, path, facts)
            yield ComparedModel(model, plain, target, _friction(model, mujoco))


def driven_joints(path: Path) -> tuple[str, ...]:
    """Returns the joints of a description that turn or slide and follow no other.

    Raises:
        BadInput: The file cannot be read.
    """
    _refuse_missing(path)
    with as_urdf(path) as (urdf, _):
        joints = read_urdf(urdf).joints
    return tuple(name for name, joint in joints.items() if joint.has_one_axis and joint.mimic is None)


def _refuse_missing(path: Path) -> None:
    if not path.is_file():
        raise BadInput(f"--urdf {path}: no such file (valid: a URDF or MuJoCo model of the robot)")


@contextmanager
def _standing(urdf: Path, still: Mapping[str, float]) -> Iterator[Path]:
    """Gives the description with some joints fixed; the file itself where there are none."""
    if not still:
        yield urdf
        return
    tree = ET.parse(urdf)
    for joint in tree.getroot().findall("joint"):
        if joint.get("name") in still:
            _fix(joint, still[str(joint.get("name"))])
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / urdf.name
        tree.write(copy, encoding="utf-8")
        yield copy


def _fix(joint: ET.Element, position: float) -> None:
    """Makes a joint a fixed one, where it stands at a position [rad] or [m]."""
    axis_element, origin = joint.find("axis"), joint.find("origin")
    axis = _vector(axis_element, "xyz", "1 0 0")
    axis = axis / np.linalg.norm(axis)
    R, p = rotation_of_rpy(_vector(origin, "rpy").tolist()), _vector(origin, "xyz")
    if joint.get("type") == "prismatic":
        p = p + R @ axis * position
    else:
        R = R @ exp3(position * axis)
    for tag in ("origin", "axis", "limit", "mimic", "dynamics", "safety_controller", "calibration"):
        for element in joint.findall(tag):
            joint.remove(element)
    joint.set("type", "fixed")
    ET.SubElement(joint, "origin", xyz=numbers(p), rpy=numbers(rpy_of_rotation(R)))


def _vector(element: ET.Element | None, key: str, default: str = "0 0 0") -> Array:
    return np.array(
        [float(word) for word in (default if element is None else element.get(key, default)).split()]
    )


def _check_recorded(path: Path, facts: UrdfFacts, recorded: Mapping[str, float]) -> None:
    movable = tuple(name for name, joint in facts.joints.items() if joint.moves)
    for joint in recorded:
        if joint not in movable:
            raise BadInput(
                f"{path}: no moving joint '{joint}'{nearest(joint, movable)} (valid: {', '.join(movable)})"
            )


def _check_held(
    path: Path, facts: UrdfFacts, recorded: Mapping[str, float], held: Mapping[str, float]
) -> None:
    movable = tuple(name for name, joint in facts.joints.items() if joint.has_one_axis)
    for name, position in held.items():
        if name not in movable:
            raise BadInput(
                f"--hold {name}: {path} has no such joint that turns or slides{nearest(name, movable)}"
                f" (valid: {', '.join(movable)})"
            )
        if name in recorded:
            raise BadInput(f"--hold {name}: its position was recorded (valid: joints that were not)")
        limits = facts.joints[name].limits
        if limits is not None and not limits.lower <= position <= limits.upper:
            raise BadInput(
                f"--hold {name}={position:g}: its range is {limits.lower:g} to {limits.upper:g}"
                f" {_unit(facts.joints[name])} (valid: a position within it)"
            )


def _following(
    facts: UrdfFacts, recorded: Mapping[str, float], held: Mapping[str, float]
) -> dict[str, float]:
    """Position of each joint that follows another one whose position is known, or that was recorded itself."""
    out: dict[str, float] = {}
    for name, joint in facts.joints.items():
        mimic = joint.mimic
        if mimic is None or name in held or not joint.has_one_axis:
            continue
        if name in recorded:
            out[name] = recorded[name]
        elif (leader := {**held, **recorded}.get(mimic.leader)) is not None:
            out[name] = mimic.multiplier * leader + mimic.offset
    return out


def _held_notes(
    path: Path,
    facts: UrdfFacts,
    held: Mapping[str, float],
    follows: Mapping[str, float],
    recorded: Mapping[str, float],
) -> Iterator[str]:
    if held:
        stated = ", ".join(f"{name} at {q:.4g} {_unit(facts.joints[name])}" for name, q in held.items())
        yield f"not recorded, held where it was stated: {stated}"
    for name, position in follows.items():
        joint = facts.joints[name]
        leader = "" if joint.mimic is None else joint.mimic.leader
        why = "its mean" if name in recorded else f"where the mean of '{leader}' puts it"
        yield (
            f"{path.name}: '{name}' follows '{leader}' (mimic) and has no drive of its own; the model holds it at"
            f" {position:.4g} {_unit(joint)}, {why}, and '{leader}' moves without its mass"
        )


def _other_joints(
    path: Path, facts: UrdfFacts, model: NominalModel, still: Mapping[str, float]
) -> Iterator[str]:
    """Says which joints were neither recorded nor matter, as those of another arm."""
    known = {*model.joints, *model.tree.standing, *still}
    others = [name for name, joint in facts.joints.items() if joint.moves and name not in known]
    if others:
        more = f" and {len(others) - LISTED} more" if len(others) > LISTED else ""
        yield (
            f"{path.name}: not recorded, and neither carrying nor carried by what was:"
            f" {', '.join(others[:LISTED])}{more}; the base is taken to stand upright and still"
        )


def _resistance_notes(
    path: Path, facts: UrdfFacts, model: NominalModel, mujoco: MujocoLinks | None
) -> Iterator[str]:
    if mujoco is None:
        stated = [name for name in model.joints if facts.joints[name].resists]
        if stated:
            yield (
                f"{path.name}: <dynamics> (damping, friction) of {_listed(stated)} is not part of the model; what is"
                " there shows as a cause"
            )
        return
    for kind, found in mujoco.resistances.items():
        own = [f"{joint} {found[joint]:.4g}" for joint in model.joints if joint in found]
        if own:
            yield f"{path.name}: part of the model is its {kind}: {_listed(own)}"
    yield from (f"{path.name}: {note}" for note in mujoco.notes)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more


def _unit(joint: UrdfJoint) -> str:
    return "m" if joint.type == "prismatic" else "rad"


def _with_rotors(model: NominalModel, mujoco: MujocoLinks) -> NominalModel:
    """Takes a MuJoCo model's armature and damping as those of the drives."""
    armature, damping = (
        np.array([mujoco.resistances[kind].get(joint, 0.0) for joint in model.joints])
        for kind in ("armature", "damping")
    )
    return replace(model, reflected_inertia=armature, motor_damping=damping)


def _friction(model: NominalModel, mujoco: MujocoLinks | None) -> tuple[EffectSpec, ...]:
    """A MuJoCo model's dry friction, as an effect that the model has from the beginning."""
    found = {} if mujoco is None else mujoco.resistances["frictionloss"]
    units = dict(zip(model.joints, model.tree.units(), strict=True))
    parameters = {
        joint: {"fc": PatchQuantity(found[joint], units[joint], None)}
        for joint in model.joints
        if joint in found
    }
    if not parameters:
        return ()
    return (EffectSpec(CoulombFriction().id, tuple(parameters), "actuator", parameters, {}),)
