# SPDX-License-Identifier: BSD-3-Clause
"""A quick comparison of a recording with its model, good enough to notice a wrong unit or sign."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_dynamics import inverse_dynamics

Array = NDArray[np.float64]

CUTOFF = 3.0
"""Motion above it hardly matters to a sign [Hz]."""

SAMPLES = 600
"""Samples that a rough comparison takes."""

FAST = 0.05
"""Share of its greatest speed above which a joint is taken as moving one way."""


@dataclass(frozen=True, eq=False)
class Rough:
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


def rough(log: Log, model: NominalModel, scale: float = 1.0) -> Rough | None:
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
        return Rough(q, v, a, effort, torque - weight, None)
    if log.command is None or not compensated:
        return Rough(q, v, a, effort, torque, None)
    return Rough(q, v, a, effort, torque, sosfiltfilt(sections, log.command, axis=0)[rows] + weight)


def without(values: Array, basis: Array) -> Array:
    """What is left of values (M,) after a least-squares fit of a basis (M, p)."""
    solution = np.linalg.lstsq(basis, values, rcond=None)[0]
    return np.asarray(values - basis @ solution)
