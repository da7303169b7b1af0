# SPDX-License-Identifier: BSD-3-Clause
"""Search of the surfaces' effects in rows in contact, after all others: what the links do in free air is known then.

Rows in contact are masked for the joints' and links' effects. Where the recording's task says on what the hands press,
these rows are compared with the task's surfaces instead. A number of a surface is named if it explains 7.5 nats more
than its penalty and differs from the task's with 95 % confidence, the joints' zeros and the links' weights left free
within their priors. Where another number of the same surface explains nearly as much, both are named.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.task_surfaces import with_known_surfaces
from impedance_modules.diagnosis.model_selection.acceptance import BIC_MIN
from impedance_modules.diagnosis.model_selection.cause_search import SIGMA
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.lack_of_fit import SYSTEMATIC
from impedance_modules.diagnosis.model_selection.masked_rows import (
    LEAD_MIN,
    RowsExplained,
    correlation_in_time,
    effects_found,
    merged,
    motion_residual,
    share_closed,
    with_warning,
)
from impedance_modules.diagnosis.regression.contact_fit import (
    ContactFit,
    Number,
    Surfaces,
    evaluated,
    fit_contact,
    gained,
    in_use,
)
from impedance_modules.diagnosis.regression.contact_rows import (
    ContactRecording,
    SurfaceNumbers,
    contact_recording,
)
from impedance_modules.diagnosis.residuals.preparation import Prepared, effect_torque
from impedance_modules.diagnosis.result import Cause, Diagnosis, Estimate, Rival, Standing
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.surface_effects import SurfaceEffect, surface_key
from impedance_modules.spec.patch_file import EffectSpec

EFFECT_OF: Mapping[str, str] = {
    effect.description.parameters[0].symbol: effect.id
    for effect in CATALOGUE.values()
    if isinstance(effect, SurfaceEffect)
}
"""Symbol of a surface's number -> the effect that changes it."""


@dataclass(frozen=True, eq=False)
class ContactResult:
    """What the rows in contact say.

    Attributes:
        fit: The accepted numbers.
        before: Chi-square of rows in contact, with the surfaces as the task has them.
        after: With the accepted numbers.
        count: Their degrees of freedom.
        scale: Power of whitened remainders over that of white noise of unit size, at least 1.
        explained: Whether the remainder is the noise's.
        shrink: Of the gap in contact on recordings that no fit has seen; None without any, or without a gap.
        gains: Effect and surface -> deviance that it explains beyond the numbers accepted before.
        leads: Accepted number -> others of its surface -> deviance that they would leave more in its place.
        seconds: In contact.
    """

    fit: ContactFit
    before: float
    after: float
    count: int
    scale: float
    explained: bool
    shrink: float | None
    gains: Mapping[Number, float]
    leads: Mapping[Number, Mapping[Number, float]]
    seconds: float

    def rivals(self, number: Number) -> tuple[Number, ...]:
        """Other numbers that explain nearly as much in the place of one."""
        return tuple(other for other, lead in self.leads[number].items() if lead < LEAD_MIN)

    def standing(self, number: Number) -> Standing:
        """How far a number stands out; a deviance is twice a log-likelihood."""
        beaten = [lead for lead in self.leads[number].values() if lead >= LEAD_MIN]
        return Standing(0.5 * self.gains[number], 0.5 * min([self.gains[number], *beaten]))


def with_surfaces(
    found: Diagnosis,
    prepared: Sequence[Prepared],
    evidence: Evidence,
    known: Sequence[EffectSpec],
    without: Collection[str],
    tolerance: float,
) -> Diagnosis:
    """Adds what rows in contact say about the task's surfaces to a result.

    Args:
        found: The result of all other rows.
        prepared: All recordings with all residuals; the links' are left out of the evidence where nearly everything is
            contact.
        evidence: The fit.
        known: Effects of a patch that the model includes.
        without: Ids of effects that are left out of the catalogue.
        tolerance: Share of each joint's torque range within which a wrong surface does not matter; 0 for none.
    """
    recordings = _contact_recordings(found, prepared, known)
    fitted = [data for r, data in recordings.items() if r not in evidence.heldout]
    unseen = [data for r, data in recordings.items() if r in evidence.heldout]
    if not fitted:
        return found
    result = search_surfaces(fitted, unseen, without)
    if result.gains and matters(fitted, result.fit.surfaces, tolerance):
        return _merged(found, result, evidence)
    return _noted(found, result)


def matters(recordings: Sequence[ContactRecording], surfaces: Surfaces, tolerance: float) -> bool:
    """Says whether surfaces change some joint's torque in contact, rms, by more than a share of the joint's range."""
    power, count = 0.0, 0
    for data in recordings:
        nominal = {contact.surface: SurfaceNumbers.of(contact.nominal) for contact in data.contacts}
        change = (data.torque({**nominal, **surfaces}) - data.torque(nominal))[data.touching]
        power, count = power + np.sum(change**2, axis=0), count + len(change)
    load = np.concatenate([data.item.load for data in recordings])
    return bool(np.any(np.sqrt(power / max(count, 1)) > tolerance * np.ptp(load, axis=0)))


