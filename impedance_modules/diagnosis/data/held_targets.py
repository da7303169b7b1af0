# SPDX-License-Identifier: BSD-3-Clause
r"""Targets that are held and renewed a few times a second, as learned policies and slow planners give them.

A controller's torque jumps where its target q_d is renewed, by about

    x_k = s (q_{d,k} - q_{d,k-1}),      s = \sum \Delta\tau \Delta q_d / \sum \Delta q_d^2

summed over these rows: whatever else a torque does between two rows is not in proportion to the target's step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import Log

Mask = NDArray[np.bool_]

UNCHANGED = 0.01
"""Part of the largest step of a joint's target that is none: stamps that were made even blur a held target."""


def renewals(log: Log) -> Mask:
    """Rows (N,) at which a held target is renewed; none where targets are not recorded, or move all the time.

    Between two held targets lie one row or two: stamps that were made even put one in between.
    """
    if log.position_command is None:
        return np.zeros(log.samples, dtype=bool)
    steps = np.abs(_steps(log.position_command))
    changed = np.any(steps > UNCHANGED * steps.max(axis=0, initial=0.0), axis=1)
    moving = changed.copy()
    moving[1:-1] &= changed[:-2] & changed[2:]
    moving[[0, -1]] = False
    moving |= np.convolve(moving, np.ones(3), mode="same") > 0.0
    return np.asarray(changed & ~moving)


def renewal_rate(log: Log) -> float:
    """How often a held target is renewed while it moves [Hz]; zero where none is held."""
    renewed = renewals(log)
    rows = np.flatnonzero(renewed[1:] & ~renewed[:-1])
    return log.rate / float(np.median(np.diff(rows))) if rows.size > 2 else 0.0


def jumps_of_target(log: Log, torque: Array) -> Array:
    """By how much torques (N, n) jump before each row because a held target is renewed; zero in all other rows."""
    renewed = renewals(log)
    if log.position_command is None or not renewed.any():
        return np.zeros_like(torque)
    aimed = np.where(renewed[:, None], _steps(log.position_command), 0.0)
    power = np.sum(aimed**2, axis=0)
    slope = np.sum(_steps(torque) * aimed, axis=0) / np.where(power > 0.0, power, 1.0)
    return np.asarray(slope * aimed)


def _steps(values: Array) -> Array:
    return np.diff(values, axis=0, prepend=values[:1])
