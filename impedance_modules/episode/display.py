# SPDX-License-Identifier: BSD-3-Clause
"""Opens rerun's window: on a finished recording, or following a run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import rerun as rr

from impedance_modules.episode.rerun_writer import new_stream
from impedance_modules.errors import BadInput

DISPLAYS: tuple[str, ...] = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
TIME_TO_FAIL = 3.0
"""How long a viewer may take to find that it cannot open a window [s]."""


def require_display(what: str) -> None:
    """Makes sure that a window can open.

    Args:
        what: Would be shown, for the message.

    Raises:
        BadInput: This machine has no display.
    """
    if sys.platform == "linux" and not any(os.environ.get(name) for name in DISPLAYS):
        raise _no_window(what, "this machine has no display")


def open_viewer(recording: Path) -> None:
    """Starts the rerun viewer on a file and leaves it open.

    Raises:
        BadInput: There is no display, or the viewer ended at once.
    """
    require_display(str(recording))
    command = [sys.executable, "-m", "rerun", str(recording)]
    viewer = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )
    try:
        _, said = viewer.communicate(timeout=TIME_TO_FAIL)
    except subprocess.TimeoutExpired:
        return
    if viewer.returncode:
        raise _no_window(str(recording), _reason(said))


def open_live_stream(name: str) -> rr.RecordingStream:
    """Opens a viewer window and a stream into it; closing the window later harms nothing.

    Args:
        name: Of the recording.

    Raises:
        BadInput: There is no display.
    """
    require_display(name)
    stream = new_stream(name)
    rr.spawn(hide_welcome_screen=True, recording=stream)
    return stream


def _no_window(what: str, reason: str) -> BadInput:
    return BadInput(
        f"{what}: the viewer could not open: {reason} (valid: a machine with a display;"
        " or 'rerun --serve-web RECORDING' and a browser)"
    )


def _reason(said: bytes) -> str:
    """Returns the line that tells most of what the viewer said before it ended."""
    lines = [line.strip() for line in said.decode(errors="replace").splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower()]
    return (telling or lines or ["it gave no reason"])[0]
