# SPDX-License-Identifier: BSD-3-Clause
"""Draws random mutants: first a statement, all alike, then one of its changes."""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.random_mutants.changes import Change, Text, changes_of

SKIPPED = (ast.Raise, ast.Import, ast.ImportFrom, ast.Assert, ast.Pass, ast.Global, ast.Nonlocal, ast.Delete)


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes:
        file: From the checkout's root.
        function: ``Class.method`` or ``function`` it stands in; empty outside all of them.
        line: Where it stands, from 1.
        statement: First line of the statement that it changes.
        kind: What was done, in words.
        old, new: The text replaced, and what stands there instead.
        start: Byte of the file where it stands.
    """

    file: str
    function: str
    line: int
    statement: str
    kind: str
    old: str
    new: str
    start: int

    def applied(self, text: str) -> str:
        """The file's text with the change."""
        whole, old = text.encode(), self.old.encode()
        if whole[self.start : self.start + len(old)] != old:
            raise ValueError(f"{self.file}:{self.line}: does not have {self.old!r} there")
        return (whole[: self.start] + self.new.encode() + whole[self.start + len(old) :]).decode()


def draw(root: Path, folders: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Draws different mutants of all statements in folders, in an order that the seed fixes.

    Args:
        root: The checkout.
        folders: From the root.
        count: How many, at most all there are.
        seed: The same seed on the same text gives the same mutants, and more of them go on with the same ones.
    """
    statements = [
        pair
        for folder in folders
        for path in sorted((root / folder).rglob("*.py"))
        for pair in _of(root, path)
    ]
    chance = random.Random(seed)
    drawn: dict[Mutant, None] = {}
    for _ in range(100 * count):
        if len(drawn) == count or not statements:
            break
        drawn[chance.choice(chance.choice(statements))] = None
    return list(drawn)


def _of(root: Path, path: Path) -> Iterator[list[Mutant]]:
    """Of every statement of a file that can be changed, its mutants."""
    content = path.read_text(encoding="utf-8")
    text, tree, lines = Text(content), ast.parse(content), content.splitlines()
    file = str(path.relative_to(root))
    for statement, function in _statements(tree.body, ()):
        place = (file, function, statement.lineno, lines[statement.lineno - 1].strip())
        mutants = [
            Mutant(*place, change.kind, _old(text, change), change.new, change.start)
            for change in changes_of(statement, text)
        ]
        if mutants:
            yield mutants


def _old(text: Text, change: Change) -> str:
    return text.bytes[change.start : change.end].decode()


def _statements(body: Sequence[ast.stmt], inside: tuple[str, ...]) -> Iterator[tuple[ast.stmt, str]]:
    """All statements, with the outermost function they stand in, or its class and name."""
    for statement in body:
        if isinstance(statement, SKIPPED) or _only_for_types(statement):
            continue
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            deeper = inside if _in_function(inside) else (*inside, _name(statement))
            yield from _statements(statement.body, deeper)
            continue
        yield statement, ".".join(inside).removesuffix("()") if _in_function(inside) else ""
        for part in ("body", "orelse", "finalbody"):
            yield from _statements(getattr(statement, part, ()), inside)
        for handler in getattr(statement, "handlers", ()):
            yield from _statements(handler.body, inside)
        for case in getattr(statement, "cases", ()):
            yield from _statements(case.body, inside)


def _name(statement: ast.FunctionDef | ast.ClassDef) -> str:
    return f"{statement.name}()" if isinstance(statement, ast.FunctionDef) else statement.name


def _in_function(inside: tuple[str, ...]) -> bool:
    return bool(inside) and inside[-1].endswith("()")


def _only_for_types(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.If) and ast.unparse(statement.test).endswith("TYPE_CHECKING")