def search_surfaces(
    fitted: Sequence[ContactRecording], unseen: Sequence[ContactRecording], without: Collection[str] = ()
) -> ContactResult:
    """Finds the numbers of surfaces that differ from the task's, one after the other, the strongest first.

    Args:
        fitted: Recordings with rows in contact.
        unseen: Likewise, that only judge the result.
        without: Ids of effects that are not candidates.
    """
    nominal = {c.surface: SurfaceNumbers.of(c.nominal) for data in (*fitted, *unseen) for c in data.contacts}
    plain = best = fit_contact(fitted, (), nominal)
    candidates = [
        (index, symbol) for index in nominal for symbol, name in EFFECT_OF.items() if name not in without
    ]
    gains: dict[Number, float] = {}
    least = np.log(sum(int(data.touching.sum()) for data in fitted)) + BIC_MIN
    while open_ := [number for number in candidates if number not in best.free]:
        trials = {number: _tried(fitted, best, number) for number in open_}
        falls = {number: gained(fitted, best, trial) for number, trial in trials.items()}
        number = max(falls, key=lambda one: falls[one])
        trial, scale = trials[number], _scale(fitted, trials[number])
        gain = falls[number] / scale
        if gain < least + 2.0 * np.log(len(open_)) or not _differs(trial, nominal, number, scale):
            break
        gains[number], best = gain, trial
        best = _without_idle(fitted, best, nominal, gains, least)
    leads = {number: _leads(fitted, best, nominal, number, candidates) for number in best.free}
    return _judged(fitted, unseen, plain, best, gains, leads)


def _leads(
    fitted: Sequence[ContactRecording],
    best: ContactFit,
    nominal: Surfaces,
    number: Number,
    candidates: Sequence[Number],
) -> dict[Number, float]:
    """Other numbers of the same surface -> deviance that they leave more, each in the place of one."""
    rest, scale = _back(fitted, best, nominal, number), _scale(fitted, best)
    others = [one for one in candidates if one[0] == number[0] and one not in best.free]
    return {one: gained(fitted, _tried(fitted, rest, one), best) / scale for one in others}


def _back(
    fitted: Sequence[ContactRecording], best: ContactFit, nominal: Surfaces, number: Number
) -> ContactFit:
    """Fits the other numbers with one as the task has it."""
    index, symbol = number
    back = replace(best.surfaces[index], **{symbol: getattr(nominal[index], symbol)})
    others = [other for other in best.free if other != number]
    return fit_contact(fitted, others, {**best.surfaces, index: back})


def _without_idle(
    fitted: Sequence[ContactRecording],
    best: ContactFit,
    nominal: Surfaces,
    gains: dict[Number, float],
    least: float,
) -> ContactFit:
    """Takes numbers back that the others explain by now, the least first (backward elimination)."""
    while len(best.free) > 1:
        scale = _scale(fitted, best)
        rests = {number: _back(fitted, best, nominal, number) for number in best.free}
        losses = {number: gained(fitted, rest, best) / scale for number, rest in rests.items()}
        number = min(losses, key=lambda one: losses[one])
        if losses[number] >= least and _differs(best, nominal, number, scale):
            break
        best = rests[number]
        gains.pop(number)
        gains.update({other: losses[other] for other in best.free})
    return best


def _tried(fitted: Sequence[ContactRecording], best: ContactFit, number: Number) -> ContactFit:
    """Fits one number more, from all of its starts."""
    index, symbol = number
    effect = CATALOGUE[EFFECT_OF[symbol]]
    starts = {sign * start for start in getattr(effect, "starts", ()) for sign in (1.0, -1.0)}
    starts = starts or {getattr(best.surfaces[index], symbol)}
    fits = []
    for start in starts:
        begin = {**best.surfaces, index: replace(best.surfaces[index], **{symbol: start})}
        fits.append(fit_contact(fitted, (*best.free, number), begin))
    return min(fits, key=lambda fit: fit.deviance)


def _differs(fit: ContactFit, nominal: Surfaces, number: Number, scale: float) -> bool:
    index, symbol = number
    change = getattr(fit.surfaces[index], symbol) - getattr(nominal[index], symbol)
    return bool(abs(change) > SIGMA * fit.std(number) * np.sqrt(scale))


