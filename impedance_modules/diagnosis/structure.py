# SPDX-License-Identifier: BSD-3-Clause
r"""What a remainder of about the right power may still hide: a tone, a moment, a smooth function of the motion.

Whitened noise has a flat spectrum and no moment like another. With P(f) the periodogram summed over recordings and
E_k the power in half a second, max P / median P and max E / median E stay below about ten on clean recordings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.constancy import uneven
from impedance_modules.diagnosis.model_selection.acceptance import price
from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.regression.cleaned_signals import at_rest

Array = NDArray[np.float64]

TONE_MAX = 16.0
"""Largest power of one frequency over the median's that noise reaches."""

MOMENT_MAX = 20.0
"""Likewise of half a second."""

MOMENT = 0.5
"""[s]."""

SMOOTH_GAIN, SMOOTH_PART = 9.0, 0.05
"""Log-likelihood beyond its price, and part of a residual, that no stand-in finds in noise."""

STAND_INS = 6
"""So many of the best are tried."""


def structure(evidence: Evidence) -> str:
    """Says in words what is left beside noise; empty if nothing is."""
    bench = evidence.bench
    recordings = (*bench.fitted, *evidence.heldout)
    left = [bench.residuals(bench.whole.coefficients, r) for r in recordings]
    found = []
    small = evidence.rms(bench, recordings) <= evidence.negligible
    for g, (residual, joint) in enumerate(evidence.design.groups):
        if small[g]:
            continue
        name = f"{evidence.prepared[0].tree.joints[joint]} ({residual})"
        series = [values[g] for values in left]
        frequency, tone = _tone(series, evidence.design.rate)
        moment = _moment(series, evidence.design.rate)
        if tone > TONE_MAX:
            found.append((tone / TONE_MAX, f"a tone at {frequency:.2g} Hz is left on {name}"))
        if moment > MOMENT_MAX:
            found.append((moment / MOMENT_MAX, f"single moments stand out on {name}"))
    best = _smooth(evidence, small)
    if best is not None:
        residual, joint = evidence.design.groups[best.term.groups[0]]
        name = f"{evidence.prepared[0].tree.joints[joint]} ({residual})"
        part = 100.0 * best.reduction
        found.append(
            (1.0, f"a function of the joint's motion without physics takes {part:.0f} % more on {name}")
        )
    changing = uneven(evidence)
    if changing is not None:
        found.append((1.0 + changing[0], changing[1]))
    return max(found, default=(0.0, ""))[1]


def _tone(series: Sequence[Array], rate: float) -> tuple[float, float]:
    """Strongest frequency [Hz] and its power over the median's, all recordings together."""
    size = min(len(values) for values in series)
    power = np.sum([np.abs(np.fft.rfft(values[:size])) ** 2 for values in series], axis=0)
    place = int(np.argmax(power[1:])) + 1
    return place * rate / size, float(power[place] / max(np.median(power), 1e-24))


def _moment(series: Sequence[Array], rate: float) -> float:
    """Power of the strongest half second over the median's."""
    size = max(2, round(MOMENT * rate))
    blocks = [
        np.add.reduceat(values**2, np.arange(0, max(len(values) - size + 1, 1), size)) for values in series
    ]
    power = np.concatenate(blocks)
    return float(power.max() / max(np.median(power), 1e-24))


def _smooth(evidence: Evidence, small: NDArray[np.bool_]) -> CandidateTrial | None:
    """The stand-in that finds most beside the causes, if it finds anything; none of a joint that always stands still.

    What its encoder flickers is in its residual and in every function of its motion. Groups whose remainder is
    ``small`` beside the load do not count either.
    """
    still = np.all([at_rest(item.signals.position) for item in evidence.prepared], axis=0)
    selector, bench = evidence.selector, evidence.bench
    looks = [look for look in selector.screen.look(bench) if look.slot.shaped.candidate is None]
    trials = [selector.trial(bench, look.slot) for look in looks[:STAND_INS]]
    good = [
        trial
        for trial in trials
        if trial.gain - price(trial) > SMOOTH_GAIN
        and trial.reduction > SMOOTH_PART
        and not still[evidence.design.groups[trial.term.groups[0]][1]]
        and not small[trial.term.groups[0]]
    ]
    return max(good, key=lambda trial: trial.gain, default=None)
