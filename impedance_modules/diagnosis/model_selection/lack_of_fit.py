# SPDX-License-Identifier: BSD-3-Clause
r"""Lack of fit: whether the remainder is noise, by its power and by its structure. It decides the verdict.

    F_g = S_g / n_g,      S_g squares by what the fit can foretell with its parameters' own uncertainty

in whitened rows, on recordings that no fit has used (`regression.prediction`), and on all. The limit is that of
Fisher's F test for the samples here and in the noise floor, all groups together, or the negligible part of the
joint's load where that is larger.

The remainder has structure if its spectrum has a peak, if single moments exceed the others, if held-out recordings
need what a controller asks for as its answer to a torque that no cause has (`Effect.contradicted`), or if a cause
varies along its joint's position q as

    r = \tau(t) (1 + a \sin N q + b \cos N q),      \tau the torque of an accepted cause at its joint.

With P(f) the periodogram summed over recordings and E_k the power in half a second, both are compared with a median,
that of the neighbouring frequencies or of all moments, or with white noise of unit power where that is more:

    P(f) / max(median P, n ln 2),      E_k / max(median E, n_k)

stay below about ten on clean recordings, n and n_k the numbers of samples. (A line stands out of its neighbours; noise
whose colour is known only roughly is high over a range of frequencies. What is below the noise is no finding.)
The orders N go from one period over the travel to what the sampling can follow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.stats import f as fisher

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.regression.model_fit import ModelTerm
from impedance_modules.diagnosis.regression.prediction import foretold_squares

ALPHA = 0.002
"""Probability that a correct model fails, all groups together."""

SYSTEMATIC = 1.45
"""Allowed ratio of power to noise from approximations of the model (differences, held commands, filters)."""

RMS_MIN = 1e-24
"""Least rms, against division by zero."""

ORDERS = 30
"""Orders tried at most."""

SPACING = 2.5
"""Phase over the travel between two orders [rad]."""

PHASE_STEP_MAX = 1.0
"""Largest phase from one sample to the next [rad]."""

GAIN, PART = 12.0, 0.05
"""Least penalised log-likelihood gain, and part of the residual, of a variation that is reported."""

TONE_MAX = 16.0
"""Largest ratio of one frequency's power to its neighbours' median that noise reaches."""

NEIGHBOURS = 41
"""Frequencies of which a median is taken: enough that noise changes it by less than a third."""

MOMENT_MAX = 20.0
"""Largest ratio of the power in half a second to the median that noise reaches."""

MOMENT = 0.5
"""Length of a moment [s]."""


@dataclass(frozen=True, order=True)
class RemainingStructure:
    """Something in a remainder that is no noise.

    Attributes:
        prominence: Over what noise reaches; structures of different kinds are ordered by it.
        words: For the reader.
        group: Index of the group.
    """

    prominence: float
    words: str
    group: int


@dataclass(frozen=True, eq=False)
class LackOfFit:
    """The test's outcome.

    Attributes:
        ratio: (groups,) residual power over expected power.
        limit: (groups,) largest ratio that passes.
        structures: What of the remainder is no noise, the most prominent first.
    """

    ratio: Array
    limit: Array
    structures: tuple[RemainingStructure, ...]

    @property
    def structure(self) -> str:
        """The most prominent structure in words; empty if there is none."""
        return self.structures[0].words if self.structures else ""

    @property
    def failing(self) -> frozenset[int]:
        """Indices of the groups whose remainder is more than noise."""
        beyond = np.flatnonzero(self.ratio > self.limit)
        return frozenset([*map(int, beyond), *(structure.group for structure in self.structures)])

    @property
    def passed(self) -> bool:
        """Whether the remainder is only noise."""
        return not self.failing


def lack_of_fit(evidence: Evidence) -> LackOfFit:
    """Tests the residuals of the accepted model, on the held-out recordings and on all."""
    rescale = evidence.design.whitening.innovation / evidence.floor.innovation
    foretold, fitted = _foretold_squares(evidence, rescale), _fitted_squares(evidence, rescale)
    heldout = _ratios(evidence, foretold, evidence.heldout)
    everything = _ratios(evidence, foretold + fitted, _all_recordings(evidence))
    ratio, limit = _worse(heldout, everything)
    return LackOfFit(ratio, limit, find_structure(evidence))


def _worse(one: Array, other: Array) -> Array:
    """Of ratios and limits (2, groups) those of the test that each group passes by less."""
    return np.where(one[0] / one[1] >= other[0] / other[1], one, other)


def _ratios(evidence: Evidence, squares: Array, recordings: Sequence[int]) -> Array:
    """Power of some squares over the noise's, and its limit, (2, groups)."""
    whitening, counts = evidence.design.whitening, evidence.design.count(recordings)
    chance = 1.0 - ALPHA / len(counts)
    factors = SYSTEMATIC * evidence.floor.doubt
    small = (evidence.negligible / np.maximum(evidence.rms(evidence.model_fit, recordings), RMS_MIN)) ** 2
    ratios = squares / counts
    limits = np.maximum(factors * fisher.ppf(chance, counts, whitening.samples), ratios * small)
    return np.stack([ratios, limits])


