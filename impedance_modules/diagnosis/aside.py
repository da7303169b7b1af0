# SPDX-License-Identifier: BSD-3-Clause
"""Moments in which the robot touches something, as the recording's own phases say: they are left aside.

What the surroundings do to the hand is no property of the arm, and a contact that is commanded comes back in every
repeat: unlike a push it cannot be told from the arm's own torques by its absence.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.episode.data import Episode

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WORD = re.compile(r"(^|[^a-z])(in_)?contact([^a-z]|$)")
"""A phase with this name, or with this word in its name, is spent in contact ..."""

NEGATION = re.compile(r"(^|[^a-z])(no|non|without|before|until|free)([^a-z]|$)")
"""... unless the rest of the name takes it back."""

MARGIN = 0.2
"""Before and after a contact that is left aside with it: the filter's reach [s]."""

MOST = 0.8
"""Part of all samples that contact may fill; beyond it nothing would be left to compare."""


def touching(episode: Episode, time: Array) -> Mask | None:
    """Marks the times (N,) that fall into a phase of contact; None where no phase says so."""
    if episode.phase is None:
        return None
    named = {phase for phase in set(episode.phase) if phase is not None and _is_contact(phase)}
    if not named:
        return None
    marks = np.array([phase in named for phase in episode.phase])
    nearest = np.searchsorted(episode.time, time - 1e-9).clip(0, len(marks) - 1)
    return np.asarray(marks[nearest])


def _is_contact(phase: str) -> bool:
    name = phase.lower()
    return WORD.search(name) is not None and NEGATION.search(name) is None


def contact_aside(prepared: Sequence[Prepared]) -> dict[int, Mask]:
    """Recording -> (M,) rows that no contact touches; empty without contact, or with hardly anything else."""
    out: dict[int, Mask] = {}
    for r, item in enumerate(prepared):
        if item.log.touching is not None and item.log.touching.any():
            out[r] = ~_widened(item)
    lost = sum(int((~mask).sum()) for mask in out.values())
    return {} if lost > MOST * sum(item.samples for item in prepared) else out


def contact_note(prepared: Sequence[Prepared]) -> tuple[str, ...]:
    """Says what the phases of contact mean for the answer; nothing without any."""
    if all(item.log.touching is None for item in prepared):
        return ()
    aside = contact_aside(prepared)
    if not aside:
        return ("nearly everything is spent in contact, by the phases; nothing is left aside for it",)
    seconds = sum(
        float((~mask).sum()) * item.band.step / item.band.rate
        for mask, item in ((mask, prepared[r]) for r, mask in aside.items())
    )
    return (
        f"{seconds:.3g} s in contact, by the phases, are left aside: they say nothing about the arm alone",
    )


def both(first: Mapping[int, Mask], second: Mapping[int, Mask]) -> dict[int, Mask]:
    """Rows that count for two reasons at once."""
    out = dict(first)
    for r, mask in second.items():
        out[r] = out[r] & mask if r in out else mask
    return out


def _widened(item: Prepared) -> Mask:
    """Rows (M,) within the margin of a contact."""
    log = item.log
    if log.touching is None:
        return np.zeros(item.samples, dtype=bool)
    at = log.start + np.flatnonzero(log.touching) / log.rate
    after = np.searchsorted(at, item.time - MARGIN)
    return np.asarray((after < len(at)) & (at[np.minimum(after, len(at) - 1)] <= item.time + MARGIN))
