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

from impedance_modules.diagnosis.data.stamps import SEVERAL_LOST
from impedance_modules.diagnosis.residuals.contact_mask import Mask, masked_seconds
from impedance_modules.diagnosis.residuals.preparation import Prepared

Gap = tuple[float, float]
"""Times of the last sample before and of the first after lost ones, since the recording began [s]."""

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
    several = _rare_or_long(prepared, [several_lost(item) for item in prepared])
    for gaps, kept in (
        ([_all_gaps(item) for item in prepared], 1.0 - RARE),
        ([[*some, *long_gaps(item)] for some, item in zip(several, prepared, strict=True)], KEPT),
        (several, KEPT),
    ):
        clear = _clear_rows(prepared, gaps, kept)
        if clear:
            return clear
    return {}


def _rare_or_long(prepared: Sequence[Prepared], gaps: Sequence[Sequence[Gap]]) -> Sequence[Sequence[Gap]]:
    """Gaps of all recordings, or only the long ones where all would cost too many rows."""
    if _clear_rows(prepared, gaps, 1.0 - RARE):
        return gaps
    return [
        [gap for gap in some if gap in long_gaps(item)] for some, item in zip(gaps, prepared, strict=True)
    ]


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


def long_gaps(item: Prepared) -> list[Gap]:
    """The gaps that are too long to be filled in."""
    return [(a, b) for a, b in _all_gaps(item) if (b - a) * item.band.cutoff > FILLED_MAX]


def several_lost(item: Prepared) -> list[Gap]:
    """The gaps in which several samples in a row were lost."""
    return [(a, b) for a, b in _all_gaps(item) if (b - a) * item.log.rate > SEVERAL_LOST]


def lost_stretches(item: Prepared) -> list[Gap]:
    """The gaps of several samples that are too long to be filled in."""
    return [gap for gap in several_lost(item) if gap in long_gaps(item)]


def _all_gaps(item: Prepared) -> list[Gap]:
    return [(float(a), float(b)) for a, b in item.log.gaps]


def _clear_rows(prepared: Sequence[Prepared], gaps: Sequence[Sequence[Gap]], kept: float) -> dict[int, Mask]:
    """Recording -> (M,) rows far from its gaps; empty without any, or where less than a part of all would be kept."""
    clear = {r: _far_from(prepared[r], places) for r, places in enumerate(gaps) if places}
    clear = {r: mask for r, mask in clear.items() if not mask.all()}
    lost = sum(int((~mask).sum()) for mask in clear.values())
    return clear if lost <= (1.0 - kept) * sum(item.samples for item in prepared) else {}


def _far_from(item: Prepared, gaps: Sequence[Gap]) -> Mask:
    reach = item.band.reach
    mask = np.ones(item.samples, dtype=bool)
    for begin, end in gaps:
        mask &= (item.time < begin - reach) | (item.time > end + reach)
    return mask
