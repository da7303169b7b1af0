# SPDX-License-Identifier: BSD-3-Clause
"""Contact mask: samples in contact with the environment, by the recording's phases, are not used for the links.

Forces of the environment are no property of the arm. A commanded contact happens in every repeat, so it cannot be
recognised as a push is, by its absence in a repeat. It changes only residuals that compare a torque with the motion
of the links; between command and torque sensor, and in velocities, all rows are used.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import Residual, uses_motion

Mask = NDArray[np.bool_]
MaskKey = TypeVar("MaskKey", bound=Hashable)

MARGIN = 0.2
"""Time about a contact's begin and end in which its surface is not judged [s]."""

CONTACT_MAX = 0.8
"""Part of all samples that may be in contact; beyond it too little free motion is left."""


def contact_free_rows(prepared: Sequence[Prepared], fitted: Sequence[int]) -> dict[int, Mask]:
    """Recording -> (M,) rows free of contact; empty without contact, or where nearly all that is fitted is contact."""
    out = _contact_free(prepared)
    return {} if _mostly_in_contact(out, prepared, fitted) else out


def rows_of_link_residuals(
    clear: Mapping[int, Mask], groups: Sequence[tuple[Residual, int]]
) -> dict[tuple[int, int], Mask]:
    """Recording and group -> (M,) rows to use, for the groups whose residual depends on the links' motion."""
    return {
        (r, g): mask
        for r, mask in clear.items()
        for g, (residual, _) in enumerate(groups)
        if uses_motion(residual)
    }


def without_links_in_contact(prepared: tuple[Prepared, ...], fitted: Sequence[int]) -> tuple[Prepared, ...]:
    """Drops the links' residuals where nearly all fitted samples are in contact, if the drives have some of their own.

    Args:
        prepared: All recordings.
        fitted: Those that are not held out.
    """
    rest = [name for name in prepared[0].residuals if not uses_motion(name) and name != "velocity"]
    if not rest or not _mostly_in_contact(_contact_free(prepared), prepared, fitted):
        return prepared
    return tuple(
        replace(item, residuals={name: x for name, x in item.residuals.items() if not uses_motion(name)})
        for item in prepared
    )


def contact_note(prepared: Sequence[Prepared], fitted: Sequence[int]) -> tuple[str, ...]:
    """Says what the phases of contact mean for the result; empty without any."""
    if all(item.log.in_contact is None for item in prepared):
        return ()
    free = contact_free_rows(prepared, fitted)
    if not free and any(uses_motion(name) for name in prepared[0].residuals):
        if not _contact_free(prepared):
            return ()
        return (
            "nearly everything is spent in contact, by the phases; nothing is masked for it, and forces of the"
            " environment may be taken for the arm's (record a motion in free air)",
        )
    if not free:
        return (
            "nearly everything is spent in contact, by the phases: only drives and sensors are judged, not the links"
            " (record a motion in free air)",
        )
    seconds = sum(masked_seconds(prepared[r], mask) for r, mask in free.items())
    holding = any(item.log.carrying is not None and item.log.carrying.any() for item in prepared)
    what = "holding an object or in contact" if holding else "in contact"
    acts = "the object's weight and forces of the environment" if holding else "forces of the environment"
    return (f"{seconds:.3g} s {what}, by the phases, are not used for the links: {acts} act there",)


def masked_seconds(item: Prepared, mask: Mask) -> float:
    """How long the rows last that a mask (M,) leaves out [s]."""
    return float((~mask).sum()) * item.band.step / item.band.rate


def intersect_masks(first: Mapping[MaskKey, Mask], second: Mapping[MaskKey, Mask]) -> dict[MaskKey, Mask]:
    """Rows that both masks keep; a place that only one mask has keeps that one."""
    out = dict(first)
    for place, mask in second.items():
        out[place] = out[place] & mask if place in out else mask
    return out


def _contact_free(prepared: Sequence[Prepared]) -> dict[int, Mask]:
    return {
        r: ~near_contact(item)
        for r, item in enumerate(prepared)
        if item.log.in_contact is not None and item.log.in_contact.any()
    }


def _mostly_in_contact(
    clear: Mapping[int, Mask], prepared: Sequence[Prepared], fitted: Sequence[int]
) -> bool:
    lost = sum(int((~clear[r]).sum()) for r in fitted if r in clear)
    return lost > CONTACT_MAX * sum(prepared[r].samples for r in fitted)


def near_contact(item: Prepared, reach: float | None = None) -> Mask:
    """Rows (M,) within reach of a contact [s]; left out: as far as the filter spreads it."""
    marks = item.log.in_contact
    if marks is None:
        return np.zeros(item.samples, dtype=bool)
    return near_marks(item, marks, item.band.reach if reach is None else reach)


def near_marks(item: Prepared, marks: Mask, reach: float) -> Mask:
    """Rows (M,) within reach of marked samples (N,) [s]."""
    log = item.log
    if not marks.any():
        return np.zeros(item.samples, dtype=bool)
    at = log.start + np.flatnonzero(marks) / log.rate
    after = np.searchsorted(at, item.time - reach)
    return np.asarray((after < len(at)) & (at[np.minimum(after, len(at) - 1)] <= item.time + reach))
