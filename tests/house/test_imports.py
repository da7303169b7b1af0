# SPDX-License-Identifier: BSD-3-Clause
"""Imports point one way, and third-party names stay in their packages (docs/architecture.md)."""

import ast
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.support.paths import CHECKOUT

PACKAGE = CHECKOUT / "impedance_modules"

ORDER = (
    "errors", "extras installed input_files strict_json plain_figures worker_processes compiled records machine_code",
    "spec", "robot",
    "effects modules", "superposition export", "new_robot safety plant episode", "backends", "control",
    "prediction streaming", "runs", "tools diagnosis", "api", "cli",
)  # fmt: skip
RANK = {name: rank for rank, names in enumerate(ORDER) for name in names.split()}

COMPILATION = {"compiled", "records", "machine_code"}
"""One concept in three files, two of which can be imported without the compiler: they may know each other."""

NOT_FOR_DIAGNOSIS = ("backends", "control", "prediction", "runs")
"""Diagnosis works from episodes alone."""

STEPS = (
    "data", "gap_result", "rollout_result", "result", "residuals", "regression", "model_selection", "rollout",
    "report experiment_design", "diagnose", "text_logs", "known_effects", "compared_recordings",
)  # fmt: skip
STAGES = {name: step for step, names in enumerate(STEPS) for name in names.split()}
"""Folders and files of diagnosis/ in the order in which a recording goes through them."""

ALLOWED_IN = {
    "pinocchio": {"robot", "plant", "effects"}, "pink": {"robot"}, "coal": {"robot", "plant"}, "rospy": {"backends"},
    "mujoco": {"backends"},
    "pylibfranka": {"backends"}, "rclpy": {"backends"},
    "daqp": {"safety"}, "proxsuite": {"safety"}, "qpsolvers": {"safety"}, "click": {"cli"},
    "rerun": {"episode"}, "pyarrow": {"episode"}, "jsonschema": {"spec"}, "yaml": {"spec"}, "zmq": {"streaming"},
    "distributed": {"worker_processes"}, "dask": {"worker_processes"},
}  # fmt: skip

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


def imported_below(path: Path, *top: str) -> Iterator[tuple[str, str]]:
    """Yields what a file imports from a package: the whole name, and its first part below the package."""
    for name in imported_names(path):
        parts = tuple(name.split("."))
        if parts[: len(top)] == top and len(parts) > len(top):
            yield name, parts[len(top)]


def part_of(path: Path, folder: Path) -> str:
    """Returns the first folder (or file stem) of a path below a folder."""
    relative = path.relative_to(folder)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def package_of(path: Path) -> str:
    return "impedance_experiments" if EXPERIMENTS in path.parents else part_of(path, PACKAGE)


def each(files: list[Path]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("path", files, ids=lambda path: str(path.relative_to(CHECKOUT)))


@each(FILES)
def test_imports_point_downwards(path: Path) -> None:
    own = package_of(path)
    for name, other in imported_below(path, "impedance_modules"):
        free = own in ("__init__", "__main__", "impedance_experiments") or {own, other} <= COMPILATION
        if other in RANK and other != own and not free:
            assert RANK[other] < RANK[own], f"{path}: {own} must not import {name}"
            assert own != "diagnosis" or other not in NOT_FOR_DIAGNOSIS, f"{path}: {name}"


@each(sorted((PACKAGE / "diagnosis").rglob("*.py")))
def test_a_diagnosis_flows_one_way(path: Path) -> None:
    own = part_of(path, PACKAGE / "diagnosis")
    for name, other in imported_below(path, "impedance_modules", "diagnosis"):
        if own not in ("__init__", other):
            assert STAGES[other] < STAGES[own], f"{path}: {own} must not import {name}"


@each(FILES)
def test_third_party_names_stay_in_their_packages(path: Path) -> None:
    own = package_of(path)
    for name in imported_names(path):
        top = name.split(".")[0]
        if top in ALLOWED_IN:
            assert own in ALLOWED_IN[top], f"{path}: {top} belongs in {sorted(ALLOWED_IN[top])}"
        if top == "numba":
            assert path.name == "machine_code.py", f"{path}: numba belongs in machine_code.py"


def test_every_package_has_a_rank() -> None:
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir()}
    assert folders - {"__pycache__", "data"} <= set(RANK)


def test_no_assert_outside_tests() -> None:
    for path in FILES:
        found = [n.lineno for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Assert)]
        assert not found, f"{path}: assert at lines {found}"


def literals(path: Path) -> Iterator[tuple[int, str]]:
    """Yields lines and values of all strings of a file that are no documentation."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    documentation = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
            yield node.lineno, node.value


def _robot_words() -> set[str]:
    """Returns every joint, link and limb name of the shipped robots."""
    words: set[str] = set()
    for urdf in (PACKAGE.parent / "robots").rglob("*.urdf"):
        root = ElementTree.parse(urdf).getroot()
        words |= {str(part.get("name")) for kind in ("joint", "link") for part in root.iter(kind)}
        words.add(urdf.stem)
    # Words that are ordinary English outside a robot.
    return (words | {"right", "left", "s0", "s1", "e0", "e1", "w0", "w1", "w2"}) - {
        "base",
        "head",
        "world",
        "mount",
    }


def test_the_package_knows_no_robot() -> None:
    words = _robot_words()
    for path in FILES:
        if ADAPTER in path.parents:
            continue  # one robot's topics, and what is known of it
        # Tables and plots align things left and right; an effect's symbols are the field's, not a robot's.
        alignment, symbols = {"cli", "episode", "diagnosis"}, {"effects", "diagnosis"}
        allowed = {"left", "right"} if package_of(path) in alignment | symbols else set()
        allowed |= {"baxter"} if package_of(path) == "cli" else set()
        allowed |= {"s0"} if package_of(path) in symbols else set()
        for line, value in literals(path):
            assert value not in words - allowed, f"{path}:{line}: names '{value}' of a robot"
