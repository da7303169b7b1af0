# SPDX-License-Identifier: BSD-3-Clause
"""The hand-set numbers of the diagnosis, read from its source; and a diagnosis with some of them changed.

`python -m benchmarks.wide.thresholds NAME=VALUE ... -- WORDS` is `impedance WORDS` with other values. Numbers that were
computed from a changed one as modules were imported stay as they were.
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
DIAGNOSIS = ROOT / "impedance_modules" / "diagnosis"

Value = float | tuple[float, ...]


@dataclass(frozen=True)
class Threshold:
    """A hand-set number.

    Attributes:
        module: Where it stands, in Python's words.
        line: From one.
        name: In capitals.
        value: One number or several.
        decides: First sentence of the text below it; empty where there is none.
    """

    module: str
    line: int
    name: str
    value: Value
    decides: str

    def __str__(self) -> str:
        """One line: file:line, name, value, what it decides."""
        place = f"{self.module.replace('.', '/')}.py:{self.line}"
        return f"{place:<78} {self.name:<24} {self.value!s:<16} {self.decides}"


def thresholds(folder: Path = DIAGNOSIS) -> list[Threshold]:
    """Lists the numbers that modules below a folder bind to names in capitals, in order of files and lines."""
    found: list[Threshold] = []
    for path in sorted(folder.rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        body = ast.parse(path.read_text()).body
        for statement, after in zip(body, [*body[1:], None], strict=True):
            found += _of_statement(statement, after, module)
    return found


def _of_statement(statement: ast.stmt, after: ast.stmt | None, module: str) -> list[Threshold]:
    if not isinstance(statement, ast.Assign) or len(statement.targets) != 1:
        return []
    target = statement.targets[0]
    pairs = [(target, statement.value)]
    if isinstance(target, ast.Tuple) and isinstance(statement.value, ast.Tuple):
        pairs = list(zip(target.elts, statement.value.elts, strict=True))
    text = after.value if isinstance(after, ast.Expr) else None
    decides = text.value if isinstance(text, ast.Constant) and isinstance(text.value, str) else ""
    out: list[Threshold] = []
    for name, value in pairs:
        number = _number(value)
        if isinstance(name, ast.Name) and name.id.isupper() and number is not None:
            words = " ".join(decides.split())
            out.append(Threshold(module, statement.lineno, name.id, number, words))
    return out


def _number(node: ast.expr) -> Value | None:
    """Value of a number, its negative, a sum or product of numbers, or a tuple of them; None for anything else."""
    if isinstance(node, ast.Tuple):
        parts = [_number(part) for part in node.elts]
        numbers = tuple(part for part in parts if isinstance(part, float | int))
        return numbers if parts and len(numbers) == len(parts) else None
    if any(isinstance(part, ast.Name | ast.Call | ast.Attribute) for part in ast.walk(node)):
        return None
    if isinstance(node, ast.Constant | ast.UnaryOp | ast.BinOp):
        value = eval(compile(ast.Expression(node), "<number>", "eval"), {"__builtins__": {}})
        return value if isinstance(value, float | int) and not isinstance(value, bool) else None
    return None


def changes_of(words: Sequence[str]) -> dict[Threshold, float]:
    """Reads NAME=VALUE, or MODULE.NAME=VALUE where several modules have a number of that name.

    Raises:
        ValueError: No number, or several, have this name; or the value is no number.
    """
    every, out = thresholds(), {}
    for word in words:
        name, equals, text = word.partition("=")
        one = [item for item in every if f".{item.module}.{item.name}".endswith(f".{name}")]
        if not equals or len(one) != 1 or isinstance(one[0].value, tuple):
            places = ", ".join(f"{item.module}.{item.name}" for item in one) or "none"
            raise ValueError(
                f"'{word}' names no single number (found: {places}; valid: NAME=VALUE of a line of `thresholds`, with"
                " more of its module where several have that name)"
            )
        out[one[0]] = float(text)
    return out


def change(words: Sequence[str]) -> None:
    """Sets numbers of the diagnosis for this process, also in modules that took them from where they are defined.

    Raises:
        ValueError: As `changes_of`.
    """
    for item, value in changes_of(words).items():
        module = importlib.import_module(item.module)
        set_everywhere(module, item.name, type(getattr(module, item.name))(value))


def set_everywhere(holder: Any, name: str, value: Any) -> list[tuple[Any, Any]]:
    """Sets a name of a module or class, also in modules that took it from where it is defined.

    Returns:
        Each of them with what it had before.
    """
    before = getattr(holder, name)
    own = _modules_with(name)
    took = [
        module
        for place, module in list(sys.modules.items())
        if place.startswith("impedance_modules")
        and place not in own
        and module is not holder
        and getattr(module, name, None) is before
    ]
    holders = [holder, *took] if isinstance(holder, ModuleType) else [holder]
    for one in holders:
        setattr(one, name, value)
    return [(one, before) for one in holders]


@cache
def _modules_with(name: str) -> frozenset[str]:
    """Modules that define a number of a name themselves: another's of that name is none of theirs."""
    return frozenset(item.module for item in thresholds() if item.name == name)


def main() -> None:
    """Runs `impedance` with changed numbers."""
    at = sys.argv.index("--")
    change(sys.argv[1:at])
    sys.argv = ["impedance", *sys.argv[at + 1 :]]
    from impedance_modules.cli.main import main as impedance

    impedance()


if __name__ == "__main__":
    main()
