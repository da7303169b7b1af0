# SPDX-License-Identifier: BSD-3-Clause
"""Finds the moments at which the whole machine stood still: a hypervisor took it, and no program on it could run.

Usage: python -m benchmarks.backends.machine_pauses [--seconds 60]     (chrt -f 50 before it where the cores are busy)

A small process on each core sleeps 4 ms at a time and notes when it slept much longer. A pause that all of them had
at once is the machine's; one that only some had is a busy core's.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType

NAP = 0.004
LONG = 0.012
"""A nap is noted when it lasts longer than this [s]."""


@dataclass(frozen=True)
class Pause:
    """A time [s] of the monotonic clock, and how long nothing ran from then on [s]."""

    began: float
    lasted: float


class PauseWatch:
    """Watches all cores that this process may use, while it is entered."""

    def __enter__(self) -> PauseWatch:
        """Starts one watcher per core."""
        self._ends, self._watchers = [], []
        for core in sorted(os.sched_getaffinity(0)):
            end, other = multiprocessing.Pipe()
            watcher = multiprocessing.Process(target=_watch, args=(core, other), daemon=True)
            watcher.start()
            self._ends.append(end)
            self._watchers.append(watcher)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends the watchers."""
        for watcher in self._watchers:
            watcher.kill()
            watcher.join()

    def pauses(self) -> list[Pause]:
        """Returns what all cores slept through together so far."""
        for end in self._ends:
            end.send(None)
        common = [(pause.began, pause.began + pause.lasted) for pause in self._ends[0].recv()]
        for end in self._ends[1:]:
            naps = [(pause.began, pause.began + pause.lasted) for pause in end.recv()]
            common = [
                (max(a, c), min(b, d)) for a, b in common for c, d in naps if min(b, d) - max(a, c) > LONG / 2
            ]
        return [Pause(began, ended - began) for began, ended in common]


def _watch(core: int, end: Connection) -> None:
    os.sched_setaffinity(0, {core})
    noted: list[Pause] = []
    last = time.monotonic()
    while True:
        time.sleep(NAP)
        now = time.monotonic()
        if now - last > LONG:
            noted.append(Pause(last, now - last))
        if end.poll():
            end.recv()
            end.send(noted)
            now = time.monotonic()
        last = now


def describe(pauses: list[Pause], since: float) -> str:
    """Says it in one line, times counted from ``since`` [s]."""
    if not pauses:
        return "the machine itself never stood still"
    longest = max(pauses, key=lambda pause: pause.lasted)
    when = ", ".join(f"{pause.began - since:.1f} s: {1e3 * pause.lasted:.0f} ms" for pause in pauses[-8:])
    return f"the machine itself stood still {len(pauses)} times, {1e3 * longest.lasted:.0f} ms at most (last: {when})"


def main() -> None:
    """Watches and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    with PauseWatch() as watch:
        began = time.monotonic()
        time.sleep(seconds)
        print(describe(watch.pauses(), began))


if __name__ == "__main__":
    main()
