# SPDX-License-Identifier: BSD-3-Clause
r"""The grid of an encoder or of a torque reading: its step, and the errors that it made of a motion.

A position that crosses many steps per sample is rounded as if by chance: white noise of variance g^2 / 12. One that
needs several samples per step is a staircase. Its errors are saw teeth of |v| / g per second, and at low speed those
lie in the band of the motion, where they are several times as strong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from impedance_modules.arrays import Array

FILE_ROUNDING = 1e-9
"""Differences below it come from the rounding of the file [rad]."""

DIFFERENCES_MIN = 20
"""Fewest differences from which a quantisation step is read."""

STEPS_MAX = 20.0
"""Differences of up to this many steps are compared with whole multiples of the step."""

STAIRCASE = 0.05
"""Steps per sample below which the path between crossings is known well enough to round it once more."""

CROSSINGS_MIN = 3
"""Fewest crossings of the grid that show a path."""

NEIGHBOURS = 0.9
"""Part of the changes of a torque that lead to the next level, where few levels are to be a grid: a torque that is
switched jumps over some."""

RETURNS, RETURNING = 3, 0.3
"""Times that a reading on a grid returns, and least part of a log that such readings are: others were interpolated."""

DITHER = 0.2
"""Least standard deviation of what dithers a torque's grid, over its step: no model knows a torque better."""

THIRD_DIFFERENCES = 20.0
"""Power of white noise's third differences over its own; a motion has nearly none."""


def quantisation_step(positions: Array) -> float:
    """Finds the quantisation step of positions (N,); zero where they are not quantised.

    Args:
        positions: One joint's [rad or m].
    """
    places = np.unique(np.round(positions / FILE_ROUNDING)) * FILE_ROUNDING
    gaps = np.diff(places)
    if len(gaps) < DIFFERENCES_MIN:
        return 0.0
    step = float(gaps.min())
    near = gaps[gaps < STEPS_MAX * step]
    counts = near / step
    on_grid = np.abs(counts - np.round(counts)) < 0.02 + FILE_ROUNDING / step
    return (
        float(np.median(near / np.round(counts))) if len(near) >= DIFFERENCES_MIN and on_grid.all() else 0.0
    )


def steps_of(recordings: Sequence[Mapping[str, Array]], joints: Sequence[str]) -> Array:
    """Finds the quantisation steps (n,) of joints by all recordings of their positions; zero where there is none.

    A joint that hardly moved in one recording shows no step there, and was rounded all the same.

    Args:
        recordings: Joint -> (N,) positions of each [rad or m].
        joints: Whose steps are looked for.
    """
    found = [
        [quantisation_step(recording[joint]) for recording in recordings if joint in recording]
        for joint in joints
    ]
    return np.array([min((step for step in steps if step > 0.0), default=0.0) for steps in found])


def torque_steps_of(recordings: Sequence[Mapping[str, Array]], joints: Sequence[str]) -> Array:
    """Finds the steps (n,) of grids on which torques were written; zero where there is none, or joints lack.

    Args:
        recordings: Joint -> (N,) measured torque of each [N.m or N].
        joints: Whose steps are looked for.
    """
    usual = [{joint: _usual_values(torque) for joint, torque in one.items()} for one in recordings]
    steps = steps_of(usual, joints)
    for i in np.flatnonzero(steps == 0.0).tolist():
        found = [_step_of_few_levels(one[joints[i]]) for one in usual if joints[i] in one]
        steps[i] = min((step for step in found if step > 0.0), default=0.0)
    return steps


def _usual_values(torque: Array) -> Array:
    """Leaves the readings (N,) whose values return, where these are not few: others lie between two levels of a grid.

    Who interpolates a log between its stamps writes such values.
    """
    _, which, counts = np.unique(np.round(torque / FILE_ROUNDING), return_inverse=True, return_counts=True)
    returning = counts[which] >= RETURNS
    return torque[returning] if float(np.mean(returning)) >= RETURNING else torque


def _step_of_few_levels(torque: Array) -> float:
    """Step of a torque (N,) that is smaller than a few steps; zero where its levels are no whole multiples of one."""
    places = np.unique(np.round(torque / FILE_ROUNDING)) * FILE_ROUNDING
    changes = np.abs(np.diff(torque))
    changes = changes[changes > FILE_ROUNDING]
    if not 2 <= len(places) <= DIFFERENCES_MIN or len(changes) < DIFFERENCES_MIN:
        return 0.0
    step = float(np.diff(places).min())
    counts = places / step
    whole = bool(np.all(np.abs(counts - np.round(counts)) < 0.02))
    return step if whole and float(np.mean(changes < 1.5 * step)) >= NEIGHBOURS else 0.0


