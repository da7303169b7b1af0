# SPDX-License-Identifier: BSD-3-Clause
"""How a file format takes up a quantity of a patch: where it stands in the file, and by which equation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from impedance_modules.effects.patch_check import PatchTarget
from impedance_modules.effects.simulator_numbers import Amount, Quantity
from impedance_modules.export.edited_xml import EditedXml
from impedance_modules.spec.located_xml import Faults


class NotCarried(Exception):  # noqa: N818 - it is no mistake of anybody
    """An amount that a format, or this file, cannot take up; says why in the rest of a sentence on the effect."""


class RobotDescription(Protocol):
    """A robot's description that a patch is carried into.

    Attributes:
        xml: Its tree.
        faults: What is wrong with it for this patch, at its own lines.
        target: What a patch may name in it.
    """

    xml: EditedXml
    faults: Faults
    target: PatchTarget


D = TypeVar("D", bound=RobotDescription)


@dataclass(frozen=True)
class Carrier(Generic[D]):
    """One quantity in one format.

    Attributes:
        place: Element and attribute that hold it.
        equation: What is written there.
        write: Does it, in the tree; raises ``NotCarried``, or notes a fault of the file.
    """

    place: str
    equation: str
    write: Callable[[D, Amount], None]


@dataclass(frozen=True)
class Format(Generic[D]):
    """A file format.

    Attributes:
        words: What it is called.
        read: Reads a file that is to be written as another one; ``BadFile`` where it is none of this format.
        carriers: Quantity -> how it is taken up.
        refused: Quantity -> why it is not, the rest of a sentence on the effect.
        apart: Two quantities that cannot both be taken up on one joint -> why; the first one is refused.
    """

    words: str
    read: Callable[[Path, Path], D]
    carriers: Mapping[Quantity, Carrier[D]]
    refused: Mapping[Quantity, str]
    apart: Mapping[tuple[Quantity, Quantity], str]
