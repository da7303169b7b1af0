# SPDX-License-Identifier: BSD-3-Clause
"""Which functions of the package do the commands call? Runs every verb once and lists those that were not seen.

Run: ``python -m tests.seen_functions``. Prints each unseen function under the reason that ``REASONS`` gives for its
file; a function of a file without a reason is printed last, and the exit is 1. Laws run as machine code, which no
profile sees: law tests and mutants are about them. The Baxter's own verbs need a network of nodes: tests/backends.
"""

from __future__ import annotations

import ast
import fnmatch
import sys
import tempfile
import threading
from collections import defaultdict
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from click.testing import CliRunner

from impedance_modules.cli.main import impedance
from tests.support.paths import CHECKOUT

PACKAGE = CHECKOUT / "impedance_modules"

REASONS = {
    "backends/baxter/*": "only with a Baxter or the simulated one over ROS: tests/backends",
    "cli/baxter/*": "only with a Baxter or the simulated one over ROS: tests/backends",
    "machine_code.py": "only when laws are compiled: tests/house/test_compiled.py",
    "compiled.py": "only when laws are compiled: tests/house/test_compiled.py",
    "records.py": "only when laws are compiled, or a record is copied: tests/house/test_compiled.py",
    "errors.py": "only where something is wrong",
    "spec/*": "only for keys, mistakes and robots that the shipped tasks do not have: tests/spec",
    "episode/imports/*": "only for other containers and mistakes of foreign logs: tests/episode",
    "episode/*": "only with a viewer, after a crash, or for a bad file: tests/episode",
    "effects/*": "only where that effect is applied or searched: tests/effects",
    "diagnosis/*": "only for other recordings than the one diagnosed: tests/diagnosis",
    "plant/*": "only for surfaces, joints or modes that the tasks run do not have, and ground truth: tests/plant",
    "safety/*": "only in stops, or with another solver: tests/safety",
    "control/*": "only in stops, gaps, and phases that wait: tests/control",
    "prediction/*": "only for tasks of another kind: tests/prediction",
    "superposition/*": "only for singular or folding arms, and examples: tests/superposition",
    "modules/*": "only for tasks of another kind: tests/modules",
    "robot/*": "only for robots of another kind: tests/robot",
    "runs/*": "only with a real robot, playback, or a viewer: tests/runs, tests/backends",
    "tools/*": "only for other questions: tests/tools",
    "cli/*": "only where a table has such a row, or something is wrong: tests/cli",
    "__init__.py": "a version",
    "__main__.py": "python -m impedance_modules",
}
"""Pattern of files -> why the commands do not call some of their functions, and who does; the first one counts."""


class Seen:
    """Remembers the functions of the package that were called, in every thread."""

    def __init__(self) -> None:
        self.places: set[tuple[str, int]] = set()
        self._codes: set[CodeType] = set()

    def __call__(self, frame: FrameType, event: str, _argument: Any) -> None:
        """Takes an event of ``sys.setprofile``."""
        code = frame.f_code
        if event == "call" and code not in self._codes:
            self._codes.add(code)
            if code.co_filename.startswith(str(PACKAGE)):
                self.places.add((code.co_filename, code.co_firstlineno))


def commands(folder: Path) -> list[list[str]]:
    """Every verb at least once, shortly; later ones use what earlier ones wrote."""
    run, swing = str(folder / "run"), str(folder / "swing")
    return [
        ["check", "press-and-slide"],
        ["analyze", "press-and-slide", "--json", str(folder / "analysis.json")],
        ["analyze", "press-and-slide", "--phase", "slide"],
        ["run", "press-and-slide", "--duration", "0.1", "--out", run],
        ["replay", run, "--verify"],
        ["run", "soft-hold", "--duration", "0.4", "--rate", "200", "--out", swing],
        ["diagnose", swing, "--robot", "baxter", "--json", str(folder / "answer.json")],
        ["probe", "--robot", "baxter", "--out", str(folder / "probe")],
        ["map", run],
        ["roughness", run],
        ["import", str(folder / "run" / "episode.parquet"), "--out", str(folder / "imported")],
        ["effects"],
        ["effects", "payload"],
        ["tune", "thesis/elbow-up", "--arm", "right", "--force", "x=10"],
        ["sweep", "soft-hold", "--vary", "safety.tank.initial=2:3:2", "--duration", "0.05", "--jobs", "1"],
        ["reproduce", "--list"],
        ["reproduce", "planar-arms", "--short", "--out", str(folder / "pages")],
    ]


def is_law(node: ast.FunctionDef) -> bool:
    """Whether a function is marked ``@compiled``."""
    return any(isinstance(mark, ast.Name) and mark.id == "compiled" for mark in node.decorator_list)


def functions() -> dict[tuple[str, int], str]:
    """All functions of the package: file and first line -> name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef) and not is_law(node):
                line = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
                found[str(path), line] = node.name
    return found


def main() -> int:
    """Runs the commands and prints what they did not call."""
    seen = Seen()
    threading.setprofile(seen)
    with tempfile.TemporaryDirectory() as folder:
        for words in commands(Path(folder)):
            sys.setprofile(seen)
            result = CliRunner().invoke(impedance, words, standalone_mode=False)
            sys.setprofile(None)
            print(f"exit {result.return_value}: impedance {' '.join(words)}", flush=True)
    unseen: dict[str, list[str]] = defaultdict(list)
    everything = functions()
    for (path, line), name in everything.items():
        if (path, line) not in seen.places:
            file = str(Path(path).relative_to(PACKAGE))
            reason = next((why for pattern, why in REASONS.items() if fnmatch.fnmatch(file, pattern)), "")
            unseen[reason].append(f"{file}: {name}")
    for reason, names in sorted(unseen.items(), key=lambda item: item[0] == ""):
        print(f"\n{reason or 'NO REASON'} ({len(names)})")
        print("\n".join(f"    {name}" for name in names))
    count = sum(map(len, unseen.values()))
    print(f"\n{len(everything)} functions, {len(everything) - count} seen, {count} not")
    return 1 if unseen.get("") else 0


if __name__ == "__main__":
    sys.exit(main())
