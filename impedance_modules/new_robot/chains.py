# SPDX-License-Identifier: BSD-3-Clause
"""Which joints of a description make up its arms, where the hands are, and what stands still.

An arm is the chain of joints that turn and have a drive of their own, between the base and a hand. What else moves is
held: grippers become tools whose mass stays, a column stays at its height, wheels and a head stay as they are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.errors import BadInput, nearest
from impedance_modules.spec.urdf import UrdfFacts

LISTED = 8
"""Names that a sentence lists."""

TURNING = ("revolute", "continuous")


@dataclass(frozen=True)
class Chain:
    """One arm of a description.

    Attributes:
        limb: What tasks call it.
        hand: Link of its hand.
        joints: Short name -> name in the description, from the base outwards.
    """

    limb: str
    hand: str
    joints: Mapping[str, str]


@dataclass(frozen=True)
class Structure:
    """A description's arms and what stands still.

    Attributes:
        chains: The arms.
        held: Joint that is no arm's and turns or slides -> where it stays [rad] or [m].
        fixed: Joints that become fixed ones where their coordinate is 0: they turn without limits, or have more than
            one degree of freedom.
        notes: What was chosen, in sentences.
    """

    chains: tuple[Chain, ...]
    held: Mapping[str, float]
    fixed: tuple[str, ...]
    notes: tuple[str, ...]


def find_structure(
    path: Path, facts: UrdfFacts, hands: Mapping[str, str | None], held: Mapping[str, float]
) -> Structure:
    """Finds the arms that end in stated hands.

    Args:
        path: The description, for messages.
        facts: What it says.
        hands: Limb -> link of its hand; None: the only one there is.
        held: Joint -> where it stays, as a person states it [rad] or [m].

    Raises:
        BadInput: A hand or a joint is unknown, a hand is moved by no joint, or which link is the hand is not clear.
    """
    _refuse_unknown(path, facts, hands, held)
    notes = list[str]()
    driven = {name for name, joint in facts.joints.items() if joint.type in TURNING and joint.mimic is None}
    driven -= set(held)
    ends = {limb: link or _only_hand(path, facts, driven, notes) for limb, link in hands.items()}
    counts = Counter(name for link in ends.values() for name in _chain(facts, driven, link))
    shared = [name for name, count in counts.items() if count > 1]
    if shared:
        notes.append(f"{', '.join(shared)} would move several arms: held (--hold JOINT=POSITION says where)")
        driven -= set(shared)
    chains = []
    for limb, link in ends.items():
        joints = _chain(facts, driven, link)
        if not joints:
            raise BadInput(f"{path}: no joint that turns moves the hand '{link}' of the limb '{limb}'")
        chains.append(Chain(limb, link, short_names(joints, tuple(facts.joints))))
    moving = {name for chain in chains for name in chain.joints.values()}
    still, fixed = _still(path, facts, moving, held)
    if still:
        listed = ", ".join(f"{name} at {position:g}" for name, position in tuple(still.items())[:LISTED])
        more = f" and {len(still) - LISTED} more" if len(still) > LISTED else ""
        notes.append(f"held where they are, mass and all: {listed}{more} (--hold for another position)")
    if fixed:
        notes.append(f"made fixed, since they turn without end or float: {', '.join(fixed)}")
    return Structure(tuple(chains), still, fixed, tuple(notes))


def _refuse_unknown(
    path: Path, facts: UrdfFacts, hands: Mapping[str, str | None], held: Mapping[str, float]
) -> None:
    for limb, link in hands.items():
        if link is not None and link not in facts.links:
            raise BadInput(
                f"{path}: there is no link '{link}' to be the hand of '{limb}'{nearest(link, facts.links)}"
                f" (valid: {', '.join(facts.links)})"
            )
    movable = tuple(name for name, joint in facts.joints.items() if joint.moves)
    for name in held:
        if name not in movable:
            raise BadInput(
                f"{path}: there is no joint '{name}' to hold{nearest(name, movable)} (valid: {', '.join(movable)})"
            )


def _only_hand(path: Path, facts: UrdfFacts, driven: set[str], notes: list[str]) -> str:
    """Finds the one link behind all joints that turn: the outermost that is fixed to the last of them."""
    parents = {name: _chain(facts, driven, facts.joints[name].parent) for name in driven}
    inner = {name for above in parents.values() for name in above}
    ends = [name for name in facts.joints if name in driven and name not in inner]
    if len(ends) != 1:
        found = ", ".join(facts.joints[name].child for name in ends) or "none"
        raise BadInput(
            f"{path}: several chains of joints turn, or none, so which link is the hand is not clear (valid:"
            f" --hand LIMB=LINK for each arm; chains end in {found})"
        )
    hand = _outermost(path, facts, facts.joints[ends[0]].child)
    notes.append(
        f"the hand is '{hand}', the outermost link behind '{ends[0]}' (--hand LIMB=LINK for another)"
    )
    return hand


def _outermost(path: Path, facts: UrdfFacts, link: str) -> str:
    """Finds the link that most fixed joints separate from a link."""
    found, ahead = [link], [link]
    while ahead:
        found = ahead
        ahead = [joint.child for joint in facts.joints.values() if joint.parent in found and not joint.moves]
    if len(found) > 1:
        raise BadInput(
            f"{path}: which link is the hand is not clear: {', '.join(found)} (valid: --hand LIMB=LINK, one of these)"
        )
    return found[0]


def _chain(facts: UrdfFacts, driven: set[str], link: str) -> list[str]:
    return [name for name in facts.moving_joints(link) if name in driven]


def _still(
    path: Path, facts: UrdfFacts, moving: set[str], held: Mapping[str, float]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Says where every joint stays that is no arm's: as stated, where its leader puts it, or at 0."""
    out, fixed = dict[str, float](), list[str]()
    for name, joint in facts.joints.items():
        if not joint.moves or name in moving:
            continue
        if joint.type not in ("revolute", "prismatic"):
            fixed.append(name)
            continue
        position = held.get(name, 0.0)
        if joint.mimic is not None and name not in held:
            position = joint.mimic.multiplier * held.get(joint.mimic.leader, 0.0) + joint.mimic.offset
        if joint.limits is not None:
            lower, upper = joint.limits.lower, joint.limits.upper
            if name in held and not lower <= position <= upper:
                raise BadInput(
                    f"{path}: '{name}' cannot be held at {position:g} (valid: {lower:g} to {upper:g})"
                )
            position = min(max(position, lower), upper)
        out[name] = position
    return out, tuple(fixed)


def short_names(joints: list[str], known: tuple[str, ...]) -> dict[str, str]:
    """Gives joints short names: without the words that all of them begin or end with.

    Args:
        joints: Names in the description, from the base outwards.
        known: All joints of the description: no short name may be another joint's.
    """
    words = [name.split("_") for name in joints]
    while len(words) > 1 and min(map(len, words)) > 1 and len({word[0] for word in words}) == 1:
        words = [word[1:] for word in words]
    while len(words) > 1 and min(map(len, words)) > 1 and len({word[-1] for word in words}) == 1:
        words = [word[:-1] for word in words]
    short = ["_".join(word) for word in words]
    short = [name if name[:1].isalpha() and name.isascii() else f"joint{name}" for name in short]
    clear = all(name.replace("_", "").replace("-", "").isalnum() for name in short)
    others = set(known) - set(joints)
    if not clear or len(set(short)) < len(short) or set(short) & others:
        short = [f"joint{index}" for index in range(1, len(joints) + 1)]
    return dict(zip(short, joints, strict=True))
