# SPDX-License-Identifier: BSD-3-Clause
"""Stage 3: every effect of the catalogue at every place where it could be, and its regressors, on equal terms.

A candidate is one effect at one port on one carrier (joint, pair of joints, body, base, log). Where a parameter
enters nonlinearly it comes in several shapes, one regression each. Nothing is preferred here. Columns are evaluated
one by one, at the recordings' full rate, and filtered and thinned many at a time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.residuals.band import Band
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.effect import Effect
from impedance_modules.effects.effect_description import KeyKind, Port
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.regressor import PAIR, Regressor, Site
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.worker_processes import OrderedMap, map_here

Thin = NDArray[np.float32]

Group = tuple[Residual, int]
"""One residual of one joint: the rows that share a noise level."""

PERIODS_MIN = 1.25
"""Fewest periods that a periodic effect must run through in the recordings: over less, three numbers follow any smooth
curve."""

WAITING = 4_000_000
"""Values that are collected to be filtered together."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One possible cause.

    Attributes:
        effect: From the catalogue.
        port: Where it acts.
        key: What carries its numbers.
        joints: Names of the joints it belongs to in a report.
    """

    effect: Effect
    port: Port
    key: str
    joints: tuple[str, ...]

    @property
    def name(self) -> str:
        """For messages."""
        return f"{self.effect.id} on {self.key}"

    def site(self, signals: Signals) -> Site:
        """Its place in a recording."""
        return Site(signals, self.key, self.port)


@dataclass(frozen=True, eq=False)
class ShapedCandidate:
    """A candidate with its nonlinear parameters fixed; its columns stand in the design.

    Attributes:
        candidate: Which; None for a generic regressor.
        shape: Values of what enters nonlinearly.
        size: Number of coefficients.
        fixed: Whether it has a part without a coefficient, which stands behind its columns.
        lower, upper: (p,) physical bounds of the coefficients.
        key: Effect, carrier and port; generic regressors differ in the last two.
    """

    candidate: Candidate | None
    shape: Mapping[str, float]
    size: int
    fixed: bool
    lower: Array
    upper: Array
    key: tuple[str, str, str]

    @property
    def width(self) -> int:
        """Number of columns, the one without a coefficient included."""
        return self.size + self.fixed


Shaped = tuple[Candidate, Mapping[str, float]]
"""A candidate and the values of what enters nonlinearly."""


def list_candidates(
    catalogue: Mapping[str, Effect], prepared: Sequence[Prepared], without: Collection[str]
) -> tuple[Candidate, ...]:
    """Lists all candidates of a catalogue, less the effects left out."""
    joints = prepared[0].signals.model.joint_names
    bodies = tuple((body.link, body.joint) for body in prepared[0].tree.bodies)
    found: list[Candidate] = []
    for effect in catalogue.values():
        if effect.id in without:
            continue
        for kind in effect.description.keys:
            for key, carried in _keys(kind, joints, bodies, effect.symmetric):
                found.extend(Candidate(effect, port, key, carried) for port in effect.description.ports)
    return tuple(found)


def shapes_of(candidate: Candidate, recordings: Sequence[Signals]) -> list[dict[str, float]]:
    """Lists the shapes of a candidate that are worth trying on some recordings: those of the widest motion.

    A periodic shape must run through enough of its periods in all of them to be one, not merely a curvature.
    """
    first = recordings[0]
    if candidate.key not in first.model.joint_names:
        return [dict(shape) for shape in candidate.effect.shapes(candidate.site(first))]
    positions = [one.position[:, first.joint(candidate.key)] for one in recordings]
    travels = [(float(q.min()), float(q.max())) for q in positions]
    widest = int(np.argmax([high - low for low, high in travels]))
    whole = max(high for _, high in travels) - min(low for low, _ in travels)
    shapes = candidate.effect.shapes(replace(candidate.site(recordings[widest]), all_travel=whole))
    return [dict(shape) for shape in shapes if repeats(candidate, shape, recordings)]


def repeats(candidate: Candidate, shape: Mapping[str, float], recordings: Sequence[Signals]) -> bool:
    """Whether a periodic shape runs through enough of its periods in all recordings; true for any other."""
    first = recordings[0]
    if candidate.key not in first.model.joint_names:
        return True
    positions = [one.position[:, first.joint(candidate.key)] for one in recordings]
    seen = covered([(float(q.min()), float(q.max())) for q in positions])
    return candidate.effect.periods(shape, seen) >= PERIODS_MIN


def covered(travels: Sequence[tuple[float, float]]) -> float:
    """Length that intervals cover together, each place once."""
    length, end = 0.0, -np.inf
    for low, high in sorted(travels):
        length += max(0.0, high - max(low, end))
        end = max(end, high)
    return length


@dataclass(frozen=True, eq=False)
class Columns:
    """A shaped candidate on one recording at its full rate.

    Attributes:
        blocks: Group -> (N, p), or (N, p + 1) with the part without a coefficient last.
        fixed: Whether that part is anywhere other than zero.
        lower, upper: (p,) physical bounds of the coefficients.
    """

    blocks: Mapping[Group, Array]
    fixed: bool
    lower: Array
    upper: Array


def columns_of(
    candidate: Candidate,
    shapes: Sequence[Mapping[str, float]],
    signals: Signals,
    residuals: Sequence[Residual],
) -> Iterator[Columns | None]:
    """Evaluates shapes of a candidate on a recording; None for one that shows in no residual.

    As many at once as about `WAITING` values allow.
    """
    site = candidate.site(signals)
    together = max(1, WAITING // (len(residuals) * len(signals.time)))
    for start in range(0, len(shapes), together):
        some = shapes[start : start + together]
        each = [candidate.effect.regressors(site, residual, some) for residual in residuals]
        for shown in zip(*each, strict=True):
            yield _side_by_side(dict(zip(residuals, shown, strict=True)))


def _side_by_side(each: Mapping[Residual, Regressor | None]) -> Columns | None:
    """Puts the parts without a coefficient beside the columns of one shape, where there are any."""
    shown = {residual: found for residual, found in each.items() if found is not None}
    if not shown:
        return None
    fixed = any(bool(found.fixed.any()) for found in shown.values())
    blocks: dict[Group, Array] = {}
    for residual, found in shown.items():
        bounds = found.lower, found.upper
        for place, row in enumerate(found.rows):
            own = found.columns[:, place]
            blocks[residual, row] = np.column_stack([own, found.fixed[:, place]]) if fixed else own
    return Columns(blocks, fixed, *bounds)


@dataclass(frozen=True, eq=False)
class ThinnedColumns:
    """A shaped candidate on one recording, in its band.

    Attributes:
        blocks: Group -> (M, p) thinned, or (M, p + 1) as in `Columns`.
        fixed: Whether there is a part without a coefficient.
        lower, upper: (p,) physical bounds of the coefficients.
    """

    blocks: dict[Group, Thin]
    fixed: bool
    lower: Array
    upper: Array


@dataclass(eq=False)
class CandidateRegressor:
    """A shaped candidate's columns, filled in recording by recording.

    Attributes:
        candidate: None for a generic regressor.
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

    def append(self, found: ThinnedColumns | None) -> None:
        """Takes the columns of the next recording; None where it shows in no residual there."""
        self.blocks.append({} if found is None else found.blocks)
        if found is not None:
            self.lower, self.upper = found.lower, found.upper
            self.fixed = self.fixed or found.fixed

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.lower) + self.fixed


