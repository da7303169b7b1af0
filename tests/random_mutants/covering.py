# SPDX-License-Identifier: BSD-3-Clause
"""Which tests call which function, and how long each takes: a run of the tests that watches every call.

A function is ``FILE::FUNCTION`` or ``FILE::Class.method``; what is defined inside it counts as itself. What a fixture
calls counts for every test that uses it, and what a test has kept in a cache is thrown away before the next one.
"""

from __future__ import annotations

import functools
import gc
import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest


@dataclass
class Covering:
    """What was seen: test -> its functions, and its time [s]."""

    functions: dict[str, list[str]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def read(self, path: Path) -> None:
        """Takes in the lines that a ``Watcher`` wrote, a test each; only tests that passed cover anything."""
        for line in path.read_text().splitlines():
            seen = json.loads(line)
            if seen["passed"]:
                self.functions[seen["test"]], self.seconds[seen["test"]] = seen["functions"], seen["seconds"]

    def tests_of(self, file: str, function: str) -> list[str]:
        """Tests that call a function, the fastest first; for text outside functions those that call any of its file."""
        wanted = f"{file}::{function}"
        return sorted(
            (
                test
                for test, called in self.functions.items()
                if (wanted in called if function else any(one.startswith(f"{file}::") for one in called))
            ),
            key=lambda test: (self.seconds[test], test),
        )


class Watcher:
    """A plugin of pytest that writes a line for every test as soon as it is over."""

    def __init__(self, root: Path, watched: tuple[str, ...], lines: Path) -> None:
        self._root, self._watched, self.lines = f"{root}/", watched, lines
        self._names: dict[CodeType, str | None] = {}
        self._called: set[str] = set()
        self._by_fixture: dict[str, set[str]] = defaultdict(set)
        self._passed: set[str] = set()

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Watches a test with its own fixtures."""
        _forget_what_is_kept()
        began = time.perf_counter()
        with self._watching(set()) as called:
            yield
        for fixture in getattr(item, "fixturenames", ()):
            called |= self._by_fixture[fixture]
        seconds = round(time.perf_counter() - began, 4)
        passed = item.nodeid in self._passed
        seen = {"test": item.nodeid, "seconds": seconds, "passed": passed, "functions": sorted(called)}
        with self.lines.open("a") as lines:
            lines.write(json.dumps(seen) + "\n")

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Is told how a test ended: one that was skipped, or failed, shows nothing."""
        if report.when == "call" and report.passed:
            self._passed.add(report.nodeid)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        """Watches a fixture, which many tests may share."""
        before = set(self._called)
        yield
        self._by_fixture[fixturedef.argname] |= self._called - before

    @contextmanager
    def _watching(self, called: set[str]) -> Iterator[set[str]]:
        self._called = called
        before = sys.gettrace()
        sys.settrace(self._see)
        try:
            yield called
        finally:
            sys.settrace(before)

    def _see(self, frame: FrameType, _event: str, _argument: object) -> None:
        """Is told of every call; lines inside are not watched."""
        code = frame.f_code
        name = self._names.get(code, "")
        if name == "":
            name = self._names[code] = self._name(code)
        if name is not None:
            self._called.add(name)

    def _name(self, code: CodeType) -> str | None:
        file = code.co_filename.removeprefix(self._root)
        if not file.startswith(self._watched):
            return None
        return f"{file}::{code.co_qualname.partition('.<locals>')[0]}"


def _forget_what_is_kept() -> None:
    """Empties the caches of the tests' own functions."""
    for kept in gc.get_objects():
        if isinstance(kept, functools._lru_cache_wrapper) and kept.__module__.startswith("tests."):
            kept.cache_clear()
