# SPDX-License-Identifier: BSD-3-Clause
"""Pieces of a recording in the episode's own columns and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples.

    Attributes:
        time: (rows,) [s].
        columns: Episode column without ``time`` -> (rows,).
        places: (rows,) line, sample or message of each, for messages.
    """

    time: Vector
    columns: Mapping[str, Vector]
    places: NDArray[np.int64]
