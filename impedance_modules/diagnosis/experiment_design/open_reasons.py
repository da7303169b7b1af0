# SPDX-License-Identifier: BSD-3-Clause
"""Why no motion answers a question, and what has to be recorded instead."""

from __future__ import annotations

import math
from collections.abc import Iterator

from impedance_modules.diagnosis.experiment_design.probe_questions import ProbeQuestion
from impedance_modules.diagnosis.experiment_design.separation import Separation
from impedance_modules.effects.catalogue import CATALOGUE

CHI_SQUARE = 200.0
"""Expected chi-square difference that answers a question."""

SHARE_PERHAPS = 0.02
"""Below this share no answer is expected: a diagnosis cannot separate causes within a hundredth."""

CERTAIN = 2000.0
"""From this chi-square on an answer can be hoped for below that share, too: a diagnosis weighs evidence as well."""

REPEATS_MAX = 20
"""More repeats of one motion than that are not proposed."""


def open_reason(question: ProbeQuestion, best: Separation) -> str:
    """Says why no motion of the library answers a question, and what to record.

    A rival that imitates the effect in every motion stays a rival however often it is recorded. An effect that is
    merely small beside the noise shows after some repeats: the chi-square of n equal recordings is n times that of
    one.

    Args:
        question: Which.
        best: The best that a safe motion of the library achieves.
    """
    instead = f"record instead: {'; '.join(dict.fromkeys(_excitations(question)))}"
    if any(CATALOGUE[one.effect].searched == "never" for one in (question.first, question.second)):
        return "the two are one law in all that is recorded: no recording can show which it is"
    if best.chi_square <= 0.0:
        return f"neither of the two shows in a motion of the library; {instead}"
    if best.share < SHARE_PERHAPS:
        imitated = 100.0 * (1.0 - best.share)
        return f"in every safe motion of the library the rival imitates {imitated:.3g} % of it; {instead}"
    repeats = math.ceil(CHI_SQUARE / best.chi_square)
    small = f"it is small beside the noise (chi-square {best.chi_square:.0f} of {CHI_SQUARE:.0f})"
    if repeats <= REPEATS_MAX:
        return f"{small}; record the motion {repeats} times"
    return f"{small}; {instead}"


def _excitations(question: ProbeQuestion) -> Iterator[str]:
    """What the catalogue says of each effect: the motion that tells it apart."""
    for one in (question.first, question.second):
        yield f"{CATALOGUE[one.effect].description.excitation} ({one.name})"
