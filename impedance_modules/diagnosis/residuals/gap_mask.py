# SPDX-License-Identifier: BSD-3-Clause
"""Gap mask: rows about a gap in which several samples in a row were lost do not count.

Whoever was late, the robot or its logger, the command within the gap is not known: a robot holds the last one or obeys
others that nobody wrote down, and a straight line is neither. One lost sample is known from its neighbours; of a gap
that is long beside the filter's period nothing is, and the filter spreads what was filled in over its own length.
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


def rows_without_gaps(prepared: Sequence[Prepared]) -> dict[int, Mask]:
    """Recording -> (M,) rows farther than the filter's length from a long gap; empty without one."""
    clear = {r: _far_from_gaps(item) for r, item in enumerate(prepared) if len(item.log.gaps)}
    clear = {r: mask for r, mask in clear.items() if not mask.all()}
    lost = sum(int((~mask).sum()) for mask in clear.values())
    return clear if lost <= (1.0 - KEPT) * sum(item.samples for item in prepared) else {}


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


def _far_from_gaps(item: Prepared) -> Mask:
    reach = filter_length(item.band.cutoff)
    mask = np.ones(item.samples, dtype=bool)
    for begin, end in long_gaps(item):
        mask &= (item.time < begin - reach) | (item.time > end + reach)
    return mask
