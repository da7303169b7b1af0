# SPDX-License-Identifier: BSD-3-Clause
"""What the further values of an episode's metadata must look like, so that whoever uses one may rely on it.

Files come from anywhere: a rate that is a text, limits of zero or a list where an object belongs would otherwise come
to light in a replay, a picture or a diagnosis. Keys that are not known here are nobody's concern and are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from impedance_modules.errors import BadInput, printable

LARGEST = 1e18
"""No number that is used as one is beyond."""

IN_MEMORY = ("segment", "kept_every")
"""Keys that readers add; in a file they would be taken for their own."""

Test = Callable[[Any], bool]


def check_values(metadata: Mapping[str, Any], place: str) -> None:
    """Refuses a known key with a value of the wrong kind.

    Raises:
        BadInput: With the first such key.
    """
    for key in IN_MEMORY:
        if key in metadata:
            raise BadInput(
                f"{place}: metadata '{key}' is made by readers, not kept in a file (valid: without it)"
            )
    for key, (test, valid) in _KNOWN.items():
        if key in metadata and not test(metadata[key]):
            raise BadInput(f"{place}: metadata '{key}' is {_shown(metadata[key])} (valid: {valid})")


def is_name(value: object) -> bool:
    """Says whether a value can name something: text of one line, without control characters."""
    return isinstance(value, str) and 0 < len(value) <= 500 and printable(value) == value


def is_number(value: object) -> bool:
    """Says whether a value is a number of a size that can be used; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _positive(value: object) -> bool:
    return isinstance(value, int | float) and is_number(value) and value > 0


def _text(value: object) -> bool:
    return isinstance(value, str)


def _flag(value: object) -> bool:
    return isinstance(value, bool)


def _whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _or_null(test: Test) -> Test:
    return lambda value: value is None or test(value)


def _list_of(test: Test, count: int | None = None) -> Test:
    return lambda value: isinstance(value, list) and count in (None, len(value)) and all(map(test, value))


def _object_of(test: Test) -> Test:
    return lambda value: (
        isinstance(value, dict) and all(map(is_name, value)) and all(map(test, value.values()))
    )


def _saved(value: object) -> bool:
    return isinstance(value, dict) and _or_null(_whole)(value.get("first_row", "absent"))


_KNOWN: Mapping[str, tuple[Test, str]] = {
    "rate": (_positive, "a number above 0 [Hz]"),
    "scale": (_positive, "a number above 0"),
    "seed": (_whole, "a whole number, 0 or more"),
    "arm": (_or_null(is_name), "the name of an arm, or null"),
    "arms": (_list_of(is_name), "a list of names"),
    "limbs": (_object_of(_list_of(is_name)), "limb -> list of joints"),
    "backend": (is_name, "a name"),
    "task_name": (is_name, "a name"),
    "task_path": (_text, "text"),
    "effects": (_or_null(_text), "the text of a patch, or null"),
    "played_back": (_text, "the text of a task"),
    "mode": (_text, "text"),
    "ending": (_text, "text"),
    "reason": (_text, "text"),
    "complete": (_flag, "true or false"),
    "allow_unstable": (_flag, "true or false"),
    "saved": (_saved, "an object with 'first_row', a whole number or null"),
    "acting": (_list_of(is_number), "a list of numbers [N.m]"),
    "effort_max": (_object_of(_positive), "joint -> number above 0 [N.m]"),
    "tank": (_object_of(is_number), "an object of numbers [J]"),
    "versions": (_object_of(_text), "library -> version"),
    "joint_origins": (
        _object_of(_list_of(_list_of(is_number, 3), 2)),
        "joint -> [[x, y, z], [roll, pitch, yaw]]",
    ),
    "paths": (_list_of(lambda value: isinstance(value, dict)), "a list of objects"),
    "imported": (lambda value: isinstance(value, dict), "an object"),
}
"""Key -> what its value must pass, and what to say of one that does not."""
