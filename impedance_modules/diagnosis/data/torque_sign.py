# SPDX-License-Identifier: BSD-3-Clause
r"""A torque whose sign is flipped: it falls where the links' rises, or friction would drive instead of brake.

Both torques are first freed of what the joint's own spring, damper and friction could do, so that neither a
balancing spring nor strong friction looks like a sign. Where a command was recorded too, a reading that follows it
has its sign: a hand that is pushed turns the links' torque, not the drive's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.rough import Rough, rough, without
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

OPPOSED = -0.8
"""Correlation with the links' torque below which a sign is flipped."""

SEEN = 0.05
"""Least part of a torque's size that is left beside the joint's own effects, for a sign to show in it."""

LIGHT = 0.005
"""Part of the most loaded joint's torque below which a joint shows no sign: a light tool turns its torque round."""

SIZE = (0.4, 2.5)
"""Slopes of torque over the links' torque, but for the sign, that are the same physical quantity."""

FOLLOWS = 0.5
"""Correlation with what was asked of the motor above which a reading has its sign."""

DRIVEN = 0.5
"""Part of a torque that must follow the speed for it to be judged by friction."""


def refuse_flipped_torque(log: Log, model: NominalModel) -> None:
    """Refuses a torque with the wrong sign, naming every joint that has one.

    Raises:
        BadInput: With the joints.
    """
    found = rough(log, model)
    if found is None:
        return
    what = "effort" if log.effort is not None else "effort_command"
    flipped = [joint for index, joint in enumerate(model.joints) if _flipped(found, index)]
    if flipped:
        columns = ", ".join(f"{what}.{joint}" for joint in flipped)
        all_of_them = " on every joint" if len(flipped) == model.n > 1 else ""
        raise BadInput(
            f"{log.name}: the sign of {columns} is flipped{all_of_them}: it opposes the torque that the links"
            " need, or friction would drive the joint (valid: torque that turns the joint the way its position"
            " grows; state 'sign: {JOINT: -1}' in the import map)"
        )


def _flipped(found: Rough, joint: int) -> bool:
    effort, model = found.effort[:, joint], found.model[:, joint]
    if _follows_command(found, joint):
        return False
    own = found.own(joint)
    e, m = without(effort, own), without(model, own)
    heaviest = float(found.model.std(axis=0).max())
    if _size(model) < LIGHT * heaviest:
        return False
    if _size(m) > SEEN * max(_size(effort), 1e-9) and _size(e) > 0.0:
        correlation = float(e @ m) / (len(e) * _size(e) * _size(m))
        slope = float(e @ m) / float(m @ m)
        return correlation < OPPOSED and SIZE[0] < -slope < SIZE[1]
    return _drives(effort - model, own) and not _drives(-effort - model, own)


def _follows_command(found: Rough, joint: int) -> bool:
    """Whether a measured torque rises where more was asked for."""
    if found.drive is None:
        return False
    effort, drive = found.effort[:, joint], found.drive[:, joint]
    if min(_size(effort), _size(drive)) == 0.0:
        return False
    return float(np.corrcoef(effort, drive)[0, 1]) > FOLLOWS


def _drives(rest: Array, own: Array) -> bool:
    """Whether a torque beyond the links' mostly follows the speed and feeds energy into the joint."""
    basis = own[:, [0, 1, 2, 3]]
    solution = np.linalg.lstsq(basis, rest, rcond=None)[0]
    friction = basis[:, 2:] @ solution[2:]
    follows = _size(friction) > np.sqrt(DRIVEN) * _size(rest)
    return bool(follows and friction @ own[:, 2] < 0.0)


def _size(values: Array) -> float:
    return float(values.std())
