# SPDX-License-Identifier: BSD-3-Clause
r"""The regression that all candidates compete in, as sums over recordings, so that any fit takes a moment.

Rows fall into groups (one residual of one joint) and folds (recordings that repeat each other). Of each fold
and group only X^T X, X^T y and y^T y are kept. Columns are, first, the nuisance: the bodies' inertial
parameters, each scaled to one standard deviation of its prior; then every shaped candidate's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.candidates import Group, Shaped
from impedance_modules.diagnosis.prepare import Prepared

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

INERTIA_PRIOR = 0.05
"""Standard deviation of a link's inertial parameters over their size."""

WIDE_PRIOR = 0.5
"""Likewise of a link whose inertia is a candidate: wrong by half, not by several times."""

TIMING_PRIOR = 0.2
"""Standard deviation of the delay that all joints share, in samples: when in a period a command is stamped."""

WEIGHT_PRIOR = 0.03
"""Likewise of the weights that the robot compensates by itself."""


@dataclass(frozen=True, eq=False)
class Slot:
    """Where a shaped candidate's columns stand.

    Attributes:
        shaped: The candidate.
        columns: (p,) indices of its columns.
        fixed: Index of its column without a coefficient; None where it has none.
        scale: (p,) what its columns were divided by.
        groups: Indices of the groups that it touches.
        precision: (p,) of a wide prior on its scaled coefficients; zero where there is none.
    """

    shaped: Shaped
    columns: Indices
    fixed: int | None
    scale: Array
    groups: tuple[int, ...]
    precision: Array


@dataclass(frozen=True, eq=False)
class Design:
    """All sums that fits need.

    Attributes:
        groups: The groups.
        nuisance: Number of nuisance columns, which come first.
        total: Number of all columns.
        slots: One per shaped candidate that shows at all.
        ids: Group -> (C,) sorted indices of the columns that touch it.
        gram: Recording -> group -> (C + 1, C + 1), y first.
        rows: Recording -> group -> (M, C + 1), y first.
        names: Names of the recordings.
    """

    groups: tuple[Group, ...]
    nuisance: int
    total: int
    slots: tuple[Slot, ...]
    ids: tuple[Indices, ...]
    gram: tuple[tuple[Array, ...], ...]
    rows: tuple[tuple[Array, ...], ...]
    names: tuple[str, ...]

    def count(self, recordings: Sequence[int], group: int) -> int:
        """Number of rows of a group in some recordings."""
        return sum(len(self.rows[recording][group]) for recording in recordings)

    def residual(self, recording: int, group: int, coefficients: Array) -> Array:
        """What is left of a group's rows, (M,), given all columns' coefficients."""
        rows, values = self.rows[recording][group], coefficients[self.ids[group]]
        used = np.flatnonzero(values)
        return np.asarray(rows[:, 0] - rows[:, used + 1] @ values[used])


def inertia_prior(parameters: Array) -> Array:
    """Standard deviations of the bodies' ten parameters, (10 n,): a part of mass, moments and inertia.

    A first moment may err by a part of the body's own reach, so that a centre of mass on an axis is free too.
    """
    out = []
    for body in parameters.reshape(-1, 10):
        mass, reach = body[0], np.sqrt(max(np.trace(_tensor(body)) / 2.0, 0.0) / max(body[0], 1e-9))
        second = max(float(np.abs(body[4:]).max()), 1e-6)
        out.append(np.concatenate([[mass], np.full(3, mass * reach), np.full(6, second)]))
    return INERTIA_PRIOR * np.concatenate(out) + 1e-9


