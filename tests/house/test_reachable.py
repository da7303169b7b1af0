# SPDX-License-Identifier: BSD-3-Clause
"""Nothing in the package is there for tests alone: every module and every name is reached from what people call."""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

from tests.house.test_imports import EXPERIMENTS, FILES, PACKAGE, imported_names, literals
from tests.support.paths import CHECKOUT

ENTRIES = (
    *("impedance_modules.cli.main", "impedance_modules.__main__"),
    *("impedance_modules.streaming.policy", "impedance_modules.streaming.sender"),
)
"""What a person calls, the last two from Python (docs/live-set-points.md).

Verbs are imported by the names in ``cli.main.VERBS``, experiments by those in their list.
"""

REGISTERED = (
    *("impedance_modules/machine_code.py", "impedance_modules/cli/"),
    "impedance_modules/robot/elbow_task.py",
    *("baxter/ros/socket_transport.py", "baxter/ros/tcp_connection.py"),
)
"""Files whose functions are called through a table: numba's decorators, click's verbs, pink's tasks, ROS's XML-RPC."""

REASONS = {
    "write_episode": "Python API: writes an episode from columns (docs/import.md)",
    "imbalance": "Python API: the plant's energy balance (docs/plant.md)",
    "PolicySource": "Python API: set-points from a function (docs/live-set-points.md)",
    "motor_work": "Python API: work at the plant's motors (docs/plant.md)",
}
"""Names that no command reaches, each with its reason."""

BY_NAME = re.compile(r"^[a-z_]+(\.[a-z_]+)*$")
"""A string that could be the name of a module."""


def module_of(path: Path) -> str:
    """Dotted name of a file; a package's ``__init__`` is the package."""
    parts = list(path.relative_to(CHECKOUT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, Path]:
    return {module_of(path): path for path in FILES}


def next_of(module: str) -> set[str]:
    """Modules that one imports, at any depth, or names in a string, as tables of verbs and experiments do."""
    path = modules()[module]
    named = set(imported_names(path))
    parent = module if path.name == "__init__.py" else module.rsplit(".", 1)[0]
    for text in (text for _, text in literals(path) if BY_NAME.match(text)):
        named |= {text, f"{parent}.{text}", f"impedance_modules.{text}"}
    packages = {name.rsplit(".", k)[0] for name in named for k in range(1, name.count(".") + 1)}
    return {name for name in named | packages if name in modules()}


def test_every_module_is_reached_from_the_command_line() -> None:
    reached, waiting = set(), list(ENTRIES)
    while waiting:
        module = waiting.pop()
        if module not in reached:
            reached.add(module)
            waiting += next_of(module)
    alone = sorted(set(modules()) - reached)
    assert not alone, "reached by tests alone, or by nobody: " + " ".join(alone)


def definitions(path: Path) -> list[str]:
    """Names that a file defines at its top, and the methods of its classes."""
    found = []
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.append(node.name)
        if isinstance(node, ast.ClassDef):
            found += [part.name for part in node.body if isinstance(part, ast.FunctionDef)]
    return found


CALLED_BY_OTHERS = re.compile(r"^(__\w+__|visit_\w+|do_\w+|rpc_\w+|publisherUpdate|[a-z]+[A-Z]\w*)$")
"""Names that a library calls: Python's own, a syntax tree's, an HTTP server's, ROS's XML-RPC (camel case)."""


def test_every_function_is_named_somewhere_else_in_the_package() -> None:
    words = Counter(word for path in FILES for word in re.findall(r"\w+", path.read_text()))
    own = Counter(name for path in FILES for name in definitions(path))
    where = {name: path for path in FILES for name in definitions(path)}
    unnamed = [
        f"{where[name].relative_to(CHECKOUT)}: {name}"
        for name, count in own.items()
        if words[name] <= count and not CALLED_BY_OTHERS.match(name) and name not in REASONS
        if not any(part in str(where[name]) for part in REGISTERED)
    ]
    assert not unnamed, "named nowhere but where it is defined:\n" + "\n".join(sorted(unnamed))


def test_file_stems_and_class_names_have_one_meaning() -> None:
    stems = Counter(path.stem for path in FILES if path.stem not in ("__init__", "__main__"))
    assert not [stem for stem, count in stems.items() if count > 1]
    bodies = [ast.parse(path.read_text()).body for path in FILES]
    classes = Counter(node.name for body in bodies for node in body if isinstance(node, ast.ClassDef))
    assert not [name for name, count in classes.items() if count > 1 and not name.startswith("_")]


def test_the_entries_are_files() -> None:
    assert set(ENTRIES) <= set(modules())
    assert PACKAGE.is_dir() and EXPERIMENTS.is_dir()
