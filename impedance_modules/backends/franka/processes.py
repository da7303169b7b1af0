# SPDX-License-Identifier: BSD-3-Clause
"""Starts the processes that serve a run: one for each arm, one for each hand."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import impedance_modules

EXIT_TIME = 3.0
"""Longest wait for such a process to end by itself [s]; an arm's takes the torque to zero first."""


def start_process(
    module: str, address: str, options: Sequence[str]
) -> tuple[socket.socket, subprocess.Popen[bytes]]:
    """Starts ``python -m MODULE ADDRESS SOCKET OPTIONS`` in a session of its own: Ctrl-C reaches the run alone.

    Returns:
        Our end of a pair of local sockets that carry whole datagrams and never wait on our side, and the process.
    """
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    # Said of both ends: another library in this process (rospy does) may have set a time-out for all new sockets,
    # and then even MSG_DONTWAIT waits.
    ours.setblocking(False)
    theirs.setblocking(True)
    package = str(Path(impedance_modules.__file__).resolve().parent.parent)
    paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    process = subprocess.Popen(
        [sys.executable, "-m", module, address, str(theirs.fileno()), *options],
        pass_fds=(theirs.fileno(),),
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )
    theirs.close()
    return ours, process


def arrived(channel: socket.socket, longest: int) -> Iterator[bytes]:
    """Yields every message of at most ``longest`` bytes that has arrived; never waits.

    An empty one comes last where the process has ended.
    """
    while True:
        try:
            message = channel.recv(longest, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError:
            message = b""
        yield message
        if not message:
            return


def end_process(process: subprocess.Popen[bytes]) -> None:
    """Waits until a process that was told so has ended; one that does not is killed."""
    try:
        process.wait(EXIT_TIME)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
