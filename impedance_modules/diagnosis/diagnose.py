# SPDX-License-Identifier: BSD-3-Clause
"""All stages of a diagnosis in order: recordings and a model in, a `Diagnosis` out.

    recordings -> data -> residuals -> regression -> model_selection -> rollout -> report

data             checks and an even time base (`admit`), folds and hold-out (`assign_folds`)
residuals        measured minus predicted torque, all in one frequency band (`prepare`)
regression       candidate columns, noise floor and least squares, used by the search
model_selection  search of the causes (`search_causes`), their names and rivals, verdict (`conclude`)
rollout          the plant simulated with the causes, on held-out recordings (`with_rollouts`)
report           JSON, patch and HTML of the result (the command line calls it)

Each folder imports only from those before it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from impedance_modules.diagnosis.data.admission import admit
from impedance_modules.diagnosis.data.folds import DataSplit, assign_folds
from impedance_modules.diagnosis.data.log import DataReport
from impedance_modules.diagnosis.data.motor_torques import with_motor_torques
from impedance_modules.diagnosis.data.nominal_model import NominalModel, with_known_effects
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.model_selection.cause_search import Progress
from impedance_modules.diagnosis.model_selection.conclusion import (
    causes_of_model,
    compensation_note,
    conclude,
)
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.held_out_gap import with_held_out_gap
from impedance_modules.diagnosis.model_selection.naming import rejected_by_motion
from impedance_modules.diagnosis.model_selection.object_search import with_held_object
from impedance_modules.diagnosis.model_selection.probability import (
    unlikely_beside_others,
    with_probabilities,
)
from impedance_modules.diagnosis.model_selection.repeated_search import RepeatedSearch
from impedance_modules.diagnosis.model_selection.surface_search import with_surfaces
from impedance_modules.diagnosis.model_selection.swallowed import swallowed_by_priors
from impedance_modules.diagnosis.model_selection.tolerance import set_small_aside
from impedance_modules.diagnosis.residuals.band import (
    choose_band,
    filter_length,
    least_duration,
    renewal_note,
)
from impedance_modules.diagnosis.residuals.contact_mask import (
    contact_note,
    without_links_in_contact,
)
from impedance_modules.diagnosis.residuals.gap_mask import gap_note
from impedance_modules.diagnosis.residuals.preparation import Prepared, prepare
from impedance_modules.diagnosis.result import DEFAULT_TOLERANCE, Diagnosis, Remainder
from impedance_modules.diagnosis.rollout.rollout_stage import with_rollouts
from impedance_modules.diagnosis.rollout_result import LeftOut, no_rollout
from impedance_modules.effects.catalogue import not_searched
from impedance_modules.episode.data import Episode
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.worker_processes import OrderedMap, map_here

ROWS_MIN = 12
"""Fewest samples in the band that a recording must give."""

USUAL_SHARES: Mapping[str, float] = {
    "admitting the recordings": 0.0,
    "computing residuals": 0.05,
    "evaluating candidates": 0.1,
    "searching": 0.6,
    "judging rivals": 0.75,
    "concluding": 0.8,
    "simulating the held-out recordings": 0.85,
}
"""Sentence of each stage -> about the share of a diagnosis's time that has usually passed when it begins."""


