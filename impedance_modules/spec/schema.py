# SPDX-License-Identifier: BSD-3-Clause
"""Checks a document against its JSON Schema, and reports every deviation with its place, one sentence each.

The schemas avoid ``anyOf``: a value that may be a number or a mapping says ``"type": ["number", "object"]``
and puts the bounds of both beside it, so each deviation has exactly one cause. Three annotations beside
the standard keywords are used: ``unit``, ``hint`` (added to the message) and ``message`` (replaces it).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from impedance_modules.errors import Problem, nearest
from impedance_modules.installed import EFFECTS, installed
from impedance_modules.spec.document import Document
from impedance_modules.spec.locate import find_schema
from impedance_modules.spec.yaml_tree import KeyPath

if TYPE_CHECKING:
    from jsonschema import Draft202012Validator

_Fault = tuple[KeyPath, str, tuple[str, ...], str]
"""The arguments of ``Document.problem``."""

_KINDS = {
    "number": "a number",
    "integer": "a whole number",
    "string": "text",
    "boolean": "true or false",
    "array": "a list",
    "object": "keys with values",
    "null": "nothing",
}


def load_schema(name: str) -> dict[str, Any]:
    """Returns the JSON Schema ``name`` as plain data; raises BadInput for an unknown name.

    A patch may have the effects of other installed packages, too.
    """
    schema: dict[str, Any] = json.loads(find_schema(name).read_text(encoding="utf-8"))
    if name == "patch":
        known = schema["$defs"]["effect"]["properties"]["effect"]["enum"]
        known += [more for more in (*installed(EFFECTS), *_MORE_EFFECTS) if more not in known]
    return schema


_MORE_EFFECTS: list[str] = []


def allow_effect(name: str) -> None:
    """Lets patches have an effect that is not in the schema's file."""
    _MORE_EFFECTS.append(name)
    _validator.cache_clear()


def schema_problems(document: Document, schema_name: str) -> list[Problem]:
    """Returns everything in which a document deviates from a schema, located, without repetitions.

    Args:
        document: What to check.
        schema_name: ``task``, ``robot``, ``patch`` ...: ``schemas/<name>.schema.json``.
    """
    return [problem for problem, _ in schema_faults(document, schema_name)]


def schema_faults(document: Document, schema_name: str) -> list[tuple[Problem, KeyPath]]:
    """Like ``schema_problems``, each with its path, so that a reader can go on with the sound parts."""
    distinct = dict.fromkeys(_deviations(document, schema_name))
    return [(document.problem(*fault), fault[0]) for fault in distinct]


def first_schema_error(value: object, name: str) -> str | None:
    """Says where data that no person wrote (a JSON answer) deviate from a schema; None where they do not."""
    from jsonschema.exceptions import best_match  # noqa: PLC0415 - as above

    found = best_match(_validator(name).iter_errors(value))
    return None if found is None else f"{found.json_path}: {found.message}"


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


def describe_deviation(deviation: Deviation) -> tuple[str, tuple[str, ...]]:
    """Returns the sentence for a deviation and the valid choices, if they can be listed."""
    if deviation.keyword == "not" and "message" in deviation.schema:
        return str(deviation.schema["message"]), ()
    choices = _choices(deviation)
    describe = _DESCRIBED.get(deviation.keyword)
    if describe is None:
        return (
            f"{_shown(deviation.found)} breaks the rule '{deviation.keyword}: {deviation.expected}'",
            choices,
        )
    hint = "" if deviation.keyword == "type" else deviation.hint
    return describe(deviation) + hint, choices


def _deviations(document: Document, schema_name: str) -> Iterator[_Fault]:
    for error in _validator(schema_name).iter_errors(document.data):
        schema: Any = error.schema
        yield from _faults(
            Deviation(
                path=tuple(error.absolute_path),
                keyword=str(error.validator),
                expected=error.validator_value,
                found=error.instance,
                schema=schema if isinstance(schema, dict) else {},
            )
        )


@cache
def _validator(schema_name: str) -> Draft202012Validator:
    from jsonschema import Draft202012Validator  # noqa: PLC0415 - slow to import, and not always needed

    return Draft202012Validator(load_schema(schema_name))


def _faults(deviation: Deviation) -> Iterator[_Fault]:
    if deviation.keyword == "additionalProperties":
        yield from _unknown_keys(deviation)
    elif deviation.keyword in {"required", "dependentRequired"}:
        yield from _missing_keys(deviation)
    else:
        sentence, valid = describe_deviation(deviation)
        yield deviation.path, sentence, valid, "value"


def _unknown_keys(deviation: Deviation) -> Iterator[_Fault]:
    patterns = deviation.schema.get("patternProperties", {})
    known = sorted(deviation.schema.get("properties", {}))
    for key in deviation.found:
        if key in known or any(re.search(pattern, key) for pattern in patterns):
            continue
        message = f"unknown key '{key}'{nearest(key, known)}"
        if patterns and not known:
            message = f"'{key}' cannot stand here{deviation.hint}"
        yield (*deviation.path, key), message, tuple(known), "key"


def _missing_keys(deviation: Deviation) -> Iterator[_Fault]:
    wanted, because = deviation.expected, ""
    if deviation.keyword == "dependentRequired":
        needing = [owner for owner in wanted if owner in deviation.found]
        wanted, because = [key for owner in needing for key in wanted[owner]], f", which {needing[0]} needs"
    for key in wanted:
        if key not in deviation.found:
            known = deviation.schema.get("properties", {}).get(key, {})
            message = f"missing key '{key}'{because}{_explained(known)}"
            yield (*deviation.path, key), message, (), "key"


def _explained(schema: dict[str, Any]) -> str:
    """The first sentence of a description, and the unit."""
    text = str(schema.get("description", "")).split(". ")[0].rstrip(".")
    unit = schema.get("unit", "1")
    return f" ({text}{'' if unit == '1' else f', in {unit}'})" if text else ""


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


_DESCRIBED: dict[str, Callable[[Deviation], str]] = {
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
