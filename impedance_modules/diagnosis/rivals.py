# SPDX-License-Identifier: BSD-3-Clause
"""Stage 6: for each cause, what else could be it, and why the others lost."""

from __future__ import annotations

from collections.abc import Sequence

from impedance_modules.diagnosis.candidates import Candidate
from impedance_modules.diagnosis.design import Design, Slot
from impedance_modules.diagnosis.generic import candidate_of
from impedance_modules.diagnosis.noise import Floor
from impedance_modules.diagnosis.result import Rival
from impedance_modules.diagnosis.screen import screen
from impedance_modules.diagnosis.select import price, promising
from impedance_modules.diagnosis.trial import Bench, Trial

ASKED = 8
"""Rivals that are tried beside each cause."""

EQUAL_SIGMA = 2.0
"""Fewer standard errors than this between two candidates: the recordings cannot tell them apart ..."""

EQUAL_LOSS = 0.01
"""... if also no more than this part of the explained power lies between them."""


def judge_rivals(  # noqa: PLR0917 - all of them belong together
    design: Design,
    folds: Sequence[Sequence[int]],
    causes: Sequence[Slot],
    slot: Slot,
    floor: Floor,
    rate: float,
) -> tuple[tuple[Rival, ...], tuple[Rival, ...]]:
    """Tries every promising candidate in a cause's place, the other causes kept.

    Returns:
        Those that cannot be told from it, and the others with the reason why they lost.
    """
    rest = [other for other in causes if other is not slot]
    bench = Bench(design, folds, rest, floor, rate)
    own = bench.trial(slot)
    held = {other.shaped.key for other in causes}
    equal: list[Rival] = []
    lost: list[Rival] = []
    for found in promising(screen(bench), ASKED):
        if found.shaped.key in held:
            continue
        rival = bench.trial(found)
        candidate = candidate_of(found.shaped)
        if not same_name(candidate, candidate_of(slot.shaped)) and _equal(bench, own, rival):
            equal.append(_named(candidate, "fits unseen recordings as well"))
        else:
            lost.append(_named(candidate, _reason(bench, own, rival)))
    return tuple(dict.fromkeys(equal)), tuple(dict.fromkeys(lost))


def same_name(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are one answer: one effect on the same joints."""
    return one.effect.id == other.effect.id and one.key == other.key


def _named(candidate: Candidate, reason: str) -> Rival:
    return Rival(candidate.effect.id, candidate.joints, reason)


def _equal(bench: Bench, own: Trial, rival: Trial) -> bool:
    groups = own.slot.groups
    mine, its = own.reach_on(groups), rival.reach_on(groups)
    if _contains(rival, own) or mine <= 0.0:
        return False
    loss = (mine - its) / mine
    return loss < EQUAL_LOSS or (loss < 5.0 * EQUAL_LOSS and bench.advantage(own, rival) < EQUAL_SIGMA)


def _contains(rival: Trial, own: Trial) -> bool:
    """Whether the rival is the cause with more parameters: then it lost by being no better."""
    more, less = candidate_of(rival.slot.shaped), candidate_of(own.slot.shaped)
    return more.key == less.key and set(more.effect.description.symbols) > set(
        less.effect.description.symbols
    )


def _reason(bench: Bench, own: Trial, rival: Trial) -> str:
    mine, its = own.reach_on(own.slot.groups), rival.reach_on(own.slot.groups)
    if its <= 0.0:
        return "explains nothing on unseen recordings"
    if _contains(rival, own):
        return "contains the cause, and its further parameters gain nothing on unseen recordings"
    share = 100.0 * its / mine if mine > 0.0 else 0.0
    if its > mine and price(bench, rival.slot) > price(bench, own.slot):
        return "does no better than its further parameters cost"
    return f"explains {share:.0f} % of what the cause explains on unseen recordings"
