# SPDX-License-Identifier: BSD-3-Clause
"""Mistakes of recordings that would otherwise be diagnosed as physics: units, signs, echoed commands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.dynamics import inertial_regressor
from impedance_modules.diagnosis.log import Log
from impedance_modules.diagnosis.model import NominalModel
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

DEGREES = 180.0 / np.pi
ROUGH_SAMPLES = 400
"""Samples that a rough comparison with the model takes."""


def refuse_mistakes(log: Log, model: NominalModel) -> None:
    """Refuses a recording whose numbers cannot mean what they claim.

    Raises:
        BadInput: Degrees for radians, a position that is the command, a torque of the wrong sign.
    """
    _refuse_degrees(log, model)
    _refuse_echo(log, model)
    _refuse_flipped_torque(log, model)


def _refuse_degrees(log: Log, model: NominalModel) -> None:
    for index, body in enumerate(model.tree.bodies):
        if body.prismatic:
            continue
        q = log.position[:, index]
        if np.abs(q).max() > 4.0 * np.pi and np.ptp(q) < 4.0 * np.pi * DEGREES:
            raise BadInput(
                f"{log.name}: position.{body.joint} reaches {np.abs(q).max():.4g}, which looks like degrees"
                " (valid: rad; state 'unit: deg' in the import map)"
            )
        if log.velocity is None:
            continue
        slope = _slope(np.gradient(q) * log.rate, log.velocity[:, index])
        if slope is None or 0.1 < slope < 10.0:
            continue
        if 0.5 < slope / DEGREES < 2.0 or 0.5 < slope * DEGREES < 2.0:
            raise BadInput(
                f"{log.name}: velocity.{body.joint} is {slope:.3g} times the position's rate of change: one of"
                " them is in degrees (valid: rad and rad/s; state the unit in the import map)"
            )
        if slope < -0.1:
            raise BadInput(
                f"{log.name}: velocity.{body.joint} has the opposite sign of the position's rate of change"
                " (valid: one sign for both; state 'sign: -1' in the import map)"
            )


def _refuse_echo(log: Log, model: NominalModel) -> None:
    if log.position_command is None:
        return
    same = np.all(log.position == log.position_command, axis=0) & (np.ptp(log.position, axis=0) > 0.0)
    if same.any():
        joint = model.joints[int(np.argmax(same))]
        raise BadInput(
            f"{log.name}: position.{joint} equals position_command.{joint} in every sample: it is the command,"
            " not a measurement (valid: measured positions)"
        )


def _refuse_flipped_torque(log: Log, model: NominalModel) -> None:
    if log.effort is None:
        return
    rows = np.linspace(0, log.samples - 1, min(log.samples, ROUGH_SAMPLES)).astype(int)
    q = log.position[rows]
    still = np.zeros_like(q)
    weight = inertial_regressor(model.tree, q, still, still) @ model.tree.inertia
    for index, joint in enumerate(model.joints):
        likeness = _slope(weight[:, index], log.effort[rows, index])
        if likeness is not None and likeness < -0.5 and np.ptp(weight[:, index]) > 1.0:
            correlation = float(np.corrcoef(weight[:, index], log.effort[rows, index])[0, 1])
            if correlation < -0.9:
                raise BadInput(
                    f"{log.name}: effort.{joint} has the opposite sign of the weight it carries (correlation"
                    f" {correlation:.2f}): its sign is flipped (valid: state 'sign: -1' in the import map)"
                )


def _slope(cause: Array, effect: Array) -> float | None:
    """Least-squares slope about the means where the two resemble each other at all; else None."""
    a, b = cause - cause.mean(), effect - effect.mean()
    power, size = float(a @ a), float(b @ b)
    if power == 0.0 or size == 0.0 or abs(float(a @ b)) < 0.5 * np.sqrt(power * size):
        return None
    return float(a @ b) / power
