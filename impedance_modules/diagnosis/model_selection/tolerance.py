# SPDX-License-Identifier: BSD-3-Clause
r"""What is seen but does not matter: gaps within a stated share of each joint's torque that change no simulated motion.

With good sensors and long recordings, torques of a thousandth of a joint's range are certain. Nobody is warned of them:

    \tau_{rms} \le s (\tau_{max} - \tau_{min})      for every joint and residual,

\tau a cause's torque in each recording, rms and range by itself: a joint that carries much in one recording excuses
nothing in another; or what remains beside the noise, over all recordings, as the noise is. The range is that of the
joint's torque (of reported velocities, that of its speed), s the tolerance. And the simulated motion must be as good
without each cause as with it, and with all of them, where something remains, as near to the recorded one as its noise
or the same share of the joint's motion allows; what remains in reported velocities alone changes none, as nothing is
simulated with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.stats import chi2

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.cause_search import SIGMA
from impedance_modules.diagnosis.model_selection.conclusion import verdict_of
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.external_pushes import torque_of
from impedance_modules.diagnosis.model_selection.lack_of_fit import ALPHA, MOMENT
from impedance_modules.diagnosis.model_selection.naming import SHARE_THAT_MATTERS, ranked_terms
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import Cause, Diagnosis, Remainder
from impedance_modules.diagnosis.rollout_result import Rollout
from impedance_modules.effects.external_contact import ExternalContact
from impedance_modules.effects.residual_kinds import uses_motion

CHANGED = 1.21
"""Power of the simulated motion's error without a cause over that with it, from which the cause changes the motion."""

DRIFT = 1.5
"""Simulated error over its noise, beyond which what remains changes the motion."""


def set_small_aside(found: Diagnosis, evidence: Evidence, tolerance: float) -> Diagnosis:
    """Lists as small what does not matter: all of a gap, or minor causes and a remainder beside the others.

    Beside a cause that matters, another is minor only if it also explains little of the gap's torque, and a remainder
    is small only if little of the gap is left, by all causes: a gap that is half explained is not explained, however
    small it is.

    Args:
        found: With its rollouts.
        evidence: The fit.
        tolerance: s; 0 leaves everything as it is.
    """
    found = replace(found, tolerance=tolerance)
    if tolerance == 0.0 or found.verdict == "no_gap":
        return found
    limits = tolerance * ranges(evidence.prepared, evidence.design.groups)
    each = tolerance * np.array([ranges([item], evidence.design.groups) for item in evidence.prepared])
    small = [cause for cause in found.causes if is_small(cause, evidence, each)]
    nothing = len(small) == len(found.causes)
    alike = found.remainder.of_velocities or stays_near(found.rollout, _near(found, evidence, tolerance))
    passes = found.remainder.explained or (_left_is_small(found, evidence, limits) and alike)
    if nothing:
        return _without_gap(found) if passes else found
    parts = parts_of_torque(evidence)
    minor = tuple(c for c in small if parts.get((c.effect, c.port), 0.0) < SHARE_THAT_MATTERS)
    kept = tuple(cause for cause in found.causes if cause not in minor)
    aside = sum(cause.weight for cause in minor)
    half = found.unexplained_weight >= SHARE_THAT_MATTERS and not found.remainder.of_velocities
    found = replace(found, causes=kept, small=minor, unexplained_weight=found.unexplained_weight + aside)
    if found.remainder.explained or not passes or half:
        return found
    remainder = _within(found)
    return replace(found, remainder=remainder, verdict=verdict_of(kept, remainder, near=True))


def _without_gap(found: Diagnosis) -> Diagnosis:
    return replace(found, verdict="no_gap", causes=(), small=found.causes, remainder=_within(found))


def _within(found: Diagnosis) -> Remainder:
    words = f"; within the tolerance of {100.0 * found.tolerance:.3g} % of each joint's torque range"
    return replace(found.remainder, explained=True, structure=found.remainder.structure + words)


def _left_is_small(found: Diagnosis, evidence: Evidence, limits: Array) -> bool:
    """Whether what remains beside noise is within the limits (groups,) in every comparison that does not pass as noise.

    Where none is known, in all of them. What lasts for a moment is judged while it lasts: what noise reaches in one
    moment of all is allowed.
    """
    joints, failing = evidence.prepared[0].tree.joints, found.remainder.failing
    judged = [
        not failing or (residual, joints[joint]) in failing for residual, joint in evidence.design.groups
    ]
    size, series = max(2, round(MOMENT * evidence.design.rate)), _left_rows(evidence)
    reached = np.array([largest_moment(rows, size, ALPHA / len(series)) for rows in series])
    noise = reached * np.mean(evidence.floor.rms**2, axis=0)
    calm = np.array([loudest_moment(rows, size) for rows in series]) <= limits**2 + noise
    return bool(np.all(((beside_noise(evidence) <= limits) & calm)[judged]))


def beside_noise(evidence: Evidence) -> Array:
    """(groups,) rms of what the model leaves of all recordings beside their noise, in each group's unit."""
    left = evidence.rms(evidence.model_fit, range(len(evidence.prepared)))
    noise = np.mean(evidence.floor.rms**2, axis=0)
    return np.asarray(np.sqrt(np.clip(left**2 - noise, 0.0, None)))


def loudest_moment(series: Sequence[Array], size: int) -> float:
    """Gives the largest mean square of ``size`` samples in a row; zero where no recording has so many."""
    moments = [sliding_window_view(rows, size) for rows in series if len(rows) >= size]
    return max((float(np.mean(windows**2, axis=1).max()) for windows in moments), default=0.0)


