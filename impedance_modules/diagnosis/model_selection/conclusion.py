# SPDX-License-Identifier: BSD-3-Clause
"""Stage 9: the gap before and after on unseen recordings, what remains, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.lack_of_fit import Lack, lack_of_fit
from impedance_modules.diagnosis.data.log import DataReport
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.next_motion import propose
from impedance_modules.diagnosis.result import Cause, Diagnosis, JointGap, Remainder
from impedance_modules.diagnosis.rollout.outcome import nothing_rolled_out
from impedance_modules.diagnosis.series import held_out_series
from impedance_modules.diagnosis.model_selection.gap_location import locate

Array = NDArray[np.float64]


WEIGHTY = 0.05
"""Part of the gap that a cause must explain for its rivals to make the whole answer ambiguous."""

KNOWN, NEAR = 0.5, 6.0
"""Part of the gap that causes must explain, and residual power over noise that they may leave, for it to be ambiguous
which, where something is left. What is left may have a structure, but no more power than passes; more only where no
repeats say for certain how strong the noise is."""


def conclude(
    evidence: Evidence, causes: tuple[Cause, ...], model: NominalModel, report: DataReport
) -> Diagnosis:
    """Draws the conclusion from the accepted causes."""
    gaps = _gaps(evidence, model)
    lack = lack_of_fit(evidence)
    remainder = _remainder(lack, evidence, model)
    logs = evidence.prepared
    return Diagnosis(
        verdict=_verdict(causes, remainder, near=_near(lack, weak=evidence.floor.weak)),
        robot=model.robot,
        episodes=tuple(item.log.name for item in logs),
        heldout=tuple(logs[index].log.name for index in evidence.heldout),
        data=report,
        reason="",
        gaps=gaps,
        shrink=_shrink(gaps),
        rollout=nothing_rolled_out(),
        where=locate(evidence, model),
        causes=causes,
        unexplained_weight=max(0.0, 1.0 - sum(cause.weight for cause in causes)),
        remainder=remainder,
        next_motion=propose(causes, report, model, _middle(evidence, model)),
        series=held_out_series(evidence, model),
    )


def _middle(evidence: Evidence, model: NominalModel) -> dict[str, float]:
    """Joint -> median of all recorded positions: about where the next motion may begin."""
    middle = np.median(np.concatenate([item.position for item in evidence.prepared]), axis=0)
    return {joint: float(q) for joint, q in zip(model.joints, middle, strict=True)}


def _near(lack: Lack, *, weak: bool) -> bool:
    return bool(np.all(lack.ratio <= np.maximum(lack.limit, NEAR if weak else 0.0)))


def _verdict(causes: Sequence[Cause], remainder: Remainder, *, near: bool) -> str:
    if not causes:
        return "no_gap" if remainder.explained else "unexplained"
    known = remainder.explained or (near and sum(cause.weight for cause in causes) >= KNOWN)
    if known and any(cause.equivalent and cause.weight >= WEIGHTY for cause in causes):
        return "ambiguous"
    return "explained" if remainder.explained else "partly_explained"


def _gaps(evidence: Evidence, model: NominalModel) -> tuple[JointGap, ...]:
    first, last = evidence.rms(None), evidence.rms(evidence.bench)
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
        for group, (residual, joint) in enumerate(evidence.design.groups)
    )


def _shrink(gaps: Sequence[JointGap]) -> float | None:
    """The joints' ratio with squares summed after dividing each by its floor's."""
    start = sum(max(0.0, gap.before**2 / gap.noise_floor**2 - 1.0) for gap in gaps)
    left = sum(
        max(0.0, gap.after**2 / gap.noise_floor**2 - 1.0) for gap in gaps if gap.before > gap.noise_floor
    )
    return None if start <= 0.0 else 1.0 - float(np.sqrt(left / start))


def _remainder(found: Lack, evidence: Evidence, model: NominalModel) -> Remainder:
    worst = int(np.argmax(found.ratio / found.limit))
    residual, joint = evidence.design.groups[worst]
    ratio = float(found.ratio[worst])
    words = (
        f"residual power is {ratio:.3g} times noise and parameters' uncertainty on {model.joints[joint]} ({residual});"
        f" {found.limit[worst]:.3g} would pass"
    )
    if evidence.floor.weak:
        words += "; the noise floor is weak, no recording repeats another"
    if found.structure:
        words += f"; {found.structure}"
    if not found.passed:
        words += "; not explained by the catalogue"
        if evidence.refusal is not None:
            words += (
                f" (nearest: {evidence.refusal.trial.term.candidate.name}, which {evidence.refusal.reason})"
            )
    return Remainder(ratio, found.passed, words)
