# SPDX-License-Identifier: BSD-3-Clause
"""A patch file: physical effects that the plant and the model are to wear (design 3.4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from impedance_modules.errors import BadFile
from impedance_modules.spec.schema import schema_problems
from impedance_modules.spec.source import read_document


@dataclass(frozen=True)
class Quantity:
    """A number with its unit and, when it was identified, its standard deviation."""

    value: float
    unit: str
    std: float | None


@dataclass(frozen=True)
class EffectSpec:
    """One effect of a patch.

    Attributes:
        effect: Id from the catalogue.
        joints: Joints that wear it.
        port: ``actuator``, ``link``, ``sensor``, ``timing`` or ``contact``.
        parameters: Joint, body, ``base`` or ``log`` -> symbol -> quantity.
    """

    effect: str
    joints: tuple[str, ...]
    port: str
    parameters: Mapping[str, Mapping[str, Quantity]]


@dataclass(frozen=True)
class PatchSpec:
    """A whole patch file."""

    robot: str
    effects: tuple[EffectSpec, ...]
    path: Path
    text: str


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
    return PatchSpec(data["robot"], effects, path, document.text)


def _effect(entry: Mapping[str, Any]) -> EffectSpec:
    parameters = {
        key: {
            symbol: Quantity(float(quantity["value"]), quantity["unit"], quantity.get("std"))
            for symbol, quantity in symbols.items()
        }
        for key, symbols in entry["parameters"].items()
    }
    return EffectSpec(entry["effect"], tuple(entry["joints"]), entry["port"], parameters)
