# SPDX-License-Identifier: BSD-3-Clause
r"""The controller around elastic joints, sampled and late: is it stable, and how stiff may the hand be?

    \tau_k = -(K_q q_k + D_q v_k), acts over the period that begins ``delay_periods`` later

The loop is the matrix of one period on the arm's state and the torques still under way. It is stable when
its spectral radius is below one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.superposition.elastic_joints import SampledArm
from impedance_modules.superposition.modes import VibrationMode, modes_of

MARGIN = 1e-7
"""A free motion has a double eigenvalue one, which rounding moves by about 1e-8; this is above that."""

STRIDE = 1.6
"""Factor by which the endpoint stiffness is changed while the limit of stability is looked for."""

SMALLEST_SCALE = 1e-3
"""Of the endpoint stiffness; a loop that is unstable there is taken as unstable however soft the hand is."""

TOLERANCE = 0.01
"""Relative accuracy of the highest stable stiffness."""


@dataclass(frozen=True)
class Gains:
    """Joint-space gains of a controller, (k, k) each [N.m/rad, N.m.s/rad]."""

    stiffness: Array
    damping: Array


def loop_matrix(arm: SampledArm, gains: Gains) -> Array:
    """Writes one period of the closed loop on (x, oldest torque under way ... newest)."""
    size, k = arm.B.shape
    late = arm.sampling.delay_periods
    command = -gains.stiffness @ arm.position - gains.damping @ arm.velocity
    if late == 0:
        return np.asarray(arm.A + arm.B @ command)
    matrix = np.zeros((size + k * late, size + k * late))
    matrix[:size, :size] = arm.A
    matrix[:size, size : size + k] = arm.B
    # Every torque under way moves up by one period; the new command joins at the end.
    matrix[size:-k, size + k :] = np.eye(k * (late - 1))
    matrix[-k:, :size] = command
    return matrix


def spectral_radius(arm: SampledArm, gains: Gains) -> float:
    """Gives the growth of the loop's least stable motion per period; below 1 is stable."""
    return float(np.max(np.abs(np.linalg.eigvals(loop_matrix(arm, gains)))))


def oscillating_growth(arm: SampledArm, gains: Gains) -> float:
    """Gives the growth per period of the fastest growing oscillation.

    A motion that grows without swinging (an eigenvalue that is real and positive) is an arm that folds under its load:
    slow, and the same at every rate and delay. It is left out.
    """
    values = np.linalg.eigvals(loop_matrix(arm, gains))
    folding = (values.real > 0.0) & (np.abs(values.imag) <= 1e-9 * np.abs(values))
    return float(np.max(np.abs(values[~folding]), initial=0.0))


def sampled_modes(arm: SampledArm, gains: Gains) -> tuple[VibrationMode, ...]:
    """Finds the loop's modes as continuous motions, s = rate log(z), slowest first.

    Motions that decay within a small fraction of a period, such as the pure delay's, are left out.
    """
    values, vectors = np.linalg.eig(loop_matrix(arm, gains))
    lasting = np.abs(values) > 1e-3
    shapes = arm.position @ vectors[: arm.A.shape[0], lasting]
    return modes_of(arm.sampling.rate * np.log(values[lasting].astype(complex)), shapes)


def highest_stable_stiffness(arm: SampledArm, fixed: Gains, scaled: Gains, largest: float) -> float | None:
    r"""Finds how far the endpoint stiffness can be raised before the sampled loop is unstable.

    The endpoint stiffness is multiplied by s and its damping, by its rule 2 \zeta \sqrt{k m}, by \sqrt{s}. The
    search goes from s = 1 upwards while the loop is stable, else downwards, then bisects to ``TOLERANCE``.

    Args:
        arm: The arm between samples.
        fixed: Joint springs, Gamma and explicit dampers, which stay.
        scaled: J^T K_end J and J^T D_end J, which grow.
        largest: Scale beyond which nobody asks.

    Returns:
        The scale, near to 1, at which the loop loses stability, from below; 0 if it is unstable down to about
        ``SMALLEST_SCALE``; None if it is stable up to ``largest``.
    """

    def stable(scale: float) -> bool:
        stiffness, root = fixed.stiffness + scale * scaled.stiffness, math.sqrt(scale)
        return spectral_radius(arm, Gains(stiffness, fixed.damping + root * scaled.damping)) < 1.0 + MARGIN

    high = 1.0
    while stable(high):
        if high >= largest:
            return None
        high = min(STRIDE * high, largest)
    low = high / STRIDE
    while not stable(low):
        if low < SMALLEST_SCALE:
            return 0.0
        high, low = low, low / STRIDE
    while high / low > 1.0 + TOLERANCE:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
