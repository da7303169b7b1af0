# SPDX-License-Identifier: BSD-3-Clause
r"""A torque whose sign is flipped: it falls where the links' rises, or friction would drive instead of brake.

Both torques are first freed of what the joint's own spring, damper and friction could do, so that neither a
balancing spring nor strong friction looks like a sign. Where a command was recorded too, a reading that follows it
has its sign: a hand that is pushed turns the links' torque, not the drive's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_dynamics import inverse_dynamics
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

CUTOFF = 3.0
"""Motion above it hardly matters to a sign [Hz]."""

SAMPLES = 600
"""Samples that a compare_coarsely comparison takes."""

FAST = 0.05
"""Share of its greatest speed above which a joint is taken as moving one way."""


def refuse_flipped_torque(log: Log, model: NominalModel) -> None:
    """Refuses a torque with the wrong sign, naming every joint that has one.

    Raises:
        BadInput: With the joints.
    """
    found = compare_coarsely(log, model)
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


@dataclass(frozen=True, eq=False)
class CoarseComparison:
    """A smoothed selection of samples, (M, n) each.

    Attributes:
        position, velocity, acceleration: [rad], [rad/s], [rad/s^2].
        effort: Measured, or commanded where none was measured [N.m].
        model: What the rigid links would take [N.m]; less the weight where the robot adds that to a command.
        drive: What was asked of the motors and the weight that the robot added [N.m]; None where it adds none, or
            only one torque was recorded. With both torques' signs flipped the sum no longer fits the reading.
    """

    position: Array
    velocity: Array
    acceleration: Array
    effort: Array
    model: Array
    drive: Array | None

    def own(self, joint: int) -> Array:
        """What a joint's own spring, damper and friction could do, (M, 5)."""
        q, v = self.position[:, joint], self.velocity[:, joint]
        sign = np.clip(v / max(FAST * float(np.abs(v).max()), 1e-12), -1.0, 1.0)
        return np.column_stack([np.ones_like(q), q, v, sign, q * q])


def compare_coarsely(log: Log, model: NominalModel, scale: float = 1.0) -> CoarseComparison | None:
    """Compares a recording, its positions times ``scale``, with its model; None without any torque."""
    effort = log.effort if log.effort is not None else log.command
    if effort is None:
        return None
    sections = butter(2, min(CUTOFF / (0.5 * log.rate), 0.8), output="sos")
    q = sosfiltfilt(sections, log.position, axis=0) * scale
    v = np.gradient(q, 1.0 / log.rate, axis=0)
    a = np.gradient(v, 1.0 / log.rate, axis=0)
    inner = slice(log.samples // 20, log.samples - log.samples // 20)
    rows = np.arange(log.samples)[inner][:: max(1, log.samples // SAMPLES)]
    q, v, a = q[rows], v[rows], a[rows]
    torque = inverse_dynamics(model.tree, q, v, a)
    still = np.zeros_like(q)
    compensated = log.gravity_compensation == "robot"
    weight = inverse_dynamics(model.tree, q, still, still) if compensated else still
    effort = sosfiltfilt(sections, effort, axis=0)[rows]
    if log.effort is None:
        return CoarseComparison(q, v, a, effort, torque - weight, None)
    if log.command is None or not compensated:
        return CoarseComparison(q, v, a, effort, torque, None)
    return CoarseComparison(
        q, v, a, effort, torque, sosfiltfilt(sections, log.command, axis=0)[rows] + weight
    )


def without(values: Array, basis: Array) -> Array:
    """What is left of values (M,) after a least-squares fit of a basis (M, p)."""
    solution = np.linalg.lstsq(basis, values, rcond=None)[0]
    return np.asarray(values - basis @ solution)


def _flipped(found: CoarseComparison, joint: int) -> bool:
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


def _follows_command(found: CoarseComparison, joint: int) -> bool:
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
