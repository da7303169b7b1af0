# SPDX-License-Identifier: BSD-3-Clause
"""The start of the search at joints where the model lacks friction, damping and rotor of a geared drive at once.

A model of bare links meets a geared robot: every joint lacks friction, damping and a rotor together. Taken one at a
time, a richer law of one kind (bristles, directions) imitates two simple ones, and neither can be accepted after it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import product

from impedance_modules.diagnosis.model_selection.candidate_trial import (
    CandidateTrial,
    HeldOutResiduals,
    try_term,
)
from impedance_modules.diagnosis.regression.design_matrix import ColumnLayout
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm, term_of
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.dry_reversals import REGULARISATION

RejectionReason = Callable[[CandidateTrial], str | None]

LESS = 0.3
"""Part of what the best single law of the joint leaves that all of them together may leave at most."""

TRY_OTHERS_BELOW = 3.0
"""Multiple of what is allowed beyond which other shapes of the same laws are not tried."""


def geared_start_model(
    model_fit: ModelFit,
    make: Callable[[Sequence[ModelTerm]], ModelFit],
    single: Callable[[ModelFit], Sequence[CandidateTrial]],
    rejection_reason: RejectionReason,
) -> tuple[ModelTerm, ...]:
    """Finds the laws of the drive at joints where the model lacks all of them.

    Args:
        model_fit: The model so far.
        make: Fits a model.
        single: Tries the best candidates beside a model, one by one.
        rejection_reason: Why a trial is rejected; None if it passes.

    Returns:
        For each such joint its laws, each of which passes beside the others.
    """
    found: list[ModelTerm] = []
    for joint, layouts in _drive_laws(model_fit).items():
        groups = layouts[0][0].groups
        most = LESS * _left(model_fit.unseen, groups)
        left, terms = _best(model_fit, make, layouts, most)
        if left > most or not _all_pass(model_fit, make, terms, rejection_reason):
            continue
        alone = [trial for trial in single(model_fit) if joint in trial.term.candidate.joints]
        if all(left < LESS * _left(trial.unseen, groups) for trial in alone):
            found += terms
    return tuple(found)


def _best(
    model_fit: ModelFit,
    make: Callable[[Sequence[ModelTerm]], ModelFit],
    layouts: Sequence[Sequence[ColumnLayout]],
    most: float,
) -> tuple[float, list[ModelTerm]]:
    """The shapes of a joint's laws that together leave least, and what they leave; one try where it cannot succeed."""
    best: tuple[float, list[ModelTerm]] = (float("inf"), [])
    for choice in product(*layouts):
        terms = [term_of(model_fit.design, layout) for layout in choice]
        left = _left(make([*model_fit.model, *terms]).unseen, terms[0].groups)
        best = min(best, (left, terms), key=lambda found: found[0])
        if left > TRY_OTHERS_BELOW * most:
            break
    return best


def _all_pass(
    model_fit: ModelFit,
    make: Callable[[Sequence[ModelTerm]], ModelFit],
    terms: Sequence[ModelTerm],
    rejection_reason: RejectionReason,
) -> bool:
    """Whether each of some terms passes beside the others."""
    rests = ([other for other in terms if other is not term] for term in terms)
    return all(
        rejection_reason(try_term(make([*model_fit.model, *rest]), term)) is None
        for rest, term in zip(rests, terms, strict=True)
    )


def _drive_laws(model_fit: ModelFit) -> dict[str, list[list[ColumnLayout]]]:
    """Joint -> shapes of each law of a drive at the motor, where all of them show in the same residuals."""
    layouts: dict[str, dict[str, list[ColumnLayout]]] = defaultdict(lambda: defaultdict(list))
    for layout in model_fit.design.layouts:
        one = layout.shaped.candidate
        # Dry friction with a wide regularisation is partly viscous friction; together they would hide a rotor.
        if one is None or one.port != "actuator" or REGULARISATION in layout.shaped.shape:
            continue
        if one.effect.in_every_drive:
            layouts[one.key][one.effect.id].append(layout)
    laws = sum(effect.in_every_drive for effect in CATALOGUE.values())
    full = {key: list(own.values()) for key, own in layouts.items() if len(own) == laws}
    return {
        key: own
        for key, own in full.items()
        if len({layout.groups for shapes in own for layout in shapes}) == 1
    }


def _left(unseen: HeldOutResiduals, groups: Sequence[int]) -> float:
    """Squares that a model leaves of some groups on recordings that its fits have not seen."""
    return float(sum(left[g] @ left[g] for left in unseen.values() for g in groups))
