# SPDX-License-Identifier: BSD-3-Clause
"""Makes ``robots/NAME`` of a robot description, and reads it back before anybody sees it."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from impedance_modules.errors import BadFile, BadInput, Problem
from impedance_modules.new_robot.chains import Chain, Structure, find_structure
from impedance_modules.new_robot.collision_pairs import (
    MOST_PAIRS,
    Pair,
    Semantics,
    own_pairs,
    pairs_between,
    read_srdf,
)
from impedance_modules.new_robot.copies import Base, Copies
from impedance_modules.new_robot.copy_names import CopyNames, names_of_copies
from impedance_modules.new_robot.drive_numbers import DriveNumbers, drive_numbers, stated_effort
from impedance_modules.new_robot.first_postures import NamedPosture, first_postures
from impedance_modules.new_robot.robot_text import RobotText, robot_yaml
from impedance_modules.new_robot.source_description import SourceDescription, read_description
from impedance_modules.robot.description_facts import ArmFrame, largest_weight_torques, mirror_signs
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.near_pairs import neighbours
from impedance_modules.spec.locate import ROBOT_FILE
from impedance_modules.spec.robot_reader import read_robot

SHOULDERS = 0.002
"""By how much the shoulders of mirrored arms may differ [m]."""


@dataclass(frozen=True)
class NewRobot:
    """What a person asks for.

    Attributes:
        name: The robot's, and its folder's.
        description: URDF, xacro file or MuJoCo model.
        folder: In which ``name`` is made.
        hands: Limb -> link of its hand; None: the only one there is.
        bases: Limb -> where a copy of the description stands for it; empty: the description as it is.
        held: Joint -> where it stays [rad] or [m].
        srdf: None for none.
        shapes: What becomes of collision meshes, see ``copies.SHAPES``.
        gravity: What carries the arms' weight; None: not said.
        modes: Control modes; empty: not said.
        source: Where the description comes from, in words; empty: its file's name.
    """

    name: str
    description: Path
    folder: Path
    hands: Mapping[str, str | None]
    bases: Mapping[str, Base]
    held: Mapping[str, float]
    srdf: Path | None
    shapes: str
    gravity: str | None
    modes: tuple[str, ...]
    source: str


@dataclass(frozen=True)
class MadeRobot:
    """What was made.

    Attributes:
        folder: ``robots/NAME``.
        limbs: Limb -> its joints, as tasks name them.
        notes: What was chosen or left out, in sentences.
        assumed: Keys of the robot file that a person must fill in or confirm.
    """

    folder: Path
    limbs: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...]
    assumed: tuple[str, ...]


def make_robot(asked: NewRobot) -> MadeRobot:
    """Makes a robot's folder; nothing is left behind where that fails.

    Raises:
        BadInput: The folder is there already, or the description cannot be used.
        BadFile: Links or joints lack what an arm needs; all problems, each with its line.
    """
    target = asked.folder / asked.name
    if target.exists():
        raise BadInput(
            f"{target} is there already and is not overwritten (valid: another name, or --out DIR)"
        )
    description = read_description(asked.description)
    structure = _structure(asked, description)
    _refuse_unfit(asked, description, structure)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / asked.name
        folder.mkdir()
        text = _completed(_written(asked, description, structure, folder), folder)
        asked.folder.mkdir(parents=True, exist_ok=True)
        shutil.copytree(folder, target)
    limbs = {chain.limb: tuple(chain.joints) for _, chain in text.arms}
    return MadeRobot(target, limbs, tuple(text.notes), text.assumed)


def _structure(asked: NewRobot, description: SourceDescription) -> Structure:
    """Finds the arms of the description; copies all have the one of the first limb, under their own names."""
    if not asked.bases:
        return find_structure(asked.description, description.facts, asked.hands, asked.held)
    first = next(iter(asked.bases))
    found = find_structure(asked.description, description.facts, {first: asked.hands[first]}, asked.held)
    (chain,) = found.chains
    return replace(found, chains=tuple(replace(chain, limb=limb) for limb in asked.bases))


def _refuse_unfit(asked: NewRobot, description: SourceDescription, structure: Structure) -> None:
    """Refuses links without inertia behind joints of an arm, and weight that would be carried twice."""
    facts, problems = description.facts, list[Problem]()
    for chain in structure.chains:
        for name in chain.joints.values():
            child = facts.joints[name].child
            if facts.welded_to(child) <= facts.links_without_inertia:
                line = facts.link_lines[child] if description.kind == "URDF" else 1
                message = (
                    f"the link '{child}', moved by the joint '{name}', has no inertia: give it mass and moments about"
                    " its centre in the description, or hold the joint (--hold)"
                )
                problems.append(Problem(asked.description, line, 1, "", message))
    if problems:
        raise BadFile(problems)
    if description.compensates and asked.gravity == "command":
        raise BadInput(
            f"{asked.description}: its bodies have gravcomp, so the robot carries its weight by itself; with --gravity"
            " command it would be taken twice (valid: --gravity robot)"
        )


def _written(
    asked: NewRobot, description: SourceDescription, structure: Structure, folder: Path
) -> RobotText:
    """Writes both files into a folder."""
    joints = list(dict.fromkeys(name for chain in structure.chains for name in chain.joints.values()))
    numbers = drive_numbers(description, joints, _weights(description, joints, folder))
    names = names_of_copies(tuple(asked.hands), len(asked.bases))
    copies = Copies(description, asked.name, asked.shapes, folder, tuple(names.values()))
    if asked.bases:
        copies.add_base([(names[limb], base) for limb, base in asked.bases.items()])
    limits = {name: numbers.limits(name) for name in joints}
    for naming in dict.fromkeys(names.values()):
        copies.add_copy(naming, limits, structure.fixed)
    chains = {chain.limb: chain for chain in structure.chains}
    arms = [(names[limb], chains[limb]) for limb in asked.hands]
    text = _robot_text(asked, description, structure, (arms, numbers, copies, folder))
    source = f"{asked.name}: made of {asked.description.name} by: impedance robot new\n{text.source}"
    (folder / f"{asked.name}.urdf").write_text(copies.text(source.replace("--", "- -")), encoding="utf-8")
    (folder / ROBOT_FILE).write_text(robot_yaml(text), encoding="utf-8")
    return text


def _weights(description: SourceDescription, joints: Sequence[str], folder: Path) -> dict[str, float]:
    """Largest torques of weight, for joints whose largest torque is not stated."""
    silent = [name for name in joints if stated_effort(description, name) is None]
    return largest_weight_torques(_one_arm(description, folder), silent) if silent else {}


def _one_arm(description: SourceDescription, folder: Path) -> Path:
    """Writes the description without its shapes to a file beside the robot's folder, for questions about one arm."""
    path = folder.parent / "one_arm.urdf"
    if not path.is_file():
        plain = Copies(description, "one_arm", "none", folder, (CopyNames(),))
        plain.add_copy(CopyNames(), {}, ())
        path.write_text(plain.text("one arm"), encoding="utf-8")
    return path