class BatchFilter:
    """Filters columns of many candidates at once and hands them back to their regressors."""

    def __init__(self, band: Band) -> None:
        """Takes the band of a recording."""
        self._band = band
        self._waiting: list[tuple[dict[Group, Thin], Group, Thin]] = []
        self._size = 0

    def add(self, into: dict[Group, Thin], group: Group, block: Array) -> None:
        """Takes a block (N, p) at full rate; ``into[group]`` gets it thinned by the next `flush`."""
        self._waiting.append((into, group, block.astype(np.float32)))
        self._size += block.size
        if self._size > WAITING:
            self.flush()

    def thinned(self, found: Columns) -> ThinnedColumns:
        """Takes the columns of a shape; their blocks are there after the next `flush`."""
        into = ThinnedColumns({}, found.fixed, found.lower, found.upper)
        for group, block in found.blocks.items():
            self.add(into.blocks, group, block)
        return into

    def flush(self) -> None:
        """Filters what waits."""
        if not self._waiting:
            return
        whole = np.concatenate([block for _, _, block in self._waiting], axis=1)
        # Each column in one piece, as one is that another process has sent: sums have the same order.
        thinned: Thin = np.asfortranarray(self._band.condense(whole))
        first = 0
        for into, group, block in self._waiting:
            into[group] = thinned[:, first : first + block.shape[1]]
            first += block.shape[1]
        self._waiting, self._size = [], 0


