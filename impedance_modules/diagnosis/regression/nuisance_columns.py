# SPDX-License-Identifier: BSD-3-Clause
r"""What every recording may be wrong by without that being a finding: small errors with a prior.

- each link's ten inertial parameters (\pm 3 %), and, of the weights that the robot compensates, \pm 3 %;
- the instant in a period at which commands, efforts and velocities are stamped (\pm a fifth, a tenth, a quarter of a
  sample: a driver that differentiates backwards is half a sample late, an engine's half step is a part of it);
- the second order of the filter of reported velocities, of which the time constant T of one pole is known
  (\pm T^2 / 2: two equal poles of the same lag have 1/4 T^2 less than one, a Butterworth filter 1/2 T^2);
- the age of the positions from which the robot computes the weight that it adds by itself (\pm 3 ms);
- what the grid of a torque reading does to a torque of a few steps, once (\pm 1): it returns in every repeat;
- when, between two rows, a torque jumped (\pm half a row, of each joint): see `jumped_torques`.

Every column is scaled to one standard deviation of its prior, so that the prior is a unit circle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array, Indices
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.regression.cleaned_signals import stationary_joints
from impedance_modules.diagnosis.regression.jumped_torques import jump_column
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import EFFORT_SIGN

INERTIA_PRIOR = 0.03
"""Standard deviation of a link's inertial parameters over their size."""

WIDE_PRIOR = 0.5
"""Likewise of a link whose inertia is a candidate: wrong by half, not by several times."""

TIMING_PRIOR = 0.2
"""Standard deviation of the delay that all joints' commands share, in samples."""

READING_PRIOR = 0.1
"""Likewise of the readings of effort, against those of position."""

SPEED_PRIOR = 0.25
"""Likewise of the reported velocities."""

FILTER_PRIOR = 0.5
"""Standard deviation of the second order of the velocities' filter, over the square of its time constant."""

GRID_PRIOR = 1.0
"""Standard deviation of what the grid of an effort adds, over what it would add to the torque as it is known."""

ASSISTANCE_PRIOR = 0.003
"""Standard deviation of the age of the positions from which a robot compensates its weight [s]: a few of its cycles."""

WEIGHT_PRIOR = 0.03
"""Standard deviation of the weights that the robot compensates by itself, over their size."""

JUMP_PRIOR = 0.5
"""Standard deviation of when a torque jumped, in rows."""


@dataclass(frozen=True, eq=False)
class NuisanceColumns:
    """Columns with a prior.

    Attributes:
        groups: The groups.
        size: Number of all nuisance columns, K.
        ids: Group -> (k,) which of them it sees.
        columns: Recording -> group -> (M, k).
        links: Link -> (10,) wide prior of its inertia, for the candidates that change it.
    """

    groups: tuple[Group, ...]
    size: int
    ids: tuple[Indices, ...]
    columns: tuple[tuple[Array, ...], ...]
    links: dict[str, Array]


def build_nuisance(prepared: Sequence[Prepared], parameters: Array) -> NuisanceColumns:
    """Collects the nuisance of all recordings.

    Args:
        prepared: The recordings.
        parameters: (10 n,) nominal inertial parameters.
    """
    groups = _groups(prepared)
    prior = inertia_prior(parameters)
    kinds = _kinds(prepared[0], prior)
    ids: list[list[int]] = [[] for _ in groups]
    columns: list[list[list[Array]]] = [[[] for _ in groups] for _ in prepared]
    first = 0
    for kind in kinds:
        for index, group in enumerate(groups):
            if not kind.sees(group):
                continue
            blocks = [kind.columns(item, group) for item in prepared]
            seen = np.flatnonzero(np.max([np.abs(block).max(axis=0) for block in blocks], axis=0) > 1e-9)
            ids[index].extend((first + seen).tolist())
            for recording, block in zip(columns, blocks, strict=True):
                recording[index].append(block[:, seen])
        first += kind.size
    wide = WIDE_PRIOR / INERTIA_PRIOR * prior.reshape(-1, 10)
    return NuisanceColumns(
        groups=groups,
        size=first,
        ids=tuple(np.array(found, dtype=np.intp) for found in ids),
        columns=tuple(
            tuple(_beside(parts, item.samples) for parts in recording)
            for recording, item in zip(columns, prepared, strict=True)
        ),
        links={body.link: wide[index] for index, body in enumerate(prepared[0].tree.bodies)},
    )


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


