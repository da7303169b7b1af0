# SPDX-License-Identifier: BSD-3-Clause
"""Keeps the processor from falling asleep between two states: waking up takes longer than computing a torque."""

from __future__ import annotations

import os
import struct
from pathlib import Path

DEVICE = Path("/dev/cpu_dma_latency")
"""Linux wakes up within as many microseconds as were written there, for as long as the file is open."""


class AwakeProcessor:
    """A wish to the kernel, if this process may have one; it ends with ``end`` or with the process.

    Linux gives the file to root alone; a rule of udev may give it to a group. Without it everything works, later.

    Attributes:
        granted: Whether the processor stays awake now.
    """

    def __init__(self, device: Path = DEVICE) -> None:
        self._device = device
        self._file: int | None = None

    @property
    def granted(self) -> bool:
        """Whether the processor stays awake now."""
        return self._file is not None

    def begin(self) -> None:
        """Asks; a kernel that refuses, or has no such file, is left alone."""
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
        """Lets the processor sleep again; may be called twice."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
