# SPDX-License-Identifier: BSD-3-Clause
r"""The regression that all candidates take part in: rows of all recordings, and columns of all candidates.

Rows fall into groups (one residual of one joint) and recordings. The nuisance (what any recording may be wrong
by, see `nuisance_columns`) has columns of its own, scaled to one standard deviation of their prior; then come the
columns of every shaped candidate. Candidates' columns are kept in single precision: there are thousands of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.candidates import (
    CandidateRegressor,
    Group,
    ShapedCandidate,
    alike,
)
from impedance_modules.diagnosis.regression.nuisance_columns import NuisanceColumns
from impedance_modules.diagnosis.regression.whitening import ORDER, Whitening

Thin = NDArray[np.float32]
Mask = NDArray[np.bool_]

Real = TypeVar("Real", Array, Thin)

UNSEEN = 1e-5
"""A column whose largest torque is less than this part of another's beside it is zero but for rounding."""


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
        layouts: One per shaped candidate that shows in any residual.
        rate: Of the rows [Hz].
    """

    groups: tuple[Group, ...]
    names: tuple[str, ...]
    nuisance: NuisanceColumns
    whitening: Whitening
    raw: tuple[tuple[Array, ...], ...]
    y: tuple[tuple[Array, ...], ...]
    Z: tuple[tuple[Array, ...], ...]
    X: tuple[tuple[Thin, ...], ...]
    layouts: tuple[ColumnLayout, ...]
    rate: float

    def count(self, recordings: Sequence[int]) -> Array:
        """Number of independent samples of each group in some recordings, (groups,)."""
        rows = [
            sum(self.whitening.rows(r, g, len(self.y[r][g])) for r in recordings)
            for g in range(len(self.groups))
        ]
        return np.asarray(self.whitening.part * np.array(rows, dtype=float))

    def log_likelihood(self, squares: Array, counts: Array) -> Array:
        r"""Log-likelihood of white rows whose level is what is left of them, but not below the noise [nats].

            -n/2 (\ln s + p / s)      p = SSE / n,  s = max(p, 1 / d)

        with d the factor by which the floor may be wrong, one where repeats measured it. What is less than the noise
        is no more likely by a logarithm.

        Args:
            squares: (groups,) sums of squares, in units of the floor.
            counts: (groups,) n, their independent samples.
        """
        power = squares / np.maximum(counts, 1.0)
        level = np.maximum(power, 1.0 / self.whitening.doubt)
        return np.asarray(-0.5 * counts * (np.log(level) + power / level))

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
        return Counter(layout.shaped.key for layout in self.layouts)

    @cached_property
    def nuisance_gram(self) -> tuple[tuple[Array, ...], ...]:
        """Recording -> group -> (k, k) Z^T Z."""
        return tuple(tuple(block.T @ block for block in recording) for recording in self.Z)


def build_design(
    regressors: Sequence[CandidateRegressor],
    nuisance: NuisanceColumns,
    raw: Sequence[Sequence[Array]],
    whitening: Whitening,
    *,
    names: Sequence[str],
    rate: float,
) -> Design:
    """Whitens everything and puts the candidates' columns side by side.

    Args:
        regressors: Candidates, all shapes, on all recordings; their columns are taken away, recording by recording.
        nuisance: What may be wrong everywhere.
        raw: Recording -> group -> (M,) residuals.
        whitening: Of the noise.
        names: Of the recordings.
        rate: Of the rows [Hz].
    """
    layouts, members = layouts_of(regressors, nuisance)
    beside = []
    for r, residuals in enumerate(raw):
        parts = [[(regressors[i], layouts[i]) for i in inside] for inside in members]
        beside.append(
            tuple(
                _beside(part, (r, g), nuisance.groups[g], whitening, len(residuals[g]))
                for g, part in enumerate(parts)
            )
        )
        for regressor in regressors:
            regressor.blocks[r] = {}  # it stands in the design now, and would take its memory twice
    return Design(
        groups=nuisance.groups,
        names=tuple(names),
        nuisance=nuisance,
        whitening=whitening,
        raw=tuple(tuple(recording) for recording in raw),
        y=whitened(raw, whitening),
        Z=whitened(nuisance.columns, whitening),
        X=tuple(beside),
        layouts=tuple(layouts.values()),
        rate=rate,
    )


def whitened(blocks: Sequence[Sequence[Array]], whitening: Whitening) -> tuple[tuple[Array, ...], ...]:
    """Whitens recording -> group -> (M, ...) rows."""
    return tuple(
        tuple(np.asarray(whitening.apply(block, r, g)) for g, block in enumerate(recording))
        for r, recording in enumerate(blocks)
    )


@dataclass(frozen=True, eq=False)
class ColumnLayout:
    """Where a shaped candidate's columns stand.

    Attributes:
        shaped: The candidate.
        places: Group -> index of its first column there.
        scale: (p,) what its columns were divided by.
        precision: (p,) of a wide prior on its scaled coefficients; zero where there is none.
        unseen: (p,) coefficients whose columns are zero in every recording: nothing is said about them.
    """

    shaped: ShapedCandidate
    places: Mapping[int, int]
    scale: Array
    precision: Array
    unseen: Mask

    @property
    def free(self) -> int:
        """Number of coefficients that the recordings say something about."""
        return self.shaped.size - int(self.unseen.sum())

    @cached_property
    def divisor(self) -> Thin:
        """(width,) what its columns are divided by, the one without a coefficient by one."""
        return np.append(self.scale, np.ones(int(self.shaped.fixed))).astype(np.float32)

    @property
    def groups(self) -> tuple[int, ...]:
        """Indices of the groups that it touches."""
        return tuple(self.places)


def layout_of(
    regressor: CandidateRegressor,
    groups: Sequence[Group],
    links: Mapping[str, Array],
    first: Mapping[int, int],
) -> ColumnLayout | None:
    """Describes a regressor's place; None where a column of it is nowhere other than zero.

    Of a body or a base some columns may be: the weight of an arm in one plane says nothing about a centre of mass
    beside it. Such coefficients stay what they are, about as sure as one in their own unit.

    Args:
        regressor: The candidate.
        groups: All groups.
        links: Wide priors of link inertias.
        first: Group -> index of its first free column.
    """
    touched = sorted({g for blocks in regressor.blocks for g, group in enumerate(groups) if group in blocks})
    scale = _scale(regressor)
    reach = scale * _range(regressor)
    unseen = reach <= UNSEEN * reach.max(initial=0.0)
    if not touched or unseen.all() or (unseen.any() and not _spatial(regressor)):
        return None
    scale = np.where(unseen, 1.0, scale)
    size = len(regressor.lower)
    wide = links.get(regressor.key[1])
    bound = wide is not None and size == len(wide)
    precision = (scale * wide) ** -2.0 if bound and wide is not None else unseen.astype(float)
    own = () if regressor.candidate is None else regressor.candidate.effect.deviations
    if own:
        precision = np.maximum(precision, (scale * np.array(own)) ** -2.0)
    shaped = ShapedCandidate(
        regressor.candidate,
        regressor.shape,
        size,
        regressor.fixed,
        regressor.lower,
        regressor.upper,
        regressor.key,
    )
    return ColumnLayout(shaped, {g: first[g] for g in touched}, scale, precision, unseen)


def layouts_of(
    regressors: Sequence[CandidateRegressor], nuisance: NuisanceColumns
) -> tuple[dict[int, ColumnLayout], list[list[int]]]:
    """Places all regressors; also group -> those that stand in it, in order."""
    first = dict.fromkeys(range(len(nuisance.groups)), 0)
    members: list[list[int]] = [[] for _ in nuisance.groups]
    layouts: dict[int, ColumnLayout] = {}
    seen: set[tuple[object, ...]] = set()
    for index, regressor in enumerate(regressors):
        # At a motor's torque, friction before and behind the gear are one column: the first port stands.
        likeness = alike(regressor)
        layout = None if likeness in seen else layout_of(regressor, nuisance.groups, nuisance.links, first)
        if layout is None:
            continue
        seen.add(likeness)
        layouts[index] = layout
        for group in layout.places:
            members[group].append(index)
            first[group] += regressor.width
    return layouts, members


def scaled_block(
    regressor: CandidateRegressor, layout: ColumnLayout, recording: int, group: Group, rows: int
) -> Thin:
    """A regressor's columns (rows, width) in one group, divided by their scale; zero where it does not show."""
    block = regressor.blocks[recording].get(group)
    if block is None:
        return np.zeros((rows, layout.shaped.width), np.float32)
    return np.asarray(block / layout.divisor)


