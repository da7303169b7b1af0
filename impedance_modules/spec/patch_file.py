# SPDX-License-Identifier: BSD-3-Clause
"""A patch file: physical effects that are applied to the plant and to the model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from impedance_modules.errors import BadFile
from impedance_modules.spec.document import Document, read_document
from impedance_modules.spec.schema import schema_problems


@dataclass(frozen=True)
class PatchQuantity:
    """A number with its unit and, when it was identified, its standard deviation."""

    value: float
    unit: str
    std: float | None


@dataclass(frozen=True)
class EffectSpec:
    """One effect of a patch.

    Attributes:
        effect: Id from the catalogue.
        joints: Joints it acts on.
        port: ``actuator``, ``link``, ``sensor``, ``timing`` or ``contact``.
        parameters: Joint, body, ``base`` or ``log`` -> symbol -> quantity.
        range: ``position``, ``velocity`` or ``effort`` -> joint -> lowest and highest value of the data it was
            fitted to; empty where it holds everywhere.
    """

    effect: str
    joints: tuple[str, ...]
    port: str
    parameters: Mapping[str, Mapping[str, PatchQuantity]]
    range: Mapping[str, Mapping[str, tuple[float, float]]]


@dataclass(frozen=True)
class PatchSpec:
    """A whole patch file.

    Attributes:
        robot: Name of the robot it is for.
        effects: They add.
        document: The file, which knows where every value stood.
    """

    robot: str
    effects: tuple[EffectSpec, ...]
    document: Document = field(repr=False)

    @property
    def path(self) -> Path:
        """As the user wrote it."""
        return self.document.path

    @property
    def text(self) -> str:
        """The whole file."""
        return self.document.text


def read_patch(path: Path) -> PatchSpec:
    """Reads a patch file.

    Raises:
        BadInput: The file cannot be read.
        BadFile: It is not a patch; every problem is listed with its line.
    """
    document = read_document(path)
    problems = schema_problems(document, "patch")
    if problems:
        raise BadFile(problems)
    data = document.data
    effects = tuple(_effect(entry) for entry in data["effects"])
    return PatchSpec(data["robot"], effects, document)


def _effect(entry: Mapping[str, Any]) -> EffectSpec:
    parameters = {
        key: {
            symbol: PatchQuantity(float(quantity["value"]), quantity["unit"], quantity.get("std"))
            for symbol, quantity in symbols.items()
        }
        for key, symbols in entry["parameters"].items()
    }
    valid = {
        quantity: {joint: (float(low), float(high)) for joint, (low, high) in joints.items()}
        for quantity, joints in entry.get("range", {}).items()
    }
    return EffectSpec(entry["effect"], tuple(entry["joints"]), entry["port"], parameters, valid)