def _fitted_squares(evidence: Evidence, rescale: Array) -> Array:
    """(groups,) squares of what the fit leaves of the recordings that it has seen, in units of the floor's noise."""
    model_fit = evidence.model_fit
    parts = [
        [float(values @ values) * rescale[r, g] ** 2 for g, values in enumerate(model_fit.left_of(r))]
        for r in model_fit.fitted
    ]
    return np.asarray(np.sum(parts, axis=0))


def _foretold_squares(evidence: Evidence, rescale: Array) -> Array:
    """(groups,) squares of what it leaves of the held-out ones, by what its links and causes can foretell of them."""
    model_fit = evidence.model_fit
    left, columns = [], []
    A = model_fit.whole.normal.copy()
    for r in evidence.heldout:
        residuals = model_fit.residuals(model_fit.whole.coefficients, r)
        left.append([values * rescale[r, g] for g, values in enumerate(residuals)])
        columns.append([block * rescale[r, g] for g, block in enumerate(model_fit.rows[r])])
        for block, ids in zip(columns[-1], model_fit.ids, strict=True):
            A[np.ix_(ids, ids)] += block.T @ block
    ones = np.ones(len(model_fit.ids))
    return foretold_squares(left, columns, model_fit.ids, ones, np.asarray(np.linalg.inv(A)))


def find_structure(evidence: Evidence) -> tuple[RemainingStructure, ...]:
    """Describes what of the remainder is no noise, the most prominent first."""
    small = evidence.rms(evidence.model_fit, _all_recordings(evidence)) <= evidence.negligible
    found = list(_tones_and_moments(evidence, small))
    found.extend(_disturbances(evidence))
    found.extend(_answers(evidence, small))
    changing = position_dependence(evidence)
    if changing is not None:
        found.append(replace(changing, prominence=1.0 + changing.prominence))
    return tuple(sorted(found, reverse=True))


def _tones_and_moments(evidence: Evidence, small: NDArray[np.bool_]) -> Iterator[RemainingStructure]:
    """Lines and single moments in each group that is not ``small`` beside its load."""
    model_fit, rate = evidence.model_fit, evidence.design.rate
    left = [model_fit.residuals(model_fit.whole.coefficients, r) for r in _all_recordings(evidence)]
    for g in np.flatnonzero(~small):
        series, group = [values[g] for values in left], int(g)
        frequency, tone = _tone(series, rate)
        moment = moment_ratio(series, rate)
        if tone > TONE_MAX:
            words = f"a tone at {frequency:.2g} Hz remains on {_name(evidence, group)}"
            yield RemainingStructure(tone / TONE_MAX, words, group)
        if moment > MOMENT_MAX:
            words = f"single moments exceed the noise on {_name(evidence, group)}"
            yield RemainingStructure(moment / MOMENT_MAX, words, group)


def _disturbances(evidence: Evidence) -> Iterator[RemainingStructure]:
    """Joints on which a moment was left out that no law has."""
    if not evidence.disturbed:
        return
    powers = evidence.disturbed_powers()
    for g in np.flatnonzero((powers > 0.0) & (powers >= min(float(powers.max()), MOMENT_MAX))):
        words = f"single moments exceed the noise on {_name(evidence, int(g))}"
        yield RemainingStructure(max(float(powers[g]) / MOMENT_MAX, 1.0), words, int(g))


def _answers(evidence: Evidence, small: NDArray[np.bool_]) -> Iterator[RemainingStructure]:
    """A joint whose controller answers a torque that no cause has: held-out recordings need what it asks for."""
    refusal = evidence.refusal
    if refusal is None or refusal.reason != evidence.selector.plausibility.contradiction(refusal.trial):
        return
    for g in refusal.trial.term.groups:
        if not small[g]:
            words = f"the controller answers a torque that no cause has on {_name(evidence, g)}"
            yield RemainingStructure(1.0 + refusal.trial.reduction, words, g)


def _all_recordings(evidence: Evidence) -> tuple[int, ...]:
    return (*evidence.model_fit.fitted, *evidence.heldout)


def _name(evidence: Evidence, group: int) -> str:
    residual, joint = evidence.design.groups[group]
    return f"{evidence.prepared[0].tree.joints[joint]} ({residual})"


def _tone(series: Sequence[Array], rate: float) -> tuple[float, float]:
    """Frequency [Hz] that stands out most of its neighbours and of unit noise, and by what factor of power."""
    size = min(len(values) for values in series)
    power = np.sum([np.abs(np.fft.rfft(values[:size])) ** 2 for values in series], axis=0)[1:]
    noise = np.log(2.0) * size * len(series)
    ratio = power / np.maximum(median_filter(power, NEIGHBOURS, mode="nearest"), noise)
    place = int(np.argmax(ratio))
    return (place + 1) * rate / size, float(ratio[place])


