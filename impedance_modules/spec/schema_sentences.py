# SPDX-License-Identifier: BSD-3-Clause
"""One sentence for each way in which a value can deviate from its schema."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from impedance_modules.errors import nearest

_KINDS = {
    "number": "a number",
    "integer": "a whole number",
    "string": "text",
    "boolean": "true or false",
    "array": "a list",
    "object": "keys with values",
    "null": "nothing",
}


@dataclass(frozen=True)
class Deviation:
    """One deviation of a value from its schema.

    Attributes:
        path: Of the value in the document.
        keyword: The keyword of JSON Schema that is not met.
        expected: The keyword's value.
        found: The document's value.
        schema: The subschema that holds the keyword.
    """

    path: tuple[str | int, ...]
    keyword: str
    expected: Any
    found: Any
    schema: dict[str, Any]

    @property
    def hint(self) -> str:
        """The schema's own advice, as the end of a sentence."""
        return f"; {self.schema['hint']}" if "hint" in self.schema else ""

    @property
    def unit(self) -> str:
        """The unit, with a leading blank; nothing for a pure number."""
        unit = self.schema.get("unit", "1")
        return "" if unit == "1" else f" {unit}"


def say(deviation: Deviation) -> tuple[str, tuple[str, ...]]:
    """Returns the sentence for a deviation and the valid choices, if they can be listed."""
    if deviation.keyword == "not" and "message" in deviation.schema:
        return str(deviation.schema["message"]), ()
    choices = _choices(deviation)
    speak = _SENTENCES.get(deviation.keyword)
    if speak is None:
        return (
            f"{_shown(deviation.found)} breaks the rule '{deviation.keyword}: {deviation.expected}'",
            choices,
        )
    hint = "" if deviation.keyword == "type" else deviation.hint
    return speak(deviation) + hint, choices


def _choices(deviation: Deviation) -> tuple[str, ...]:
    if deviation.keyword == "enum":
        return tuple(str(value) for value in deviation.expected)
    return (str(deviation.expected),) if deviation.keyword == "const" else ()


def _shown(value: object) -> str:
    """A value as a person would name it in a sentence."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return f"keys ({', '.join(list(value)[:3])})" if value else "an empty mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _wrong_type(deviation: Deviation) -> str:
    kinds = [deviation.expected] if isinstance(deviation.expected, str) else deviation.expected
    unit = f" in{deviation.unit}" if deviation.unit else ""
    wanted = " or ".join(_KINDS[kind] + (unit if kind in {"number", "integer"} else "") for kind in kinds)
    advice = _number_advice(deviation.found) if "number" in kinds and isinstance(deviation.found, str) else ""
    return f"expected {wanted}, found {_shown(deviation.found)}{advice}"


def _number_advice(text: str) -> str:
    """Says why a text that begins like a number is none."""
    number = re.match(r"\s*([-+]?[0-9]*\.?[0-9]+)\s*(.*)", text)
    if number is None:
        return ""
    return "; write the number alone, without its unit" if number[2] else "; remove the quotes"


def _too_small(deviation: Deviation) -> str:
    than = "less than the least allowed," if deviation.keyword == "minimum" else "not more than"
    return f"{deviation.found}{deviation.unit} is {than} {deviation.expected}{deviation.unit}"


def _too_large(deviation: Deviation) -> str:
    than = "more than the most allowed," if deviation.keyword == "maximum" else "not less than"
    return f"{deviation.found}{deviation.unit} is {than} {deviation.expected}{deviation.unit}"


def _wrong_count(deviation: Deviation) -> str:
    edge = "at least" if deviation.keyword.startswith("min") else "at most"
    what = "keys" if deviation.keyword.endswith("Properties") else "values"
    keys = sorted(deviation.schema.get("properties", {})) if what == "keys" else []
    listed = f" of {', '.join(keys)}" if keys else ""
    counted = what[:-1] if deviation.expected == 1 else what
    return f"expected {edge} {deviation.expected} {counted}{listed}, found {len(deviation.found)}"


def _wrong_choice(deviation: Deviation) -> str:
    return (
        f"{_shown(deviation.found)} is not a choice here{nearest(str(deviation.found), _choices(deviation))}"
    )


def _wrong_pattern(deviation: Deviation) -> str:
    expected = "" if deviation.hint else f" (expected {deviation.expected})"
    return f"{_shown(deviation.found)} cannot be used here{expected}"


def _twice(deviation: Deviation) -> str:
    values = [str(value) for value in deviation.found]
    return f"{', '.join(sorted({v for v in values if values.count(v) > 1}))}: listed more than once"


_SENTENCES: dict[str, Callable[[Deviation], str]] = {
    "type": _wrong_type,
    "minimum": _too_small,
    "exclusiveMinimum": _too_small,
    "maximum": _too_large,
    "exclusiveMaximum": _too_large,
    "minItems": _wrong_count,
    "maxItems": _wrong_count,
    "minProperties": _wrong_count,
    "maxProperties": _wrong_count,
    "enum": _wrong_choice,
    "const": _wrong_choice,
    "pattern": _wrong_pattern,
    "uniqueItems": _twice,
}
