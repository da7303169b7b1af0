# SPDX-License-Identifier: BSD-3-Clause
"""Gap mask: rows about a gap in which several samples in a row were lost do not count.

Whoever was late, the robot or its logger, the command within the gap is not known: a robot holds the last one or obeys
others that nobody wrote down, and a straight line is neither. One lost sample is known from its neighbours; of a gap
that is long beside the filter's period nothing is, and the filter spreads what was filled in over its own length. What
was filled into a short gap is as good as the noise of each reading, but torques and velocities that are compared have
much of it in common: rows about it are no loss where such gaps are rare.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from impedance_modules.diagnosis.residuals.band import filter_length
from impedance_modules.diagnosis.residuals.contact_mask import Mask, masked_seconds
from impedance_modules.diagnosis.residuals.preparation import Prepared

FILLED_MAX = 0.2
"""Longest gap that may be filled in, in periods of the end of the band."""

KEPT = 0.5
"""Least part of all rows that must remain; where gaps are everywhere, the recordings are taken as they are."""

RARE = 0.1
"""Part of all rows that short gaps may cost; where they cost more, their rows count."""


def rows_without_gaps(prepared: Sequence[Prepared]) -> dict[int, Mask]:
    """Recording -> (M,) rows farther than the filter's length from gaps: all where they are rare, else long ones."""
    every = _clear_rows(prepared, [[(a, b) for a, b in item.log.gaps] for item in prepared], 1.0 - RARE)
    return every or _clear_rows(prepared, [long_gaps(item) for item in prepared], KEPT)


def rows_of_all_residuals(clear: Mapping[int, Mask], groups: int) -> dict[tuple[int, int], Mask]:
    """Recording and group -> (M,) rows to use: what was filled in is in every residual."""
    return {(r, g): mask for r, mask in clear.items() for g in range(groups)}


def gap_note(prepared: Sequence[Prepared]) -> tuple[str, ...]:
    """Says how much does not count because of gaps; empty without any."""
    lost = {
        prepared[r].log.name: masked_seconds(prepared[r], mask)
        for r, mask in rows_without_gaps(prepared).items()
    }
    if not lost:
        return ()
    places = ", ".join(f"{name} ({seconds:.3g} s)" for name, seconds in lost.items())
    return (f"several samples in a row were lost; what lies about these gaps does not count: {places}",)


def long_gaps(item: Prepared) -> list[tuple[float, float]]:
    """Begin and end of the gaps that are too long to be filled in, since the recording began [s]."""
    return [(a, b) for a, b in item.log.gaps if (b - a) * item.band.cutoff > FILLED_MAX]


def _clear_rows(
    prepared: Sequence[Prepared], gaps: Sequence[Sequence[tuple[float, float]]], kept: float
) -> dict[int, Mask]:
    """Recording -> (M,) rows far from its gaps; empty without any, or where less than a part of all would be kept."""
    clear = {r: _far_from(prepared[r], places) for r, places in enumerate(gaps) if places}
    clear = {r: mask for r, mask in clear.items() if not mask.all()}
    lost = sum(int((~mask).sum()) for mask in clear.values())
    return clear if lost <= (1.0 - kept) * sum(item.samples for item in prepared) else {}


def _far_from(item: Prepared, gaps: Sequence[tuple[float, float]]) -> Mask:
    reach = filter_length(item.band.cutoff)
    mask = np.ones(item.samples, dtype=bool)
    for begin, end in gaps:
        mask &= (item.time < begin - reach) | (item.time > end + reach)
    return mask
