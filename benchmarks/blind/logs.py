# SPDX-License-Identifier: BSD-3-Clause
"""From the inner 1 kHz to what a user records: 100 Hz columns of one episode; and its reader for the baselines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Drive, read_drive
from benchmarks.blind.plant import PERIOD, RawLog
from benchmarks.blind.records import Faults
from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.metadata import episode_metadata

Array = NDArray[np.float64]

DECIMATION = 10
SAMPLES = 1200
"""Of every log: 12 s. The simulation runs a little longer, so that a fast clock finds something to read."""
CHANNELS = ("position", "velocity", "effort", "effort_command", "position_command")


def record(raw: RawLog, drive: Drive, faults: Faults) -> dict[str, Array]:
    """Returns time (m,), touch (m,) and one (m, n) array per channel.

    Args:
        raw: Episode at 1 kHz.
        drive: Sensor grids.
        faults: Their clocks. The log carries the controller's stamps; a sensor's clock that runs fast by a share
            ``clock`` has, at the controller's time t, delivered what it saw at t / (1 + clock).
    """
    clock = faults.clock
    few = np.arange(0, SAMPLES * DECIMATION, DECIMATION)
    seen = few / (1.0 + clock)
    columns: dict[str, Array] = {
        "time": np.asarray(few * PERIOD * (1.0 + faults.stamps)),
        "touch": raw.touch[few],
    }
    columns["effort_command"], columns["position_command"] = raw.command[few], raw.target[few]
    grids = {"position": drive.position_resolution, "effort": drive.effort_resolution}
    for name, values in (("position", raw.position), ("velocity", raw.velocity), ("effort", raw.effort)):
        columns[name] = values[few] if clock == 0.0 else _between(values, seen, grids.get(name))
    return columns


def _between(values: Array, index: Array, grid: float | None) -> Array:
    low = np.floor(index).astype(int)
    high = np.minimum(low + 1, values.shape[0] - 1)
    share = (index - low)[:, None]
    mixed = (1 - share) * values[low] + share * values[high]
    return np.asarray(mixed if grid is None else np.round(mixed / grid) * grid)


def save(
    path: Path,
    columns: Mapping[str, Array],
    joints: Sequence[str],
    repeat_of: str | None,
    phases: Sequence[str] | None,
    task: str | None = None,
) -> None:
    """Writes one episode file; nothing in it, the task included, tells what was wrong with the arm or the floor."""
    table: dict[str, Array | Sequence[str | None]] = {"time": columns["time"]}
    for channel in CHANNELS:
        for i, joint in enumerate(joints):
            table[f"{channel}.{joint}"] = columns[channel][:, i]
    if phases is not None:
        table["phase"] = list(phases)
    metadata = episode_metadata(
        robot="baxter",
        episode=path.stem,
        effort_source="joint_sensor",
        gravity_compensation="robot",
        repeat_of=repeat_of,
        task=task,
    )
    write_episode(path, table, metadata)


@dataclass(frozen=True)
class Log:
    """Which arm it is, and (samples, n) arrays by channel (time: (samples,))."""

    side: str
    channels: dict[str, Array]


def read_log(path: Path) -> Log:
    """Reads one episode.

    Raises:
        ValueError: It has the joints of neither arm.
    """
    table = pq.read_table(path)
    for side in ("left", "right"):
        joints = read_drive(side).joints
        if f"position.{joints[0]}" in table.column_names:
            channels = {"time": table.column("time").to_numpy()}
            for channel in CHANNELS:
                columns = [table.column(f"{channel}.{joint}").to_numpy() for joint in joints]
                channels[channel] = np.stack(columns, axis=1)
            return Log(side, channels)
    raise ValueError(f"{path}: no joints of a known arm")
