# SPDX-License-Identifier: BSD-3-Clause
"""Gap mask: rows about a gap in which samples were lost do not count.

Whoever was late, the robot or its logger, the command within the gap is not known: a robot holds the last one or obeys
others that nobody wrote down, and a straight line is neither. One lost sample is known from its neighbours where many
lie in a period of the band's end. Of a gap that is long beside that period nothing is, and the filter spreads what was
filled in over its own length. What was filled into a short gap is as good as the noise of each reading, but torques and
velocities that are compared have much of it in common: rows about it are no loss where such gaps are rare.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.stamps import SEVERAL_LOST
from impedance_modules.diagnosis.residuals.contact_mask import Mask, masked_seconds
from impedance_modules.diagnosis.residuals.preparation import Prepared

FILLED_MAX = 0.2
"""Longest gap that may be filled in, in periods of the end of the band."""

KEPT = 0.5
"""Least part of all rows that must remain; where gaps are everywhere, the recordings are taken as they are."""

RARE = 0.1
"""Part of all rows that short gaps may cost; where they cost more, their rows count."""


def rows_without_gaps(prepared: Sequence[Prepared]) -> dict[int, Mask]:
    """Recording -> (M,) rows farther than the filter's reach from gaps.

    From all gaps where they are rare; else from as many of the long ones as leave enough rows: those in which several
    samples were lost come first.
    """
    everything = [np.ones(len(item.log.gaps), dtype=bool) for item in prepared]
    several, long = [_several(item) for item in prepared], [_long(item) for item in prepared]
    if not _clear_rows(prepared, several, 1.0 - RARE):
        several = [some & far for some, far in zip(several, long, strict=True)]
    both = [some | far for some, far in zip(several, long, strict=True)]
    for gaps, kept in ((everything, 1.0 - RARE), (both, KEPT), (several, KEPT)):
        clear = _clear_rows(prepared, gaps, kept)
        if clear:
            return clear
    return {}


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
    return (f"samples were lost; what lies about these gaps does not count: {places}",)


def lost_stretches(item: Prepared) -> Array:
    """The gaps (G, 2) of several samples that are too long to be filled in, since the recording began [s]."""
    return np.asarray(item.log.gaps[_several(item) & _long(item)])


def _long(item: Prepared) -> Mask:
    """Marks the gaps (G,) that are too long to be filled in."""
    return np.asarray(np.diff(item.log.gaps)[:, 0] * item.band.cutoff > FILLED_MAX)


def _several(item: Prepared) -> Mask:
    """Marks the gaps (G,) in which several samples in a row were lost."""
    return np.asarray(np.diff(item.log.gaps)[:, 0] * item.log.rate > SEVERAL_LOST)


def _clear_rows(prepared: Sequence[Prepared], gaps: Sequence[Mask], kept: float) -> dict[int, Mask]:
    """Recording -> (M,) rows far from its marked gaps; empty without any, or where less than a part would be kept."""
    clear = {r: _far_from(prepared[r], marks) for r, marks in enumerate(gaps) if marks.any()}
    clear = {r: mask for r, mask in clear.items() if not mask.all()}
    lost = sum(int((~mask).sum()) for mask in clear.values())
    return clear if lost <= (1.0 - kept) * sum(item.samples for item in prepared) else {}


def _far_from(item: Prepared, marks: Mask) -> Mask:
    """Rows (M,) out of reach of the marked gaps, of which there may be thousands: they follow each other in time."""
    reach = item.band.reach
    begin, end = item.log.gaps[marks].T
    last = np.searchsorted(begin - reach, item.time, side="right") - 1
    return np.asarray((last < 0) | (item.time > end[np.maximum(last, 0)] + reach))
