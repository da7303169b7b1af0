# SPDX-License-Identifier: BSD-3-Clause
"""Search of a held object's mass and centre of mass, in rows in which hands hold it and touch nothing else.

These rows are masked for the joints' and links' effects. They are compared with the nominal model and the object as
the task has it, after all other causes. Its mass, its centre, or both are named if they explain 7.5 nats more than
their penalty and differ from the task's with 95 % confidence, links and joints' zeros left free within their priors. A
thing that is fixed to the hand all the time acts in free motion, too: where that does not decide, both are named.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.task_object import TaskObject
from impedance_modules.diagnosis.model_selection.acceptance import BIC_MIN
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
from impedance_modules.diagnosis.regression.object_fit import (
    SIZE,
    Free,
    ObjectFit,
    evaluated,
    fit_object,
    parameter_change,
)
from impedance_modules.diagnosis.regression.object_rows import ObjectRows, object_rows, uncertain_columns
from impedance_modules.diagnosis.residuals.preparation import Prepared, effect_torque
from impedance_modules.diagnosis.result import Cause, Diagnosis, Estimate, Rival, Standing
from impedance_modules.effects.bodies import LinkInertia, Payload
from impedance_modules.effects.object_inertia import CENTRE, OBJECT_KEY, ObjectInertia
from impedance_modules.spec.patch_file import EffectSpec

EFFECT = ObjectInertia.description.id

CONFIDENCE = 0.95

RIVALS: tuple[tuple[Free, str], ...] = (
    ("always", Payload.description.id),
    ("hand", LinkInertia.description.id),
)
"""What may be taken for the object, and the effect that it is."""


@dataclass(frozen=True, eq=False)
class ObjectResult:
    """What rows say in which an object is held.

    Attributes:
        fit: The accepted numbers; those of the task where none is.
        rows: How well they explain these rows.
        scale: Power of whitened remainders over that of white noise of unit size, at least 1.
        shrink: Of the gap in these rows on recordings that no fit has seen; None without any, or without a gap.
        gain: Deviance that the numbers explain.
        rivals: Effects that explain nearly as much.
        lead: Deviance by which the next rival explains less.
        seconds: While it is held.
    """

    fit: ObjectFit
    rows: RowsExplained
    scale: float
    shrink: float | None
    gain: float
    rivals: tuple[str, ...]
    lead: float
    seconds: float

    @property
    def named(self) -> bool:
        """Whether the object differs from the task's."""
        return self.fit.free != "nothing"


def with_held_object(
    found: Diagnosis,
    prepared: Sequence[Prepared],
    evidence: Evidence,
    known: Sequence[EffectSpec],
    without: Collection[str],
    tolerance: float,
) -> Diagnosis:
    """Adds what rows in which hands hold an object say about it.

    Args:
        found: The result of all other rows.
        prepared: All recordings with all residuals.
        evidence: The fit.
        known: Effects of a patch that the model includes.
        without: Ids of effects that are left out of the catalogue.
        tolerance: Share of each joint's torque range within which a wrong object does not matter; 0 for none.
    """
    if all(item.log.task_object is None for item in prepared) or EFFECT in without:
        return found
    held = _same_object(prepared, known)
    if held is None:
        return with_warning(
            found, "the recordings' tasks have different objects; their masses are not searched"
        )
    recordings = _rows(found, prepared, held, known)
    heldout = _unseen(recordings, evidence)
    fitted = [rows for r, rows in recordings.items() if r not in heldout]
    unseen = [recordings[r] for r in heldout]
    if all(rows.carried is None for rows in fitted):
        return found
    result = search_object(fitted, unseen)
    if result.named and matters(fitted, result.fit, tolerance):
        return _merged(found, result, evidence, held)
    return _noted(found, result)


def search_object(fitted: Sequence[ObjectRows], unseen: Sequence[ObjectRows] = ()) -> ObjectResult:
    """Finds whether the object's mass, its centre, or both differ from the task's.

    Args:
        fitted: Recordings; at least one of them holds it.
        unseen: Others that hold it, which only judge the result.
    """
    spec = next(rows.carried.spec for rows in fitted if rows.carried is not None)
    nominal = spec.mass, np.array(spec.centre)
    plain = best = fit_object(fitted, "nothing", *nominal)
    steps: dict[Free, tuple[Free, ...]] = {
        "nothing": ("mass", "centre"),
        "mass": ("both",),
        "centre": ("both",),
    }
    while open_ := steps.get(best.free):
        trials = [fit_object(fitted, free, *nominal) for free in open_]
        trial = min(trials, key=lambda one: one.deviance + SIZE[one.free] * _penalty(fitted))
        if not _accepted(fitted, best, trial, nominal):
            break
        best = trial
    return _judged(fitted, unseen, plain, best, nominal)


