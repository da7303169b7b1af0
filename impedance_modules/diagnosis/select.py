# SPDX-License-Identifier: BSD-3-Clause
"""Stage 5: which causes there are. One is accepted at a time; each must earn its place on unseen recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.diagnosis.design import Design, Slot
from impedance_modules.diagnosis.generic import is_generic
from impedance_modules.diagnosis.noise import Floor
from impedance_modules.diagnosis.screen import Look, screen
from impedance_modules.diagnosis.trial import Bench, Trial

CAUSES_MAX = 30
"""More are not looked for."""

TRIED = 10
"""Candidates that are tried on held-out folds in each round."""

SAME_REACH = 0.95
"""Candidates that explain this part of what the best one does are as good; the cheaper one is taken."""

STAND_INS = 4
"""Generic stand-ins that are tried beside them."""

BIC_MIN = 15.0
"""Least improvement of the Bayesian information criterion."""

SIGNIFICANCE = 3.5
"""Least mean gain per block over its standard error."""

SPECIFIC = 3.0
"""Standard errors by which a cause must beat the best generic stand-in."""

REDUCTION_MIN = 0.05
"""Least part of a group's held-out squares that a cause removes."""


@dataclass(frozen=True, eq=False)
class Refusal:
    """Why a candidate that fitted best was not named."""

    trial: Trial
    reason: str


@dataclass(frozen=True, eq=False)
class Selection:
    """What was found.

    Attributes:
        causes: Accepted candidates, in the order they were found.
        refusal: Why the next best was not accepted; None where nothing was left to try.
    """

    causes: tuple[Slot, ...]
    refusal: Refusal | None


def select(
    design: Design, folds: Sequence[Sequence[int]], floor: Floor, rate: float, progress: Callable[[str], None]
) -> Selection:
    """Accepts causes until the next one does not earn its place, then exchanges and removes.

    Args:
        design: All candidates.
        folds: Indices of the fitted recordings by fold.
        floor: The noise.
        rate: Of the thinned samples [Hz].
        progress: Called with a sentence for each cause found.
    """
    model: list[Slot] = []
    refusal: Refusal | None = None
    while len(model) < CAUSES_MAX:
        bench = Bench(design, folds, model, floor, rate)
        found, refusal = _next(bench)
        if found is None:
            break
        model.append(found)
        progress(f"found {found.shaped.key[0]} on {found.shaped.key[1]}")
        if len(model) > 1:
            model = _exchange(design, folds, model, floor, rate)
    return Selection(tuple(_pruned(design, folds, model, floor, rate)), refusal)


def _next(bench: Bench) -> tuple[Slot | None, Refusal | None]:
    """The best candidate that earns its place, or why there is none."""
    looks = screen(bench)
    trials = [bench.trial(slot) for slot in promising(looks, TRIED)]
    stand_ins = [
        bench.trial(look.slot) for look in [x for x in looks if is_generic(x.slot.shaped)][:STAND_INS]
    ]
    refusal: Refusal | None = None
    for trial in by_merit(bench, trials):
        reason = objection(bench, trial, stand_ins)
        if reason is None:
            return trial.slot, None
        refusal = refusal or Refusal(trial, reason)
    return None, refusal


def best_of_each(looks: Sequence[Look], most: int) -> list[Look]:
    """The best physical shape of each candidate, the best candidates first."""
    found: dict[tuple[str, str, str], Look] = {}
    for look in looks:
        if look.physical and not is_generic(look.slot.shaped):
            found.setdefault(look.slot.shaped.key, look)
    return list(found.values())[:most]


def by_merit(bench: Bench, trials: Sequence[Trial]) -> list[Trial]:
    """Sorts trials by what they explain; of those that explain the same, the one whose parameters cost least."""
    left = sorted(trials, key=lambda item: -item.reach)
    out: list[Trial] = []
    while left:
        near = [item for item in left if item.reach >= SAME_REACH * left[0].reach]
        chosen = max(near, key=lambda item: adjusted(bench, item), default=left[0])
        out.append(chosen)
        left.remove(chosen)
    return out


def promising(looks: Sequence[Look], most: int) -> list[Slot]:
    """The best candidates by likelihood, and the best by the power they would explain."""
    by_gain = best_of_each(looks, most)
    by_power = best_of_each(sorted(looks, key=lambda look: -look.power), most)
    return list({look.slot.shaped.key: look.slot for look in [*by_gain, *by_power]}.values())


def adjusted(bench: Bench, trial: Trial) -> float:
    """Held-out gain less half the price of its parameters [nats]."""
    return trial.gain - 0.5 * price(bench, trial.slot)


def price(bench: Bench, slot: Slot) -> float:
    """Price of a candidate's parameters in the Bayesian information criterion, half of it [nats]."""
    samples = np.max(bench.counts[list(slot.groups)] * bench.independent[list(slot.groups)])
    size = slot.shaped.size + len(slot.shaped.shape)
    return float(0.5 * size * np.log(max(samples, 2.0)))


def objection(bench: Bench, trial: Trial, stand_ins: Sequence[Trial]) -> str | None:
    """Why a candidate does not earn its place; None if it does."""
    gain = 2.0 * (trial.gain - price(bench, trial.slot))
    if gain < BIC_MIN:
        return f"gains too little for its parameters on unseen recordings (BIC {gain:.1f}, needs {BIC_MIN:g})"
    if trial.reduction < REDUCTION_MIN:
        return f"removes only {100 * trial.reduction:.1f} % of the residual on unseen recordings"
    if np.mean(trial.folds > 0.0) < (1.0 if len(trial.folds) < 5 else 0.8):
        return "helps on some recordings and harms on others"
    if bench.advantage(trial, None) < SIGNIFICANCE:
        return "its gain comes from a few moments only"
    own = set(trial.slot.groups)
    for rival in stand_ins:
        if not own & set(rival.slot.groups) or rival.slot.shaped.size > trial.slot.shaped.size:
            continue
        if (
            rival.reach_on(trial.slot.groups) > trial.reach_on(trial.slot.groups)
            or bench.advantage(trial, rival) < SPECIFIC
        ):
            return "no better than a generic smooth function of the same signals: not specific"
    return None


def _exchange(
    design: Design, folds: Sequence[Sequence[int]], model: list[Slot], floor: Floor, rate: float
) -> list[Slot]:
    """Replaces an accepted cause by another that does better now that the last one is known."""
    for index, slot in enumerate(model[:-1]):
        if not set(slot.groups) & set(model[-1].groups):
            continue
        rest = [*model[:index], *model[index + 1 :]]
        bench = Bench(design, folds, rest, floor, rate)
        own = bench.trial(slot)
        rivals = [bench.trial(look.slot) for look in best_of_each(screen(bench), 3)]
        better = max(rivals, key=lambda item: adjusted(bench, item), default=own)
        if adjusted(bench, better) > adjusted(bench, own) + BIC_MIN and objection(bench, better, []) is None:
            model = [*model[:index], better.slot, *model[index + 1 :]]
    return model


def _pruned(
    design: Design, folds: Sequence[Sequence[int]], model: list[Slot], floor: Floor, rate: float
) -> list[Slot]:
    """Removes causes that no longer earn their place beside the others."""
    for slot in list(model):
        rest = [other for other in model if other is not slot]
        bench = Bench(design, folds, rest, floor, rate)
        if objection(bench, bench.trial(slot), []) is not None:
            model = rest
    return model
