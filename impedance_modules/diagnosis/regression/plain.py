# SPDX-License-Identifier: BSD-3-Clause
"""A fitted model in the residuals' own units and band: what it leaves of a recording, unwhitened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.regression.model_fit import Bench
from impedance_modules.diagnosis.regression.parameter_estimates import Refiner
from impedance_modules.diagnosis.regression.slots import scaled_block
from impedance_modules.diagnosis.regression.term import Term

Array = NDArray[np.float64]


class PlainRows:
    """Unwhitened columns of the terms that a diagnosis speaks about, evaluated once each."""

    def __init__(self, refiner: Refiner) -> None:
        """Takes what can evaluate candidates."""
        self._refiner, self.design = refiner, refiner.design
        self._kept: dict[int, tuple[Term, list[dict[int, Array]]]] = {}

    def _columns(self, term: Term) -> Sequence[Mapping[int, Array]]:
        if id(term) not in self._kept:
            draft = self._refiner.draft(term.candidate, term.shaped.shape)
            rows = []
            for r, raw in enumerate(self.design.raw):
                rows.append(
                    {
                        g: scaled_block(draft, term.slot, r, self.design.groups[g], len(raw[g])).astype(float)
                        for g in term.groups
                    }
                    if draft is not None
                    else {}
                )
            self._kept[id(term)] = (term, rows)
        return self._kept[id(term)][1]

    def torque(self, bench: Bench, index: int, recording: int) -> dict[int, Array]:
        """What one term of a bench's whole fit adds to a recording: group -> (M,) in the group's unit."""
        term, start = bench.model[index], int(bench.starts[index])
        own = bench.whole.coefficients[start : start + term.shaped.size]
        whole = np.append(own, np.ones(int(term.shaped.fixed)))
        return {g: block @ whole for g, block in self._columns(term)[recording].items()}

    def left(self, bench: Bench, recording: int) -> list[Array]:
        """What a bench's whole fit leaves of a recording: group -> (M,) in the group's unit."""
        design = self.design
        coefficients = bench.whole.coefficients
        out = [
            raw - columns @ coefficients[ids]
            for raw, columns, ids in zip(
                design.raw[recording], design.nuisance.columns[recording], design.nuisance.ids, strict=True
            )
        ]
        for index in range(len(bench.model)):
            for g, torque in self.torque(bench, index, recording).items():
                out[g] = out[g] - torque
        return out
