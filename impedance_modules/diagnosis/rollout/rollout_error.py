# SPDX-License-Identifier: BSD-3-Clause
r"""Errors of rollouts: rms before and after, noise floor, growth over the horizon, and the verdict per cause.

Noise floor from repeats, as for torques: half the mean square of the difference of two rollouts' errors, in which
everything common to both recordings cancels. Without repeats, from the noise of the initial state alone:

    \sigma_q^2 (t) = \sigma_q^2 (1 + f_c / f_N) + \sigma_v^2 t^2        \sigma_v(t)^2 = 2 \sigma_v^2
    \sigma_v^2 = \sigma_q^2 (2 \pi)^2 f_c^3 / (3 f_N)       white position noise behind a filter that ends at f_c

and, if a measured torque drives the plant, from its white noise \sigma_e at rate f, M with the rotors included:

    \sigma_a^2 = (M^{-1})^2 \sigma_e^2, entry by entry
    \sigma_v^2 += \sigma_a^2 t / f        \sigma_q^2 += \sigma_a^2 t^3 / (3 f)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.gap_result import total_shrink
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.rollout.simulated_windows import WINDOW, RolloutWindow, WindowErrors
from impedance_modules.diagnosis.rollout_result import (
    CauseRollout,
    ErrorGrowth,
    LeftOut,
    Rollout,
    RolloutError,
    RolloutTrace,
)

Mobility = Callable[[Array], Array] | None

STANDARD_ERRORS = 3.0
"""Standard errors by which a cause must change the rollouts' errors."""

LOG_RATIO_MIN = 0.05
"""Least logarithm of the ratio of error powers that counts as a change."""

INERTIA_EVERY = 50
"""The inertia is evaluated at every so many samples."""

FLOOR_MIN = 1e-9
"""Least noise floor: round-off [rad]."""

GROWTH_EVERY = 4
"""Every so many times of a window the growth is reported."""


@dataclass(frozen=True, eq=False)
class BeforeAfter:
    """Errors before, with the causes alone, and with links and weights refitted beside them; floors (n,) of both.

    The floors are those of position and velocity.
    """

    before: WindowErrors
    after: WindowErrors
    refitted: WindowErrors
    floors: tuple[Array, Array]


def summarise(  # noqa: PLR0917 - all of them are the outcome
    evidence: Evidence,
    drive: str,
    windows: Sequence[RolloutWindow],
    outcome: BeforeAfter,
    floor: str,
    verdicts: Mapping[tuple[str, str], CauseRollout],
    left_out: tuple[LeftOut, ...],
) -> Rollout:
    """Puts the result of all rollouts together."""
    first = [rms(outcome.before.position), rms(outcome.before.velocity)]
    last = [rms(outcome.after.position), rms(outcome.after.velocity)]
    refitted = [rms(outcome.refitted.position), rms(outcome.refitted.velocity)]
    bodies = evidence.prepared[0].tree.bodies
    errors = [
        {
            body.joint: RolloutError(
                float(first[k][i]),
                float(last[k][i]),
                float(refitted[k][i]),
                float(outcome.floors[k][i]),
                ("m" if body.prismatic else "rad") + ("/s" if k else ""),
            )
            for i, body in enumerate(bodies)
        }
        for k in range(2)
    ]
    scales = error_scales(outcome.refitted, outcome.floors)
    every = range(len(bodies))
    names = dict.fromkeys(evidence.prepared[window.recording].log.name for window in windows)
    return Rollout(
        drive=drive,
        window=WINDOW,
        windows=len(windows),
        episodes=tuple(names),
        floor=floor,
        position=errors[0],
        velocity=errors[1],
        growth=_growth(outcome, [body.joint for body in bodies]),
        shrink=total_shrink(*map(np.concatenate, (first, last, outcome.floors))),
        whole=judge(power(outcome.before, scales, every), power(outcome.refitted, scales, every)),
        causes=verdicts,
        left_out=left_out,
        traces=tuple(_trace(evidence, windows, outcome, i) for i in range(len(bodies))),
    )


