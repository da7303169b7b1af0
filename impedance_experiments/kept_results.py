# SPDX-License-Identifier: BSD-3-Clause
"""Results of runs in files that hold data and nothing else: arrays in .npz, everything else as JSON inside it.

Whoever can write into the folder of ``--keep`` can change numbers there, but nothing in such a file is ever executed.
A frozen dataclass is written as its fields; which dataclass it was is asked of the function that made it.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, cast, get_type_hints
from zipfile import BadZipFile

import numpy as np

from impedance_modules.errors import BadInput
from impedance_modules.input_files import open_input
from impedance_modules.strict_json import parse_json

LARGEST = 1_000_000_000
"""Bytes of a kept result."""

_TREE = "tree"
_DAMAGE = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, EOFError, BadZipFile, OSError)


def write_result(result: object, place: Path) -> None:
    """Writes a result, whole or not at all.

    Raises:
        TypeError: It is not plain data: numbers, texts, arrays, tuples, lists, mappings, a dataclass of these.
    """
    arrays: list[np.ndarray[Any, Any]] = []
    tree = json.dumps(_plain(result, arrays))
    stream = io.BytesIO()
    named = {f"array{number}": array for number, array in enumerate(arrays)}
    np.savez(stream, allow_pickle=False, **{_TREE: np.frombuffer(tree.encode(), dtype=np.uint8)}, **named)
    part = place.with_suffix(".part")
    part.write_bytes(stream.getvalue())
    part.replace(place)


def read_result(run: Callable[..., Any], place: Path) -> Any:
    """Reads what ``run`` has returned.

    Raises:
        BadInput: The file is no kept result of it.
    """
    try:
        with open_input(place, LARGEST) as stream, np.load(stream, allow_pickle=False) as kept:
            tree = parse_json(kept[_TREE].tobytes())
            made = _made(tree, kept)
        return made if not isinstance(tree, dict) or "record" not in tree else _record(run, made)
    except _DAMAGE as error:
        raise BadInput(
            f"{place}: no kept result: {error} (valid: remove it, and it is made again)"
        ) from error


def _plain(value: Any, arrays: list[np.ndarray[Any, Any]]) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise TypeError("an array of objects is not plain data")
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, float):
        return {"float": value.hex()}
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, tuple | list):
        return {type(value).__name__: [_plain(item, arrays) for item in value]}
    if isinstance(value, Mapping):
        return {"mapping": [[_plain(key, arrays), _plain(item, arrays)] for key, item in value.items()]}
    if is_dataclass(value):
        return {"record": {each.name: _plain(getattr(value, each.name), arrays) for each in fields(value)}}
    raise TypeError(f"a {type(value).__name__} is not plain data")


def _made(tree: Any, kept: Mapping[str, Any]) -> Any:
    if not isinstance(tree, dict):
        return tree
    ((kind, content),) = tree.items()
    if kind == "array":
        return kept[f"array{content}"]
    if kind == "float":
        return float.fromhex(content)
    if kind == "mapping":
        return {_made(key, kept): _made(item, kept) for key, item in content}
    if kind == "record":
        return {name: _made(item, kept) for name, item in content.items()}
    if kind not in ("tuple", "list"):
        raise ValueError(f"an unknown kind of value, '{kind}'")
    items = [_made(item, kept) for item in content]
    return tuple(items) if kind == "tuple" else items


def _record(run: Callable[..., Any], values: dict[str, Any]) -> Any:
    """Makes the dataclass that ``run`` says it returns."""
    kind: Any = get_type_hints(run)["return"]
    if not is_dataclass(kind) or {each.name for each in fields(kind)} != set(values):
        raise ValueError(f"its fields are not those of a {getattr(kind, '__name__', kind)}")
    return cast(Callable[..., Any], kind)(**values)