def _completed(text: RobotText, folder: Path) -> RobotText:
    """Reads the folder back, takes neighbours off its list of pairs, and adds the first postures."""
    model = RobotModel(read_robot(folder))
    near = neighbours(model, model.spec.collision.pairs, model.spec.collision.margin)
    notes = list(text.notes)
    if near:
        listed = ", ".join(f"{first} and {second}" for first, second in sorted(near))
        notes.append(f"not kept apart, since they are close in most postures: {listed}")
    known = {posture.name for posture in text.postures}
    found = [posture for posture in first_postures(model) if posture.name not in known]
    for limb in model.limbs:
        if not any(limb in posture.limbs for posture in found):
            notes.append(f"no posture with the hand of '{limb}' in front was found: name one under postures")
    kept = replace(
        _own_mirror(text, model),
        pairs=[pair for pair in text.pairs if pair not in near],
        notes=tuple(notes),
        postures=(*text.postures, *found),
    )
    (folder / ROBOT_FILE).write_text(robot_yaml(kept), encoding="utf-8")
    read_robot(folder)
    return kept


Parts = tuple[list[tuple[CopyNames, Chain]], DriveNumbers, Copies, Path]


def _robot_text(
    asked: NewRobot, description: SourceDescription, structure: Structure, parts: Parts
) -> RobotText:
    arms, numbers, copies, folder = parts
    semantics = None if asked.srdf is None else read_srdf(asked.srdf, description.facts)
    pairs, notes = _pairs(description, structure, arms, copies, semantics)
    held = {
        naming(name): position
        for naming in dict.fromkeys(naming for naming, _ in arms)
        for name, position in structure.held.items()
    }
    mirrored = _stand_mirrored(asked.bases)
    return RobotText(
        name=asked.name,
        source=asked.source or f"{asked.description.name}, a {description.kind}",
        file=asked.description.name,
        arms=arms,
        numbers=numbers,
        held=held,
        mirror=_signs(description, structure.chains[0], folder) if mirrored else None,
        mirrored=mirrored,
        pairs=pairs,
        postures=_named_postures(arms, semantics),
        gravity=("robot", description.compensates) if asked.gravity is None else (asked.gravity, True),
        modes=(asked.modes or ("torque",), bool(asked.modes)),
        notes=(*structure.notes, *notes, *_description_notes(description, copies, numbers)),
    )


