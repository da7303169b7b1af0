# SPDX-License-Identifier: BSD-3-Clause
"""Desired motions of one arm: what an experimenter would run, and what a careless one would."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Drive

Array = NDArray[np.float64]

RATE = 1000
FADE = 1.0
"""Time [s] in which a motion grows from rest."""


@dataclass(frozen=True)
class Motion:
    """Desired (samples, n) position [rad], velocity [rad/s] and feed-forward torque [N.m], at 1 kHz.

    ``peak`` (n,) is the largest torque [N.m] that the motors need for it, ``weight`` (n,) the largest weight in it.
    """

    position: Array
    velocity: Array
    feed_forward: Array
    peak: Array
    weight: Array


Shape = Callable[[Array, Drive, np.random.Generator], Array]
"""Time (samples,) -> deviation from the centre (samples, n) [rad], before scaling to the limits."""


def multisine(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Six tones per joint, 0.1 to 2.2 Hz, each joint its own: the richest motion."""
    shape = np.zeros((time.size, len(drive.joints)))
    for i in range(shape.shape[1]):
        tones = np.geomspace(0.1, 2.2, 6) * rng.uniform(0.85, 1.18, 6)
        shape[:, i] = _tones(time, tones, tones**-1.1, rng)
    return shape


def fourier(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Five harmonics of one slow tone, as in the textbooks of identification."""
    base = rng.uniform(0.1, 0.16)
    shape = np.zeros((time.size, len(drive.joints)))
    for i in range(shape.shape[1]):
        shape[:, i] = _tones(
            time,
            np.asarray(base * np.arange(1, 6), np.float64),
            rng.uniform(0.3, 1.0, 5) / np.arange(1, 6),
            rng,
        )
    return shape


def point_to_point(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Quick and slow moves between postures, with rests."""
    return _moves(time, drive, rng, duration=(0.6, 2.0), rest=(0.3, 1.0))


def ramps(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Constant speeds from creeping to brisk, back and forth, with short rests: friction's motion."""
    n = len(drive.joints)
    shape = np.zeros((time.size, n))
    for i in range(n):
        times, places = [0.0], [0.0]
        while times[-1] < time[-1]:
            speed = np.exp(rng.uniform(np.log(0.03), np.log(0.5)))
            length = min(speed * rng.uniform(0.8, 2.0), 0.5)
            places.append(-np.sign(places[-1] or rng.choice([-1.0, 1.0])) * 0.5 * length)
            times.append(times[-1] + max(abs(places[-1] - places[-2]) / speed, 0.3))
            if rng.random() < 0.35:
                places.append(places[-1])
                times.append(times[-1] + rng.uniform(0.3, 0.7))
        shape[:, i] = smooth(np.interp(time, times, places), 0.08)
    return shape


def reaching(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Slow reaches with all joints together, as a task would ask for."""
    return _moves(time, drive, rng, duration=(1.2, 2.5), rest=(0.1, 0.6), together=True)


def _tones(time: Array, tones: Array, sizes: Array, rng: np.random.Generator) -> Array:
    phases = rng.uniform(0, 2 * np.pi, tones.size)
    return np.asarray((sizes * np.sin(2 * np.pi * np.outer(time, tones) + phases)).sum(axis=1))


def _moves(
    time: Array,
    drive: Drive,
    rng: np.random.Generator,
    duration: tuple[float, float],
    rest: tuple[float, float],
    together: bool = False,
) -> Array:
    n = len(drive.joints)
    shape = np.zeros((time.size, n))
    clock, here = 0.5, np.zeros(n)
    while clock < time[-1]:
        takes = rng.uniform(*duration) * np.ones(n) if together else rng.uniform(*duration, n)
        there = rng.uniform(-0.45, 0.45, n)
        part = np.clip((time[:, None] - clock) / takes, 0.0, 1.0)
        jerkless = part**3 * (10 - 15 * part + 6 * part**2)
        shape = np.where(time[:, None] >= clock, here + (there - here) * jerkless, shape)
        clock += float(takes.max()) + rng.uniform(*rest)
        here = there
    return shape


def smooth(values: Array, width: float) -> Array:
    """Rounds corners over ``width`` [s] by two running means."""
    half = round(width * RATE / 2)
    kernel = np.ones(2 * half + 1) / (2 * half + 1)
    for _ in range(2):
        values = np.convolve(np.pad(values, half, mode="edge"), kernel, mode="valid")
    return values


def fade_in(time: Array) -> Array:
    """Grows smoothly from 0 to 1 over the first second."""
    part = np.clip(time / FADE, 0.0, 1.0)
    return np.asarray(part**3 * (10 - 15 * part + 6 * part**2))


RICH: dict[str, Shape] = {
    "multisine": multisine,
    "fourier": fourier,
    "point_to_point": point_to_point,
    "ramps": ramps,
    "reaching": reaching,
}