def _kept(block: Real, keep: Mask | None) -> Real:
    """Puts rows that do not count to zero."""
    if keep is None:
        return block
    out = block.copy(order="K")
    out[~keep] = 0.0
    return out


def _beside(
    members: Sequence[tuple[CandidateRegressor, ColumnLayout]],
    place: tuple[int, int],
    group: Group,
    whitening: Whitening,
    rows: int,
) -> Thin:
    blocks = [scaled_block(regressor, layout, place[0], group, rows) for regressor, layout in members]
    whole = np.concatenate(blocks, axis=1) if blocks else np.zeros((rows, 0), np.float32)
    return np.asfortranarray(whitening.apply(whole, *place), dtype=np.float32)


def _spatial(regressor: CandidateRegressor) -> bool:
    """Whether a regressor is about a body or the base: what a motion shows of it is a matter of geometry."""
    kinds = regressor.candidate.effect.description.keys if regressor.candidate is not None else ()
    return bool({"body", "base"} & set(kinds))


def _range(regressor: CandidateRegressor) -> Array:
    """Range (p,) of each coefficient where all have one, so that their units do not matter; else ones."""
    width = np.asarray(regressor.upper) - np.asarray(regressor.lower)
    return width if np.isfinite(width).all() else np.ones(len(width))


def _scale(regressor: CandidateRegressor) -> Array:
    size = len(regressor.lower)
    power, count = np.zeros(size), 0
    for blocks in regressor.blocks:
        for values in blocks.values():
            power += np.einsum("mp,mp->p", values[:, :size], values[:, :size])
            count += len(values)
    scale = np.sqrt(power / max(count, 1))
    return np.where(scale > 1e-12, scale, 0.0)
