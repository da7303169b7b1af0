# SPDX-License-Identifier: BSD-3-Clause
"""Torque channels with the wrong sign, found by a coarse comparison with the rigid links.

A sign is wrong if the torque falls where that of the links rises, or if friction would feed energy into the joint.
What a spring, damper or friction of the joint itself could do is first regressed out of both torques, so that
neither a balancing spring nor strong friction looks like a wrong sign. Where a command was recorded too, a reading
that correlates with it has its sign: an external push changes the torque of the links, not that of the drive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_dynamics import inverse_dynamics
from impedance_modules.errors import BadInput

OPPOSITE = -0.8
"""A correlation with the links' torque below this value means a wrong sign."""

VISIBLE_PART = 0.05
"""The sign is judged by correlation if at least this part of the links' torque is no effect of the joint itself."""

LIGHT_PART = 0.005
"""Joints with less than this part of the most loaded joint's torque are not judged: a light tool changes their sign."""

SLOPE_RANGE = (0.4, 2.5)
"""Slopes of torque over the links' torque, without the sign, at which both are the same physical quantity."""

COMMAND_CORRELATION = 0.5
"""A reading that correlates more with the commanded torque has the right sign."""

AGREEMENT = 0.25
"""A torque that differs from the links' by less than this part of what it would with the other sign, in power, has the
right one."""

FRICTION_PART = 0.5
"""Part of a torque's power that must follow the speed for its sign to be judged by friction."""

CUTOFF = 3.0
"""Cutoff of the low-pass filter for the comparison [Hz]."""

SAMPLES = 600
"""Number of samples that are compared."""

SATURATION = 0.05
"""Part of its greatest speed at which the smoothed sign of a joint's velocity saturates."""


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
    """A smoothed, thinned recording beside the torque of the rigid links, (M, n) each.

    Attributes:
        position, velocity, acceleration: [rad], [rad/s], [rad/s^2].
        effort: Measured, or commanded where none was measured [N.m].
        model: Torque of the rigid links [N.m]; without the weight where the robot adds that to a command.
        drive: Commanded torque plus the weight that the robot added [N.m]; None where it adds none, or only one torque
            was recorded. If the signs of both torques are wrong, this sum does not fit the reading.
    """

    position: Array
    velocity: Array
    acceleration: Array
    effort: Array
    model: Array
    drive: Array | None

    def joint_basis(self, joint: int) -> Array:
        """Columns (M, 5) of a spring, damper and friction of one joint."""
        q, v = self.position[:, joint], self.velocity[:, joint]
        sign = np.clip(v / max(SATURATION * float(np.abs(v).max()), 1e-12), -1.0, 1.0)
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
    rest = np.zeros_like(q)
    compensated = log.gravity_compensation == "robot"
    weight = inverse_dynamics(model.tree, q, rest, rest) if compensated else rest
    effort = sosfiltfilt(sections, effort, axis=0)[rows]
    if log.effort is None:
        return CoarseComparison(q, v, a, effort, torque - weight, None)
    if log.command is None or not compensated:
        return CoarseComparison(q, v, a, effort, torque, None)
    return CoarseComparison(
        q, v, a, effort, torque, sosfiltfilt(sections, log.command, axis=0)[rows] + weight
    )


def residual_of_fit(values: Array, basis: Array) -> Array:
    """Residual of values (M,) after a least-squares fit of a basis (M, p)."""
    solution = np.linalg.lstsq(basis, values, rcond=None)[0]
    return np.asarray(values - basis @ solution)


def _flipped(found: CoarseComparison, joint: int) -> bool:
    effort, model = found.effort[:, joint], found.model[:, joint]
    if _follows_command(found, joint) or _agrees(effort, model):
        return False
    own = found.joint_basis(joint)
    e, m = residual_of_fit(effort, own), residual_of_fit(model, own)
    heaviest = float(found.model.std(axis=0).max())
    if _size(model) < LIGHT_PART * heaviest:
        return False
    correlation = float(e @ m) / max(len(e) * _size(e) * _size(m), 1e-300)
    if correlation > -OPPOSITE:
        return False  # a tool at a joint with a light hand changes its load, and both rise and fall together
    if _size(m) > VISIBLE_PART * max(_size(effort), 1e-9) and _size(e) > 0.0:
        slope = float(e @ m) / float(m @ m)
        return correlation < OPPOSITE and SLOPE_RANGE[0] < -slope < SLOPE_RANGE[1]
    return _drives(effort - model, own) and not _drives(-effort - model, own)


def _agrees(effort: Array, model: Array) -> bool:
    """Whether the whole torque, weight and all, is far nearer the links' than with the other sign.

    The little that is no effect of the joint itself may be turned round by a base that leans.
    """
    return float(np.sum((effort - model) ** 2)) < AGREEMENT * float(np.sum((effort + model) ** 2))


def _follows_command(found: CoarseComparison, joint: int) -> bool:
    """Whether a measured torque correlates with the commanded one."""
    if found.drive is None:
        return False
    effort, drive = found.effort[:, joint], found.drive[:, joint]
    if min(_size(effort), _size(drive)) == 0.0:
        return False
    return float(np.corrcoef(effort, drive)[0, 1]) > COMMAND_CORRELATION


def _drives(rest: Array, own: Array) -> bool:
    """Whether the torque beyond the links' mostly follows the speed and feeds energy into the joint."""
    basis = own[:, [0, 1, 2, 3]]
    solution = np.linalg.lstsq(basis, rest, rcond=None)[0]
    friction = basis[:, 2:] @ solution[2:]
    follows = _size(friction) > np.sqrt(FRICTION_PART) * _size(rest)
    return bool(follows and friction @ own[:, 2] < 0.0)


def _size(values: Array) -> float:
    return float(values.std())
