# SPDX-License-Identifier: BSD-3-Clause
"""What arms are asked to do: sums of sines, pick and place, a teleoperator's hand, and slow sweeps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.stranger.robots import Maker

Array = NDArray[np.float64]

TICK = 1e-3
"""Period of the controllers [s]."""

REST = 1.0
"""Time for which the arm is held before a recording begins [s]; it is not recorded."""

KINDS = ("sines", "pick_place", "teleop", "slow")


@dataclass(frozen=True)
class Motion:
    """Set-points of one recording at the controller's ticks [rad, rad/s, rad/s^2]; the rest included."""

    q: Array
    v: Array
    a: Array


def draw_motion(kind: str, maker: Maker, seconds: float, rng: np.random.Generator) -> Motion:
    """Draws one motion; it starts at rest, and stays within the arm's reach and speeds."""
    count = round(seconds / TICK)
    t: Array = np.arange(count, dtype=np.float64) * TICK
    if kind == "pick_place":
        path = _pick_place(t, maker, rng)
    elif kind == "teleop":
        path = _teleop(t, len(maker.middle), rng)
    else:
        path = _sines(t, len(maker.middle), kind == "slow", rng)
    path = _within(path, maker, 0.25 if kind == "slow" else 1.0, rng)
    held = np.repeat(path[:1], round(REST / TICK), axis=0)
    return _with_rates(np.concatenate([held, path]))


def _with_rates(q: Array) -> Motion:
    """Smooths the corners (a set-point generator's low-pass at 6 Hz) and differentiates."""
    q = sosfiltfilt(butter(2, 6.0 * 2.0 * TICK, output="sos"), q, axis=0, padlen=200)
    v = np.gradient(q, TICK, axis=0)
    return Motion(q, v, np.gradient(v, TICK, axis=0))


def _sines(t: Array, joints: int, slow: bool, rng: np.random.Generator) -> Array:
    """Three to five sines per joint, faded in over a second; a slow sweep has a tenth of the frequencies."""
    low, high = (0.02, 0.09) if slow else (0.08, 0.7)
    out = np.zeros((len(t), joints))
    for j in range(joints):
        for _ in range(int(rng.integers(3, 6))):
            f = np.exp(rng.uniform(np.log(low), np.log(high)))
            out[:, j] += (
                rng.uniform(0.3, 1.0) * np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) / np.sqrt(f)
            )
    fade = np.clip(t / 1.0, 0.0, 1.0)[:, None]
    return out * (3 * fade**2 - 2 * fade**3)


def _teleop(t: Array, joints: int, rng: np.random.Generator) -> Array:
    """A hand that wanders: white noise behind a low-pass at 0.3 to 0.7 Hz, with pauses of the hand."""
    cut = rng.uniform(0.3, 0.7)
    noise = rng.standard_normal((len(t) + 4000, joints))
    smooth = sosfiltfilt(butter(2, cut * 2.0 * TICK, output="sos"), noise, axis=0)[2000:-2000]
    fade = np.clip(t / 1.5, 0.0, 1.0)[:, None]
    path: Array = (smooth - smooth[:1]) * (3 * fade**2 - 2 * fade**3)
    return path


def _pick_place(t: Array, maker: Maker, rng: np.random.Generator) -> Array:
    """Trapezoids of speed between places, all joints at once, with pauses to grip."""
    joints = len(maker.middle)
    out = np.zeros((len(t), joints))
    here, k = rng.uniform(-1, 1, joints), round(0.3 / TICK)
    out[:k] = here
    while k < len(t):
        there = rng.uniform(-1, 1, joints)
        span, dwell = round(rng.uniform(1.0, 2.2) / TICK), round(rng.uniform(0.1, 0.7) / TICK)
        s = _trapezoid(np.arange(span) / span)[:, None]
        leg = np.concatenate([here + s * (there - here), np.repeat(there[None], dwell, axis=0)])
        out[k : k + len(leg)] = leg[: len(t) - k]
        here, k = there, k + len(leg)
    return out


def _trapezoid(s: Array) -> Array:
    """Share of the way after a share s of the time: a quarter speeds up, a quarter slows down."""
    up = np.minimum(s, 0.25)
    level = np.clip(s - 0.25, 0.0, 0.5)
    down = np.maximum(s - 0.75, 0.0)
    done: Array = (2.0 * up**2 + level + down - 2.0 * down**2) / 0.75
    return done


def _within(path: Array, maker: Maker, speed: float, rng: np.random.Generator) -> Array:
    """Scales each joint to a share of its reach, and below its speed; puts it about the arm's middle."""
    reach = np.array(maker.reach) * rng.uniform(0.5, 1.0, len(maker.reach))
    centre = np.array(maker.middle) + 0.15 * np.array(maker.reach) * rng.uniform(-1, 1, len(maker.reach))
    path = path - 0.5 * (path.max(axis=0) + path.min(axis=0))
    scale = reach / np.maximum(np.abs(path).max(axis=0), 1e-9)
    fastest = np.abs(np.diff(path, axis=0)).max(axis=0) / TICK * scale
    scale = scale * np.minimum(1.0, speed * np.array(maker.speed) / np.maximum(fastest, 1e-9))
    moved: Array = centre + path * scale
    return moved
