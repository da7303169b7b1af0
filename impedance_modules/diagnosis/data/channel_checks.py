# SPDX-License-Identifier: BSD-3-Clause
"""Mistakes of recordings that would otherwise be diagnosed as physics: echoes, stuck channels, units, signs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.torque_sign import refuse_flipped_torque
from impedance_modules.diagnosis.units import refuse_units
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

JUMP = 1.0
"""No joint turns so far from one sample to the next [rad], at any rate that is admitted."""

FULL_TURN = 0.05
"""A jump that differs from a full turn by less is a wrapped angle [rad]."""


def refuse_mistakes(log: Log, model: NominalModel) -> None:
    """Refuses a recording whose numbers cannot mean what they claim.

    Raises:
        BadInput: A reading that is the command, a stuck channel, wrong units, a torque of the wrong sign.
    """
    for reading, command in (("position", "position_command"), ("effort", "command")):
        _refuse_echo(log, model, reading, command)
    _refuse_stuck(log, model)
    refuse_units(log, model)
    refuse_flipped_torque(log, model)


def _refuse_echo(log: Log, model: NominalModel, reading: str, command: str) -> None:
    measured: Array | None = getattr(log, reading)
    asked: Array | None = getattr(log, command)
    if measured is None or asked is None:
        return
    same = np.all(measured == asked, axis=0) & (np.ptp(measured, axis=0) > 0.0)
    if same.any():
        joint = model.joints[int(np.argmax(same))]
        name = command if command == "position_command" else "effort_command"
        raise BadInput(
            f"{log.name}: {reading}.{joint} equals {name}.{joint} in every sample: it is the command,"
            f" not a measurement (valid: a measured {reading}; leave the column out if there is none)"
        )


def _refuse_stuck(log: Log, model: NominalModel) -> None:
    if log.effort is None:
        return
    stuck = (np.ptp(log.effort, axis=0) == 0.0) & (np.ptp(log.position, axis=0) > 0.0)
    if stuck.any():
        index = int(np.argmax(stuck))
        joint, value = model.joints[index], log.effort[0, index]
        raise BadInput(
            f"{log.name}: effort.{joint} is {value:.4g} in every sample although the joint moves: nothing was"
            " measured there (valid: a measured torque; leave the column out if there is none)"
        )


def unwrapped(log: Log, model: NominalModel, warnings: list[str]) -> Log:
    """Undoes the jumps of angles that are counted from zero again after each turn.

    Raises:
        BadInput: A position jumps otherwise.
    """
    steps = np.diff(log.position, axis=0)
    turns = np.array([not body.prismatic for body in model.tree.bodies])
    jumps = (np.abs(steps) > JUMP) & turns
    if not jumps.any():
        return log
    joint = int(np.argmax(jumps.any(axis=0)))
    size = steps[jumps[:, joint], joint]
    row = int(np.argmax(jumps[:, joint])) + 1
    name = model.joints[joint]
    if np.abs(np.abs(size) - 2.0 * np.pi).max() > FULL_TURN + np.abs(steps[~jumps[:, joint], joint]).max():
        return (
            log if np.abs(log.position).max() > 4.0 * np.pi else _refuse_jump(log, name, row, float(size[0]))
        )
    warnings.append(f"{log.name}: position.{name} wraps around after a turn; unwrapped")
    return replace(log, position=np.where(turns, np.unwrap(log.position, axis=0), log.position))


def _refuse_jump(log: Log, joint: str, row: int, size: float) -> Log:
    raise BadInput(
        f"{log.name}: position.{joint} jumps by {size:.3g} rad at row {row} (valid: a continuous position in rad;"
        " cut the recording there, or fix the encoder's fault)"
    )
