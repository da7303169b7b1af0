# SPDX-License-Identifier: BSD-3-Clause
"""Reads a case's log for the baselines, with the stock Parquet reader."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from benchmarks.blind.logs import CHANNELS
from benchmarks.blind.arm_model import read_drive

Array = NDArray[np.float64]


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
