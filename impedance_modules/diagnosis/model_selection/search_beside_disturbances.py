# SPDX-License-Identifier: BSD-3-Clause
"""The search beside moments that no law has: a knock on a single joint, a cable that catches, a shaken base.

A push on a link that several joints feel is a cause (`external_pushes`). What one joint feels alone, or what no single
force explains, could be anything, and is none. But as long as such moments count, they hide causes that are there all
the time, and others are named for them. So they are left out, and causes are searched again. What lay hidden may show
then, and other moments beside it: the search ends where none is left. The gap of these moments stays unexplained.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.calm_moments import calm_rows
from impedance_modules.diagnosis.model_selection.forward_selection import Selection, Selector
from impedance_modules.diagnosis.model_selection.lack_of_fit import MOMENT_MAX, moment_ratio
from impedance_modules.diagnosis.model_selection.search_beside_pushes import fits_as_well
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.regression.disturbed_moments import OUTLYING_SHARE_MAX
from impedance_modules.diagnosis.regression.model_fit import ModelFit
from impedance_modules.diagnosis.residuals.contact_mask import Mask, intersect_masks
from impedance_modules.diagnosis.residuals.preparation import Prepared

RowsOfGroups = Mapping[tuple[int, int], Mask]
"""Recording and group -> (M,) rows."""


def without_disturbances(
    selector: Selector, found: Selection, prepared: Sequence[Prepared], progress: Callable[[str], None]
) -> tuple[Selector, Selection, RowsOfGroups]:
    """Repeats the search without moments in which the causes leave what neither they nor noise can have.

    Returns:
        The search, what it found, and the rows that it leaves out; as given, and none, where there are no such
        moments, too many of them, or causes that explain the other rows better with them.
    """
    first, begun, disturbed = selector, found, dict[tuple[int, int], Mask]()
    while clear := _clear_rows(selector.model_fit(found.causes), prepared):
        known = selector.design.whitening.clear
        every = {place: np.ones(len(rows), dtype=bool) for place, rows in clear.items()}
        new = {place: known.get(place, every[place]) & ~rows for place, rows in clear.items()}
        disturbed = {place: rows | disturbed.get(place, ~every[place]) for place, rows in new.items()}
        if _share(disturbed) > OUTLYING_SHARE_MAX:
            return first, begun, {}
        progress("masking moments that no law has")
        masked = selector.on(selector.design.without(intersect_masks(known, clear)))
        again = masked.run(progress)
        if not fits_as_well(masked, again.causes, found.causes):
            return first, begun, {}
        selector, found = masked, again
    return selector, found, disturbed


def _clear_rows(model_fit: ModelFit, prepared: Sequence[Prepared]) -> dict[tuple[int, int], Mask]:
    """Rows without moments that are unusual beside the others and cannot be noise; empty where there are none."""
    left = [model_fit.residuals(model_fit.whole.coefficients, r) for r in range(len(prepared))]
    moments = (moment_ratio([own[g] for own in left], model_fit.design.rate) for g in range(len(left[0])))
    return calm_rows(model_fit, prepared) if max(moments) > MOMENT_MAX else {}


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
    return f"up to {peak:.2g} {item.tree.units()[joint]} on {item.tree.joints[joint]}"


def _spans(item: Prepared, own: Mapping[int, Mask]) -> list[tuple[float, float]]:
    """Begin and end of each run of rows, in the recording that a segment was cut from [s]."""
    rows = np.any(list(own.values()), axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int)))
    return [
        (float(item.time[a]), float(item.time[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
