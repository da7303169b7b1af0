# SPDX-License-Identifier: BSD-3-Clause
"""All stages in order: recordings and a model in, a diagnosis out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np

from impedance_modules.diagnosis.admit import admit
from impedance_modules.diagnosis.arrange import Arrangement, arrange
from impedance_modules.diagnosis.band import choose_cutoff
from impedance_modules.diagnosis.candidates import list_candidates, shape_candidates
from impedance_modules.diagnosis.causes import Evidence, name_causes
from impedance_modules.diagnosis.conclude import conclude
from impedance_modules.diagnosis.design import build_design
from impedance_modules.diagnosis.generic import generic_stand_ins
from impedance_modules.diagnosis.log import DataReport
from impedance_modules.diagnosis.model import NominalModel
from impedance_modules.diagnosis.noise import noise_floor
from impedance_modules.diagnosis.noise_motion import floor_at
from impedance_modules.diagnosis.prepare import Prepared, prepare
from impedance_modules.diagnosis.result import Diagnosis, Remainder
from impedance_modules.diagnosis.rigid import BatchedRigidModel
from impedance_modules.diagnosis.rollout.outcome import LeftOut, nothing_rolled_out
from impedance_modules.diagnosis.rollout.stage import with_rollouts
from impedance_modules.diagnosis.select import select
from impedance_modules.diagnosis.trial import Bench
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.episode.data import Episode
from impedance_modules.spec.patch import EffectSpec

UNSEARCHED = ("external_contact",)
"""Bound to one recording's time: no other recording can confirm it, so the common procedure does not look for it."""

Progress = Callable[[str], None]


def diagnose(
    episodes: Sequence[Episode],
    model: NominalModel,
    urdf: Path,
    *,
    heldout: Collection[str] = (),
    without: Collection[str] = (),
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
        worn: Effects of a patch that the model wears to begin with.
        progress: Called with a sentence for each step.

    Raises:
        BadInput: A recording contradicts itself or the model.
        InsufficientData: Too little to tell a cause.
    """
    progress("admitting the recordings")
    logs, report = admit(episodes, model)
    arrangement = arrange(logs, heldout)
    progress("computing residuals")
    rigid = BatchedRigidModel.of_tree(urdf, model.tree)
    cutoff = choose_cutoff(arrangement.logs)
    prepared = tuple(prepare(log, model, rigid, cutoff, worn) for log in arrangement.logs)
    progress("evaluating candidates")
    evidence = _explain(prepared, arrangement, model, cutoff, without, progress)
    progress("judging rivals")
    causes = name_causes(evidence)
    progress("concluding")
    found = conclude(evidence, causes, model, _with_warnings(report, arrangement))
    progress("letting the plant live the held-out recordings again")
    return with_rollouts(found, evidence, model, urdf, worn)


def _explain(  # noqa: PLR0917 - all of them belong together
    prepared: tuple[Prepared, ...],
    arrangement: Arrangement,
    model: NominalModel,
    cutoff: float,
    without: Collection[str],
    progress: Progress,
) -> Evidence:
    residuals = list(prepared[0].residuals)
    candidates = list_candidates(CATALOGUE, prepared, {*without, *UNSEARCHED})
    shaped = shape_candidates(candidates, prepared, residuals)
    for residual in residuals:
        shaped += generic_stand_ins(prepared, residual)
    design = build_design(prepared, shaped, model.tree.inertia)
    rate = prepared[0].band.rate / prepared[0].band.step
    pairs, share = repeat_pairs(prepared, arrangement.fitted), min(1.0, 2.0 * cutoff / rate)
    floor = noise_floor(design, pairs, np.zeros(design.total), share, arrangement.fitted)
    found = select(design, arrangement.folds, floor, rate, progress)
    bench = Bench(design, arrangement.folds, found.causes, floor, rate)
    # With the causes known, repeats that did not quite repeat no longer leak into the floor.
    floor = noise_floor(design, pairs, bench.whole.coefficients, share, arrangement.fitted)
    bench = Bench(design, arrangement.folds, found.causes, floor, rate)
    noise = floor_at(floor, design.groups, prepared, pairs, arrangement.heldout)
    return Evidence(design, arrangement.folds, arrangement.heldout, prepared, floor, noise, bench, rate)


def repeat_pairs(prepared: Sequence[Prepared], recordings: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of recordings of one motion."""
    return [
        (i, j)
        for place, i in enumerate(recordings)
        for j in recordings[:place]
        if prepared[i].log.group == prepared[j].log.group
    ]


def _with_warnings(report: DataReport, arrangement: Arrangement) -> DataReport:
    return DataReport(**{**vars(report), "warnings": (*report.warnings, *arrangement.warnings)})


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
            "purpose": reason,
            "joints": [],
            "excitation": "several motions with reversals, at 25 Hz or more",
        },
        series=(),
    )
