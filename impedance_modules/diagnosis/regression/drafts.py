# SPDX-License-Identifier: BSD-3-Clause
"""Columns of all candidates on all recordings, thinned: evaluated one by one, filtered many at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.regression.candidates import Candidate, Group, columns_of
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]
Thin = NDArray[np.float32]

WAITING = 4_000_000
"""Values that may wait to be filtered together."""


@dataclass(eq=False)
class Draft:
    """A shape while the recordings are gone through one by one.

    Attributes:
        candidate: None for a generic stand-in.
        shape: Values of what enters nonlinearly.
        key: Effect, carrier and port.
        blocks: Recording -> group -> (M, width) thinned columns.
        fixed: Whether the last column has no coefficient.
        lower, upper: (p,) physical bounds; empty until it has shown somewhere.
    """

    candidate: Candidate | None
    shape: Mapping[str, float]
    key: tuple[str, str, str]
    blocks: list[dict[Group, Thin]] = field(default_factory=list)
    fixed: bool = False
    lower: Array = field(default_factory=lambda: np.zeros(0))
    upper: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.lower) + self.fixed


class Filler:
    """Filters columns of many candidates at once and hands them back to their drafts."""

    def __init__(self, item: Prepared) -> None:
        """Takes the recording whose band counts."""
        self._item = item
        self._waiting: list[tuple[dict[Group, Thin], Group, Thin]] = []
        self._size = 0

    def add(self, into: dict[Group, Thin], group: Group, block: Array) -> None:
        """Takes a block (N, p) at full rate; ``into[group]`` gets it thinned by the next `flush`."""
        self._waiting.append((into, group, block.astype(np.float32)))
        self._size += block.size
        if self._size > WAITING:
            self.flush()

    def flush(self) -> None:
        """Filters what waits."""
        if not self._waiting:
            return
        whole = np.concatenate([block for _, _, block in self._waiting], axis=1)
        thinned: Thin = self._item.band.condense(whole)
        first = 0
        for into, group, block in self._waiting:
            into[group] = thinned[:, first : first + block.shape[1]]
            first += block.shape[1]
        self._waiting, self._size = [], 0


def draft_candidates(
    shaped: Sequence[tuple[Candidate, Mapping[str, float]]],
    prepared: Sequence[Prepared],
    signals: Sequence[Signals],
    residuals: Sequence[Residual],
) -> list[Draft]:
    """Evaluates shapes of candidates on all recordings; what shows in no residual is left out.

    Args:
        shaped: Candidates with the values of what enters nonlinearly.
        prepared: The recordings.
        signals: Theirs, as columns may see them (`instrument`).
        residuals: That exist.
    """
    drafts = [
        Draft(candidate, shape, (candidate.effect.id, candidate.key, candidate.port))
        for candidate, shape in shaped
    ]
    for item, own in zip(prepared, signals, strict=True):
        filler = Filler(item)
        with item.remembered():
            for draft, (candidate, shape) in zip(drafts, shaped, strict=True):
                draft.blocks.append({})
                found = columns_of(candidate, shape, own, residuals)
                if found is None:
                    continue
                draft.lower, draft.upper = found.lower, found.upper
                draft.fixed = draft.fixed or found.fixed
                for group, block in found.blocks.items():
                    filler.add(draft.blocks[-1], group, block)
        filler.flush()
    return [_squared(draft) for draft in drafts if draft.lower.size]


def _squared(draft: Draft) -> Draft:
    """Gives all recordings the same number of columns: a fixed part that is zero there may be lacking."""
    for blocks in draft.blocks:
        for group, block in blocks.items():
            if block.shape[1] < draft.width:
                blocks[group] = np.pad(block, ((0, 0), (0, 1)))
    return draft


def alike(draft: Draft) -> tuple[object, ...]:
    """What two shapes of one effect on one carrier share if they are the same regression."""
    marks = tuple(
        (group, tuple(np.round(values[:40].sum(axis=0, dtype=float), 5)))
        for group, values in draft.blocks[0].items()
    )
    return (draft.key[0], draft.key[1], tuple(draft.shape.values()), marks)