def torque_dither_of(recordings: Sequence[Mapping[str, Array]], joints: Sequence[str], steps: Array) -> Array:
    r"""Finds the sensors' noise that dithers their grids, (n,) over the steps, by what differs from row to row.

        P(d) = d^2 + 1/12 - \sum_k \exp(-4 \pi^2 k^2 d^2) / (2 \pi^2 k^2)

    is the power of noise d and rounding together, in steps, less that of the errors which are the same whenever the
    torque is. Half a step of noise leaves none of these.

    Args:
        recordings: Joint -> (N,) measured torque of each [N.m or N].
        joints: Whose noise is looked for.
        steps: (n,) of the grids; 0 where there is none, and no noise is looked for.
    """
    d = np.geomspace(1e-3, 1e3, 400)
    k = np.arange(1, 50)[:, None]
    power = d**2 + np.sum((1.0 - np.exp(-4.0 * (np.pi * k * d) ** 2)) / (2.0 * (np.pi * k) ** 2), axis=0)
    found = np.full(len(joints), DITHER)
    for i, (joint, step) in enumerate(zip(joints, steps, strict=True)):
        differences = [np.diff(one[joint], 3) for one in recordings if joint in one]
        if step > 0.0 and sum(map(len, differences)):
            read = float(np.mean(np.concatenate(differences) ** 2)) / THIRD_DIFFERENCES / step**2
            found[i] = max(float(np.interp(read, power, d)), DITHER)
    return found


def mean_rounding(torque: Array, steps: Array, dither: Array) -> Array:
    r"""What a grid adds to a torque (N, n) on the mean over the sensor's noise: the same whenever the torque is.

        E[round(\tau + d \xi)] - \tau = \sum_k (-1)^k \exp(-2 \pi^2 k^2 d^2) \sin(2 \pi k \tau) / (\pi k)

    in steps, d the noise that dithers the grid. A torque below half a step reads zero; noise alone makes it read
    anything. So a small torque reads too small, in every repeat, by an error that is a function of the torque.

    Args:
        torque: As the model has it [N.m or N].
        steps: (n,) of the grids; 0 where there is none.
        dither: (n,) d over the steps, at least `DITHER`.
    """
    size = np.where(steps > 0.0, steps, 1.0)
    phase, added = 2.0 * np.pi * torque / size, np.zeros_like(torque)
    # Of a fifth of a step the third term is a thousandth of the first.
    for k in (1, 2, 3):
        part = (-1.0) ** k * np.exp(-2.0 * (np.pi * k * dither) ** 2) / (np.pi * k)
        added = added + part * np.sin(k * phase)
    return np.asarray(np.where(steps > 0.0, added * size, 0.0))


def rounding_errors(positions: Array, steps: Array, seed: int) -> Array:
    """Simulates what rounding does to positions (N, n) like these: errors of their size and spectrum, (N, n).

    Where a joint is slow, its path is a smooth curve through the crossings of the grid (Akima), and is rounded once
    more to a grid that is moved by a part of a step. Where it is fast, errors are drawn.

    Args:
        positions: As recorded [rad or m].
        steps: (n,) of the grids; 0 where there is none.
        seed: Of what is drawn.
    """
    random = np.random.default_rng(seed)
    return np.column_stack([_errors(*one, random) for one in zip(positions.T, steps, strict=True)])


def _errors(positions: Array, step: float, random: np.random.Generator) -> Array:
    """Errors of one joint's positions (N,)."""
    drawn, shift = random.uniform(-0.5, 0.5, len(positions)), random.uniform()
    crossed = np.flatnonzero(np.diff(positions))
    if step == 0.0 or len(crossed) < CROSSINGS_MIN:
        return np.zeros(len(positions))
    levels = 0.5 * (positions[crossed] + positions[crossed + 1])
    times = np.clip(np.arange(len(positions)), crossed[0] + 0.5, crossed[-1] + 0.5)
    path = Akima1DInterpolator(crossed + 0.5, levels)(times) / step + shift
    slow = np.abs(np.gradient(path)) < STAIRCASE
    return np.asarray(step * np.where(slow, np.round(path) - path, drawn))
