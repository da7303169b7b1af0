# SPDX-License-Identifier: BSD-3-Clause
"""Stage 9: the gap before and after on unseen recordings, what remains, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.causes import Evidence
from impedance_modules.diagnosis.fit import prediction_variance, squares
from impedance_modules.diagnosis.generic import is_generic
from impedance_modules.diagnosis.log import DataReport
from impedance_modules.diagnosis.model import NominalModel
from impedance_modules.diagnosis.next_motion import propose
from impedance_modules.diagnosis.result import Cause, Diagnosis, JointGap, Remainder
from impedance_modules.diagnosis.rollout.outcome import nothing_rolled_out
from impedance_modules.diagnosis.screen import screen
from impedance_modules.diagnosis.series import held_out_series
from impedance_modules.diagnosis.where import locate

Array = NDArray[np.float64]

LACK_MEASURED, LACK_WEAK = 1.7, 3.0
"""Largest residual power over noise power that counts as fitted: floor from repeats, or a weak one."""

LEFT_MAX = 0.1
"""Part of the excess power that a model called complete may leave."""

STRUCTURE_MIN = 0.05
"""Part of the held-out residual that a smooth function must explain to speak of structure."""


def conclude(
    evidence: Evidence, causes: tuple[Cause, ...], model: NominalModel, report: DataReport
) -> Diagnosis:
    """Draws the conclusion from the accepted causes."""
    nominal = np.zeros(evidence.design.total)
    after = evidence.bench.whole.coefficients
    adjusted = evidence.calibrated.coefficients
    gaps = _gaps(evidence, nominal, after, model)
    start, left = evidence.excess(nominal), evidence.excess(after)
    remainder = _remainder(evidence, gaps, left / start if start > 0.0 else 0.0)
    logs = evidence.prepared
    return Diagnosis(
        verdict=_verdict(causes, remainder),
        robot=model.robot,
        episodes=tuple(item.log.name for item in logs),
        heldout=tuple(logs[index].log.name for index in evidence.heldout),
        data=report,
        reason="",
        gaps=gaps,
        shrink=_shrink(gaps),
        rollout=nothing_rolled_out(),
        where=locate(evidence.design, logs, model, adjusted, evidence.floor, evidence.unit_power),
        causes=causes,
        unexplained_weight=max(0.0, 1.0 - sum(cause.weight for cause in causes)),
        remainder=remainder,
        next_motion=propose(causes, report, model),
        series=held_out_series(evidence, nominal, after, model),
    )


def _verdict(causes: Sequence[Cause], remainder: Remainder) -> str:
    if not causes:
        return "no_gap" if remainder.explained else "unexplained"
    if any(cause.equivalent for cause in causes):
        return "ambiguous"
    return "explained" if remainder.explained else "partly_explained"


def _gaps(evidence: Evidence, nominal: Array, after: Array, model: NominalModel) -> tuple[JointGap, ...]:
    design, heldout = evidence.design, evidence.heldout
    counts = np.array([design.count(heldout, group) for group in range(len(design.groups))])
    first = np.sqrt(squares(design, heldout, nominal) / counts)
    last = np.sqrt(squares(design, heldout, after) / counts)
    units = model.tree.units()
    return tuple(
        JointGap(
            joint=model.joints[joint],
            residual=residual,
            before=float(first[group]),
            after=float(last[group]),
            noise_floor=float(evidence.heldout_noise[group]),
            unit=units[joint] if residual != "velocity" else "rad/s",
        )
        for group, (residual, joint) in enumerate(design.groups)
    )


def _shrink(gaps: Sequence[JointGap]) -> float | None:
    """The joints' ratio with squares summed after dividing each by its floor's."""
    start = sum(max(0.0, gap.before**2 / gap.noise_floor**2 - 1.0) for gap in gaps)
    left = sum(
        max(0.0, gap.after**2 / gap.noise_floor**2 - 1.0) for gap in gaps if gap.before > gap.noise_floor
    )
    return None if start <= 0.0 else 1.0 - float(np.sqrt(left / start))


def _remainder(evidence: Evidence, gaps: Sequence[JointGap], share: float) -> Remainder:
    # On new motions even the right model errs, by what its parameters are uncertain.
    doubt = prediction_variance(evidence.design, evidence.heldout, evidence.bench.whole)
    lack = {
        f"{gap.joint} ({gap.residual})": float(gap.after**2 / (gap.noise_floor**2 + variance))
        for gap, variance in zip(gaps, doubt, strict=True)
    }
    worst = max(lack, key=lambda name: lack[name])
    limit = LACK_WEAK if evidence.floor.weak else LACK_MEASURED
    fits = lack[worst] <= limit
    explained = fits or (bool(evidence.bench.model) and share <= LEFT_MAX)
    words = f"residual power is {lack[worst]:.3g} times noise and parameters' uncertainty on {worst}"
    if evidence.floor.weak:
        words += "; the noise floor is weak, no recording repeats another"
    if not explained:
        words += "; not explained by the catalogue" + _structure(evidence)
    return Remainder(lack[worst], bool(explained), words)


def _structure(evidence: Evidence) -> str:
    """Whether a smooth function of a joint's own signals would explain more, on unseen folds."""
    stand_ins = [look.slot for look in screen(evidence.bench) if is_generic(look.slot.shaped)][:3]
    trials = [evidence.bench.trial(slot) for slot in stand_ins]
    best = max((trial.reduction for trial in trials), default=0.0)
    if best < STRUCTURE_MIN:
        return (
            "; no smooth function of a joint's motion and torque explains it either: memory, time or contact"
        )
    return f"; a smooth function of one joint's motion and torque would explain {100 * best:.0f} % of it"
