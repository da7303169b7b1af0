# SPDX-License-Identifier: BSD-3-Clause
"""Checks that the tests notice a wrong law: changes one term of the package at a time and runs its tests.

Run: ``python -m tests.mutants [--only AREA ...] [--jobs N] [--match TEXT]``. Exit 1 if any mutant survives.

An area is a file ``tests/mutants/<area>.py`` with two names:

- ``MUTANTS``: tuples (file, old text, new text); ``file`` from the checkout's root, ``old text`` stands in it
  exactly once;
- ``TESTS``: file -> the test files that must fail when that file is changed, the fastest first.

Tests run on a copy of the checkout, with laws as plain Python: no compile time, and no kept machine code of a mutant.
An area with ``MACHINE_CODE = True`` runs them as machine code as well. Every mutant has a process of its own, a fork of
this one, which has loaded all libraries but nothing of the checkout.
"""

from __future__ import annotations

import argparse
import importlib
import os
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from tests.support.paths import CHECKOUT

COPIED = (
    "impedance_modules", "impedance_experiments", "tests", "robots", "tasks", "schemas", "benchmarks", "docs",
    "examples", "pyproject.toml",
)  # fmt: skip
LIBRARIES = ("numpy", "scipy.linalg", "scipy.optimize", "pinocchio", "coal", "yaml", "hypothesis", "pytest")
PATIENCE = 600
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


def start_tests(folder: Path, tests: tuple[str, ...], *, machine_code: bool) -> int:
    """Runs test files in a copy, in a process of their own; returns its id."""
    process = os.fork()
    if process:
        return process
    status = 99
    try:
        os.setsid()
        signal.alarm(PATIENCE)
        output = os.open(folder / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        enter(folder, machine_code=machine_code)
        import pytest

        status = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests]))
    finally:
        sys.stdout.flush()
        os._exit(status)


def enter(folder: Path, *, machine_code: bool) -> None:
    """Makes a copy the checkout of this process."""
    os.chdir(folder)
    os.environ |= {
        "PYTHONPATH": str(folder),
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_CACHE_DIR": str(folder / "kept"),
        "LAWS_RUN_AS": "python,machine code" if machine_code else "python",
        "NUMBA_DISABLE_JIT": "0" if machine_code else "1",
    }
    sys.dont_write_bytecode = True
    ours = ("tests", "impedance_modules", "impedance_experiments", "benchmarks")
    for name in [name for name in sys.modules if name.partition(".")[0] in ours]:
        del sys.modules[name]
    sys.path[:] = [str(folder), *(path for path in sys.path if path and Path(path) != CHECKOUT)]
    sys.path_importer_cache.clear()


def failure(folder: Path) -> str:
    """The last line of the output that names a failed test."""
    lines = (folder / "output.txt").read_text(errors="replace").splitlines()
    named = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    return (named or lines or ["no output"])[-1][:150]


def baseline(folder: Path, chosen: list[Mutant]) -> bool:
    """Runs all tests once without any change; returns whether they pass."""
    for tests, machine_code in sorted({(mutant.tests, mutant.machine_code) for mutant in chosen}):
        process = start_tests(folder, tests, machine_code=machine_code)
        if os.waitpid(process, 0)[1] != 0:
            print(f"without any change these fail: {' '.join(tests)}\n{failure(folder)}")
            return False
    return True


def run(chosen: list[Mutant], folders: list[Path]) -> list[Mutant]:
    """Runs one mutant per copy at a time; returns those that survived."""
    waiting, running, survivors = list(reversed(chosen)), {}, []
    while waiting or running:
        while waiting and folders:
            folder, mutant = folders.pop(), waiting.pop()
            (folder / mutant.file).write_text(mutated(mutant))
            process = start_tests(folder, mutant.tests, machine_code=mutant.machine_code)
            running[process] = folder, mutant
        process, status = os.wait()
        folder, mutant = running.pop(process)
        (folder / mutant.file).write_text((CHECKOUT / mutant.file).read_text())
        folders.append(folder)
        survivors += [mutant] if status == 0 else []
        change = f"{mutant.file}: {mutant.old.strip()!r} -> {mutant.new.strip()!r}"
        print(
            f"{'SURVIVED' if status == 0 else 'killed  '}  {change}\n            {failure(folder)}",
            flush=True,
        )
    return survivors


def main() -> int:
    """Runs all mutants of the areas asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=areas(), default=areas(), metavar="AREA")
    parser.add_argument("--match", default="", help="only mutants whose file or text contains this")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    for library in LIBRARIES:
        importlib.import_module(library)
    chosen = [m for area in options.only for m in mutants_of(area) if options.match in f"{m.file} {m.old}"]
    for mutant in chosen:
        mutated(mutant)
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as top:
        folders = [Path(top) / str(job) for job in range(options.jobs)]
        for folder in folders:
            copy_checkout(folder)
        if not baseline(folders[0], chosen):
            return 1
        survivors = run(chosen, folders)
    print(f"{len(chosen)} mutants, {len(survivors)} survived, {time.perf_counter() - begun:.0f} s")
    for mutant in survivors:
        print(f"SURVIVED  {mutant.file}: {mutant.old.strip()!r} -> {mutant.new.strip()!r}")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
