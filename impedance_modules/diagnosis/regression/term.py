# SPDX-License-Identifier: BSD-3-Clause
"""A candidate that takes part in a fit, with its own whitened columns: tried, accepted, or refined off the grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.regression.candidates import Candidate, Shaped
from impedance_modules.diagnosis.regression.design_matrix import Design
from impedance_modules.diagnosis.regression.slots import Slot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Term:
    """A shaped candidate with its columns.

    Attributes:
        slot: Its description.
        columns: Recording -> group -> (M, p) whitened and scaled.
        fixed: Recording -> group -> (M,) whitened part without a coefficient; empty where there is none.
    """

    slot: Slot
    columns: tuple[Mapping[int, Array], ...]
    fixed: tuple[Mapping[int, Array], ...]

    @property
    def shaped(self) -> Shaped:
        """The candidate in its shape."""
        return self.slot.shaped

    @property
    def key(self) -> tuple[str, str, str]:
        """Effect, carrier and port."""
        return self.slot.shaped.key

    @property
    def groups(self) -> tuple[int, ...]:
        """Groups that it touches."""
        return self.slot.groups

    @property
    def generic(self) -> bool:
        """Whether it is a stand-in without physics."""
        return self.slot.shaped.candidate is None

    @property
    def candidate(self) -> Candidate:
        """The physical candidate.

        Raises:
            TypeError: It is a stand-in.
        """
        if self.slot.shaped.candidate is None:
            raise TypeError("a generic stand-in has no physical candidate")
        return self.slot.shaped.candidate


def term_of(design: Design, slot: Slot) -> Term:
    """Cuts a candidate's columns out of the design."""
    size, width = slot.shaped.size, slot.shaped.width
    blocks = [
        {group: block[group][:, first : first + width].astype(float) for group, first in slot.places.items()}
        for block in design.X
    ]
    return Term(
        slot=slot,
        columns=tuple({group: block[:, :size] for group, block in found.items()} for found in blocks),
        fixed=tuple(
            {group: block[:, size] for group, block in found.items() if width > size} for found in blocks
        ),
    )


def part_of(term: Term, kept: NDArray[np.intp]) -> Term:
    """Keeps some of a term's coefficients."""
    slot = term.slot
    shaped = replace(
        slot.shaped, size=len(kept), lower=slot.shaped.lower[kept], upper=slot.shaped.upper[kept]
    )
    return Term(
        slot=Slot(shaped, slot.places, slot.scale[kept], slot.precision[kept], slot.unseen[kept]),
        columns=tuple({g: block[:, kept] for g, block in found.items()} for found in term.columns),
        fixed=term.fixed,
    )
