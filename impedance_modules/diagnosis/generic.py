# SPDX-License-Identifier: BSD-3-Clause
r"""The generic stand-in: what any smooth function of a joint's signals could explain, without physics.

    r = \sum_k c_k \tanh(w_k \cdot (q, v, a, \tau) + b_k)

with signals scaled to unit size and random w, b of a fixed seed. A cause is named only if it does clearly better
than the best of these with as many coefficients; otherwise the data only say that *something* is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.candidates import Candidate, Group, Shaped
from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.effects.residuals import Residual

Array = NDArray[np.float64]

DRAWS: Mapping[int, int] = {1: 10, 2: 6, 4: 4}
"""Number of coefficients -> number of random stand-ins per joint and residual."""

GENERIC = "generic"


@dataclass(frozen=True)
class Scaling:
    """Means and sizes of one joint's signals over all recordings, (4,)."""

    mean: Array
    size: Array


def generic_stand_ins(prepared: tuple[Prepared, ...], residual: Residual) -> list[Shaped]:
    """Draws the stand-ins of every joint in one residual."""
    random = np.random.default_rng(20260101)
    found: list[Shaped] = []
    for joint in range(prepared[0].signals.n):
        inputs = [_inputs(item, joint) for item in prepared]
        stacked = np.concatenate(inputs)
        scaling = Scaling(stacked.mean(axis=0), stacked.std(axis=0) + 1e-9)
        for size, draws in DRAWS.items():
            for draw in range(draws):
                weights, offset = random.normal(size=(4, size)), random.normal(size=size)
                columns = [np.tanh((x - scaling.mean) / scaling.size @ weights + offset) for x in inputs]
                found.append(_shaped((residual, joint), prepared, columns, f"{size}.{draw}"))
    return found


def _inputs(item: Prepared, joint: int) -> Array:
    """(N, 4) position, velocity, acceleration and load of a joint."""
    s = item.signals
    load = s.effort if s.effort is not None else s.rigid
    return np.column_stack(
        [s.position[:, joint], s.velocity[:, joint], s.acceleration[:, joint], load[:, joint]]
    )


def _shaped(group: Group, prepared: tuple[Prepared, ...], columns: list[Array], draw: str) -> Shaped:
    size = columns[0].shape[1]
    return Shaped(
        candidate=None,
        shape={},
        columns=tuple({group: item.band.condense(x)} for item, x in zip(prepared, columns, strict=True)),
        fixed=tuple({} for _ in prepared),
        lower=np.full(size, -np.inf),
        upper=np.full(size, np.inf),
        key=(GENERIC, f"{group[0]}.{group[1]}", draw),
    )


def is_generic(shaped: Shaped) -> bool:
    """Whether a shaped candidate is a stand-in."""
    return shaped.candidate is None


def candidate_of(shaped: Shaped) -> Candidate:
    """The physical candidate behind a shape.

    Raises:
        TypeError: It is a stand-in.
    """
    if shaped.candidate is None:
        raise TypeError("a generic stand-in has no physical candidate")
    return shaped.candidate