def rms(errors: Array) -> Array:
    """Root mean square over windows and times, (n,)."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=(0, 1))))


def floor_of_repeats(errors: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    """Noise floor (n,) from errors (W, L, n) and pairs of windows at the same time of two repeats."""
    difference = np.array([errors[i] - errors[j] for i, j in pairs])
    return np.asarray(np.maximum(np.sqrt(0.5) * rms(difference), FLOOR_MIN))


def floor_of_seeds(prepared: Sequence[Prepared], time: Array, mobility: Mobility) -> tuple[Array, Array]:
    """Rms (n,) of position and velocity from noise of initial state and driving torque, over a horizon (L,) [s].

    Args:
        prepared: Recordings.
        time: Of the horizon.
        mobility: Position -> squared entries (n, n) of M^{-1}; None where a noiseless command drives.
    """
    position, velocity = [], []
    for item in prepared:
        nyquist = 0.5 * item.log.rate
        cutoff = min(item.band.motion_cutoff, 0.99 * nyquist)
        white = _white_noise(item, item.log.position, item.signals.position, cutoff)
        drift = white * (2.0 * np.pi) ** 2 * cutoff**3 / (3.0 * nyquist)
        driven = (
            0.0 * drift if mobility is None else _acceleration_noise(item, cutoff, mobility) / item.log.rate
        )
        spread = drift * float(np.mean(time**2)) + driven * float(np.mean(time**3)) / 3.0
        position.append(white * (1.0 + cutoff / nyquist) + spread)
        velocity.append(2.0 * drift + driven * float(np.mean(time)))
    floors = [np.maximum(np.sqrt(np.mean(parts, axis=0)), FLOOR_MIN) for parts in (position, velocity)]
    return floors[0], floors[1]


def _white_noise(item: Prepared, raw: Array, smooth: Array, cutoff: float) -> Array:
    """Variance (n,) of white noise, from its part above the filter's cutoff."""
    margin = item.band.margin
    beyond = (raw - smooth)[margin : len(raw) - margin]
    return np.asarray(np.mean(beyond**2, axis=0) / (1.0 - cutoff / (0.5 * item.log.rate)))


def _acceleration_noise(item: Prepared, cutoff: float, mobility: Callable[[Array], Array]) -> Array:
    """Variance (n,) of the acceleration from the driving torque's noise."""
    s, effort = item.signals, item.log.effort
    if effort is None or s.effort is None:
        return np.zeros(s.n)
    squared_mobility = np.mean([mobility(q) for q in s.position[::INERTIA_EVERY]], axis=0)
    return np.asarray(squared_mobility @ _white_noise(item, effort, s.effort, cutoff))


def error_scales(after: WindowErrors, floors: tuple[Array, Array]) -> tuple[Array, Array]:
    """Units of errors, (n,) each: the noise floor or, if larger, the remainder with all causes."""
    return (
        np.maximum(floors[0], rms(after.position)),
        np.maximum(floors[1], rms(after.velocity)),
    )


def power(found: WindowErrors, scales: tuple[Array, Array], joints: Sequence[int]) -> Array:
    """Error power of each window (W,) in units of the scales, mean over some joints, position and velocity together."""
    parts = [
        np.mean(errors**2, axis=1) / scale**2
        for errors, scale in zip((found.position, found.velocity), scales, strict=True)
    ]
    return np.asarray(0.5 * (parts[0] + parts[1])[:, list(joints)].mean(axis=1))


def judge(without: Array, with_it: Array) -> CauseRollout:
    """Compares error powers without and with a cause, window by window (W,), by their ratios.

    Ratios, because a window in which the arm hardly moves says little and one at full speed much.
    """
    change = np.log(without) - np.log(with_it)
    error = float(np.std(change, ddof=1) / np.sqrt(len(change))) if len(change) > 1 else float("inf")
    mean = float(np.mean(change))
    clear = abs(mean) > STANDARD_ERRORS * error and abs(mean) > LOG_RATIO_MIN
    verdict = "no difference" if not clear else "helps" if mean > 0.0 else "worsens"
    return CauseRollout(float(np.mean(without)), float(np.mean(with_it)), float(np.exp(mean)), error, verdict)


def _growth(outcome: BeforeAfter, joints: Sequence[str]) -> ErrorGrowth:
    picked = slice(GROWTH_EVERY - 1, None, GROWTH_EVERY)

    def grown(found: WindowErrors) -> dict[str, tuple[float, ...]]:
        over = np.sqrt(np.mean(found.position**2, axis=0))[picked]
        return {joint: tuple(map(float, over[:, i])) for i, joint in enumerate(joints)}

    return ErrorGrowth(
        tuple(map(float, outcome.before.time[picked])), grown(outcome.before), grown(outcome.after)
    )


def _trace(
    evidence: Evidence, windows: Sequence[RolloutWindow], outcome: BeforeAfter, joint: int
) -> RolloutTrace:
    """One joint's window with the largest error of the nominal plant."""
    worst = int(np.argmax(np.mean(outcome.before.position[:, :, joint] ** 2, axis=1)))
    window = windows[worst]
    item = evidence.prepared[window.recording]
    time = item.signals.time[0] + window.start + outcome.before.time
    measured = np.interp(time, item.signals.time, item.log.position[:, joint])
    return RolloutTrace(
        joint=item.tree.joints[joint],
        episode=item.log.name,
        time=time,
        measured=measured,
        before=measured + outcome.before.position[worst, :, joint],
        after=measured + outcome.after.position[worst, :, joint],
    )
