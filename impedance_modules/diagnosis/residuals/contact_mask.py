# SPDX-License-Identifier: BSD-3-Clause
"""Moments in which the robot touches something, as the recording's own phases say: they are left aside.

What the surroundings do to the hand is no property of the arm, and a contact that is commanded comes back in every
repeat: unlike a push it cannot be told from the arm's own torques by its absence. It shows where the links' motion is
compared with a torque, and there alone: between command and torque sensor, and in velocities, all rows count.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import Residual, uses_motion

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Place = TypeVar("Place", bound=Hashable)

MARGIN = 0.2
"""Before and after a contact that is left aside with it: the filter's reach [s]."""

MOST = 0.8
"""Part of all samples that contact may fill; beyond it hardly a motion of the links is left to compare."""


def contact_free_rows(prepared: Sequence[Prepared]) -> dict[int, Mask]:
    """Recording -> (M,) rows that no contact touches; empty without contact, or with hardly anything else."""
    out = _contact_free(prepared)
    return {} if _mostly_in_contact(out, prepared) else out


def rows_of_link_residuals(
    clear: Mapping[int, Mask], groups: Sequence[tuple[Residual, int]]
) -> dict[tuple[int, int], Mask]:
    """Recording and group -> (M,) rows that count: what touches the robot shows where its links' motion is compared."""
    return {
        (r, g): mask
        for r, mask in clear.items()
        for g, (residual, _) in enumerate(groups)
        if uses_motion(residual)
    }


def without_links_in_contact(prepared: tuple[Prepared, ...]) -> tuple[Prepared, ...]:
    """Leaves the links' residuals out where contact fills nearly all, if the drives have residuals of their own."""
    rest = [name for name in prepared[0].residuals if not uses_motion(name) and name != "velocity"]
    if not rest or not _mostly_in_contact(_contact_free(prepared), prepared):
        return prepared
    return tuple(
        replace(item, residuals={name: x for name, x in item.residuals.items() if not uses_motion(name)})
        for item in prepared
    )


def contact_note(prepared: Sequence[Prepared]) -> tuple[str, ...]:
    """Says what the phases of contact mean for the answer; nothing without any."""
    if all(item.log.in_contact is None for item in prepared):
        return ()
    aside = contact_free_rows(prepared)
    if not aside and any(uses_motion(name) for name in prepared[0].residuals):
        if not _contact_free(prepared):
            return ()
        return (
            "nearly everything is spent in contact, by the phases; nothing is left aside for it, and what the"
            " surroundings do may be taken for the arm's (record a motion in free air)",
        )
    if not aside:
        return (
            "nearly everything is spent in contact, by the phases: only drives and sensors are judged, not the links"
            " (record a motion in free air)",
        )
    seconds = sum(
        float((~mask).sum()) * item.band.step / item.band.rate
        for mask, item in ((mask, prepared[r]) for r, mask in aside.items())
    )
    return (
        f"{seconds:.3g} s in contact, by the phases, are left aside for the links: they say nothing about the arm",
    )


def intersect_masks(first: Mapping[Place, Mask], second: Mapping[Place, Mask]) -> dict[Place, Mask]:
    """Rows that count for two reasons at once."""
    out = dict(first)
    for place, mask in second.items():
        out[place] = out[place] & mask if place in out else mask
    return out


def _contact_free(prepared: Sequence[Prepared]) -> dict[int, Mask]:
    return {
        r: ~_near_contact(item)
        for r, item in enumerate(prepared)
        if item.log.in_contact is not None and item.log.in_contact.any()
    }


def _mostly_in_contact(clear: Mapping[int, Mask], prepared: Sequence[Prepared]) -> bool:
    lost = sum(int((~mask).sum()) for mask in clear.values())
    return lost > MOST * sum(item.samples for item in prepared)


def _near_contact(item: Prepared) -> Mask:
    """Rows (M,) within the margin of a contact."""
    log = item.log
    if log.in_contact is None:
        return np.zeros(item.samples, dtype=bool)
    at = log.start + np.flatnonzero(log.in_contact) / log.rate
    after = np.searchsorted(at, item.time - MARGIN)
    return np.asarray((after < len(at)) & (at[np.minimum(after, len(at) - 1)] <= item.time + MARGIN))
