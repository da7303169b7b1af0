# SPDX-License-Identifier: BSD-3-Clause
"""Imports point one way, and third-party names stay in their rooms (docs/architecture.md)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.support.paths import CHECKOUT

PACKAGE = CHECKOUT / "impedance_modules"

RANK = {
    "errors": 0,
    "compiled": 0,
    "records": 0,
    "machine_code": 0,
    "spec": 1,
    "robot": 2,
    "effects": 3,
    "modules": 3,
    "superposition": 4,
    "safety": 5,
    "plant": 5,
    "episode": 5,
    "backends": 6,
    "control": 7,
    "prediction": 8,
    "runs": 9,
    "tools": 10,
    "diagnosis": 10,
    "cli": 11,
}

LAWS = {"compiled", "records", "machine_code"}
"""One thing in three files: ``machine_code`` alone imports a compiler, and the others import it when asked for one."""

NOT_FOR_DIAGNOSIS = ("backends", "control", "prediction", "runs")
"""Diagnosis works from episodes alone."""

ROOMS = {
    "pinocchio": {"robot", "plant", "effects"},
    "coal": {"robot", "plant"},
    "daqp": {"safety"},
    "proxsuite": {"safety"},
    "qpsolvers": {"safety"},
    "rerun": {"episode"},
    "pyarrow": {"episode"},
    "jsonschema": {"spec"},
    "yaml": {"spec"},
    "click": {"cli"},
    "rospy": {"backends"},
}

ADAPTER = PACKAGE / "backends" / "baxter"

EXPERIMENTS = CHECKOUT / "impedance_experiments"
"""The thesis, on top of the package; the command line reaches it by name alone."""

FILES = sorted([*PACKAGE.rglob("*.py"), *EXPERIMENTS.rglob("*.py")])


def imported_names(path: Path) -> Iterator[str]:
    """Yields every module a file imports, at any depth, under TYPE_CHECKING too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                raise AssertionError(f"{path}:{node.lineno}: relative import")
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def package_of(path: Path) -> str:
    """Returns the first folder (or file stem) below the package."""
    if EXPERIMENTS in path.parents:
        return "impedance_experiments"
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(CHECKOUT)))
def test_imports_point_downwards(path: Path) -> None:
    own = package_of(path)
    for name in imported_names(path):
        parts = name.split(".")
        if parts[0] != "impedance_modules" or len(parts) < 2 or parts[1] not in RANK:
            continue
        other = parts[1]
        if own in ("__init__", "__main__", "impedance_experiments") or other == own:
            continue
        assert RANK[other] < RANK[own] or {own, other} <= LAWS, f"{path}: {own} must not import {name}"
        assert (own, other) not in {("diagnosis", upper) for upper in NOT_FOR_DIAGNOSIS}, f"{path}: {name}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(CHECKOUT)))
def test_third_party_names_stay_in_their_rooms(path: Path) -> None:
    own = package_of(path)
    for name in imported_names(path):
        top = name.split(".")[0]
        if top in ROOMS:
            assert own in ROOMS[top], f"{path}: {top} belongs in {sorted(ROOMS[top])}"
        if top == "numba":
            assert path.name == "machine_code.py", f"{path}: numba belongs in machine_code.py"


def test_every_package_has_a_rank() -> None:
    folders = {
        path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name not in {"__pycache__", "data"}
    }
    assert folders <= set(RANK)


def test_no_assert_outside_tests() -> None:
    for path in FILES:
        found = [n.lineno for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Assert)]
        assert not found, f"{path}: assert at lines {found}"


def _docstrings(tree: ast.AST) -> set[int]:
    """Returns the ids of the string nodes that are documentation."""
    found = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            for statement in body:
                if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                    found.add(id(statement.value))
    return found


def _robot_words() -> set[str]:
    """Returns every joint, link and limb name of the shipped robots."""
    words: set[str] = set()
    for urdf in (PACKAGE.parent / "robots").rglob("*.urdf"):
        root = ElementTree.parse(urdf).getroot()
        words |= {str(part.get("name")) for kind in ("joint", "link") for part in root.iter(kind)}
        words.add(urdf.stem)
    # Words that are ordinary English outside a robot.
    return (words | {"right", "left", "s0", "s1", "e0", "e1", "w0", "w1", "w2"}) - {"base", "head", "world"}


def test_the_package_knows_no_robot() -> None:
    words = _robot_words()
    for path in FILES:
        if ADAPTER in path.parents:
            continue  # one robot's topics, and what is known of it
        tree = ast.parse(path.read_text())
        documentation = _docstrings(tree)
        # Tables and plots align things left and right; an effect's symbols are the field's, not a robot's.
        alignment, symbols = {"cli", "episode", "diagnosis"}, {"effects", "diagnosis"}
        allowed = {"left", "right"} if package_of(path) in alignment | symbols else set()
        allowed |= {"baxter"} if package_of(path) == "cli" else set()
        allowed |= {"s0"} if package_of(path) in symbols else set()
        for node in ast.walk(tree):
            if (
                isinstance(node, ast.Constant)
                and isinstance(node.value, str)
                and id(node) not in documentation
            ):
                assert node.value not in words - allowed, (
                    f"{path}:{node.lineno}: names '{node.value}' of a robot"
                )
