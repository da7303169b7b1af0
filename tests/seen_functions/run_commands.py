# SPDX-License-Identifier: BSD-3-Clause
"""Runs the commands of ``commands.py`` in this process, the simulated Baxter in a process of its own."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from unittest.mock import patch

import click

from impedance_modules.backends.baxter.ros.messages import String
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.simulator.simulator_node import FAULT_TOPIC
from impedance_modules.cli.main import impedance, main
from impedance_modules.episode.run_folder import PART_PATTERN
from tests.seen_functions.commands import CTRL_C, SECTIONS, Command, Section
from tests.seen_functions.inputs import write_tasks
from tests.seen_functions.instrument import Calls
from tests.support.baxter_process import ATTEMPTS, BUSY, favour
from tests.support.own_ros_master import own_ros_master

STARTING = 60.0
"""Longest time until a simulated Baxter stands, or a run records [s]."""
SETTLING = 1.5
"""From a simulated Baxter's first word until all its messages come [s]."""
HEARING = 0.3
"""Until a new publisher is connected [s]."""
CRASHED = 1
"""Exit code where an exception came out of the command line."""
LAST_LINES = 12
"""Of what a command said that ended otherwise than it should."""


def run_sections(only: str, calls: Calls) -> list[str]:
    """Runs all sections whose name contains a text; lists what went wrong."""
    problems: list[str] = []
    with calls.ignored():
        write_tasks()
    with own_ros_master():
        for section in SECTIONS:
            if only in section.name:
                problems += run_section(section, calls)
    return problems


def run_section(section: Section, calls: Calls) -> list[str]:
    problems = []
    print(f"-- {section.name}", flush=True)
    with calls.ignored():
        section.prepare()
    with ExitStack() as stack:
        if section.robot:
            stack.enter_context(simulated_baxter(section.robot, calls))
        for command in section.commands:
            began = time.monotonic()
            code, said = outcome(command, calls, real_time=bool(section.robot))
            print(f"exit {code} {time.monotonic() - began:6.1f} s: impedance {command.words}", flush=True)
            if not is_right(command, code, said):
                expected = " or ".join(map(str, command.exits)) + f" and '{command.says}'" * bool(
                    command.says
                )
                end = "\n    ".join(["", *said.splitlines()[-LAST_LINES:]])
                problems.append(f"exit {code} instead of {expected}: impedance {command.words}{end}")
    return problems


def outcome(command: Command, calls: Calls, *, real_time: bool) -> tuple[int, str]:
    """Runs one command: its exit code, and all that it printed; again where a busy machine has ended it."""
    attempt = 0
    while True:
        attempt += 1
        said = StringIO()
        with redirect_stdout(said), redirect_stderr(said), meanwhile(command, calls):
            code = exit_of(shlex.split(command.words.format(attempt=attempt)))
        text = said.getvalue()
        busy = real_time and BUSY.search(re.sub(r"\s+", " ", text))
        if is_right(command, code, text) or not busy or attempt == ATTEMPTS:
            return code, text


def is_right(command: Command, code: int, said: str) -> bool:
    return code in command.exits and command.says in said


def exit_of(words: list[str]) -> int:
    """Runs the command line in this process."""
    with patch.object(sys, "argv", ["impedance", *words]):
        try:
            main()
        except SystemExit as ended:
            return ended.code if isinstance(ended.code, int) else CRASHED
        except Exception:  # noqa: BLE001 - a crash is one more way to end otherwise than stated
            traceback.print_exc()
    return CRASHED


@contextmanager
def meanwhile(command: Command, calls: Calls) -> Iterator[None]:
    """Lets something happen to a command as soon as the first part of its recording is there."""
    ended = threading.Event()

    def act() -> None:
        limit = time.monotonic() + STARTING
        while not list(Path().glob(f"{command.recorded_in}/{PART_PATTERN}")):
            if ended.wait(0.05) or time.monotonic() > limit:
                return
        if command.meanwhile == CTRL_C:
            os.kill(os.getpid(), signal.SIGINT)
        else:
            inject_fault(command.meanwhile)

    thread = threading.Thread(target=act, daemon=True)
    if command.meanwhile:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        if command.meanwhile:
            thread.join()


def inject_fault(words: str) -> None:
    """Tells the simulated Baxter of a fault."""
    node = SocketTransport("/seen_functions", os.environ["ROS_MASTER_URI"])
    faults = node.advertise(FAULT_TOPIC, String)
    time.sleep(HEARING)
    faults.send(String(words))
    time.sleep(HEARING)
    node.close()


@contextmanager
def simulated_baxter(options: str, calls: Calls) -> Iterator[None]:
    """Runs ``impedance baxter fake`` in a process of its own, which keeps real time, and takes its calls."""
    record = Path("calls.json").absolute()
    words = [sys.executable, "-m", "tests.seen_functions", "--record", str(record), "baxter", "fake"]
    process = subprocess.Popen([*words, *shlex.split(options)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    favour(process.pid, most=True)
    favour(os.getpid())
    try:
        said = process.stdout.readline()
        if "Ctrl-C ends it" not in said:
            raise AssertionError(f"impedance baxter fake {options}: {said}{process.stdout.read()}")
        time.sleep(SETTLING)
        yield
    finally:
        process.send_signal(signal.SIGINT)
        print(f"   fake {options}: {' | '.join(process.stdout.read().splitlines())}")
        process.wait(STARTING)
    calls.take(record)


def options_not_given() -> list[str]:
    """Options of the command line that no command of any section gives."""
    given = {tuple(shlex.split(command.words)) for section in SECTIONS for command in section.commands}
    given |= {("baxter", "fake", *shlex.split(section.robot)) for section in SECTIONS if section.robot}
    return [
        f"no command gives {' '.join(verb)} {option} (tests/seen_functions/commands.py)"
        for verb, option in all_options()
        if not any(words[: len(verb)] == verb and is_given(option, words) for words in given)
    ]


def is_given(option: str, words: tuple[str, ...]) -> bool:
    return any(word == option or word.startswith(f"{option}=") for word in words)


def all_options() -> Iterator[tuple[tuple[str, ...], str]]:
    """Every verb with each of its options."""
    waiting: list[tuple[tuple[str, ...], click.Command]] = [((), impedance)]
    while waiting:
        verb, command = waiting.pop()
        if isinstance(command, click.Group):
            context = click.Context(command)
            found = [(name, command.get_command(context, name)) for name in command.list_commands(context)]
            waiting += [((*verb, name), member) for name, member in found if member is not None]
        for parameter in command.params:
            if isinstance(parameter, click.Option) and verb:
                yield verb, parameter.opts[0]