def matters(recordings: Sequence[ObjectRows], fit: ObjectFit, tolerance: float) -> bool:
    """Says whether the object's change is beyond a share of some joint's torque range, rms over samples of holding."""
    power, count = 0.0, 0
    for rows in recordings:
        if rows.carried is not None:
            change = rows.change @ parameter_change(rows.carried, fit)
            power, count = power + np.sum(change**2, axis=0), count + int(rows.carried.rows.sum())
    load = np.concatenate([rows.load for rows in recordings])
    return bool(np.any(np.sqrt(power / max(count, 1)) > tolerance * np.ptp(load, axis=0)))


def _penalty(fitted: Sequence[ObjectRows]) -> float:
    """Bayesian penalty of one number."""
    return float(np.log(sum(int(rows.held.sum()) for rows in fitted)))


def _accepted(
    fitted: Sequence[ObjectRows], best: ObjectFit, trial: ObjectFit, nominal: tuple[float, Array]
) -> bool:
    """Whether a fit with more numbers is physical, gains enough, and surely differs from the task's object."""
    scale = _scale(fitted, trial)
    gain = (best.deviance - trial.deviance) / scale
    more = SIZE[trial.free] - SIZE[best.free]
    if trial.mass <= 0.0 or gain < more * _penalty(fitted) + BIC_MIN:
        return False
    change = np.array([trial.mass - nominal[0], *(trial.centre - nominal[1])])
    certain = float(change @ np.linalg.pinv(scale * trial.covariance) @ change)
    return certain > float(chi2.ppf(CONFIDENCE, SIZE[trial.free]))


def _scale(recordings: Sequence[ObjectRows], fit: ObjectFit) -> float:
    """Inflation of variances by the remainder over the noise, while it is held or free, and by its correlation."""
    held = [x[rows.held] for rows, x in zip(recordings, fit.left, strict=True)]
    free = np.concatenate([x[~rows.held] for rows, x in zip(recordings, fit.left, strict=True)])
    power = float(np.mean(np.concatenate(held) ** 2))
    if free.size:
        power = max(power, float(np.mean(free**2)))
    in_time = [x.reshape(rows.means, -1) for rows, x in zip(recordings, held, strict=True) if rows.means]
    return max(1.0, power) * correlation_in_time(in_time)


def _judged(
    fitted: Sequence[ObjectRows],
    unseen: Sequence[ObjectRows],
    plain: ObjectFit,
    best: ObjectFit,
    nominal: tuple[float, Array],
) -> ObjectResult:
    scale = _scale(fitted, best)
    before, count = _while_held(fitted, plain.left)
    after, _ = _while_held(fitted, best.left)
    gain = (plain.deviance - best.deviance) / scale
    leads = {
        name: (fit_object(fitted, free, *nominal).deviance - best.deviance) / scale
        + (SIZE[free] - SIZE[best.free]) * _penalty(fitted)
        for free, name in RIVALS
    }
    rivals = tuple(name for name, lead in leads.items() if lead < LEAD_MIN) if best.free != "nothing" else ()
    return ObjectResult(
        fit=best,
        rows=RowsExplained(before, after, count, after <= SYSTEMATIC * count, bool(rivals)),
        scale=scale,
        shrink=_shrink(unseen, plain, best) if unseen else share_closed(before - count, after - count),
        gain=gain,
        rivals=rivals,
        lead=min([gain, *(lead for lead in leads.values() if lead >= LEAD_MIN)]),
        seconds=sum(rows.seconds for rows in (*fitted, *unseen)),
    )


def _shrink(unseen: Sequence[ObjectRows], plain: ObjectFit, best: ObjectFit) -> float | None:
    first, size = _while_held(unseen, evaluated(unseen, plain))
    last, _ = _while_held(unseen, evaluated(unseen, best))
    return share_closed(first - size, last - size)