def _scale(recordings: Sequence[ContactRecording], fit: ContactFit) -> float:
    r"""Power of the whitened remainder, times (1 + \rho) / (1 - \rho) for its correlation in time.

    It is that in contact or, if larger, that in free air: where the links are not understood, no surface is.
    """
    inside = [data.touching[in_use(data)] for data in recordings]
    left = [x[chosen] for chosen, x in zip(inside, fit.left, strict=True)]
    free = np.concatenate([x[~chosen] for chosen, x in zip(inside, fit.left, strict=True)])
    power = float(np.mean(np.concatenate(left) ** 2))
    if free.size:
        power = max(power, float(np.mean(free**2)))
    return max(1.0, power) * correlation_in_time(left)


def _judged(
    fitted: Sequence[ContactRecording],
    unseen: Sequence[ContactRecording],
    plain: ContactFit,
    best: ContactFit,
    gains: Mapping[Number, float],
    leads: Mapping[Number, Mapping[Number, float]],
) -> ContactResult:
    before, count = _in_contact(fitted, plain.left)
    after, _ = _in_contact(fitted, best.left)
    shrink = None
    if unseen:
        first, size = _in_contact(unseen, evaluated(unseen, plain))
        last, _ = _in_contact(unseen, evaluated(unseen, best))
        shrink = share_closed(first - size, last - size)
    else:
        shrink = share_closed(before - count, after - count)
    return ContactResult(
        fit=best,
        before=before,
        after=after,
        count=count,
        scale=_scale(fitted, best),
        explained=after <= SYSTEMATIC * count,
        shrink=shrink,
        gains=gains,
        leads=leads,
        seconds=sum(
            float(data.touching.sum()) * data.item.band.step / data.item.band.rate
            for data in (*fitted, *unseen)
        ),
    )


def _in_contact(recordings: Sequence[ContactRecording], left: Sequence[Array]) -> tuple[float, int]:
    """Sum of squares of the rows in contact, and their number."""
    parts = [x[data.touching[in_use(data)]] for data, x in zip(recordings, left, strict=True)]
    return sum(float(np.sum(x**2)) for x in parts), sum(x.size for x in parts)


def _contact_recordings(
    found: Diagnosis, prepared: Sequence[Prepared], known: Sequence[EffectSpec]
) -> dict[int, ContactRecording]:
    """Recording -> its rows in contact, where the task has surfaces that the hands themselves touch."""
    residual = motion_residual(prepared)
    if residual is None:
        return {}
    out = {}
    for r, item in enumerate(prepared):
        surroundings = item.log.surroundings
        if surroundings is None or surroundings.holds:
            continue
        surfaces = with_known_surfaces(surroundings, known).surfaces
        explained = item.band.condense(effect_torque(effects_found(found), item.signals, residual))
        data = contact_recording(item, surfaces, surroundings.hands, explained, residual)
        if data is not None:
            out[r] = data
    return out


def _noted(found: Diagnosis, result: ContactResult) -> Diagnosis:
    """Says how well the rows in contact agree with the task's surfaces, where none of their numbers is named."""
    ratio = result.after / result.count
    words = (
        f"{result.seconds:.3g} s in contact agree with the task's surfaces, residual power {ratio:.3g} times noise"
        if result.explained
        else f"{result.seconds:.3g} s in contact are not explained by surfaces that differ from the task's, residual"
        f" power {ratio:.3g} times noise where {SYSTEMATIC:g} would pass; they stay masked"
    )
    return with_warning(found, words)


def _merged(found: Diagnosis, result: ContactResult, evidence: Evidence) -> Diagnosis:
    """Names the surfaces' effects beside the other causes."""
    whole = sum(result.gains.values())
    causes = [(_cause(result, number), gain / whole) for number, gain in result.gains.items()]
    ambiguous = any(map(result.rivals, result.gains))
    rows = RowsExplained(result.before, result.after, result.count, result.explained, ambiguous)
    ratio = result.after / result.count
    return with_warning(
        merged(found, evidence, rows, causes),
        f"{result.seconds:.3g} s in contact, compared with the task's surfaces: residual power"
        f" {result.before / result.count:.3g} times noise with the task's numbers, {ratio:.3g} with those found"
        + ("" if result.explained else f"; {SYSTEMATIC:g} would pass: more than surfaces differs there"),
    )


def _cause(result: ContactResult, number: Number) -> Cause:
    index, symbol = number
    fit = result.fit
    parameter = CATALOGUE[EFFECT_OF[symbol]].description.parameters[0]
    value = float(getattr(fit.surfaces[index], symbol))
    std = fit.std(number) * float(np.sqrt(result.scale))
    return Cause(
        effect=EFFECT_OF[symbol],
        joints=(),
        port="contact",
        parameters={surface_key(index): {symbol: Estimate(value, std, parameter.unit)}},
        weight=0.0,
        shrink=result.shrink,
        equivalent=tuple(Rival(EFFECT_OF[other], (), "") for _, other in result.rivals(number)),
        rivals=(),
        position_range={},
        velocity_range={},
        standing=result.standing(number),
    )
