# SPDX-License-Identifier: BSD-3-Clause
"""All stages in order: recordings and a model in, a diagnosis out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.admit import admit
from impedance_modules.diagnosis.arrange import Arrangement, arrange
from impedance_modules.diagnosis.aside import (
    both,
    contact_aside,
    contact_note,
    on_links,
    without_touched_links,
)
from impedance_modules.diagnosis.band import choose_cutoff, filter_length, least_duration
from impedance_modules.diagnosis.causes import name_causes
from impedance_modules.diagnosis.certain import certain
from impedance_modules.diagnosis.compensated import compensation_note
from impedance_modules.diagnosis.conclude import conclude
from impedance_modules.diagnosis.confirmed import confirmed
from impedance_modules.diagnosis.contact import find_pushes, moments_clear
from impedance_modules.diagnosis.evidence import Evidence
from impedance_modules.diagnosis.model import NominalModel
from impedance_modules.diagnosis.negligible import felt, negligible
from impedance_modules.diagnosis.prepare import Prepared, prepare
from impedance_modules.diagnosis.result import Diagnosis, Remainder
from impedance_modules.diagnosis.rigid import BatchedRigidModel
from impedance_modules.diagnosis.rollout.outcome import LeftOut, nothing_rolled_out
from impedance_modules.diagnosis.rollout.stage import with_rollouts
from impedance_modules.diagnosis.selection.candidates import list_candidates, shapes_of
from impedance_modules.diagnosis.selection.design import build_design
from impedance_modules.diagnosis.selection.drafts import Draft, draft_candidates
from impedance_modules.diagnosis.selection.floor import noise_by_repeats, noise_by_smoothness, repeat_pairs
from impedance_modules.diagnosis.selection.generic import draft_stand_ins
from impedance_modules.diagnosis.selection.instrument import instrument, noise_of_repeats
from impedance_modules.diagnosis.selection.nuisance import Nuisance, build_nuisance
from impedance_modules.diagnosis.selection.plain import PlainRows
from impedance_modules.diagnosis.selection.refine import Refiner
from impedance_modules.diagnosis.selection.select import Selector
from impedance_modules.diagnosis.selection.still import quieted
from impedance_modules.diagnosis.selection.term import Term
from impedance_modules.diagnosis.selection.whiten import Whitening
from impedance_modules.diagnosis.wearing import wearing
from impedance_modules.effects.catalogue import BENCH, CATALOGUE, SURFACES, WATER
from impedance_modules.episode.data import Episode
from impedance_modules.spec.patch import EffectSpec

ROWS_MIN = 12
"""Fewest samples in the band that a recording must give."""

CONTACT = "external_contact"
"""Bound to one recording's time: no other recording can confirm it, so it has a procedure of its own (`contact`)."""

Array = NDArray[np.float64]

Progress = Callable[[str], None]


