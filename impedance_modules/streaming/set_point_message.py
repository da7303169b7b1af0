# SPDX-License-Identifier: BSD-3-Clause
"""One message of set-points: read whole from JSON, or from what a program in the same process hands over."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput
from impedance_modules.spec.schema import first_schema_error
from impedance_modules.strict_json import parse_json

SCHEMA = "set-point"
LONGEST = 65536
"""Bytes of a message; a longer one is not read."""

UNIT = 1e-3
"""How far from 1 the length of a quaternion may be."""


@dataclass(frozen=True)
class TargetSetPoint:
    """What a message asks of one target; None where it says nothing.

    Attributes:
        position: (3,) of the equilibrium in world [m].
        rotation: (4,) unit quaternion (x, y, z, w) of the equilibrium in world.
        stiffness: (6,) along the spring's axes [N/m, N.m/rad].
        force: (6,) of the hybrid axes, in the spring's axes [N, N.m].
    """

    position: Array | None = None
    rotation: Array | None = None
    stiffness: Array | None = None
    force: Array | None = None


@dataclass(frozen=True)
class SetPointMessage:
    """Set-points of some targets.

    Attributes:
        sequence: Rises from message to message of one sender.
        targets: Target -> what is asked of it.
        sent: Seconds since 1970; None where the sender does not say.
    """

    sequence: int
    targets: Mapping[str, TargetSetPoint]
    sent: float | None = None


def read_message(text: bytes) -> SetPointMessage:
    """Reads a message from JSON (``schemas/set-point.schema.json``).

    Raises:
        BadInput: It is too long, no JSON, has a number that is not finite, or deviates from the schema.
    """
    if len(text) > LONGEST:
        raise BadInput(f"set-point: a message of {len(text)} bytes (valid: up to {LONGEST})")
    try:
        raw = parse_json(text)
    except json.JSONDecodeError as error:
        raise BadInput(f"set-point: no JSON: {error.msg} at {error.lineno}:{error.colno}") from None
    except ValueError as error:
        raise BadInput(f"set-point: {error}") from None
    return make_message(raw)


def make_message(raw: Mapping[str, Any]) -> SetPointMessage:
    """Makes a message of plain data, as JSON has it.

    Raises:
        BadInput: It deviates from the schema, a number is not finite, or a quaternion is none.
    """
    if (fault := first_schema_error(raw, SCHEMA)) is not None:
        raise BadInput(f"set-point: {fault}")
    targets = {name: _target(name, given) for name, given in raw["targets"].items()}
    sent = float(raw["sent"]) if "sent" in raw else None
    return SetPointMessage(int(raw["sequence"]), targets, sent)


def _target(name: str, raw: Mapping[str, Any]) -> TargetSetPoint:
    numbers = {key: np.array(values, dtype=np.float64) for key, values in raw.items()}
    for key, values in numbers.items():
        if not np.isfinite(values).all():
            raise BadInput(f"set-point: {key} of '{name}' is {values.tolist()} (valid: finite numbers)")
    rotation = numbers.get("rotation")
    if rotation is not None:
        length = float(np.linalg.norm(rotation))
        if abs(length - 1.0) > UNIT:
            raise BadInput(
                f"set-point: rotation of '{name}' is {rotation.tolist()}, of length {length:.4g}"
                " (valid: a unit quaternion x y z w)"
            )
        numbers["rotation"] = rotation / length
    return TargetSetPoint(**numbers)
