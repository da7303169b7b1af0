# SPDX-License-Identifier: BSD-3-Clause
"""Lets every function of the package say that it was called, by one statement put before its first.

A trace of the interpreter would do the same at ten times the cost, too slow for a robot in real time. Laws stay as
they are: machine code is made of them.
"""

from __future__ import annotations

import ast
import builtins
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

from tests.support.paths import CHECKOUT

PACKAGE = CHECKOUT / "impedance_modules"
CALLED = "__called__"
"""Name, among Python's builtins, of the function that a statement calls; so no file must import it."""

Place = tuple[str, int]
"""A function's file and first line, that of its first decorator."""


class Calls:
    """Which functions of the package were called since it was installed."""

    def __init__(self) -> None:
        self._numbers: set[int] = set()
        self._places: list[Place] = []
        self._others: set[Place] = set()

    @property
    def places(self) -> set[Place]:
        """Of all that were called here or in a process whose calls were taken."""
        return {self._places[number] for number in self._numbers} | self._others

    def install(self) -> None:
        """Has every module of the package, imported from now on, report its calls."""
        if any(name.partition(".")[0] == PACKAGE.name for name in sys.modules):
            raise RuntimeError(f"{PACKAGE.name} was imported before its calls could be counted")
        setattr(builtins, CALLED, self._numbers.add)
        sys.meta_path.insert(0, _Finder(self))

    @contextmanager
    def ignored(self) -> Iterator[None]:
        """What is called meanwhile does not count."""
        before = set(self._numbers)
        yield
        self._numbers.intersection_update(before)

    def write(self, path: Path) -> None:
        path.write_text(json.dumps(sorted(self.places)))

    def take(self, path: Path) -> None:
        """Adds what another process has written."""
        self._others |= {(file, line) for file, line in json.loads(path.read_text())}

    def number_of(self, place: Place) -> int:
        """Gives a function the number by which it reports."""
        self._places.append(place)
        return len(self._places) - 1


class _Finder(MetaPathFinder):
    def __init__(self, calls: Calls) -> None:
        self._calls = calls

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name.partition(".")[0] != PACKAGE.name:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path, self._calls)
        return spec


class _Loader(SourceFileLoader):
    def __init__(self, name: str, path: str, calls: Calls) -> None:
        super().__init__(name, path)
        self._calls = calls

    def get_code(self, fullname: str) -> CodeType:
        """Compiles anew: kept bytecode reports nothing, and this one must not be kept."""
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path))
        for _, node in definitions(tree, ""):
            report = ast.parse(f"{CALLED}({self._calls.number_of((path, first_line(node)))})").body[0]
            after = node.body[0]
            for part in ast.walk(report):
                ast.copy_location(part, after)
            node.body.insert(int(ast.get_docstring(node, clean=False) is not None), report)
        return compile(tree, path, "exec", dont_inherit=True)


def definitions(node: ast.AST, owner: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions inside a node but laws and methods of protocols, each with the classes and functions around it."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef):
            if not is_protocol(child):
                yield from definitions(child, f"{owner}{child.name}.")
        elif isinstance(child, ast.FunctionDef):
            if not is_law(child):
                yield owner + child.name, child
                yield from definitions(child, f"{owner}{child.name}.")
        else:
            yield from definitions(child, owner)


def first_line(node: ast.FunctionDef) -> int:
    return min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])


def is_law(node: ast.FunctionDef) -> bool:
    """Whether a function is marked ``@compiled``."""
    return any(isinstance(mark, ast.Name) and mark.id == "compiled" for mark in node.decorator_list)


def is_protocol(node: ast.ClassDef) -> bool:
    bases = [base.value if isinstance(base, ast.Subscript) else base for base in node.bases]
    return any(isinstance(base, ast.Name) and base.id == "Protocol" for base in bases)
