# SPDX-License-Identifier: BSD-3-Clause
"""What a user has of a motion: rounded, noisy, stamped by a busy computer, in the columns of some program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.stranger.machine import Trace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensors:
    """Resolutions, noises and habits of one robot and its logger."""

    encoder: float  # rad, one step of what is logged
    torque_noise: tuple[float, ...]  # N.m
    torque_step: float  # N.m, 0 if it is not rounded
    velocity: str  # none, difference, smoothed, observer
    velocity_noise: float  # rad/s, of an observer
    jitter: float  # s, of the stamps
    dropped: float  # share of rows that are missing
    bursts: bool  # now and then some rows are stamped late
    channels: str
    aim: bool  # set-points are logged
    style: str  # native, degrees, amps


@dataclass(frozen=True)
class Distortion:
    """What the recorder itself does wrong: lags of reported velocities [s], its clock, a late stream [s]."""

    lags: dict[int, float]
    ppm: float = 0.0
    apart: bool = False
    late: float = 0.0


def table(
    trace: Trace, s: Sensors, d: Distortion, rng: np.random.Generator
) -> tuple[Array, dict[str, Array]]:
    """Stamps [s] and quantities (rad, rad/s, N.m) of one recording."""
    rate = 1.0 / (trace.t[1] - trace.t[0])
    q = trace.q + 0.3 * s.encoder * rng.standard_normal(trace.q.shape)
    q = np.round(q / s.encoder) * s.encoder
    out = {"position": q}
    velocity = _velocity(trace, q, rate, s, d, rng)
    if velocity is not None:
        out["velocity"] = velocity
    for letter, efforts in (("S", trace.sensor), ("M", trace.motor)):
        if letter in s.channels:
            out["effort"] = _effort(_moved(efforts, trace.t, d), s, rng)
    if "C" in s.channels:
        out["effort_command"] = trace.command
    if s.aim:
        out["position_command"] = trace.aim
    stamps = trace.t * (1.0 if d.apart else 1.0 + d.ppm * 1e-6)
    stamps = _stamped(stamps, 1.0 / rate, s, rng)
    kept = _kept(len(stamps), s.dropped, rng)
    return stamps[kept], {name: x[kept] for name, x in out.items()}


def _velocity(
    trace: Trace, q: Array, rate: float, s: Sensors, d: Distortion, rng: np.random.Generator
) -> Array | None:
    """Reported velocity: none, backward differences, smoothed ones without lag, or an observer's."""
    if s.velocity == "none":
        return None
    if s.velocity == "difference":
        return np.diff(q, axis=0, prepend=2 * q[:1] - q[1:2]) * rate
    if s.velocity == "smoothed":
        low = butter(2, min(0.3 * rate, 25.0), fs=rate, output="sos")
        smooth: Array = sosfiltfilt(low, np.gradient(q, 1.0 / rate, axis=0), axis=0)
        return smooth
    v = trace.v.copy()
    for j, seconds in d.lags.items():
        v[:, j] = lagged(v[:, j], seconds * rate)
    return v + s.velocity_noise * rng.standard_normal(v.shape)


def lagged(x: Array, samples: float) -> Array:
    """A first-order lag of some samples, exact for a signal that is straight between them."""
    keep = np.exp(-1.0 / samples)
    share = samples * (1.0 - keep)
    out = np.empty_like(x)
    state = float(x[0])
    out[0] = state
    for k in range(1, len(x)):
        state = keep * state + (share - keep) * x[k - 1] + (1.0 - share) * x[k]
        out[k] = state
    return out


def _moved(efforts: Array, t: Array, d: Distortion) -> Array:
    """A stream with a clock of its own: at a row's stamp it holds what was a little earlier."""
    if not d.apart:
        return efforts
    source = t - d.late - t * d.ppm * 1e-6
    return np.column_stack([np.interp(source, t, e) for e in efforts.T])