def _tensor(body: Array) -> Array:
    xx, xy, yy, xz, yz, zz = body[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def build_design(prepared: Sequence[Prepared], shaped: Sequence[Shaped], parameters: Array) -> Design:
    """Collects the columns of all candidates on all recordings.

    Args:
        prepared: The recordings.
        shaped: Candidates, all shapes.
        parameters: (10 n,) nominal inertial parameters.
    """
    groups = _groups(prepared)
    prior = inertia_prior(parameters)
    nuisance = 2 * len(prior) + 1
    wide = WIDE_PRIOR / INERTIA_PRIOR * prior.reshape(-1, 10)
    links = {body.link: wide[index] for index, body in enumerate(prepared[0].tree.bodies)}
    slots, total = _slots(shaped, groups, nuisance, links)
    ids: list[list[int]] = [[] for _ in groups]
    parts: list[list[list[Array]]] = [[[item.residuals[g[0]][:, g[1]]] for g in groups] for item in prepared]
    for index, group in enumerate(groups):
        _add_nuisance(index, group, prepared, prior, ids, parts)
    for slot in slots:
        _add_slot(slot, groups, ids, parts)
    rows = tuple(
        tuple(np.asfortranarray(np.column_stack(columns)) for columns in recording) for recording in parts
    )
    return Design(
        groups=groups,
        nuisance=nuisance,
        total=total,
        slots=slots,
        ids=tuple(np.array(found, dtype=np.intp) for found in ids),
        gram=tuple(tuple(block.T @ block for block in recording) for recording in rows),
        rows=rows,
        names=tuple(item.log.name for item in prepared),
    )


def _groups(prepared: Sequence[Prepared]) -> tuple[Group, ...]:
    first = prepared[0]
    common = [name for name in first.residuals if all(name in item.residuals for item in prepared)]
    return tuple((name, joint) for name in common for joint in range(first.signals.n))


def _slots(
    shaped: Sequence[Shaped], groups: Sequence[Group], first: int, links: Mapping[str, Array]
) -> tuple[tuple[Slot, ...], int]:
    place: Mapping[Group, int] = {group: index for index, group in enumerate(groups)}
    slots: list[Slot] = []
    for item in shaped:
        touched = sorted({place[g] for recording in item.columns for g in recording if g in place})
        scale = _scale(item)
        if not touched or not np.all(scale > 0.0):
            continue
        columns = np.arange(first, first + item.size, dtype=np.intp)
        first += item.size
        fixed = None
        if any(recording for recording in item.fixed):
            fixed, first = first, first + 1
        wide = links.get(item.key[1])
        free = wide is None or item.size != len(wide)
        precision = np.zeros(item.size) if free or wide is None else (scale * wide) ** -2.0
        slots.append(Slot(item, columns, fixed, scale, tuple(touched), precision))
    return tuple(slots), first


def _scale(item: Shaped) -> Array:
    power = np.zeros(item.size)
    count = 0
    for recording in item.columns:
        for values in recording.values():
            power += np.sum(values**2, axis=0)
            count += len(values)
    scale = np.sqrt(power / max(count, 1))
    return np.where(scale > 1e-12, scale, 0.0)


def _add_nuisance(  # noqa: PLR0917 - all of them belong together
    index: int,
    group: Group,
    prepared: Sequence[Prepared],
    prior: Array,
    ids: list[list[int]],
    parts: list[list[list[Array]]],
) -> None:
    """Adds the inertial parameters that a group's rows see, if any."""
    residual, joint = group
    compensated = _compensated(prepared[0])
    drive = residual in ("actuator", "whole", "drive")
    for first, sees, attribute, scale in (
        (0, residual in ("link", "motor", "whole"), "link_nuisance", prior),
        (len(prior), compensated and drive, "weight_nuisance", WEIGHT_PRIOR / INERTIA_PRIOR * prior),
        (2 * len(prior), drive, "timing_nuisance", np.full(1, TIMING_PRIOR / prepared[0].log.rate)),
    ):
        if not sees:
            continue
        raw = [getattr(item, attribute)[:, joint] for item in prepared]
        blocks = [values.reshape(len(values), -1) * scale for values in raw]
        seen = np.flatnonzero(np.max([np.abs(block).max(axis=0) for block in blocks], axis=0) > 1e-9)
        ids[index].extend((first + seen).tolist())
        for recording, block in zip(parts, blocks, strict=True):
            recording[index].append(block[:, seen])


def _compensated(item: Prepared) -> bool:
    """Whether the robot adds weights to a recorded command."""
    return item.log.gravity_compensation == "robot" and item.log.command is not None


def _add_slot(
    slot: Slot, groups: Sequence[Group], ids: list[list[int]], parts: list[list[list[Array]]]
) -> None:
    for index in slot.groups:
        group = groups[index]
        ids[index].extend(slot.columns.tolist())
        if slot.fixed is not None:
            ids[index].append(slot.fixed)
        for recording, found, steady in zip(parts, slot.shaped.columns, slot.shaped.fixed, strict=True):
            count = len(recording[index][0])
            block = found[group] / slot.scale if group in found else np.zeros((count, slot.shaped.size))
            recording[index].append(block)
            if slot.fixed is not None:
                recording[index].append(steady.get(group, np.zeros(count))[:, None])