def moment_ratio(series: Sequence[Array], rate: float) -> float:
    """Largest power in half a second of whitened rows over the median, or over unit noise."""
    size = max(2, round(MOMENT * rate))
    blocks = [
        np.add.reduceat(values**2, np.arange(0, max(len(values) - size + 1, 1), size)) for values in series
    ]
    power = np.concatenate(blocks)
    return float(power.max() / max(float(np.median(power)), size))


def position_dependence(evidence: Evidence) -> RemainingStructure | None:
    """Finds the cause whose size varies most with its joint's position; None where all are constant.

    Its prominence is the part of the residual that the variation explains.
    """
    found = []
    for index, term in enumerate(evidence.model_fit.model):
        if len(term.candidate.joints) == 1 and len(term.groups) == 1:
            part = _explained_by_variation(evidence, index, term)
            if part is not None:
                name = f"{term.key[0]} on {term.candidate.joints[0]}"
                said = f"the size of {name} changes with the joint's position, which explains {100 * part:.0f} % more"
                found.append(RemainingStructure(part, said, term.groups[0]))
    return max(found, default=None)


def _explained_by_variation(evidence: Evidence, index: int, term: ModelTerm) -> float | None:
    """Part of the residual that the best order explains, if it also does on held-out recordings; else None."""
    model_fit, (g,) = evidence.model_fit, term.groups
    joint = evidence.prepared[0].tree.joints.index(term.candidate.joints[0])
    positions = [item.position[:, joint] for item in evidence.prepared]
    orders = _orders(positions)
    samples = float(model_fit.counts[g])
    best: tuple[float, float] | None = None
    for order in orders:
        blocks = [_modulated(evidence, index, (r, g), order * q) for r, q in enumerate(positions)]
        gain, coefficients, carried = _fit(evidence, blocks, g)
        # Penalty for the two parameters, and for the orders tried.
        gain -= float(np.log(samples)) + float(np.log(len(orders)))
        if (
            gain > GAIN
            and (best is None or gain > best[0])
            and _validated(evidence, blocks, g, coefficients, carried)
        ):
            best = (gain, 1.0 - float(np.exp(-2.0 * gain / samples)))
    return best[1] if best is not None and best[1] > PART else None


def _orders(positions: Sequence[Array]) -> Array:
    travel = float(np.ptp(np.concatenate(positions)))
    jump = float(np.quantile(np.concatenate([np.abs(np.diff(q)) for q in positions]), 0.95))
    if travel < 1e-3 or jump == 0.0:
        return np.zeros(0)
    return np.arange(SPACING, PHASE_STEP_MAX * travel / jump, SPACING)[:ORDERS] / travel


def _modulated(evidence: Evidence, index: int, place: tuple[int, int], phase: Array) -> Array:
    """Whitened columns (M, 2) of a cause's torque times sine and cosine of a phase (M,)."""
    r, g = place
    torque = evidence.plain.torque(evidence.model_fit, index, r)[g]
    block = torque[:, None] * np.column_stack([np.sin(phase), np.cos(phase)])
    return np.asarray(evidence.design.whitening.apply(block, r, g))


def _fit(evidence: Evidence, blocks: Sequence[Array], g: int) -> tuple[float, Array, Array]:
    """Gain [nats] of columns beside the whole fit, their coefficients, and by how much they change the model's."""
    model_fit = evidence.model_fit
    ids, weight = model_fit.ids[g], model_fit.weights[g]
    cross, own, right = np.zeros((len(ids), 2)), np.zeros((2, 2)), np.zeros(2)
    for r in model_fit.fitted:
        left = model_fit.residuals(model_fit.whole.coefficients, r)[g]
        cross += weight * (model_fit.rows[r][g].T @ blocks[r])
        own += weight * (blocks[r].T @ blocks[r])
        right += weight * (blocks[r].T @ left)
    carried = model_fit.whole.inverse[np.ix_(ids, ids)] @ cross
    free = own - cross.T @ carried
    coefficients = np.linalg.pinv(free, rcond=1e-6, hermitian=True) @ right
    samples = float(model_fit.counts[g])
    explained = float(right @ coefficients) / samples
    return -0.5 * samples * float(np.log(max(1.0 - explained, 1e-6))), np.asarray(coefficients), carried


def _validated(
    evidence: Evidence, blocks: Sequence[Array], g: int, coefficients: Array, carried: Array
) -> bool:
    """Whether the same coefficients lower the residual of the held-out recordings."""
    model_fit = evidence.model_fit
    gained = 0.0
    for r in evidence.heldout:
        left = model_fit.residuals(model_fit.whole.coefficients, r)[g]
        after = left - (blocks[r] - model_fit.rows[r][g] @ carried) @ coefficients
        gained += float(left @ left - after @ after)
    return gained > 0.0