def candidate_regressors(
    shaped: Sequence[Shaped],
    prepared: Sequence[Prepared],
    signals: Sequence[Signals],
    residuals: Sequence[Residual],
    each: OrderedMap = map_here,
) -> list[CandidateRegressor]:
    """Evaluates shapes of candidates on all recordings; what shows in no residual is left out.

    Args:
        shaped: Candidates with the values of what enters nonlinearly.
        prepared: The recordings.
        signals: Theirs, as columns may use them (`clean_signals`).
        residuals: That exist.
        each: Where recordings are worked on, one by one.
    """
    regressors = [
        CandidateRegressor(candidate, shape, (candidate.effect.id, candidate.key, candidate.port))
        for candidate, shape in shaped
    ]
    recordings = zip((item.band for item in prepared), signals, strict=True)
    for columns in each(partial(thinned_columns, shaped, residuals), recordings):
        for regressor, found in zip(regressors, columns, strict=True):
            regressor.append(found)
    return [_squared(regressor) for regressor in regressors if regressor.lower.size]


def thinned_columns(
    shaped: Sequence[Shaped], residuals: Sequence[Residual], recording: tuple[Band, Signals]
) -> list[ThinnedColumns | None]:
    """Evaluates shapes of candidates on one recording; None for those that show in no residual."""
    band, signals = recording
    batch = BatchFilter(band)
    out: list[ThinnedColumns | None] = []
    rigid = signals.model
    with rigid.remembering() if isinstance(rigid, BatchedRigidModel) else nullcontext():
        for candidate, shapes in groupby(shaped, key=itemgetter(0)):
            for found in columns_of(candidate, [shape for _, shape in shapes], signals, residuals):
                out.append(None if found is None else batch.thinned(found))
    batch.flush()
    return out


def alike(regressor: CandidateRegressor) -> tuple[object, ...]:
    """What two shapes of one effect on one carrier share if they are the same regression."""
    marks = tuple(
        (group, tuple(np.round(values[:40].sum(axis=0, dtype=float), 5)))
        for group, values in regressor.blocks[0].items()
    )
    return (regressor.key[0], regressor.key[1], tuple(regressor.shape.values()), marks)


def _keys(
    kind: KeyKind, joints: Sequence[str], bodies: Sequence[tuple[str, str]], symmetric: bool
) -> Iterator[tuple[str, tuple[str, ...]]]:
    if kind == "joint":
        yield from ((joint, (joint,)) for joint in joints)
    elif kind == "pair":
        for index, joint in enumerate(joints):
            others = joints[index + 1 :] if symmetric else [other for other in joints if other != joint]
            yield from ((f"{joint}{PAIR}{other}", (joint,)) for other in others)
    elif kind == "body":
        yield from ((link, (joint,)) for link, joint in bodies)
    else:
        yield kind, ()


def _squared(regressor: CandidateRegressor) -> CandidateRegressor:
    """Gives all recordings the same number of columns: a fixed part that is zero there may be lacking."""
    for blocks in regressor.blocks:
        for group, block in blocks.items():
            if block.shape[1] < regressor.width:
                blocks[group] = np.pad(block, ((0, 0), (0, 1)))
    return regressor
