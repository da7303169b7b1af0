# SPDX-License-Identifier: BSD-3-Clause
"""How large an experiment is to be, and where it may put the recordings it makes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path


class Size(Enum):
    """How much of an experiment is run.

    ``SHORT`` is what tests run (seconds), ``NORMAL`` what ``impedance reproduce`` runs (a minute or two each),
    ``FULL`` the long tables that are committed (``--full``).
    """

    SHORT = "short"
    NORMAL = "normal"
    FULL = "full"


@dataclass(frozen=True)
class Settings:
    """What ``reproduce`` hands to an experiment.

    Attributes:
        size: How much is run.
        seed: First seed of everything random.
        work: Existing folder for recordings; the experiment names its own files in it.
        on_progress: Called with the share done, 0 to 1, and what is going on.
    """

    size: Size
    seed: int
    work: Path
    on_progress: Callable[[float, str], None]

    def choose(self, short: int, normal: int, full: int) -> int:
        """Returns the number of runs, samples or steps that belongs to the size."""
        return {Size.SHORT: short, Size.NORMAL: normal, Size.FULL: full}[self.size]
