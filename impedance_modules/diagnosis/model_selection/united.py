# SPDX-License-Identifier: BSD-3-Clause
"""Late torques of many joints under one name: a late bus delays all commands, and is one cause, not several.

Joint by joint a delay and a lag of the motor differ by little; near the noise chance would give some joints the one
name and some the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from impedance_modules.diagnosis.regression.model_fit import Bench
from impedance_modules.diagnosis.regression.parameter_estimates import Refiner
from impedance_modules.diagnosis.regression.term import Term, term_of
from impedance_modules.diagnosis.model_selection.candidate_trial import try_term

COMMON, OWN = "command_delay", "actuator_lag"
"""What all joints can share, and what each motor has for itself."""

JOINTS_MIN = 3
"""Joints that must be late for a common reason to be thought of."""

GIVEN_UP = 5.0
"""Log-likelihood that the common name may cost on a joint [nats]."""


def united(model: Sequence[Term], make: Callable[[Sequence[Term]], Bench], refiner: Refiner) -> list[Term]:
    """Exchanges lags for delays where most joints could be late alike and the recordings hardly mind.

    Args:
        model: Accepted causes.
        make: Fits a model.
        refiner: Moves shapes off their grid.
    """
    kept = list(model)
    late = {term.key[1] for term in kept if term.key[0] in {COMMON, OWN}}
    delayed = {term.key[1] for term in kept if term.key[0] == COMMON}
    if len(late) < JOINTS_MIN or not delayed:
        return kept
    for index, term in enumerate(model):
        if term.key[0] != OWN or term.key[1] in delayed:
            continue
        better = _delay(kept, term, make, refiner)
        if better is None:
            continue
        old, new = make(kept), make([*kept[:index], better, *kept[index + 1 :]])
        if 0.5 * float((new.left - old.left) @ old.weights) <= GIVEN_UP:
            kept[index] = better
    return kept


def _delay(
    model: Sequence[Term], lag: Term, make: Callable[[Sequence[Term]], Bench], refiner: Refiner
) -> Term | None:
    """The delay that does best in a lag's place; None where none was ever a candidate."""
    rest = make([other for other in model if other is not lag])
    slots = [slot for slot in rest.design.slots if slot.shaped.key[:2] == (COMMON, lag.key[1])]
    trials = [try_term(rest, term_of(rest.design, slot)) for slot in slots]
    if not trials:
        return None
    return refiner.refine(rest, max(trials, key=lambda trial: trial.seen.gain).term)
