# SPDX-License-Identifier: BSD-3-Clause
"""Units that a log may use, as factors to those of an episode: rad, rad/s, N.m; m, m/s, N if prismatic."""

from __future__ import annotations

import math
from collections.abc import Mapping

from impedance_modules.episode.imports.import_map import EFFORTS, POSITIONS

TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

COUNTS = "counts"
GAIN_UNITS = ("A", "V", "other")
"""Units of torque that mean nothing without a gain."""

_TURNING: Mapping[str, Mapping[str, float]] = {
    "position": {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi, COUNTS: 2 * math.pi},
    "velocity": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180,
        "rev/s": 2 * math.pi,
        "rpm": 2 * math.pi / 60,
    },
    "effort": {"N.m": 1.0, "mN.m": 1e-3, "A": 1.0, "V": 1.0, "other": 1.0},
}
_SLIDING: Mapping[str, Mapping[str, float]] = {
    "position": {"m": 1.0, "mm": 1e-3},
    "velocity": {"m/s": 1.0, "mm/s": 1e-3},
    "effort": {"N": 1.0, "A": 1.0, "V": 1.0, "other": 1.0},
}


def unit_factors(kind: str, *, sliding: bool) -> Mapping[str, float]:
    """Returns the units of a quantity with the factor to the episode's.

    Counts are turns here, still to be divided by the counts of a turn; A, V and 'other' still lack their gain.

    Args:
        kind: ``position``, ``velocity``, ``effort``, ``effort_command`` or ``position_command``.
        sliding: Of a prismatic joint, on the joint's side of the transmission.
    """
    family = "position" if kind in POSITIONS else "effort" if kind in EFFORTS else "velocity"
    return (_SLIDING if sliding else _TURNING)[family]
