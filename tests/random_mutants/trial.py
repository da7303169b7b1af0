# SPDX-License-Identifier: BSD-3-Clause
"""Runs chosen tests in a copy of the checkout, in a process of their own: a fork of this one with its libraries."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.mutants.__main__ import enter

LIBRARIES = (
    "numpy", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.stats", "pinocchio", "coal", "yaml", "hypothesis",
    "pytest", "jsonschema", "click", "pyarrow", "pyarrow.parquet", "matplotlib",
)  # fmt: skip
"""Loaded once, before the forks."""

PASSED, NO_TESTS = 0, 5
"""Exit codes of pytest."""


@dataclass(frozen=True)
class Verdict:
    """How a trial ended: ``killed``, ``timed out`` or ``survived``, and the test that noticed."""

    outcome: str
    by: str


def load_libraries() -> None:
    """Loads what all trials need."""
    for library in LIBRARIES:
        importlib.import_module(library)


def as_child(folder: Path, work: Callable[[], int], patience: float, *, machine_code: bool) -> int | None:
    """Does something in a copy of the checkout; returns its exit code, or None if it took too long.

    Args:
        folder: The copy; ``output.txt`` in it takes what is printed.
        work: Is called in a fork of this process.
        patience: Longest time for it [s].
        machine_code: Whether laws run as machine code, kept in the copy, or as plain Python.
    """
    process = os.fork()
    if process == 0:
        status = 99
        try:
            os.setsid()
            signal.setitimer(signal.ITIMER_REAL, patience)
            output = os.open(folder / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(output, 1)
            os.dup2(output, 2)
            enter(folder, machine_code=machine_code)
            if machine_code:
                os.environ["LAWS_RUN_AS"] = "machine code"
            refuse_other_packages(folder)
            status = work()
        finally:
            sys.stdout.flush()
            os._exit(status)
    status = os.waitpid(process, 0)[1]
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM:
        return None
    return os.waitstatus_to_exitcode(status)


def refuse_other_packages(folder: Path) -> None:
    """Makes sure that the copy's package is the one that would be imported.

    Raises:
        RuntimeError: It is another one, e.g. the installed one.
    """
    found = importlib.util.find_spec("impedance_modules")
    if found is None or not str(found.origin).startswith(f"{folder}/"):
        raise RuntimeError(
            f"impedance_modules would be imported from {found and found.origin}, not from {folder}"
        )


def run_pytest(arguments: Sequence[str], *plugins: Any) -> int:
    """Runs pytest with the same random examples every time; a failing example is not made smaller."""
    import hypothesis
    import pytest

    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
    slow = (hypothesis.HealthCheck.too_slow, hypothesis.HealthCheck.data_too_large)
    hypothesis.settings.register_profile(
        "mutants", phases=phases, database=None, deadline=None, suppress_health_check=slow
    )
    hypothesis.settings.load_profile("mutants")
    fixed = ("-q", "-p", "no:cacheprovider", "--tb=no", "--hypothesis-seed=0")
    return int(pytest.main([*fixed, *arguments], plugins=list(plugins)))


class FirstFailure:
    """A plugin of pytest that writes down which test failed first."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Is told of every test."""
        if report.failed and not self._path.exists():
            self._path.write_text(json.dumps(report.nodeid))

    def pytest_collectreport(self, report: Any) -> None:
        """Is told of every file; one that cannot be imported has noticed as well."""
        self.pytest_runtest_logreport(report)


def trial(folder: Path, tests: Sequence[str], patience: float, *, machine_code: bool) -> Verdict:
    """Runs tests one after the other until one fails."""
    first = folder / "first-failure.json"
    first.unlink(missing_ok=True)
    code = as_child(
        folder,
        lambda: run_pytest(["-x", *tests], FirstFailure(first)),
        patience,
        machine_code=machine_code,
    )
    if code is None:
        return Verdict("timed out", "")
    if code == PASSED:
        return Verdict("survived", "")
    by = json.loads(first.read_text()) if first.exists() else f"exit code {code}"
    return Verdict("killed", by)
