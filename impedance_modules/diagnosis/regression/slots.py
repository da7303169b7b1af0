# SPDX-License-Identifier: BSD-3-Clause
"""Where the columns of every shaped candidate stand among all columns, and by what they are divided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.regression.candidates import Group, Shaped
from impedance_modules.diagnosis.regression.drafts import Draft, alike
from impedance_modules.diagnosis.regression.nuisance_columns import Nuisance

Array = NDArray[np.float64]
Thin = NDArray[np.float32]
Mask = NDArray[np.bool_]

UNSEEN = 1e-5
"""A column smaller than this part of the largest one beside it is zero but for rounding."""


@dataclass(frozen=True, eq=False)
class Slot:
    """Where a shaped candidate's columns stand.

    Attributes:
        shaped: The candidate.
        places: Group -> index of its first column there.
        scale: (p,) what its columns were divided by.
        precision: (p,) of a wide prior on its scaled coefficients; zero where there is none.
        unseen: (p,) coefficients whose columns are zero in every recording: nothing is said about them.
    """

    shaped: Shaped
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


def slot_of(
    draft: Draft, groups: Sequence[Group], links: Mapping[str, Array], first: Mapping[int, int]
) -> Slot | None:
    """Describes a draft's place; None where a column of it is nowhere other than zero.

    Of a body or a base some columns may be: the weight of an arm in one plane says nothing about a centre of mass
    beside it. Such coefficients stay what they are, about as sure as one in their own unit.

    Args:
        draft: The candidate.
        groups: All groups.
        links: Wide priors of link inertias.
        first: Group -> index of its first free column.
    """
    touched = sorted({g for blocks in draft.blocks for g, group in enumerate(groups) if group in blocks})
    scale = _scale(draft)
    unseen = scale <= UNSEEN * scale.max(initial=0.0)
    if not touched or unseen.all() or (unseen.any() and not _spatial(draft)):
        return None
    scale = np.where(unseen, 1.0, scale)
    size = len(draft.lower)
    wide = links.get(draft.key[1])
    bound = wide is not None and size == len(wide)
    precision = (scale * wide) ** -2.0 if bound and wide is not None else unseen.astype(float)
    shaped = Shaped(draft.candidate, draft.shape, size, draft.fixed, draft.lower, draft.upper, draft.key)
    return Slot(shaped, {g: first[g] for g in touched}, scale, precision, unseen)


def _spatial(draft: Draft) -> bool:
    """Whether a draft is about a body or the base: what a motion shows of it is a matter of geometry."""
    kinds = draft.candidate.effect.description.keys if draft.candidate is not None else ()
    return bool({"body", "base"} & set(kinds))


def slots_of(drafts: Sequence[Draft], nuisance: Nuisance) -> tuple[dict[int, Slot], list[list[int]]]:
    """Places all drafts; also group -> those that stand in it, in order."""
    first = dict.fromkeys(range(len(nuisance.groups)), 0)
    members: list[list[int]] = [[] for _ in nuisance.groups]
    slots: dict[int, Slot] = {}
    seen: set[tuple[object, ...]] = set()
    for index, draft in enumerate(drafts):
        # At a motor's torque, friction before and behind the gear are one column: the first port stands.
        likeness = alike(draft)
        slot = None if likeness in seen else slot_of(draft, nuisance.groups, nuisance.links, first)
        if slot is None:
            continue
        seen.add(likeness)
        slots[index] = slot
        for group in slot.places:
            members[group].append(index)
            first[group] += draft.width
    return slots, members


def _scale(draft: Draft) -> Array:
    size = len(draft.lower)
    power, count = np.zeros(size), 0
    for blocks in draft.blocks:
        for values in blocks.values():
            power += np.einsum("mp,mp->p", values[:, :size], values[:, :size])
            count += len(values)
    scale = np.sqrt(power / max(count, 1))
    return np.where(scale > 1e-12, scale, 0.0)


def scaled_block(draft: Draft, slot: Slot, recording: int, group: Group, rows: int) -> Thin:
    """A draft's columns (rows, width) in one group, divided by their scale; zero where it does not show."""
    block = draft.blocks[recording].get(group)
    if block is None:
        return np.zeros((rows, slot.shaped.width), np.float32)
    return np.asarray(block / slot.divisor)
