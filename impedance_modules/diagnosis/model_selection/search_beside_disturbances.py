# SPDX-License-Identifier: BSD-3-Clause
"""The search beside moments that no law has: a knock on a single joint, a cable that catches, a shaken base.

A push on a link that several joints feel is a cause (`external_pushes`). What one joint feels alone, or what no single
force explains, could be anything, and is none. But as long as such moments count, they hide causes that are there all
the time, and others are named for them. So they are left out, and causes are searched again. What lay hidden may show
then, and other moments beside it, so that is done again. The gap of these moments stays unexplained.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.calm_moments import calm_rows
from impedance_modules.diagnosis.model_selection.external_pushes import runs_of
from impedance_modules.diagnosis.model_selection.forward_selection import Selection, Selector
from impedance_modules.diagnosis.model_selection.lack_of_fit import MOMENT_MAX, moment_ratio
from impedance_modules.diagnosis.model_selection.search_beside_pushes import fits_as_well
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.regression.disturbed_moments import OUTLYING_SHARE_MAX
from impedance_modules.diagnosis.regression.model_fit import ModelFit
from impedance_modules.diagnosis.residuals.contact_mask import Mask, intersect_masks
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import uses_motion

RowsOfGroups = Mapping[tuple[int, int], Mask]
"""Recording and group -> (M,) rows."""

PASSES = 3
"""Times that the search is repeated at most: each takes as long as the first."""


def without_disturbances(
    selector: Selector, found: Selection, prepared: Sequence[Prepared], progress: Callable[[str], None]
) -> tuple[Selector, Selection, RowsOfGroups]:
    """Repeats the search without moments in which the causes leave what neither they nor noise can have.

    Returns:
        The search, what it found, and the rows that it leaves out: none where there are no such moments, or too many
        of them. It is not repeated where the causes that were found with them explain the other rows better.
    """
    first, begun, disturbed = selector, found, dict[tuple[int, int], Mask]()
    for _ in range(PASSES):
        clear = _clear_rows(selector.model_fit(found.causes), prepared)
        if not clear:
            break
        known = selector.design.whitening.clear
        wider = _lost(clear, known, disturbed)
        if _share(wider) > OUTLYING_SHARE_MAX:
            return first, begun, {}
        progress("masking moments that no law has")
        masked = selector.on(selector.design.without(intersect_masks(known, clear)))
        again = masked.run(progress)
        if not fits_as_well(masked, again.causes, found.causes):
            break
        selector, found, disturbed = masked, again, wider
    return selector, found, disturbed


def _clear_rows(model_fit: ModelFit, prepared: Sequence[Prepared]) -> dict[tuple[int, int], Mask]:
    """Rows without moments that are unusual beside the others and cannot be noise; empty where there are none."""
    design, coefficients = model_fit.design, model_fit.whole.coefficients
    left = [model_fit.residuals(coefficients, r) for r in range(len(prepared))]
    moved = [g for g, (residual, _) in enumerate(design.groups) if uses_motion(residual)]
    loudest = max((moment_ratio([own[g] for own in left], design.rate) for g in moved), default=0.0)
    return calm_rows(model_fit, prepared) if loudest > MOMENT_MAX else {}


def _lost(clear: RowsOfGroups, known: RowsOfGroups, before: RowsOfGroups) -> dict[tuple[int, int], Mask]:
    """Rows that count no more: those lost ``before``, and those of the ``known`` ones that are not ``clear``."""
    out = {}
    for place, rows in clear.items():
        nothing = np.zeros(len(rows), dtype=bool)
        out[place] = before.get(place, nothing) | (known.get(place, ~nothing) & ~rows)
    return out


def disturbance_notes(
    disturbed: RowsOfGroups, prepared: Sequence[Prepared], groups: Sequence[Group]
) -> tuple[str, ...]:
    """Says of each recording when something disturbed it, and how large the gap is then."""
    notes = []
    for r, item in enumerate(prepared):
        own = {g: rows for (recording, g), rows in disturbed.items() if recording == r and rows.any()}
        if not own:
            continue
        peaks = {g: float(np.abs(_gap(item, groups[g])[rows]).max()) for g, rows in own.items()}
        names = [
            _peak(item, groups[g], peak) for g, peak in peaks.items() if peak >= 0.5 * max(peaks.values())
        ]
        spans = ", ".join(f"{start:.2f} to {end:.2f} s" for start, end in _spans(item, own))
        notes.append(
            f"{item.log.name}: {spans}: no law has what acts then, {' and '.join(names)}; these rows are left out"
            f" (a knock, or whatever touched it)"
        )
    return tuple(notes)


def _share(disturbed: RowsOfGroups) -> float:
    rows = np.concatenate(list(disturbed.values()))
    return float(np.mean(rows))


def _gap(item: Prepared, group: Group) -> Array:
    residual, joint = group
    return item.residuals[residual][:, joint]


def _peak(item: Prepared, group: Group, peak: float) -> str:
    _, joint = group
    return f"a gap of up to {peak:.2g} {item.tree.units()[joint]} on {item.tree.joints[joint]}"


def _spans(item: Prepared, own: Mapping[int, Mask]) -> list[tuple[float, float]]:
    """Begin and end of each run of rows, in the recording that a segment was cut from [s]."""
    runs = runs_of(np.any(list(own.values()), axis=0))
    return [(float(item.time[first]), float(item.time[last - 1])) for first, last in runs]