def _pairs(
    description: SourceDescription,
    structure: Structure,
    arms: Sequence[tuple[CopyNames, Chain]],
    copies: Copies,
    semantics: Semantics | None,
) -> tuple[list[Pair], list[str]]:
    facts, shaped = description.facts, set(copies.shaped)
    pairs = pairs_between(facts, shaped, arms)
    notes = list(() if semantics is None else semantics.notes)
    if semantics is not None:
        for naming in dict.fromkeys(naming for naming, _ in arms):
            links = [link for link in facts.links if naming(link) in shaped]
            own = own_pairs(facts, links, structure.chains, semantics)
            pairs += [(naming(first), naming(second)) for first, second in own]
    if len(pairs) > MOST_PAIRS:
        notes.append(
            f"{len(pairs)} pairs of links could meet; the first {MOST_PAIRS} are listed: choose among them"
        )
    return pairs[:MOST_PAIRS], notes


def _stand_mirrored(bases: Mapping[str, Base]) -> bool:
    """Whether two bases are mirror images of each other in the plane xz."""
    if len(bases) != 2:
        return False
    (x, y, z, roll, pitch, yaw), other = bases.values()
    return other == (x, -y, z, -roll, pitch, -yaw)


def _signs(
    description: SourceDescription, chain: Chain, folder: Path
) -> tuple[Mapping[str, int], Mapping[str, float]] | None:
    """Joint signs and offsets by short name, by which a copy of the arm is its image."""
    arm = ArmFrame(chain.hand, tuple(chain.joints.values()))
    return _by_short_name(tuple(chain.joints), mirror_signs(_one_arm(description, folder), arm))


def _by_short_name(
    names: Sequence[str], found: tuple[tuple[int, ...], float] | None
) -> tuple[Mapping[str, int], Mapping[str, float]] | None:
    if found is None:
        return None
    signs, offset = found
    return dict(zip(names, signs, strict=True)), {names[-1]: offset} if offset else {}


def _own_mirror(text: RobotText, model: RobotModel) -> RobotText:
    """Two arms of one description are mirrored if joint signs say so, or at least their shoulders."""
    if text.mirrored or len(text.arms) != 2:
        return text
    (_, first), (_, second) = text.arms
    if tuple(first.joints) != tuple(second.joints):
        return text
    arms = [
        ArmFrame(naming(chain.hand), tuple(naming(joint) for joint in chain.joints.values()))
        for naming, chain in text.arms
    ]
    found = _by_short_name(tuple(first.joints), mirror_signs(model.spec.urdf, *arms))
    (x, y, z), other = (model.joint_place(arm.joints[0]) for arm in arms)
    opposite = abs(y) > SHOULDERS and max(abs(other - (x, -y, z))) < SHOULDERS
    return replace(text, mirror=found, mirrored=True) if found is not None or opposite else text


def _named_postures(
    arms: Sequence[tuple[CopyNames, Chain]], semantics: Semantics | None
) -> tuple[NamedPosture, ...]:
    """Group states of an SRDF that give all joints of an arm, for every copy of it."""
    found = list[NamedPosture]()
    for name, angles in ({} if semantics is None else semantics.postures).items():
        limbs = {
            chain.limb: {short: angles[joint] for short, joint in chain.joints.items()}
            for _, chain in arms
            if set(chain.joints.values()) <= set(angles)
        }
        if limbs and re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
            found.append(NamedPosture(name, "[file] the SRDF", limbs))
    return tuple(found)


def _description_notes(description: SourceDescription, copies: Copies, numbers: DriveNumbers) -> list[str]:
    notes = [f"{description.path.name}: {note}" for note in description.notes]
    if copies.missing:
        found = ", ".join(f"{link} ({mesh})" for link, mesh in copies.missing.items())
        notes.append(f"collision meshes that are not there, so these links have no shape: {found}")
    dry = {name: value for name, value in description.friction.items() if name in numbers.tables["effort"]}
    if dry:
        words = ", ".join(f"{name} {value:g}" for name, value in dry.items())
        notes.append(
            f"dry friction that the file states is not part of a robot file (a patch states it): {words} N.m"
        )
    return notes