def diagnose(
    episodes: Sequence[Episode],
    model: NominalModel,
    urdf: Path,
    *,
    heldout: Collection[str] = (),
    without: Collection[str] = (),
    under_water: bool = False,
    worn: Sequence[EffectSpec] = (),
    progress: Progress = lambda _: None,
) -> Diagnosis:
    """Says where recordings and model differ, what causes it, and how far the gap shrinks.

    Args:
        episodes: Recordings, held-out ones included.
        model: What was believed.
        urdf: File of the model's links.
        heldout: Names of recordings that no step of the fit may see; empty lets it choose.
        without: Ids of effects that are left out of the catalogue.
        under_water: The robot was under water; only then is what water does looked for.
        worn: Effects of a patch that the model wears to begin with.
        progress: Called with a sentence for each step.

    Raises:
        BadInput: A recording contradicts itself or the model.
        InsufficientData: Too little to tell a cause.
    """
    progress("admitting the recordings")
    logs, report = admit(episodes, model)
    model, worn = wearing(model, worn, logs)
    cutoff = choose_cutoff(logs)
    run_in = filter_length(cutoff)
    arrangement = arrange(logs, heldout, least_duration(cutoff, ROWS_MIN + 2), run_in)
    progress("computing residuals")
    rigid = BatchedRigidModel.of_tree(urdf, model.tree)
    prepared = tuple(prepare(log, model, rigid, cutoff, worn) for log in arrangement.logs)
    arrangement, prepared = _long_enough(arrangement, prepared)
    prepared = without_touched_links(prepared)
    progress("evaluating candidates")
    left_out = {*without, *SURFACES, *BENCH, *(() if under_water else WATER)}
    evidence = _explain(prepared, arrangement, model, left_out, progress)
    progress("judging rivals")
    causes = name_causes(evidence)
    progress("concluding")
    notes = (*arrangement.warnings, *contact_note(prepared), *compensation_note(prepared, causes))
    found = conclude(evidence, causes, model, replace(report, warnings=(*report.warnings, *notes)))
    progress("letting the plant live the held-out recordings again")
    return with_rollouts(found, evidence, model, urdf, worn)


def _long_enough(
    arrangement: Arrangement, prepared: tuple[Prepared, ...]
) -> tuple[Arrangement, tuple[Prepared, ...]]:
    """Leaves recordings out, or stretches of one, of which hardly anything is left behind the band's filter."""
    short = [i for i, item in enumerate(prepared) if item.samples < ROWS_MIN]
    if not short:
        return arrangement, prepared
    band = prepared[short[0]].band
    needed = (ROWS_MIN * band.step + 2 * band.margin) / band.rate
    names = ", ".join(f"{prepared[i].log.name} ({prepared[i].log.duration:.2g} s)" for i in short)
    why = (
        f"too short for motions whose band ends at {band.cutoff:.2g} Hz, and left out: {names}"
        f" (valid: {needed:.2g} s or more)"
    )
    return arrangement.without(short, why), tuple(x for i, x in enumerate(prepared) if i not in short)


def _explain(
    prepared: tuple[Prepared, ...],
    arrangement: Arrangement,
    model: NominalModel,
    without: Collection[str],
    progress: Progress,
) -> Evidence:
    residuals = list(prepared[0].residuals)
    pairs = repeat_pairs(prepared, arrangement.fitted)
    noise = noise_of_repeats(prepared, pairs, lambda signals: signals.drive)
    flicker = noise_of_repeats(prepared, pairs, lambda signals: signals.effort)
    signals = [instrument(quieted(item.signals), noise, flicker) for item in prepared]
    shaped = [
        (candidate, shape)
        for candidate in list_candidates(CATALOGUE, prepared, {*without, CONTACT})
        for shape in shapes_of(candidate, signals)
    ]
    stand_ins = draft_stand_ins(prepared, residuals)
    drafts = draft_candidates(shaped, prepared, signals, residuals)
    nuisance = build_nuisance(prepared, model.tree.inertia)
    raw = [[item.residuals[name][:, joint] for name, joint in nuisance.groups] for item in prepared]
    aside = on_links(contact_aside(prepared), nuisance.groups)
    floor = _floor(raw, prepared, nuisance, [*stand_ins, *_simple(drafts)], arrangement.fitted, aside)
    rate = prepared[0].band.rate / prepared[0].band.step
    names = [item.log.name for item in prepared]
    design = build_design([*drafts, *stand_ins], nuisance, raw, floor, names=names, rate=rate)
    del drafts
    selector = Selector(
        design, arrangement.folds, Refiner(design, prepared, signals), model.position_resolution
    )
    if aside:
        selector = selector.on(design.without(aside))
    contact = CONTACT in CATALOGUE and CONTACT not in without
    return _search(selector, prepared, arrangement, progress, contact=contact)