def _while_held(recordings: Sequence[ObjectRows], left: Sequence[Array]) -> tuple[float, int]:
    """Sum of squares of the rows of holding, and their number."""
    parts = [x[rows.held] for rows, x in zip(recordings, left, strict=True)]
    return sum(float(np.sum(x**2)) for x in parts), sum(x.size for x in parts)


def _unseen(recordings: Mapping[int, ObjectRows], evidence: Evidence) -> list[int]:
    """Recordings with the object that only judge: those held out, or the last one where all with it are held out."""
    holding = [r for r, rows in recordings.items() if rows.carried is not None]
    heldout = [r for r in holding if r in evidence.heldout]
    return heldout if len(heldout) < len(holding) else holding[1:][-1:]


def _same_object(prepared: Sequence[Prepared], known: Sequence[EffectSpec]) -> TaskObject | None:
    """The object of all recordings that have one, with known effects applied; None if they differ."""
    objects = [item.log.task_object for item in prepared if item.log.task_object is not None]
    same = all((one.spec, one.hands) == (objects[0].spec, objects[0].hands) for one in objects)
    return objects[0].with_known(known) if same else None


def _rows(
    found: Diagnosis, prepared: Sequence[Prepared], held: TaskObject, known: Sequence[EffectSpec]
) -> dict[int, ObjectRows]:
    """Recording -> its rows of holding and of free motion; none without a residual of the links' motion."""
    residual = motion_residual(prepared)
    if residual is None or held.hands[0] not in prepared[0].signals.model.bodies:
        return {}
    out = {}
    uncertain = uncertain_columns(prepared, residual)
    for r, item in enumerate(prepared):
        explained = item.band.condense(effect_torque(effects_found(found), item.signals, residual))
        own = item.log.task_object
        here = None if own is None else own.with_known(known)
        rows = object_rows(item, here, held.hands[0], explained, residual, uncertain[r])
        if len(rows.target):
            out[r] = rows
    return out


def _noted(found: Diagnosis, result: ObjectResult) -> Diagnosis:
    """Says how well these rows agree with the task's object, where none of its numbers is named."""
    rows = result.rows
    ratio = rows.after / rows.count
    words = (
        f"{result.seconds:.3g} s with an object in the hands agree with the task's object, residual power"
        f" {ratio:.3g} times noise"
        if rows.explained
        else f"{result.seconds:.3g} s with an object in the hands are not explained by an object of another mass or"
        f" centre, residual power {ratio:.3g} times noise where {SYSTEMATIC:g} would pass; they stay masked"
    )
    return with_warning(found, words)


def _merged(found: Diagnosis, result: ObjectResult, evidence: Evidence, held: TaskObject) -> Diagnosis:
    """Names the object's numbers beside the other causes."""
    rows = result.rows
    ratio = rows.after / rows.count
    words = (
        f"{result.seconds:.3g} s with an object in the hands, compared with the task's object of {held.spec.mass:g} kg:"
        f" residual power {rows.before / rows.count:.3g} times noise with the task's numbers, {ratio:.3g} with those"
        " found"
    )
    if not rows.explained:
        words += f"; {SYSTEMATIC:g} would pass: more than the object differs there"
    if rows.ambiguous:
        words += (
            "; too little free motion was recorded to tell it from a change of the hand (record the same arm"
        )
        words += " without the object)"
    return with_warning(merged(found, evidence, rows, [(_cause(result), 1.0)]), words)


def _cause(result: ObjectResult) -> Cause:
    fit = result.fit
    spread = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0) * result.scale)
    estimates = {
        name: Estimate(float(value), float(std), unit)
        for name, value, std, unit in zip(
            ("m", *CENTRE), (fit.mass, *fit.centre), spread, ("kg", "m", "m", "m"), strict=True
        )
        if std > 0.0 or value != 0.0
    }
    return Cause(
        effect=EFFECT,
        joints=(),
        port="link",
        parameters={OBJECT_KEY: estimates},
        weight=0.0,
        shrink=result.shrink,
        equivalent=tuple(Rival(name, (), "") for name in result.rivals),
        rivals=(),
        position_range={},
        velocity_range={},
        standing=Standing(0.5 * result.gain, 0.5 * result.lead),
    )
