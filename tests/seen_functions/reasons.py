# SPDX-License-Identifier: BSD-3-Clause
"""The functions of the package as its files say, and the reasons why commands do not call some of them."""

from __future__ import annotations

import ast
import fnmatch
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import yaml

from tests.seen_functions.instrument import PACKAGE, Place, definitions, first_line

REASONS = Path(__file__).with_name("reasons.yaml")
WHOLE_FILE = "all"


@dataclass(frozen=True)
class Function:
    """One function of the package.

    Attributes:
        name: ``file: function`` or ``file: Class.method``.
        place: Where it begins.
    """

    name: str
    place: Place


def package_functions() -> list[Function]:
    """All functions but laws and methods of protocols."""
    return [
        Function(f"{path.relative_to(PACKAGE)}: {name}", (str(path), first_line(node)))
        for path in sorted(PACKAGE.rglob("*.py"))
        for name, node in definitions(ast.parse(path.read_text()), "")
    ]


@cache
def reasons() -> Mapping[str, str]:
    """Pattern of ``file: function`` -> reason."""
    found: dict[str, str] = {}
    for reason, files in yaml.safe_load(REASONS.read_text()).items():
        for file, names in files.items():
            for name in ["*"] if names == WHOLE_FILE else names.split():
                found[f"{file}: {name}"] = reason
    return found


def reason_of(function: Function) -> str | None:
    """The reason for not calling a function; one that names it counts before one that names its file."""
    fitting = [pattern for pattern in reasons() if fnmatch.fnmatchcase(function.name, pattern)]
    return reasons()[max(fitting, key=len)] if fitting else None


def outdated(functions: Iterable[Function]) -> list[str]:
    """Reasons for functions that the package does not have."""
    names = [function.name for function in functions]
    return [
        f"reasons.yaml: the package has no '{pattern}'"
        for pattern in reasons()
        if not fnmatch.filter(names, pattern)
    ]


def not_needed(functions: Iterable[Function], places: set[Place]) -> list[str]:
    """Reasons for functions that were called all the same, each and all of them."""
    named = list(functions)
    return [
        pattern
        for pattern in reasons()
        if all(f.place in places for f in named if fnmatch.fnmatchcase(f.name, pattern))
    ]


def by_reason(functions: Iterable[Function]) -> Mapping[str | None, list[Function]]:
    grouped: dict[str | None, list[Function]] = defaultdict(list)
    for function in functions:
        grouped[reason_of(function)].append(function)
    return grouped
