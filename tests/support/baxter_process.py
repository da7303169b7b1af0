# SPDX-License-Identifier: BSD-3-Clause
"""Runs the simulated Baxter in a process of its own, injects faults, reads its event log; runs ``impedance`` verbs."""

from __future__ import annotations

import functools
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

from impedance_modules.backends.baxter.ros.messages import String
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.simulator.simulator_node import FAULT_TOPIC
from tests.support.ros_master import until

START = 90.0
IMPEDANCE = [sys.executable, "-m", "impedance_modules"]

BUSY = re.compile(
    "no state|controller was silent|late cycles|tank starved|overspeed|no fresh state|come at|silent for"
)
"""Reasons by which a run ends on a machine that is too slow: correct, but not what a test is about."""

ATTEMPTS = 4

Test = TypeVar("Test", bound=Callable[..., None])


class MachineBusyError(AssertionError):
    """The machine's load ended a run before the test's own event could."""


def again_when_busy(test: Test) -> Test:
    """Repeats a test, in a folder of its own, when the machine's load ended the run."""

    @functools.wraps(test)
    def repeated(*, tmp_path: Path, **given: Any) -> None:
        for attempt in range(ATTEMPTS):
            folder = tmp_path / f"attempt-{attempt}"
            folder.mkdir()
            try:
                test(tmp_path=folder, **given)
            except MachineBusyError:
                if attempt + 1 == ATTEMPTS:
                    raise
            else:
                return

    return cast(Test, repeated)


def ended(process: subprocess.Popen[str], reason: str) -> tuple[int, str]:
    """Waits for the end of a run: its exit code and what it said, on one line.

    Raises:
        MachineBusyError: It ended because of the machine's load, not for the expected reason.
    """
    text, _ = process.communicate(timeout=60)
    said = re.sub(r"\s+", " ", text)
    if reason not in said and BUSY.search(said):
        raise MachineBusyError(said)
    return process.returncode, said


def favour(pid: int, *, most: bool = False) -> None:
    """Raises a process's priority where the system allows it, so that a busy machine does not fail the test.

    Real-time priority (``most``) only for one that leaves its core some time: Linux suspends others for 50 ms.
    """
    try:
        if most:
            os.sched_setscheduler(pid, os.SCHED_RR, os.sched_param(1))
        Path(f"/proc/{pid}/autogroup").write_text("-15\n")
        os.setpriority(os.PRIO_PROCESS, pid, -15)
    except OSError:
        return


def start(*words: str, most: bool = False, errors: int = subprocess.STDOUT) -> subprocess.Popen[str]:
    """Starts a verb, with real-time priority for ``most``; ``end`` ends it."""
    command, pipes = [*IMPEDANCE, *words], {"stdout": subprocess.PIPE, "stderr": errors}
    process = subprocess.Popen(command, **pipes, text=True, start_new_session=True)
    favour(process.pid, most=most)
    return process


def impedance(*arguments: str, seconds: float = 60.0) -> subprocess.CompletedProcess[str]:
    """Runs a verb to its end."""
    process = start(*arguments, errors=subprocess.PIPE)
    try:
        out, err = process.communicate(timeout=seconds)
    finally:
        process.kill()
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)


class SimulatorProcess:
    """One ``impedance baxter fake``."""

    def __init__(self, process: subprocess.Popen[str], log: Path, node: SocketTransport) -> None:
        self.process, self._log, self._node = process, log, node
        self._faults = node.advertise(FAULT_TOPIC, String)
        self.said: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def fault(self, words: str) -> None:
        """Injects a fault now."""
        assert until(lambda: self._faults.connections() > 0, 5.0)
        self._faults.send(String(words))

    def lines(self) -> list[dict[str, Any]]:
        """Everything in the log so far; its last line may be incomplete."""
        text = self._log.read_text()
        return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]

    def wait_for(self, event: str, seconds: float = 10.0) -> dict[str, Any]:
        """Waits for the first event that contains a text."""
        found: list[dict[str, Any]] = []

        def happened() -> bool:
            found[:] = [line for line in self.lines() if event in line["event"]]
            return bool(found)

        assert until(happened, seconds), f"no '{event}'; {self.said}"
        return found[0]

    def seconds_of_torque(self) -> float:
        """For how long the right arm's torques have come, as far as the log tells [s].

        Not a count of commands: a run tries torque mode, then holds in position mode until it is prepared.
        """
        lines = itertools.takewhile(lambda line: line["modes"]["right"] == "TORQUE", reversed(self.lines()))
        times = [line["last_torque"]["right"] for line in lines]
        return times[0] - times[-1] if times else 0.0

    def last(self) -> dict[str, Any]:
        """Waits for the log's next line of a second and returns it: what happened before is in it."""
        count = len(self.lines())
        assert until(lambda: len(self.lines()) > count + 1, 10.0), self.said
        return self.lines()[-1]

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said.append(line.rstrip())


@contextmanager
def simulator(folder: Path, master: str, *options: str) -> Iterator[SimulatorProcess]:
    """Starts a simulated Baxter and ends it."""
    log = folder / "log.jsonl"
    process = start("baxter", "fake", "--log", str(log), *options, most=True)
    node = SocketTransport(f"/test_{os.getpid()}_{time.monotonic_ns()}", master)
    try:
        found = SimulatorProcess(process, log, node)
        assert until(lambda: any("Ctrl-C ends it" in line for line in found.said), START), found.said
        assert until(lambda: log.exists() and found.lines() != [], 10.0), found.said
        yield found
    finally:
        node.close()
        end(process)


def end(process: subprocess.Popen[str]) -> None:
    """Ends a process by SIGINT, or by SIGKILL."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(15)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(5)
