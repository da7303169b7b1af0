# SPDX-License-Identifier: BSD-3-Clause
r"""A generic basis: what functions of a joint's motion without physics could explain.

    smooth   r = \sum_k c_k \tanh(w_k \cdot (q, v, a, \tau) + b_k)         random w, b of a fixed seed
    local    r = c \max(0, \pm (q - q_k)),   r = c \exp(-((q - q_k) / h)^2)   somewhere in the joint's range
    step     r = c \tanh(\tau / (h \tau_{rms}))                               where the load reverses

with \tau the model's torque: a generic regressor must not use the reading that it is to explain. A cause is named
only if it does better than the best of these with as many coefficients, and explains a gap only if none of them finds
more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.candidates import BatchFilter, CandidateRegressor
from impedance_modules.diagnosis.regression.cleaned_signals import without_noise_of_motion
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.residual_kinds import Residual

DRAWS: Mapping[int, int] = {1: 10, 2: 6, 4: 4}
"""Number of coefficients -> number of random regressors per joint and residual."""

KNOTS = (0.15, 0.3, 0.5, 0.7, 0.85)
"""Quantiles of the position at which local regressors begin or are centred."""

STEPS = (0.02, 0.1, 0.3)
"""Loads over which a step at the load's reversal spreads, over its rms: a dead zone's, sticking of any kind."""

GENERIC = "generic"


def generic_basis(prepared: Sequence[Prepared], residuals: Sequence[Residual]) -> list[CandidateRegressor]:
    """Draws the generic regressors of every joint in every residual."""
    regressors: list[CandidateRegressor] = []
    batches = [BatchFilter(item.band) for item in prepared]
    signals = [without_noise_of_motion(item.signals) for item in prepared]
    for joint in range(prepared[0].signals.n):
        inputs = [_inputs(own, joint) for own in signals]
        stacked = np.concatenate(inputs)
        scaled = [(x - stacked.mean(axis=0)) / (stacked.std(axis=0) + 1e-9) for x in inputs]
        loads = [x[:, 3:] for x in inputs]
        for name, columns in [*_functions(scaled), *_steps(loads)]:
            for residual in residuals:
                regressor = CandidateRegressor(None, {}, (GENERIC, f"{residual}.{joint}", name))
                size = columns[0].shape[1]
                regressor.lower, regressor.upper = np.full(size, -np.inf), np.full(size, np.inf)
                for batch, values in zip(batches, columns, strict=True):
                    regressor.blocks.append({})
                    batch.add(regressor.blocks[-1], (residual, joint), values)
                regressors.append(regressor)
    for batch in batches:
        batch.flush()
    return regressors


def _inputs(s: Signals, joint: int) -> Array:
    """(N, 4) position, velocity, acceleration and the model's torque of a joint."""
    return np.column_stack(
        [s.position[:, joint], s.velocity[:, joint], s.acceleration[:, joint], s.rigid[:, joint]]
    )


def _steps(loads: Sequence[Array]) -> Iterator[tuple[str, list[Array]]]:
    """Names and values (N, 1) per recording, of loads (N, 1)."""
    rms = float(np.sqrt(np.mean(np.concatenate(loads) ** 2))) + 1e-9
    for index, spread in enumerate(STEPS):
        yield f"step.{index}", [np.tanh(x / (spread * rms)) for x in loads]


def _functions(inputs: Sequence[Array]) -> Iterator[tuple[str, list[Array]]]:
    """Names and values (N, size) per recording."""
    random = np.random.default_rng(20260101)
    for size, draws in DRAWS.items():
        for draw in range(draws):
            weights, offset = random.normal(size=(4, size)), random.normal(size=size)
            yield f"smooth.{size}.{draw}", [np.tanh(x @ weights + offset) for x in inputs]
    position = np.concatenate([x[:, 0] for x in inputs])
    knots = np.quantile(position, KNOTS)
    width = max(float(np.ptp(position)) / len(KNOTS), 1e-6)
    for index, knot in enumerate(knots):
        yield f"above.{index}", [np.maximum(x[:, :1] - knot, 0.0) for x in inputs]
        yield f"below.{index}", [np.maximum(knot - x[:, :1], 0.0) for x in inputs]
        yield f"at.{index}", [np.exp(-(((x[:, :1] - knot) / width) ** 2)) for x in inputs]