def largest_moment(series: Sequence[Array], size: int, chance: float) -> float:
    r"""Gives the mean square that no moment of noise exceeds, in units of its power, but by chance.

    The mean square of k samples with the correlations \rho_i scatters as that of

        m = k / (1 + 2 \sum_{i < k} (1 - i / k) \rho_i^2)

    samples without correlation; its quantile is \chi^2_{1 - \alpha / w}(m) / m, w the number of such samples in all, as
    many as there are moments that differ.

    Args:
        series: Noise, one array per recording.
        size: k, samples of a moment, two at least.
        chance: \alpha, probability that any moment exceeds it.
    """
    products = np.zeros(size)
    for rows in series:
        lags = min(size, len(rows))
        products[:lags] += [float(rows[i:] @ rows[: len(rows) - i]) for i in range(lags)]
    correlation = products[1:] / max(products[0], np.finfo(float).tiny)
    share = 1.0 - np.arange(1, size) / size
    independent = size / (1.0 + 2.0 * float(correlation**2 @ share))
    moments = max(sum(map(len, series)) * independent / size, 1.0)
    return float(chi2.isf(chance / moments, independent) / independent)


def _left_rows(evidence: Evidence) -> list[list[Array]]:
    """What the model leaves of each recording in the rows that count: group -> recording -> (m,), in its unit.

    Moments that no law has count here: they are small only if they are.
    """
    left = [evidence.plain.left(evidence.model_fit, r) for r in range(len(evidence.prepared))]
    groups = range(len(evidence.design.groups))
    return [
        [one[g][evidence.counted(r, g) | evidence.disturbed_rows(r, g)] for r, one in enumerate(left)]
        for g in groups
    ]


def is_small(cause: Cause, evidence: Evidence, limits: Array) -> bool:
    """Whether a cause's torque is within the limits (recordings, groups), and the simulated motion needs it not."""
    shown = cause.rollout
    # Fewer standard errors than a cause needs to be called a help: what probably changes the motion is not small.
    if shown is not None and shown.ratio >= max(CHANGED, np.exp(SIGMA * shown.standard_error)):
        return False
    powers = torque_powers(cause, evidence)
    if powers:
        return all(bool(np.all(np.sqrt(power) <= limits[:, group])) for power, group in powers)
    return cause.effect == ExternalContact.description.id and _small_pushes(evidence, limits)


def torque_powers(cause: Cause, evidence: Evidence) -> list[tuple[Array, int]]:
    """(recordings,) mean square of the torque of each of a cause's terms, and a group where it acts."""
    model_fit, found = evidence.model_fit, []
    for index, term in enumerate(model_fit.model):
        if (term.key[0], term.key[2]) != (cause.effect, cause.port):
            continue
        torques = [evidence.plain.torque(model_fit, index, r) for r in range(len(evidence.prepared))]
        found += [
            (np.array([np.mean(torque[group] ** 2) for torque in torques]), group) for group in term.groups
        ]
    return found


def parts_of_torque(evidence: Evidence) -> dict[tuple[str, str], float]:
    """Effect and port -> part of the gap's torque that is explained by it; none of pushes, which are no term.

    Weights are in units of the noise, where a joint's own noise is small beside its torque; here a torque counts by
    its size.
    """
    gains: dict[tuple[str, str], float] = {}
    for term, gain in ranked_terms(evidence, evidence.excess_torque):
        key = (term.key[0], term.key[2])
        gains[key] = gains.get(key, 0.0) + gain
    before, after = evidence.excess_torque(None), evidence.excess_torque(evidence.model_fit)
    explained = max(0.0, 1.0 - after / before) if before > 0.0 else 0.0
    total = sum(gains.values())
    return {key: explained * gain / total for key, gain in gains.items()}


def _small_pushes(evidence: Evidence, limits: Array) -> bool:
    """Whether the torque J^T f of every push, rms while it lasts, is within the limits (recordings, groups)."""
    seen = [(g, joint) for g, (residual, joint) in enumerate(evidence.design.groups) if uses_motion(residual)]
    for push in evidence.pushes:
        torque = torque_of(push, evidence.prepared[push.recording])
        if any(torque[joint] > limits[push.recording, g] for g, joint in seen):
            return False
    return bool(evidence.pushes)


def stays_near(rollout: Rollout, near: Mapping[str, float]) -> bool:
    """Whether the simulated motion with all causes is about as near to the recorded one as its noise allows.

    Args:
        rollout: The motion.
        near: Joint that is judged -> error that counts as near, whatever the noise [rad or m].
    """
    return all(
        drift.refitted <= max(DRIFT * drift.noise_floor, near[joint])
        for joint, drift in rollout.position.items()
        if joint in near
    )


def _near(found: Diagnosis, evidence: Evidence, share: float) -> dict[str, float]:
    """Joint -> a share of the range of its position over all recordings [rad or m]; where something remains.

    Errors of other joints come from elsewhere, links that are not quite known: all joints only where none is known.
    """
    joints = evidence.prepared[0].tree.joints
    travel = np.ptp(np.concatenate([item.position for item in evidence.prepared]), axis=0)
    failing = {joint for _, joint in found.remainder.failing} or set(joints)
    return {
        joint: share * float(moved) for joint, moved in zip(joints, travel, strict=True) if joint in failing
    }


def ranges(prepared: Sequence[Prepared], groups: Sequence[Group]) -> Array:
    """(groups,) range of each joint's torque over recordings [N.m], or of its speed for reported velocities."""
    torque, speed = (
        np.ptp(np.concatenate(values), axis=0)
        for values in ([item.load for item in prepared], [item.velocity for item in prepared])
    )
    return np.array([speed[joint] if residual == "velocity" else torque[joint] for residual, joint in groups])