@dataclass(frozen=True)
class _Kind:
    """One kind of error: the groups that see it, and its columns (M, k) there."""

    size: int
    sees: Callable[[Group], bool]
    columns: Callable[[Prepared, Group], Array]


def _beside(parts: Sequence[Array], samples: int) -> Array:
    return np.concatenate(parts, axis=1) if parts else np.zeros((samples, 0))


def _kinds(first: Prepared, prior: Array) -> tuple[_Kind, ...]:
    period = 1.0 / first.log.rate
    drive = ("actuator", "whole", "drive")
    compensated = first.log.gravity_compensation == "robot" and first.log.command is not None
    late = np.full(1, TIMING_PRIOR * period)
    weight = WEIGHT_PRIOR / INERTIA_PRIOR * prior
    return (
        _Kind(
            len(prior),
            lambda group: group[0] in ("link", "motor", "whole"),
            lambda item, group: item.link_nuisance[:, group[1]] * prior,
        ),
        _Kind(
            len(prior),
            lambda group: compensated and group[0] in drive,
            lambda item, group: item.weight_nuisance[:, group[1]] * weight,
        ),
        _Kind(
            1, lambda group: group[0] in drive, lambda item, group: item.timing_nuisance[:, [group[1]]] * late
        ),
        _Kind(
            1,
            lambda group: EFFORT_SIGN[group[0]] != 0.0 and first.signals.effort is not None,
            lambda item, group: (
                EFFORT_SIGN[group[0]] * READING_PRIOR * period * item.reading_nuisance[:, [group[1]]]
            ),
        ),
        _Kind(
            1,
            lambda group: group[0] == "velocity",
            lambda item, group: (
                SPEED_PRIOR * period * item.band.condense(item.signals.acceleration[:, [group[1]]])
            ),
        ),
        _Kind(
            1,
            lambda group: compensated and group[0] in drive,
            lambda item, group: ASSISTANCE_PRIOR * item.assistance_nuisance[:, [group[1]]],
        ),
        _Kind(
            first.signals.n,
            lambda group: EFFORT_SIGN[group[0]] != 0.0 and first.signals.effort is not None,
            lambda item, group: (
                EFFORT_SIGN[group[0]]
                * GRID_PRIOR
                * _of_own_joint(item.grid_nuisance[:, group[1]], item, group)
            ),
        ),
        _Kind(
            first.signals.n,
            lambda group: group[0] != "velocity",
            lambda item, group: JUMP_PRIOR * _of_own_joint(jump_column(item, group), item, group),
        ),
        _Kind(
            1,
            lambda group: group[0] == "velocity",
            lambda item, group: FILTER_PRIOR * item.filter_nuisance[:, [group[1]]],
        ),
    )


def _of_own_joint(column: Array, item: Prepared, group: Group) -> Array:
    """A column (M,) in the place of the group's joint among those of all joints, (M, n)."""
    return np.outer(column, np.arange(item.signals.n) == group[1])


def _groups(prepared: Sequence[Prepared]) -> tuple[Group, ...]:
    """All residuals of all joints, but no velocity of a stationary joint, and none that was computed.

    The one is noise, which the velocities' own filters colour; the other has the positions' noise and the frequency
    response of a difference, which beside the filters of other joints would look like one.
    """
    first = prepared[0]
    common = [name for name in first.residuals if all(name in item.residuals for item in prepared)]
    resting = np.all([stationary_joints(item.signals.position) for item in prepared], axis=0)
    silent = resting | np.any([_computed(item) for item in prepared], axis=0)
    return tuple(
        (name, joint)
        for name in common
        for joint in range(first.signals.n)
        if name != "velocity" or not silent[joint]
    )


def _computed(item: Prepared) -> NDArray[np.bool_]:
    """Joints (n,) whose reported velocities are differences of the positions."""
    marks = item.log.computed_velocity
    return np.zeros(item.signals.n, dtype=bool) if marks is None else marks


def _tensor(body: Array) -> Array:
    xx, xy, yy, xz, yz, zz = body[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
