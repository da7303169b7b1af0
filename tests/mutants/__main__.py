# SPDX-License-Identifier: BSD-3-Clause
"""Checks that the tests notice a wrong law: changes one term of the package at a time and runs its tests.

Run: ``python -m tests.mutants [--only AREA ...] [--jobs N] [--match TEXT]``. Exit 1 if any mutant survives.

An area is a file ``tests/mutants/<area>.py`` with two names:

- ``MUTANTS``: tuples (file, old text, new text); ``file`` from the checkout's root, ``old text`` stands in it
  exactly once;
- ``TESTS``: file -> the test files that must fail when that file is changed, the fastest first.

Tests run on a copy of the checkout, with laws as plain Python: no compile time, and no kept machine code of a mutant.
An area with ``MACHINE_CODE = True`` runs them as machine code as well.
"""

from __future__ import annotations

import argparse
import importlib
import os
import queue
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from tests.support.paths import CHECKOUT

COPIED = (
    "impedance_modules", "impedance_experiments", "tests", "robots", "tasks", "schemas", "benchmarks", "docs",
    "pyproject.toml",
)  # fmt: skip
PATIENCE = 600.0
"""A mutant whose tests take longer than this is killed: it made something endless [s]."""


class Mutant(NamedTuple):
    """One change, the tests that must notice it, and whether they need machine code."""

    area: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    machine_code: bool


def areas() -> list[str]:
    """Names of all areas."""
    files = Path(__file__).parent.glob("*.py")
    return sorted(file.stem for file in files if not file.stem.startswith(("_", "test_")))


def mutants_of(area: str) -> list[Mutant]:
    """Reads one area's list."""
    module = importlib.import_module(f"tests.mutants.{area}")
    machine_code = getattr(module, "MACHINE_CODE", False)
    return [
        Mutant(area, file, old, new, tuple(module.TESTS[file]), machine_code)
        for file, old, new in module.MUTANTS
    ]


def mutated(mutant: Mutant) -> str:
    """The text of the changed file.

    Raises:
        ValueError: The old text does not stand in the file exactly once, or the change is none.
    """
    text = (CHECKOUT / mutant.file).read_text()
    if text.count(mutant.old) != 1 or mutant.old == mutant.new:
        raise ValueError(f"{mutant.file}: stands in it {text.count(mutant.old)} times: {mutant.old!r}")
    return text.replace(mutant.old, mutant.new)


def copy_checkout(to: Path) -> None:
    """Copies what tests need."""
    for name in COPIED:
        source = CHECKOUT / name
        if source.is_dir():
            shutil.copytree(source, to / name, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.exists():
            shutil.copy(source, to / name)


def run_tests(folder: Path, tests: tuple[str, ...], *, machine_code: bool) -> tuple[bool, str]:
    """Runs test files in a copy; returns whether all passed, and the last line that names a failure."""
    environment = os.environ | {
        "PYTHONPATH": str(folder),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "NUMBA_CACHE_DIR": str(folder / "kept"),
        "LAWS_RUN_AS": "python,machine code" if machine_code else "python",
        "NUMBA_DISABLE_JIT": "0" if machine_code else "1",
    }
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False, f"more than {PATIENCE:g} s"
    lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if done.returncode not in (0, 1, 2):
        raise RuntimeError(f"pytest ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.returncode == 0, lines[-1][:150] if lines else ""


@contextmanager
def applied(mutant: Mutant, folder: Path) -> Iterator[None]:
    """Changes the file of a copy for a while."""
    file = folder / mutant.file
    before = file.read_text()
    file.write_text(mutated(mutant))
    try:
        yield
    finally:
        file.write_text(before)


def survives(mutant: Mutant, folders: queue.Queue[Path]) -> bool:
    """Runs one mutant in a free copy; prints and returns whether it survived."""
    folder = folders.get()
    try:
        with applied(mutant, folder):
            passed, failure = run_tests(folder, mutant.tests, machine_code=mutant.machine_code)
    finally:
        folders.put(folder)
    change = f"{mutant.file}: {mutant.old.strip()!r} -> {mutant.new.strip()!r}"
    print(f"{'SURVIVED' if passed else 'killed  '}  {change}\n            {failure}", flush=True)
    return passed


def main() -> int:
    """Runs all mutants of the areas asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=areas(), default=areas(), metavar="AREA")
    parser.add_argument("--match", default="", help="only mutants whose file or text contains this")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    chosen = [m for area in options.only for m in mutants_of(area) if options.match in f"{m.file} {m.old}"]
    for mutant in chosen:
        mutated(mutant)
    with tempfile.TemporaryDirectory() as top:
        folders: queue.Queue[Path] = queue.Queue()
        for job in range(options.jobs):
            folder = Path(top) / str(job)
            copy_checkout(folder)
            folders.put(folder)
        for tests, machine_code in sorted({(m.tests, m.machine_code) for m in chosen}):
            passed, failure = run_tests(Path(top) / "0", tests, machine_code=machine_code)
            if not passed:
                print(f"without any change these fail: {' '.join(tests)}\n{failure}")
                return 1
        with ThreadPoolExecutor(options.jobs) as pool:
            survivors = sum(pool.map(lambda mutant: survives(mutant, folders), chosen))
    print(f"{len(chosen)} mutants, {survivors} survived")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
