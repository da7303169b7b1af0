# SPDX-License-Identifier: BSD-3-Clause
r"""Where torques jump between two rows: a recording at a low rate does not know when.

A controller whose target is held and renewed a few times a second, as learned policies have, makes its torque jump.
Samples know a smooth torque between their rows, but not a jump: it came at any moment between them, a command is
logged as it is given and an effort before it acts. What that makes of a residual is a pulse at each jump,

    r_k = c (x_k - x_{k-1}),      0 <= c <= 1 and unknown,

and no cause (`regression.jumped_torques`). Where the target is recorded, too, the jumps are known well enough; where
it is not, it is said. Jumps show in the second differences: of noise, or of a smooth torque, the largest are four
times the usual ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.held_targets import jumps_of_target, renewals
from impedance_modules.diagnosis.data.log import Log

FAST = 400.0
"""Rate at which a jump is short beside what is compared [Hz]."""

JUMPS_MIN = 6.5
"""Least 99th percentile of the second differences over their median, of the median joint; 3.8 for normal noise."""


def jump_notes(logs: Sequence[Log]) -> tuple[str, ...]:
    """A sentence about recordings whose torques jump, whose rate is low and whose held target is not recorded."""
    found = [
        log for log in logs if log.rate < FAST and jumps(_torque(log)) > JUMPS_MIN and not renewals(log).any()
    ]
    if not found:
        return ()
    names = [log.name for log in found]
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    rate = min(log.rate for log in found)
    return (
        f"{', '.join(names[:5])}{more}: torques jump, and at {rate:.3g} Hz nobody knows when between two rows; a gap"
        " or a cause as large as these jumps may be made of them"
        f" (valid: {FAST:g} Hz or more, position_command as well, or a target that does not jump)",
    )


def jumps(torque: Array) -> float:
    """99th percentile of the second differences of torques (N, n) over their median, of the median joint [-].

    Joints whose torque mostly stands still on a grid say nothing; zero where all of them do.
    """
    size = np.abs(np.diff(torque, n=2, axis=0))
    usual, large = np.percentile(size, [50.0, 99.0], axis=0)
    moves = usual > 1e-9 * np.maximum(large, 1e-300)
    return float(np.median(large[moves] / usual[moves])) if moves.any() else 0.0


def jump_sizes(log: Log, torque: Array) -> Array:
    """By how much torques (N, n) of a recording jump before each row, less what they change smoothly.

    By a held target where one is recorded; else where they are much rougher than usual, if that is not noise.
    """
    out = jumps_of_target(log, torque)
    if out.any() or jumps(torque) <= JUMPS_MIN:
        return out
    steps = np.diff(torque, axis=0)
    sudden = steps[1:-1] - 0.5 * (steps[:-2] + steps[2:])
    size = np.pad(np.abs(sudden), ((1, 1), (0, 0)))
    largest = (size[1:-1] >= size[:-2]) & (size[1:-1] >= size[2:])  # beside a jump there is half of it
    large = size[1:-1] > JUMPS_MIN * np.median(np.abs(sudden), axis=0)
    out[2:-1] = np.where(largest & large, sudden, 0.0)
    return out


def _torque(log: Log) -> Array:
    """The command, which jumps most; without it, the effort."""
    torque = log.command if log.command is not None else log.effort
    return np.zeros((3, 1)) if torque is None else torque
