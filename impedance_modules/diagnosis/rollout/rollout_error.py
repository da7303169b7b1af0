# SPDX-License-Identifier: BSD-3-Clause
r"""Errors of rollouts as numbers: rms before and after, the noise floor, growth, and whether a cause helps.

Noise floor from repeats, as for torques: half the mean square of the difference of two rollouts' errors, in
which everything cancels that the two recordings share. Without repeats, from the noise of the seed alone:

    \sigma_q^2 (t) = \sigma_q^2 (1 + f_c / f_N) + \sigma_v^2 t^2        \sigma_v(t)^2 = 2 \sigma_v^2
    \sigma_v^2 = \sigma_q^2 (2 \pi)^2 f_c^3 / (3 f_N)       white position noise behind a filter that ends at f_c

and, where a measured torque drives, from its white noise \sigma_e at rate f, M with the rotors that move along:

    \sigma_a^2 = (M^{-1})^2 \sigma_e^2, entry by entry
    \sigma_v^2 += \sigma_a^2 t / f        \sigma_q^2 += \sigma_a^2 t^3 / (3 f)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import (
    CauseRollout,
    ErrorGrowth,
    LeftOut,
    Rollout,
    RolloutError,
    RolloutTrace,
)
from impedance_modules.diagnosis.rollout.simulated_windows import WINDOW, RolloutWindow, WindowErrors

Array = NDArray[np.float64]
Mobility = Callable[[Array], Array] | None

SURE = 3.0
"""Standard errors by which a cause must change the rollouts' errors to be said to."""

WORTH = 0.05
"""Least logarithm of the errors' powers' ratio that counts as a change."""

SPARSELY = 50
"""Every which sample is asked for the joints' inertia."""

FLOOR_MIN = 1e-9
"""Below it a floor is the computer's round-off [rad]."""

GROWTH_EVERY = 4
"""Every which look is told in the growth over the horizon."""


@dataclass(frozen=True, eq=False)
class BeforeAfter:
    """Errors before and after, and the floors (n,) of position and velocity."""

    before: WindowErrors
    after: WindowErrors
    floors: tuple[Array, Array]


def summarise(  # noqa: PLR0917 - all of them are the outcome
    evidence: Evidence,
    drive: str,
    windows: Sequence[RolloutWindow],
    sides: BeforeAfter,
    floor: str,
    verdicts: Mapping[tuple[str, str], CauseRollout],
    left_out: tuple[LeftOut, ...],
) -> Rollout:
    """Puts the outcome together."""
    first = [rms(sides.before.position), rms(sides.before.velocity)]
    last = [rms(sides.after.position), rms(sides.after.velocity)]
    bodies = evidence.prepared[0].tree.bodies
    drifts = [
        {
            body.joint: RolloutError(
                float(first[k][i]),
                float(last[k][i]),
                float(sides.floors[k][i]),
                ("m" if body.prismatic else "rad") + ("/s" if k else ""),
            )
            for i, body in enumerate(bodies)
        }
        for k in range(2)
    ]
    scales = error_scales(sides.after, sides.floors)
    every = range(len(bodies))
    names = dict.fromkeys(evidence.prepared[window.recording].log.name for window in windows)
    return Rollout(
        drive=drive,
        window=WINDOW,
        windows=len(windows),
        episodes=tuple(names),
        floor=floor,
        position=drifts[0],
        velocity=drifts[1],
        growth=_growth(sides, [body.joint for body in bodies]),
        shrink=total_shrink(first, last, sides.floors),
        whole=judge(power(sides.before, scales, every), power(sides.after, scales, every)),
        causes=verdicts,
        left_out=left_out,
        traces=tuple(_trace(evidence, windows, sides, i) for i in range(len(bodies))),
    )


