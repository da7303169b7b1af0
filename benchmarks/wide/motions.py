# SPDX-License-Identifier: BSD-3-Clause
"""Desired motions: of identification, of work, of a hand that leads the arm, and slow ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.arm_model import Drive
from benchmarks.blind.excitation import RATE, Motion, Shape, fourier, multisine, rich_motion, smooth

Array = NDArray[np.float64]


def pick_and_place(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Goes round between four postures, with a rest of half a second to a second at each."""
    n = len(drive.joints)
    places = rng.uniform(-0.5, 0.5, (4, n))
    shape, clock, here, k = np.zeros((time.size, n)), 0.4, np.zeros(n), 0
    while clock < time[-1]:
        takes, there = rng.uniform(0.7, 1.3), places[k % 4] + 0.02 * rng.standard_normal(n)
        part = np.clip((time[:, None] - clock) / takes, 0.0, 1.0)
        move = part**3 * (10 - 15 * part + 6 * part**2)
        shape = np.where(time[:, None] >= clock, here + (there - here) * move, shape)
        clock, here, k = clock + takes + rng.uniform(0.5, 1.0), there, k + 1
    return shape


def teleoperation(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """A hand leads the arm: smoothed random ways below 1 Hz, with a tremor, and pauses in which nothing moves."""
    n = len(drive.joints)
    low_pass = butter(2, 0.6, fs=RATE, output="sos")
    ways = sosfiltfilt(low_pass, rng.standard_normal((time.size, n)), axis=0)
    moving = smooth(
        (np.sin(2 * np.pi * time / rng.uniform(3.0, 5.0) + rng.uniform(0, 6)) > -0.5).astype(float), 0.3
    )
    clock = np.cumsum(moving) / RATE
    ways = ways / np.abs(ways).max(axis=0)
    held = np.stack([np.interp(clock, time, column) for column in ways.T], axis=1)
    tremor = 0.003 * np.sin(2 * np.pi * rng.uniform(4.0, 7.0, n) * time[:, None])
    return np.asarray(0.6 * held + tremor * moving[:, None])


def slow(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Turns back and forth below a fifteenth of a radian per second, with long straight stretches."""
    n = len(drive.joints)
    shape = np.zeros((time.size, n))
    for i in range(n):
        period, speed = rng.uniform(6.0, 12.0), rng.uniform(0.03, 0.065)
        wave = 4 * np.abs((time / period + rng.uniform()) % 1.0 - 0.5) - 1.0
        shape[:, i] = smooth(0.25 * wave * speed * period, 0.2)
    return shape


def either(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """A multisine or a Fourier series."""
    return (multisine if rng.random() < 0.5 else fourier)(time, drive, rng)


SHAPES: dict[str, Shape] = {
    "identification": either,
    "pick_and_place": pick_and_place,
    "teleoperation": teleoperation,
    "slow": slow,
}


def draw_motions(
    values: Mapping[str, str], model: mujoco.MjModel, drive: Drive, seconds: float, count: int,
    rng: np.random.Generator,
) -> tuple[list[Motion], list[int | None]]:  # fmt: skip
    """Draws the motions of a case and says which repeats which.

    Slow motions are not enlarged to the limits as the others are.
    """
    shape = SHAPES[values["motion"]]
    drawn = _kept(shape) if values["motion"] == "slow" else shape
    return repeated_after(values, count, lambda: rich_motion(drawn, seconds, model, drive, rng))


def repeated_after(
    values: Mapping[str, str], count: int, draw: Callable[[], Motion]
) -> tuple[list[Motion], list[int | None]]:
    """Draws ``count`` motions, about half of them once more where the case repeats; and says which repeats which."""
    repeated = values["repeats"] == "repeated" and count > 1
    different = max(1, (count + 1) // 2) if repeated else count
    motions, repeats = [draw() for _ in range(different)], [None] * different
    for i in range(count - different):
        motions.append(motions[i])
        repeats.append(i)
    return motions, repeats


def _kept(shape: Shape) -> Shape:
    """Returns a shape so small that `rich_motion`, which enlarges by 1.3 at most, leaves its speed."""

    def drawn(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
        return np.asarray(0.77 * shape(time, drive, rng))

    return drawn


def peaks_of(motions: Sequence[Motion]) -> tuple[Array, Array, Array]:
    """Returns largest and least peak and largest weight (n,) of some motions [N.m]."""
    peaks = np.array([one.peak for one in motions])
    return peaks.max(axis=0), peaks.min(axis=0), np.max([one.weight for one in motions], axis=0)
