# SPDX-License-Identifier: BSD-3-Clause
"""Opens rerun's window, and makes a recording of an episode that has none."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import rerun as rr

from impedance_modules.arrays import Array
from impedance_modules.episode import view_layout
from impedance_modules.episode.columns import FRAME_KINDS, JOINT_KINDS, POSE_COMPONENTS, WRENCH_COMPONENTS
from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.rerun_writer import (
    new_stream,
    open_stream,
    send_curves,
    send_layout,
    time_index,
)
from impedance_modules.episode.run_folder import EPISODE, RECORDING
from impedance_modules.episode.view_layout import columns_layout
from impedance_modules.episode.view_scene import series_colour
from impedance_modules.errors import BadInput, NotRecorded

UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "effort_command": "N.m",
    "effort": "N.m",
    "position_command": "rad",
    "wrench": "N, N.m",
    "pose": "m, quaternion",
    "target": "m, quaternion",
}
ROWS_PER_CHUNK = 10_000
DISPLAYS: tuple[str, ...] = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")

TIME_TO_FAIL = 3.0
"""How long a viewer may take to find that it cannot open a window [s]."""


def view_episode(path: Path) -> Path:
    """Opens a run's recording in the viewer; makes one next to the episode when there is none.

    Args:
        path: A run's directory, an episode file, or an ``.rrd`` file.

    Returns:
        The recording that was opened.

    Raises:
        BadInput: No such recording, or the viewer cannot open a window.
    """
    recording = _recording_of(Path(path))
    open_viewer(recording)
    return recording


def recording_from_episode(episode: Episode, path: Path) -> Path:
    """Writes every curve of an episode as a rerun recording; what was not recorded has no plot.

    Args:
        episode: Of this package or of any other program.
        path: Of the ``.rrd`` file; replaced if there.

    Raises:
        BadInput: It cannot be written; then nothing of it is left, which might be taken for all.
    """
    try:
        return _write_recording(episode, path)
    except (NotRecorded, RuntimeError) as error:
        path.unlink(missing_ok=True)
        raise BadInput(f"{path}: cannot be written: {error} (valid: a disk with free space)") from error


def _write_recording(episode: Episode, path: Path) -> Path:
    stream = open_stream(path, episode.name)
    groups: dict[str, list[str]] = {}
    for title, entity, names, values in _curves(episode):
        groups.setdefault(title, []).append(entity)
        colours = [series_colour(index) for index in range(len(names))]
        stream.log(entity, rr.SeriesLines(names=list(names), colors=colours), static=True)
        for first in range(0, len(episode), ROWS_PER_CHUNK):
            rows = slice(first, first + ROWS_PER_CHUNK)
            send_curves(stream, entity, time_index(episode.time[rows]), values[rows])
    for interval in episode.phase_intervals():
        stream.set_time(view_layout.TIMELINE, duration=episode.time[interval.start])
        stream.log(view_layout.PHASE, rr.StateChange(state=interval.phase))
    send_layout(stream, columns_layout(groups, with_phases=episode.phase is not None))
    stream.flush()
    stream.disconnect()
    return path


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


def require_display(what: str) -> None:
    """Makes sure that a window can open.

    Args:
        what: Would be shown, for the message.

    Raises:
        BadInput: This machine has no display.
    """
    if sys.platform == "linux" and not any(os.environ.get(name) for name in DISPLAYS):
        raise _no_window(what, "this machine has no display")


def _recording_of(path: Path) -> Path:
    if path.suffix == ".rrd":
        if not path.exists():
            raise BadInput(
                f"{path}: no such recording (valid: a run's directory, an episode, or an .rrd file)"
            )
        return path
    of_run = path / RECORDING if path.is_dir() else path.with_name(RECORDING)
    if (path.is_dir() or path.name == EPISODE) and of_run.exists():
        return of_run
    episode = read_episode(path)
    return recording_from_episode(episode, of_run if path.is_dir() else path.with_suffix(".rrd"))


def _curves(episode: Episode) -> Iterator[tuple[str, str, tuple[str, ...], Array]]:
    """Yields title of the plot, entity, names of the curves, and (N, curves)."""
    for kind in JOINT_KINDS:
        joints = tuple(getattr(episode, kind))
        if joints:
            title = f"{kind} [{UNITS[kind]}]"
            yield title, view_layout.column_path("joints", kind), joints, episode.matrix(kind)
    for kind in FRAME_KINDS:
        names = WRENCH_COMPONENTS if kind == "wrench" else POSE_COMPONENTS
        for frame, values in getattr(episode, kind).items():
            yield f"{kind} of {frame} [{UNITS[kind]}]", view_layout.column_path(kind, frame), names, values
    if episode.tank is not None:
        yield "tank [J]", view_layout.column_path("energy", "tank"), ("tank",), episode.tank[:, None]
    if episode.extra:
        values = np.column_stack(list(episode.extra.values()))
        yield "other columns", view_layout.column_path("other", "columns"), tuple(episode.extra), values


def _no_window(what: str, reason: str) -> BadInput:
    return BadInput(
        f"{what}: the viewer could not open: {reason} (valid: a machine with a display;"
        " or 'rerun --serve-web RECORDING' and a browser)"
    )


def _reason(said: bytes) -> str:
    """Returns the most informative line that the viewer wrote before it ended."""
    lines = [line.strip() for line in said.decode(errors="replace").splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower()]
    return (telling or lines or ["it gave no reason"])[0]