def rms(errors: Array) -> Array:
    """Root mean square over windows and looks, (n,)."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=(0, 1))))


def floor_of_repeats(errors: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    """Rms (n,) that repeats leave, from errors (W, L, n) and pairs of windows of one moment."""
    difference = np.array([errors[i] - errors[j] for i, j in pairs])
    return np.asarray(np.maximum(np.sqrt(0.5) * rms(difference), FLOOR_MIN))


def floor_of_seeds(prepared: Sequence[Prepared], time: Array, pushed: Mobility) -> tuple[Array, Array]:
    """Rms (n,) of position and velocity that noise of starts and driving torque gives, over a horizon (L,) [s].

    Args:
        prepared: Recordings.
        time: Of the horizon.
        pushed: Gives the squared entries (n, n) of M^{-1} at a position; None where a noiseless command drives.
    """
    position, velocity = [], []
    for item in prepared:
        nyquist = 0.5 * item.log.rate
        cutoff = min(item.band.motion_cutoff, 0.99 * nyquist)
        white = _white(item, item.log.position, item.signals.position, cutoff)
        drift = white * (2.0 * np.pi) ** 2 * cutoff**3 / (3.0 * nyquist)
        shaken = 0.0 * drift if pushed is None else _shaken(item, cutoff, pushed) / item.log.rate
        place_windows = drift * float(np.mean(time**2)) + shaken * float(np.mean(time**3)) / 3.0
        position.append(white * (1.0 + cutoff / nyquist) + place_windows)
        velocity.append(2.0 * drift + shaken * float(np.mean(time)))
    floors = [np.maximum(np.sqrt(np.mean(parts, axis=0)), FLOOR_MIN) for parts in (position, velocity)]
    return floors[0], floors[1]


def _white(item: Prepared, raw: Array, smooth: Array, cutoff: float) -> Array:
    """Variance (n,) of the white noise whose part above the filter is seen as roughness."""
    margin = item.band.margin
    rough = (raw - smooth)[margin : len(raw) - margin]
    return np.asarray(np.mean(rough**2, axis=0) / (1.0 - cutoff / (0.5 * item.log.rate)))


def _shaken(item: Prepared, cutoff: float, pushed: Callable[[Array], Array]) -> Array:
    """Variance (n,) of the acceleration that the driving torque's noise gives."""
    s, effort = item.signals, item.log.effort
    if effort is None or s.effort is None:
        return np.zeros(s.n)
    squared_mobility = np.mean([pushed(q) for q in s.position[::SPARSELY]], axis=0)
    return np.asarray(squared_mobility @ _white(item, effort, s.effort, cutoff))


def error_scales(after: WindowErrors, floors: tuple[Array, Array]) -> tuple[Array, Array]:
    """What errors are measured by, (n,) each: the noise floor, or what all causes together leave, if that is more."""
    return (
        np.maximum(floors[0], rms(after.position)),
        np.maximum(floors[1], rms(after.velocity)),
    )


def power(lived: WindowErrors, scales: tuple[Array, Array], joints: Sequence[int]) -> Array:
    """Error power of each window (W,) over the error_scales', mean over some joints, position and velocity together."""
    parts = [
        np.mean(errors**2, axis=1) / stick**2
        for errors, stick in zip((lived.position, lived.velocity), scales, strict=True)
    ]
    return np.asarray(0.5 * (parts[0] + parts[1])[:, list(joints)].mean(axis=1))


def judge(without: Array, with_it: Array) -> CauseRollout:
    """Compares window by window (W,) what happens without a cause and with it, by the powers' ratios.

    Ratios, because a window in which the arm hardly moves says little and one at full speed much.
    """
    change = np.log(without) - np.log(with_it)
    error = float(np.std(change, ddof=1) / np.sqrt(len(change))) if len(change) > 1 else float("inf")
    mean = float(np.mean(change))
    clear = abs(mean) > SURE * error and abs(mean) > WORTH
    verdict = "no difference" if not clear else "helps" if mean > 0.0 else "worsens"
    return CauseRollout(float(np.mean(without)), float(np.mean(with_it)), float(np.exp(mean)), error, verdict)


def total_shrink(before: Sequence[Array], after: Sequence[Array], floors: Sequence[Array]) -> float | None:
    """The joints' ratio, squares summed after dividing each by its floor's; None without a gap."""
    start, left = 0.0, 0.0
    for first, last, floor in zip(before, after, floors, strict=True):
        gap = first > floor
        start += float(np.sum(np.clip(first**2 / floor**2 - 1.0, 0.0, None)))
        left += float(np.sum(np.clip(last**2 / floor**2 - 1.0, 0.0, None)[gap]))
    return None if start <= 0.0 else 1.0 - float(np.sqrt(left / start))


def _growth(sides: BeforeAfter, joints: Sequence[str]) -> ErrorGrowth:
    picked = slice(GROWTH_EVERY - 1, None, GROWTH_EVERY)

    def told(lived: WindowErrors) -> dict[str, tuple[float, ...]]:
        over = np.sqrt(np.mean(lived.position**2, axis=0))[picked]
        return {joint: tuple(map(float, over[:, i])) for i, joint in enumerate(joints)}

    return ErrorGrowth(tuple(map(float, sides.before.time[picked])), told(sides.before), told(sides.after))


def _trace(
    evidence: Evidence, windows: Sequence[RolloutWindow], sides: BeforeAfter, joint: int
) -> RolloutTrace:
    """The window of one joint that the nominal plant misses most, seen from its seed on."""
    worst = int(np.argmax(np.mean(sides.before.position[:, :, joint] ** 2, axis=1)))
    window = windows[worst]
    item = evidence.prepared[window.recording]
    time = item.signals.time[0] + window.start + sides.before.time
    measured = np.interp(time, item.signals.time, item.log.position[:, joint])
    return RolloutTrace(
        joint=item.tree.joints[joint],
        episode=item.log.name,
        time=time,
        measured=measured,
        before=measured + sides.before.position[worst, :, joint],
        after=measured + sides.after.position[worst, :, joint],
    )
