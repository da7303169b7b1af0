# SPDX-License-Identifier: BSD-3-Clause
"""Which links a robot keeps apart: what an SRDF does not switch off, and the outer links of one arm from another's.

An SRDF lists the pairs that touch always or never; all other pairs matter. Its <group_state>s are postures.
"""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.errors import BadInput
from impedance_modules.new_robot.chains import Chain
from impedance_modules.new_robot.copy_names import CopyNames
from impedance_modules.spec.located_xml import parse_xml, read_number
from impedance_modules.spec.urdf import UrdfFacts

MOST_PAIRS = 64
"""That a robot file lists."""

OUTER_LINKS = 3
"""Links of an arm, from the hand inwards, that are kept apart from another arm's."""

Pair = tuple[str, str]


@dataclass(frozen=True)
class Semantics:
    """What an SRDF says.

    Attributes:
        off: Pairs whose distance is not kept, each as a set.
        postures: Name -> joint -> angle [rad].
        notes: Sentences.
    """

    off: frozenset[frozenset[str]]
    postures: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...]


def read_srdf(path: Path, facts: UrdfFacts) -> Semantics:
    """Reads an SRDF.

    Raises:
        BadInput: It cannot be read, or is of another robot: it names no link of the description.
    """
    root, _ = parse_xml(path)
    listed = [(str(one.get("link1")), str(one.get("link2"))) for one in root.iter("disable_collisions")]
    named = {link for pair in listed for link in pair}
    unknown = sorted(named - set(facts.links))
    if root.tag != "robot" or (named and named <= set(unknown)):
        raise BadInput(
            f"{path}: no SRDF of this robot: it names no link of {facts.path.name} (valid: one that names some of"
            f" {', '.join(facts.links[:6])} ...)"
        )
    postures = {str(one.get("name")): _angles(one) for one in root.iter("group_state")}
    notes = (f"{path.name} names links that are not there: {', '.join(unknown)}",) if unknown else ()
    return Semantics(frozenset(frozenset(pair) for pair in listed), postures, notes)


def _angles(state: ET.Element) -> dict[str, float]:
    read = {str(one.get("name")): read_number(one.get("value", "")) for one in state.iter("joint")}
    return {name: angle for name, angle in read.items() if angle is not None}


def own_pairs(
    facts: UrdfFacts, shaped: Iterable[str], chains: Sequence[Chain], srdf: Semantics
) -> list[Pair]:
    """Lists the pairs of a description that an SRDF does not switch off and that arms move against each other."""
    joints = {name for chain in chains for name in chain.joints.values()}
    moved_by = {link: tuple(n for n in facts.moving_joints(link) if n in joints) for link in shaped}
    return [
        (first, second)
        for first, second in itertools.combinations(moved_by, 2)
        if moved_by[first] != moved_by[second] and frozenset((first, second)) not in srdf.off
    ]


def pairs_between(
    facts: UrdfFacts, shaped: Iterable[str], arms: Sequence[tuple[CopyNames, Chain]]
) -> list[Pair]:
    """Lists pairs of the outer links of every two arms.

    Args:
        facts: Of the description.
        shaped: Links with a collision shape, as the robot's folder names them.
        arms: Names of a copy and arm in it.
    """
    known = set(shaped)
    outer = [_outer(facts, naming, chain, known) for naming, chain in arms]
    return [pair for one, other in itertools.combinations(outer, 2) for pair in itertools.product(one, other)]


def _outer(facts: UrdfFacts, naming: CopyNames, chain: Chain, shaped: set[str]) -> list[str]:
    """One link with a shape for each of an arm's last joints, the hand's first."""
    found = list[str]()
    for name in reversed(tuple(chain.joints.values())):
        body = facts.welded_to(facts.joints[name].child)
        links = [naming(link) for link in facts.links if link in body]
        found += [link for link in links if link in shaped][-1:]
    return found[:OUTER_LINKS]
