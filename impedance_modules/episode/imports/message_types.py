# SPDX-License-Identifier: BSD-3-Clause
"""Message definitions of a recording, before a library makes Python code of them.

The library that reads ROS recordings writes a class for each definition and executes it. The names in it come from the
recording. Its own grammar lets no program through that we know of, but names of which no class can be made; here only
names pass that are nothing but names, and arrays for which not too much code is written.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterator, Mapping
from typing import Any

TYPE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(?:/[A-Za-z][A-Za-z0-9_]*){1,2}")
_FIELD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

LONGEST_ARRAY = 10_000
"""Entries of an array of fixed length; for each of them, lines of code are written."""

MOST_FIELDS = 2_000
"""Fields and constants of all types of one definition."""

LONGEST_DEFINITION = 1_000_000
"""Characters."""


def are_plain(definitions: Mapping[str, Any]) -> bool:
    """Says whether parsed definitions hold nothing but names, numbers and texts of bounded size.

    Args:
        definitions: Type name -> (constants, fields), as the library parses them.
    """
    count = sum(len(constants) + len(fields) for constants, fields in definitions.values())
    return count <= MOST_FIELDS and all(_is_plain(name, *parts) for name, parts in definitions.items())


def is_type_name(name: str) -> bool:
    """Says whether a text is ``package/Type`` or ``package/msg/Type``, without a word that Python reserves."""
    return TYPE_NAME.fullmatch(name) is not None and not any(map(keyword.iskeyword, name.split("/")))


def _is_plain(name: str, constants: Any, fields: Any) -> bool:
    names = [constant[0] for constant in constants] + [field[0] for field in fields]
    values = [constant[2] for constant in constants]
    return (
        is_type_name(name)
        and all(_FIELD_NAME.fullmatch(one) is not None for one in names)
        and all(type(value) in (bool, int, float, str) for value in values)
        and all(_is_plain_leaf(leaf) for field in fields for leaf in _leaves(field[1]))
    )


def _is_plain_leaf(leaf: object) -> bool:
    if isinstance(leaf, str):
        return _FIELD_NAME.fullmatch(leaf) is not None or is_type_name(leaf)
    return isinstance(leaf, int) and 0 <= leaf <= LONGEST_ARRAY


def _leaves(description: Any) -> Iterator[object]:
    if isinstance(description, tuple | list):
        for part in description:
            yield from _leaves(part)
    else:
        yield description