def _effort(efforts: Array, s: Sensors, rng: np.random.Generator) -> Array:
    read = efforts + np.array(s.torque_noise) * rng.standard_normal(efforts.shape)
    return np.round(read / s.torque_step) * s.torque_step if s.torque_step else read


def _stamped(t: Array, period: float, s: Sensors, rng: np.random.Generator) -> Array:
    """Stamps of a computer that does other things too; they never run backwards."""
    t = t + np.minimum(np.abs(s.jitter * rng.standard_normal(len(t))), 0.45 * period)
    if s.bursts:
        for k in rng.integers(5, len(t) - 5, max(2, len(t) // 800)):
            t[k] += rng.uniform(0.3, 0.5) * period
    least = 2e-6 * np.arange(len(t))
    forward: Array = np.maximum.accumulate(t - least) + least
    return forward


def _kept(count: int, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    kept = np.ones(count, dtype=bool)
    if share > 0:
        kept[rng.random(count) < share] = False
        kept[:3] = kept[-3:] = True
    return kept


NATIVE = {
    k: f"{k}.{{joint}}" for k in ("position", "velocity", "effort", "effort_command", "position_command")
}
FOREIGN = {
    "position": "q_{joint}",
    "velocity": "dq_{joint}",
    "effort": "tau_{joint}",
    "effort_command": "tau_cmd_{joint}",
    "position_command": "q_des_{joint}",
}
DEGREES = 180.0 / np.pi


def write(
    path: Path, stamps: Array, quantities: dict[str, Array], joints: list[str], s: Sensors, amps: list[float]
) -> None:
    """A text table: in this project's own column names, in degrees and milliseconds, or in amperes."""
    names = NATIVE if s.style == "native" else FOREIGN
    header, columns = (
        ["time" if s.style == "native" else "stamp"],
        [stamps * (1e3 if s.style == "degrees" else 1.0)],
    )
    forms = ["%.4f" if s.style == "degrees" else "%.7f"]
    for name, values in quantities.items():
        scale = np.full(len(joints), 1.0)
        if s.style == "degrees" and name in ("position", "velocity", "position_command"):
            scale[:] = DEGREES
        if s.style == "amps" and name == "effort":
            scale = 1.0 / np.array(amps)
        header += [names[name].format(joint=j) for j in joints]
        columns += list((values * scale).T)
        forms += ["%.7f" if "position" in name else "%.6f"] * len(joints)
    separator = ";" if s.style == "degrees" else ","
    np.savetxt(
        path,
        np.column_stack(columns),
        fmt=forms,
        delimiter=separator,
        header=separator.join(header),
        comments="",
    )


def map_text(joints: list[str], s: Sensors, quantities: list[str], gravity: str, amps: list[float]) -> str:
    """The map that goes with a foreign table (docs/import.md)."""
    turned = s.style == "degrees"
    units = {"position": "deg" if turned else "rad", "velocity": "deg/s" if turned else "rad/s"}
    lines = ["format: 1", "robot: arm", "urdf: robot.urdf", f"joints: [{', '.join(joints)}]"]
    if "effort" in quantities:
        lines.append(f"effort_source: {'joint_sensor' if 'S' in s.channels else 'motor'}")
    lines += [
        f"gravity_compensation: {gravity}",
        "tables:",
        f"  - separator: {'semicolon' if turned else 'comma'}",
    ]
    lines += ["    header: true", f"    time: {{column: stamp, unit: {'ms' if turned else 's'}}}"]
    for name in quantities:
        unit = units.get(name, units["position"] if name == "position_command" else "N.m")
        more = ""
        if name == "effort" and s.style == "amps":
            unit = "A"
            more = f", gain: {{{', '.join(f'{j}: {g:.6g}' for j, g in zip(joints, amps, strict=True))}}}"
        lines.append(f'    {name}: {{columns: "{FOREIGN[name]}", unit: {unit}{more}}}')
    return "\n".join(lines) + "\n"
