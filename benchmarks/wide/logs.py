# SPDX-License-Identifier: BSD-3-Clause
"""From the inner 1 kHz to what a user has: channels that were logged, at a rate, under a clock; written as episodes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.wide.arms import VELOCITY_FILTERS, WideArm
from benchmarks.wide.plan import PERIOD, RawLog
from benchmarks.wide.stamps import STAMPS, Rows, even
from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.metadata import episode_metadata

Array = NDArray[np.float64]

SPARE = 0.5
"""Seconds that are simulated beyond a recording, so that a fast clock finds something to read."""
COMMANDS = ("effort_command", "position_command")


def record(raw: RawLog, arm: WideArm, seed: int | None) -> tuple[dict[str, Array], Rows]:
    """Returns channels (samples, n) on the samples' own times, and the rows; without a seed the clock is even.

    Args:
        raw: Recording at 1 kHz.
        arm: Says what is logged and how its clocks are wrong.
        seed: Of the clock.
    """
    values, faults = arm.values, arm.faults
    period = 1.0 / float(values["rate"])
    last = (raw.position.shape[0] - 1) * PERIOD - SPARE
    times = np.arange(int(last / period)) * period
    rows = (even if seed is None else STAMPS[values["stamps"]])(times, np.random.default_rng(seed))
    seen = rows.taken / (1.0 + faults.clock)
    position = _at(raw.position, seen)
    channels: dict[str, Array] = {"position": position}
    velocity = _velocity(raw.position, seen, rows.taken, arm)
    if velocity is not None:
        channels["velocity"] = velocity
    streams = values["streams"]
    if streams != "command":
        channels["effort"] = _at(raw.effort, seen)
    if "command" in streams:
        channels["effort_command"], channels["position_command"] = (
            _held(raw.command, rows.taken),
            _held(raw.target, rows.taken),
        )
    return channels, Rows(rows.taken, rows.stamps * (1.0 + faults.stamps), rows.kept)


def _velocity(position: Array, seen: Array, taken: Array, arm: WideArm) -> Array | None:
    kind = arm.values["velocity"]
    if kind == "absent":
        return None
    lag = arm.faults.joint["velocity_lag"]
    if kind == "differenced":
        logged = np.gradient(_at(position, seen), taken, axis=0)
        return _lagged(logged, lag, float(np.median(np.diff(taken))))
    if kind == "filtered":
        speed = np.diff(position, axis=0, prepend=position[:1]) / PERIOD
        speed = _lagged(speed, np.full(lag.size, VELOCITY_FILTERS["filtered"]), PERIOD)
    else:
        speed = _observed(position)
    return _at(_lagged(speed, lag, PERIOD), seen)


def _observed(position: Array) -> Array:
    """Tracks positions with two poles at 60 Hz, damping 0.7: v' = w^2 (q - z), z' = v + 2 d w (q - z)."""
    w, d = 2 * np.pi * 60.0, 0.7
    z, v, speed = position[0].copy(), np.zeros(position.shape[1]), np.zeros_like(position)
    for k in range(position.shape[0]):
        error = position[k] - z
        v = v + PERIOD * w * w * error
        z = z + PERIOD * (v + 2 * d * w * error)
        speed[k] = v
    return speed


def _lagged(values: Array, lag: Array, period: float) -> Array:
    if not np.any(lag > 0.0):
        return values
    out = values.copy()
    for i, time in enumerate(lag):
        if time > 0.0:
            share = 1.0 - np.exp(-period / time)
            out[:, i] = lfilter([share], [1.0, share - 1.0], values[:, i])
    return out


def _at(values: Array, times: Array) -> Array:
    """Returns values at times, along straight lines between milliseconds."""
    index = np.clip(times / PERIOD, 0.0, values.shape[0] - 1.001)
    low = np.floor(index + 1e-9).astype(int)
    share = np.maximum(index - low, 0.0)[:, None]
    mixed = (1 - share) * values[low] + share * values[low + 1]
    return np.asarray(np.where(share < 1e-6, values[low], mixed))


def _held(values: Array, times: Array) -> Array:
    return values[np.clip(np.floor(times / PERIOD + 1e-9).astype(int), 0, values.shape[0] - 1)]


def save(path: Path, channels: Mapping[str, Array], rows: Rows, arm: WideArm, repeat_of: str | None) -> None:
    """Writes one episode file; nothing in it tells what was wrong with the arm."""
    table: dict[str, Array] = {"time": rows.stamps}
    for channel, values in channels.items():
        for i, joint in enumerate(arm.drive.joints):
            table[f"{channel}.{joint}"] = np.ascontiguousarray(values[rows.kept, i])
    gravity = arm.values["gravity"]
    metadata = episode_metadata(
        robot=arm.machine.name,
        episode=path.stem,
        effort_source=arm.sensing.effort_source if arm.sensing is not None else None,
        gravity_compensation="robot" if gravity.startswith("robot") else gravity,
        repeat_of=repeat_of,
        task=None,
    )
    write_episode(path, table, metadata)