def _search(
    selector: Selector,
    prepared: tuple[Prepared, ...],
    arrangement: Arrangement,
    progress: Progress,
    *,
    contact: bool,
) -> Evidence:
    """Finds the causes, sets moments of contact aside, and judges the noise once more with all of that known."""
    found = selector.run(progress)
    pushes = find_pushes(selector.bench(found.causes), prepared) if contact else ()
    if pushes:
        progress("setting moments of contact aside")
        touched = on_links(moments_clear(pushes, prepared), selector.design.groups)
        moments = both(selector.design.whitening.clear, touched)
        narrowed = selector.on(selector.design.without(moments))
        again = narrowed.run(progress)
        if _as_good(narrowed, again.causes, found.causes):
            selector, found = narrowed, again
        else:
            pushes = ()  # what the causes explain better on the very same rows was no push
    bench, plain = selector.bench(found.causes), PlainRows(selector.refiner)
    for kept in (
        felt(bench, plain, negligible(prepared, selector.design.groups)),
        certain(bench, selector.refiner),
        confirmed(bench, selector.bench, arrangement.heldout),
    ):
        model = [term for term in bench.model if term in kept]
        bench = bench if len(model) == len(bench.model) else selector.bench(model)
    floor, pairs = selector.design.whitening, repeat_pairs(prepared, arrangement.fitted)
    if pairs:
        # With the causes known, repeats that did not quite repeat no longer leak into the floor.
        left = [plain.left(bench, r) for r in range(len(prepared))]
        clear = selector.design.whitening.clear
        floor = noise_by_repeats(left, prepared, selector.design.nuisance, pairs, clear)
    return Evidence(selector, arrangement.heldout, prepared, bench, floor, plain, found.refusal, pushes)


POORER = 1.2
"""Squares that a search without moments of contact may leave, over those that the causes found with them leave."""


def _as_good(narrowed: Selector, causes: Sequence[Term], first: Sequence[Term]) -> bool:
    """Whether causes found without some rows explain the others about as well as those found with all rows do."""
    moved = [narrowed.refiner.term(term.candidate, term.shaped.shape, term.slot) for term in first]
    known = [term for term in moved if term is not None]
    return float(narrowed.bench(causes).left.sum()) <= POORER * float(narrowed.bench(known).left.sum())


def _floor(  # noqa: PLR0917 - all of them belong together
    left: Sequence[Sequence[Array]],
    prepared: Sequence[Prepared],
    nuisance: Nuisance,
    flexible: Sequence[Draft],
    fitted: Sequence[int],
    aside: Mapping[tuple[int, int], NDArray[np.bool_]],
) -> Whitening:
    pairs = repeat_pairs(prepared, fitted)
    if pairs:
        return noise_by_repeats(left, prepared, nuisance, pairs, aside)
    return noise_by_smoothness(left, prepared, nuisance, flexible, fitted)


FOLLOWS_COMMAND = ("torque_gain", "controller_gain")
"""Effects in proportion to what was asked for, which a flexible model may not use.

A command knows the motion without the noise of its differences, and an inertia's column with it: together they are
that noise, and would take it from any floor.
"""


def _simple(drafts: Sequence[Draft]) -> list[Draft]:
    """Candidates of one joint in one shape: what a flexible model may use besides smooth functions."""
    return [
        draft
        for draft in drafts
        if not draft.shape
        and draft.width <= 3
        and len(draft.blocks[0]) == 1
        and not (draft.key[0] in FOLLOWS_COMMAND and draft.key[2] == "actuator")
    ]


def insufficient(robot: str, episodes: Sequence[str], reason: str) -> Diagnosis:
    """The answer where nothing can be told, with the reason."""
    return Diagnosis(
        verdict="insufficient_data",
        robot=robot,
        episodes=tuple(episodes),
        heldout=(),
        data=None,
        reason=reason,
        gaps=(),
        shrink=None,
        rollout=nothing_rolled_out(LeftOut("all recordings", "the data do not suffice")),
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
