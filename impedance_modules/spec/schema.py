# SPDX-License-Identifier: BSD-3-Clause
"""Checks a document against its JSON Schema and locates every deviation.

The schemas avoid ``anyOf``: a value that may be a number or a mapping says ``"type": ["number", "object"]``
and puts the bounds of both beside it, so each deviation has exactly one cause. Three annotations beside
the standard keywords are used: ``unit``, ``hint`` (added to the message) and ``message`` (replaces it).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.locate import find_schema
from impedance_modules.spec.schema_sentences import Deviation, say
from impedance_modules.spec.document import Document
from impedance_modules.spec.yaml_tree import Path

if TYPE_CHECKING:
    from jsonschema import Draft202012Validator


_Fault = tuple[Path, str, tuple[str, ...], str]
"""The arguments of ``Document.problem``."""


def load_schema(name: str) -> dict[str, Any]:
    """Returns the JSON Schema ``name`` as plain data; raises BadInput for an unknown name."""
    schema: dict[str, Any] = json.loads(find_schema(name).read_text(encoding="utf-8"))
    return schema


def schema_problems(document: Document, schema_name: str) -> list[Problem]:
    """Returns everything in which a document deviates from a schema, located, without repetitions.

    Args:
        document: What to check.
        schema_name: ``task``, ``robot``, ``patch`` ...: ``schemas/<name>.schema.json``.
    """
    return [problem for problem, _ in schema_faults(document, schema_name)]


def schema_faults(document: Document, schema_name: str) -> list[tuple[Problem, Path]]:
    """Like ``schema_problems``, each with its path, so that a reader can go on with the sound parts."""
    distinct = dict.fromkeys(_deviations(document, schema_name))
    return [(document.problem(*fault), fault[0]) for fault in distinct]


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
    from jsonschema import Draft202012Validator  # noqa: PLC0415 - its import time belongs to those who check

    return Draft202012Validator(load_schema(schema_name))


def _faults(deviation: Deviation) -> Iterator[_Fault]:
    if deviation.keyword == "additionalProperties":
        yield from _unknown_keys(deviation)
    elif deviation.keyword in {"required", "dependentRequired"}:
        yield from _missing_keys(deviation)
    else:
        sentence, valid = say(deviation)
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


def first_deviation(value: object, name: str) -> str | None:
    """Says where data that no person wrote (a JSON answer) deviate from a schema; None where they do not."""
    from jsonschema.exceptions import best_match  # noqa: PLC0415 - as above

    found = best_match(_validator(name).iter_errors(value))
    return None if found is None else f"{found.json_path}: {found.message}"