def diagnose(
    episodes: Sequence[Episode],
    model: NominalModel,
    urdf: Path,
    *,
    heldout: Collection[str] = (),
    without: Collection[str] = (),
    under_water: bool = False,
    tolerance: float = DEFAULT_TOLERANCE,
    known_effects: Sequence[EffectSpec] = (),
    progress: Progress = lambda _: None,
    each: OrderedMap = map_here,
) -> Diagnosis:
    """Says where recordings and model differ, what causes it, and how far the gap shrinks.

    Args:
        episodes: Recordings, held-out ones included.
        model: The nominal model.
        urdf: File of the model's links.
        heldout: Names of recordings that no step of the fit may use; empty: it chooses them.
        without: Ids of effects that are left out of the catalogue.
        under_water: The robot was under water; only then are the effects of water candidates.
        tolerance: Share of each joint's torque range within which a gap that changes no simulated motion is called
            none; 0 for no such share.
        known_effects: Effects of a patch that the nominal model includes from the beginning, on recorded joints and
            links.
        progress: Called with a sentence for each step.
        each: Where recordings and simulations are worked on, one by one; the answer does not depend on it.

    Raises:
        BadInput: A recording contradicts itself or the model.
        InsufficientData: Too little to tell a cause.
    """
    progress("admitting the recordings")
    logs, report = admit(episodes, model)
    logs = with_motor_torques(logs, model)
    model, known_effects = with_known_effects(model, known_effects)
    common = choose_band(logs)
    run_in = filter_length(common.cutoff)
    split = assign_folds(logs, heldout, least_duration(common.cutoff, ROWS_MIN + 2), run_in)
    progress("computing residuals")
    rigid = BatchedRigidModel.of_tree(urdf, model.tree)
    work = partial(prepare, model=model, rigid=rigid, common=common, known_effects=known_effects)
    prepared = tuple(each(work, split.logs))
    split, prepared = _long_enough(split, prepared)
    whole, prepared = prepared, without_links_in_contact(prepared, split.fitted)
    search = RepeatedSearch(
        prepared, split, model, {*without, *not_searched(under_water=under_water)}, progress, each
    )
    contact = contact_note(prepared, split.fitted)
    said = (*split.warnings, *renewal_note(logs, common), *contact, *gap_note(prepared))
    while True:
        found = _concluded(search.evidence, model, report, (*said, *search.notes), progress)
        progress("simulating the held-out recordings")
        found = with_rollouts(found, search.evidence, model, urdf, known_effects, each)
        repeats = not search.evidence.floor.weak
        rejected = rejected_by_motion(found.causes) or unlikely_beside_others(found, repeats=repeats)
        if not rejected:
            break
        search.leave_out(rejected, found.causes)
    evidence = search.evidence
    found = with_held_out_gap(set_small_aside(found, evidence, tolerance), evidence, model)
    progress("comparing contact with the task's surfaces")
    found = with_surfaces(found, whole, evidence, known_effects, without, tolerance)
    progress("comparing what the hands hold with the task's object")
    found = with_held_object(found, whole, evidence, known_effects, without, tolerance)
    return with_probabilities(found, repeats=not evidence.floor.weak)


def _concluded(
    evidence: Evidence, model: NominalModel, report: DataReport, notes: Sequence[str], progress: Progress
) -> Diagnosis:
    """Names the causes and says what they explain of the torque."""
    progress("judging rivals")
    causes = causes_of_model(evidence)
    said = (*report.warnings, *notes, *compensation_note(evidence.prepared, causes))
    progress("concluding")
    found = conclude(evidence, causes, model, replace(report, warnings=said))
    return replace(found, swallowed=swallowed_by_priors(evidence))


def _long_enough(split: DataSplit, prepared: tuple[Prepared, ...]) -> tuple[DataSplit, tuple[Prepared, ...]]:
    """Leaves out recordings, or segments of one, of which the band's filter leaves hardly a sample."""
    short = [i for i, item in enumerate(prepared) if item.samples < ROWS_MIN]
    if not short:
        return split, prepared
    band = prepared[short[0]].band
    needed = (ROWS_MIN * band.step + 2 * band.margin) / band.rate
    names = ", ".join(f"{prepared[i].log.name} ({prepared[i].log.duration:.2g} s)" for i in short)
    why = (
        f"too short for motions whose band ends at {band.cutoff:.2g} Hz, and left out: {names}"
        f" (valid: {needed:.2g} s or more)"
    )
    return split.without(short, why), tuple(x for i, x in enumerate(prepared) if i not in short)


def insufficient(robot: str, episodes: Sequence[str], reason: str) -> Diagnosis:
    """The result where the data do not suffice, with the reason."""
    return Diagnosis(
        verdict="insufficient_data",
        robot=robot,
        episodes=tuple(episodes),
        heldout=(),
        data=None,
        reason=reason,
        gaps=(),
        shrink=None,
        rollout=no_rollout(LeftOut("all recordings", "the data do not suffice")),
        where=(),
        causes=(),
        unexplained_weight=1.0,
        remainder=Remainder(float("nan"), False, ""),
        next_motion={
            "purpose": "tell a cause at all",
            "joints": [],
            "excitation": "several motions with reversals, of ten seconds or more each, at 25 Hz or more",
        },
        series=(),
    )
