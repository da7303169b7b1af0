# SPDX-License-Identifier: BSD-3-Clause
r"""The regression that all candidates compete in: rows of all recordings, columns of all candidates.

Rows fall into groups (one residual of one joint) and recordings. The nuisance (what any recording may be wrong
by, see `nuisance`) has columns of its own, scaled to one standard deviation of their prior; then come the columns
of every shaped candidate. Candidates' columns are kept in single precision: there are thousands of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.regression.drafts import Draft
from impedance_modules.diagnosis.regression.nuisance_columns import Nuisance
from impedance_modules.diagnosis.regression.slots import Slot, scaled_block, slots_of
from impedance_modules.diagnosis.regression.whitening import ORDER, Whitening

Array = NDArray[np.float64]
Thin = NDArray[np.float32]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Real = TypeVar("Real", Array, Thin)


@dataclass(frozen=True, eq=False)
class Design:
    """All rows, whitened: noise of unit size, each sample independent of the others.

    Attributes:
        groups: The groups.
        names: Names of the recordings.
        nuisance: What may be wrong everywhere.
        whitening: How rows were whitened.
        raw: Recording -> group -> (M,) residual in its own unit.
        y: Recording -> group -> (M - order,) whitened residual.
        Z: Recording -> group -> (M - order, k) whitened nuisance columns.
        X: Recording -> group -> (M - order, C) whitened candidates' columns.
        slots: One per shaped candidate that shows at all.
        rate: Of the rows [Hz].
    """

    groups: tuple[Group, ...]
    names: tuple[str, ...]
    nuisance: Nuisance
    whitening: Whitening
    raw: tuple[tuple[Array, ...], ...]
    y: tuple[tuple[Array, ...], ...]
    Z: tuple[tuple[Array, ...], ...]
    X: tuple[tuple[Thin, ...], ...]
    slots: tuple[Slot, ...]
    rate: float

    def count(self, recordings: Sequence[int]) -> Array:
        """Number of independent samples of each group in some recordings, (groups,)."""
        rows = [
            sum(self.whitening.rows(r, g, len(self.y[r][g])) for r in recordings)
            for g in range(len(self.groups))
        ]
        return np.asarray(self.whitening.part * np.array(rows, dtype=float))

    def without(self, clear: Mapping[tuple[int, int], Mask]) -> Design:
        """The same design without some rows: recording and group -> (M,) those that count."""
        whitening = replace(self.whitening, clear=clear)
        keep = {at: np.convolve(~mask, np.ones(ORDER + 1))[ORDER:-ORDER] == 0.0 for at, mask in clear.items()}

        def cut(blocks: tuple[tuple[Real, ...], ...]) -> tuple[tuple[Real, ...], ...]:
            return tuple(
                tuple(_kept(block, keep.get((r, g))) for g, block in enumerate(recording))
                for r, recording in enumerate(blocks)
            )

        return replace(self, whitening=whitening, y=cut(self.y), Z=cut(self.Z), X=cut(self.X))

    @cached_property
    def shapes(self) -> Mapping[tuple[str, str, str], int]:
        """Candidate -> how many shapes of it are tried."""
        return Counter(slot.shaped.key for slot in self.slots)

    @cached_property
    def nuisance_gram(self) -> tuple[tuple[Array, ...], ...]:
        """Recording -> group -> (k, k) Z^T Z."""
        return tuple(tuple(block.T @ block for block in recording) for recording in self.Z)


def _kept(block: Real, keep: Mask | None) -> Real:
    """Puts rows that do not count to zero."""
    if keep is None:
        return block
    out = block.copy(order="K")
    out[~keep] = 0.0
    return out


def build_design(
    drafts: Sequence[Draft],
    nuisance: Nuisance,
    raw: Sequence[Sequence[Array]],
    whitening: Whitening,
    *,
    names: Sequence[str],
    rate: float,
) -> Design:
    """Whitens everything and puts the candidates' columns side by side.

    Args:
        drafts: Candidates, all shapes, on all recordings.
        nuisance: What may be wrong everywhere.
        raw: Recording -> group -> (M,) residuals.
        whitening: Of the noise.
        names: Of the recordings.
        rate: Of the rows [Hz].
    """
    slots, members = slots_of(drafts, nuisance)
    return Design(
        groups=nuisance.groups,
        names=tuple(names),
        nuisance=nuisance,
        whitening=whitening,
        raw=tuple(tuple(recording) for recording in raw),
        y=whitened(raw, whitening),
        Z=whitened(nuisance.columns, whitening),
        X=tuple(
            tuple(
                _beside(
                    [(drafts[i], slots[i]) for i in inside],
                    (r, g),
                    nuisance.groups[g],
                    whitening,
                    len(raw[r][g]),
                )
                for g, inside in enumerate(members)
            )
            for r in range(len(raw))
        ),
        slots=tuple(slots.values()),
        rate=rate,
    )


def whitened(blocks: Sequence[Sequence[Array]], whitening: Whitening) -> tuple[tuple[Array, ...], ...]:
    """Whitens recording -> group -> (M, ...) rows."""
    return tuple(
        tuple(np.asarray(whitening.apply(block, r, g)) for g, block in enumerate(recording))
        for r, recording in enumerate(blocks)
    )


def _beside(
    members: Sequence[tuple[Draft, Slot]],
    place: tuple[int, int],
    group: Group,
    whitening: Whitening,
    rows: int,
) -> Thin:
    blocks = [scaled_block(draft, slot, place[0], group, rows) for draft, slot in members]
    whole = np.concatenate(blocks, axis=1) if blocks else np.zeros((rows, 0), np.float32)
    return np.asfortranarray(whitening.apply(whole, *place), dtype=np.float32)
