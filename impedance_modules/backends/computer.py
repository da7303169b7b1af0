# SPDX-License-Identifier: BSD-3-Clause
"""What a run in real time asks of its computer: a CPU that stays awake, an interpreter that changes threads quickly."""

from __future__ import annotations

import os
import struct
from pathlib import Path

SWITCH_INTERVAL = 1e-4
"""Longest time for which a thread that writes files may hold the interpreter lock [s]; Python's default of 5 ms would
delay a command by as much."""

DEVICE = Path("/dev/cpu_dma_latency")
"""Linux limits the CPU's wake-up latency to the microseconds written here, for as long as the file is open."""


class CpuIdleInhibitor:
    """Keeps the CPU out of deep idle states, if this process may; ends with ``end`` or with the process.

    Linux lets only root open the file; a udev rule may allow a group. Without it everything works, more slowly.
    """

    def __init__(self, device: Path = DEVICE) -> None:
        self._device = device
        self._file: int | None = None

    def begin(self) -> None:
        """Makes the request; does nothing where the kernel refuses or has no such file."""
        if self._file is not None:
            return
        try:
            file = os.open(self._device, os.O_WRONLY)
        except OSError:
            return
        try:
            os.write(file, struct.pack("i", 0))
        except OSError:
            os.close(file)
            return
        self._file = file

    def end(self) -> None:
        """Withdraws the request; may be called twice."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
