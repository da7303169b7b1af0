# SPDX-License-Identifier: BSD-3-Clause
r"""Pushes from outside: moments in which one force on one link explains all joints at once.

A push happens at one time of one recording, so no other recording can confirm it. Four conditions can:

- *pattern*: r = -J^T(q) s(t) d, one number at each time for all joints, explains as much as free torques would;
- *moment*: outside a few intervals nothing is needed: what an imperfect model leaves there is a measure of its bursts;
- *several joints*: a free torque of a single joint does not do nearly as well, as it would if that joint had a fault;
- *absence*: where the recording repeats another, the same force is not there at the same time.

A link that pushes have been found on may be pushed in a way that turns one joint only, and in a repeat as well.

f(t) is fitted in `push_forces`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.push_forces import (
    SPACING,
    Forces,
    PushPlace,
    chi_square_of,
    felt_directions,
    fit_forces,
    free_torques,
    hat_functions,
    steady_gain,
    touched_places,
)
from impedance_modules.diagnosis.regression.model_fit import ModelFit
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import Cause, Estimate, Rival, Standing
from impedance_modules.effects.external_contact import FORCE, ExternalContact
from impedance_modules.effects.residual_kinds import uses_motion

Mask = NDArray[np.bool_]

SIGNIFICANT = 16.3
"""Chi-square of three numbers that noise exceeds once in a thousand times: a hat that may belong to a push."""

GAIN_MIN = 60.0
"""Chi-square beyond its degrees of freedom that a push must explain ..."""

WEAK_FLOOR_FACTOR = 3.0
"""... times this factor on a weak noise floor, where remainders of about this multiple of the noise pass."""

UNREST_POWER = 3
"""... times this power of the chi-square elsewhere over that of noise: it was 1.0 at 17 pushes, and 1.4 to 4 at 24 of
25 that were found where nothing pushed (docs/wide-benchmark-history.md)."""

MEDIAN_OF_THREE = 2.366
"""Median of a chi-square of three numbers."""

PATTERN_MIN = 0.7
"""Least part of what free torques would explain."""

SECOND_MIN = 0.1
"""Least part of what a push explains that must fall on the second joint."""

PART_MIN = 0.02
"""A joint takes part in a push if at least this part of what it explains falls on the joint."""

ONE_JOINT_MAX = 0.8
"""Largest part of it that a free torque of one joint may explain as well: beyond it the joint has a fault."""

LOCAL_MAX = 0.5
"""Part of a recording that pushes may fill; beyond it the gap is not local."""

MARGIN = 0.2
"""Time before and after a push that is masked with it [s]."""

QUIET_QUANTILE, QUIET_SQUARE = 0.25, 0.1015
"""Quantile of squared residuals, and its value for white noise of unit variance; a push may fill half a recording."""

REPEATED_MAX = 0.5
"""A repeat whose force differs by less than this part of the push shows that the robot itself causes it."""


@dataclass(frozen=True, eq=False)
class ExternalPush:
    """One push.

    Attributes:
        recording: Index.
        place: Of the force.
        start, end: Since the recording began [s].
        force: (3,) mean over the interval within the felt directions, base axes [N].
        std: (3,) of it.
        felt: (k, 3) directions in which a force shows on the joints, orthonormal.
        gain: Chi-square that it explains beyond its degrees of freedom.
    """

    recording: int
    place: PushPlace
    start: float
    end: float
    force: Array
    std: Array
    felt: Array
    gain: float


def find_pushes(
    model_fit: ModelFit, prepared: Sequence[Prepared], coefficients: Array | None = None
) -> tuple[ExternalPush, ...]:
    """Looks for pushes in the residual of a model in each recording.

    Args:
        model_fit: The model.
        prepared: The recordings.
        coefficients: Of the model; None: those fitted to all rows.
    """
    known = model_fit.whole.coefficients if coefficients is None else coefficients
    groups = [g for g, (residual, _) in enumerate(model_fit.design.groups) if uses_motion(residual)]
    if len(groups) < 2:
        return ()
    tried: dict[int, dict[PushPlace, Forces]] = {}
    lefts: dict[int, list[Array]] = {}
    for r, item in enumerate(prepared):
        left = model_fit.residuals(known, r)
        if model_fit.design.whitening.weak:
            left = [x / _quiet_rms(x) for x in left]
        if not _not_significant(model_fit, item, r, left, groups):
            lefts[r] = left
            tried[r] = {place: fit_forces(model_fit, item, r, left, place) for place in touched_places(item)}
    found = _on_one_place(tried)
    pushes = _confirmed(model_fit, prepared, lefts, found, frozenset())
    if pushes:
        touched = frozenset(push.place for push in pushes)
        pushes = _confirmed(model_fit, prepared, lefts, found, touched)
    return pushes


def _on_one_place(tried: Mapping[int, Mapping[PushPlace, Forces]]) -> dict[int, Forces]:
    """The place of each recording: the one that explains most in all, unless another fits its pattern far better."""
    total: Counter[PushPlace] = Counter()
    for places in tried.values():
        total.update({place: forces.gain for place, forces in places.items()})
    found = {}
    for r, places in tried.items():
        best = max(places.values(), key=lambda forces: forces.gain)
        common = places[max(places, key=lambda place: total[place])]
        found[r] = common if common.gain >= PATTERN_MIN * best.gain else best
    return found


def _confirmed(
    model_fit: ModelFit,
    prepared: Sequence[Prepared],
    lefts: Mapping[int, Sequence[Array]],
    found: Mapping[int, Forces],
    touched: frozenset[PushPlace],
) -> tuple[ExternalPush, ...]:
    """Pushes of all recordings; those that a repeat shows as well count at places known to be pushed, ``touched``."""
    every = (
        push
        for r, forces in found.items()
        for push in _intervals(model_fit, prepared[r], r, lefts[r], forces, forces.place in touched)
    )
    return tuple(push for push in every if push.place in touched or not _in_a_repeat(push, prepared, found))


def rows_without_pushes(pushes: Sequence[ExternalPush], prepared: Sequence[Prepared]) -> dict[int, Mask]:
    """Recording -> (M,) rows outside all pushes and the filter's length about them."""
    out: dict[int, Mask] = {}
    for push in pushes:
        item = prepared[push.recording]
        time = item.time - item.log.start
        clear = out.setdefault(push.recording, np.ones(item.samples, dtype=bool))
        clear &= (time < push.start - MARGIN) | (time > push.end + MARGIN)
    return out


def torque_of(push: ExternalPush, item: Prepared) -> Array:
    """(n,) rms torque of a push at each joint while it lasts."""
    signals, time = item.signals, item.signals.time - item.log.start
    inside = (time >= push.start) & (time <= push.end)
    J = push.place.jacobian(signals.model, signals.position[inside])
    return np.asarray(np.sqrt(np.mean(np.einsum("mij,i->mj", J, push.force) ** 2, axis=0)))


def cause_of_pushes(pushes: Sequence[ExternalPush], share: float) -> Cause:
    """Describes the strongest push on every link as a cause: no property of the robot, so no patch contains it.

    Args:
        pushes: One or more.
        share: Part of the gap that they make.
    """
    strongest = {push.place.body: push for push in sorted(pushes, key=lambda push: push.gain)}
    parameters = {}
    for body, push in strongest.items():
        named = zip(FORCE, push.force, push.std, strict=True)
        forces = {symbol: Estimate(float(value), float(std), "N") for symbol, value, std in named}
        times = {"start": Estimate(push.start, SPACING, "s"), "end": Estimate(push.end, SPACING, "s")}
        parameters[body] = {**forces, **times}
    return Cause(
        effect=ExternalContact.description.id,
        joints=(),
        port="contact",
        parameters=parameters,
        weight=share,
        shrink=None,
        equivalent=(),
        rivals=(Rival("free torques", (), "one force explains the joints together"),),
        position_range={},
        velocity_range={},
        # Nothing else was tried in its place, so its lead is none.
        standing=Standing(0.5 * max(push.gain for push in pushes), 0.0),
    )


def push_notes(pushes: Sequence[ExternalPush], prepared: Sequence[Prepared]) -> tuple[str, ...]:
    """Says of each push in which recording it is, when, where and how large."""
    return tuple(
        f"{prepared[push.recording].log.name}: pushed from outside, {push.start:.2f} to {push.end:.2f} s, with"
        f" {np.linalg.norm(push.force):.2g} N on {push.place}{_felt_along(push)}; these rows are left out"
        for push in sorted(pushes, key=lambda push: (push.recording, push.start))
    )


def _felt_along(push: ExternalPush) -> str:
    """Says in which directions the joints feel a force, where there are some in which they do not."""
    if len(push.felt) == 3:
        return ""
    directions = " and ".join("({:.2f}, {:.2f}, {:.2f})".format(*direction) for direction in push.felt)
    return f", along {directions} in base axes, since the recording says nothing of a force across"


def _not_significant(
    model_fit: ModelFit, item: Prepared, r: int, left: Sequence[Array], groups: Sequence[int]
) -> bool:
    """Whether no joint's residual is significant at any time."""
    return all(float(np.max(free_torques(model_fit, item, r, left, g))) < SIGNIFICANT for g in groups)


def _quiet_rms(left: Array) -> float:
    """Rms of a residual at quiet times over that of noise, at least 1: on a weak floor pushes must exceed this."""
    return max(1.0, float(np.sqrt(np.quantile(left**2, QUIET_QUANTILE) / QUIET_SQUARE)))


def _intervals(
    model_fit: ModelFit, item: Prepared, r: int, left: Sequence[Array], forces: Forces, known: bool
) -> list[ExternalPush]:
    """Runs of significant hats that meet the conditions of a push; on a ``known`` link one joint may suffice."""
    count = len(forces.force)
    strength = np.array([chi_square_of(forces, slice(3 * k, 3 * k + 3)) for k in range(count)])
    runs = runs_of(strength > SIGNIFICANT)
    weak = model_fit.design.whitening.weak
    least = WEAK_FLOOR_FACTOR * GAIN_MIN if weak and not known else GAIN_MIN
    pattern = _pattern_min(forces) if weak and not known else PATTERN_MIN
    groups = [g for g, (residual, _) in enumerate(model_fit.design.groups) if uses_motion(residual)]
    each = np.array([free_torques(model_fit, item, r, left, g) for g in groups])
    second = np.sort(forces.joints)[-2] / max(float(forces.joints.sum()), 1e-9)
    one_joint = not known and second < SECOND_MIN
    if pattern >= 1.0 or one_joint or sum(last - first for first, last in runs) > LOCAL_MAX * count:
        return []  # any force would fit, one joint alone would, or the gap is not local
    out = []
    for first, last in runs:
        size, free = last - first, each[:, first:last].sum(axis=1)
        gain = steady_gain(forces, first, last)
        alone = not known and float(free.max()) - size > ONE_JOINT_MAX * gain
        needed = least * _unrest(np.delete(strength, slice(first, last))) ** UNREST_POWER
        if gain >= max(needed, pattern * (float(free.sum()) - len(groups) * size)) and not alone:
            out.append(_push(forces, item, r, (first, last), gain))
    return out


def _unrest(elsewhere: Array) -> float:
    """Median chi-square of hats over that of noise, at least 1."""
    return max(1.0, float(np.median(elsewhere)) / MEDIAN_OF_THREE) if elsewhere.size else 1.0


def _push(forces: Forces, item: Prepared, r: int, run: tuple[int, int], gain: float) -> ExternalPush:
    """The push of the hats from the first to the last-but-one of a run, which explain a gain."""
    first, last = run
    tips, _ = hat_functions(item, item.samples)
    mean = np.repeat(np.eye(3)[None] / (last - first), last - first, axis=0).transpose(1, 0, 2).reshape(3, -1)
    covariance = mean @ forces.covariance[3 * first : 3 * last, 3 * first : 3 * last] @ mean.T
    force = forces.force[first:last].mean(axis=0)
    felt = felt_directions(force, covariance)
    return ExternalPush(
        recording=r,
        place=forces.place,
        start=float(tips[first] - SPACING),
        end=float(tips[last - 1] + SPACING),
        force=felt.T @ felt @ force,
        std=np.sqrt(np.diag(covariance)),
        felt=felt,
        gain=float(gain),
    )


def _pattern_min(forces: Forces) -> float:
    """Least part of what free torques explain that a force must, where no repeat confirms it: more than by chance.

    By chance one number explains one of seven free torques. Joints that hardly take part do not count.
    """
    taking_part = int(np.count_nonzero(forces.joints > PART_MIN * forces.joints.sum()))
    chance = 1.0 / max(taking_part, 1)
    return chance + PATTERN_MIN * (1.0 - chance)


def runs_of(strong: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last-but-one index of every run of true values; one false value does not end a run."""
    bridged = strong.copy()
    bridged[1:-1] |= strong[:-2] & strong[2:]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bridged.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _in_a_repeat(push: ExternalPush, prepared: Sequence[Prepared], found: Mapping[int, Forces]) -> bool:
    """Whether a recording of the same motion shows about the same force at the same time."""
    group = prepared[push.recording].log.group
    for other, forces in found.items():
        if other == push.recording or prepared[other].log.group != group or forces.place != push.place:
            continue
        tips, _ = hat_functions(prepared[other], prepared[other].samples)
        inside = (tips >= push.start) & (tips <= push.end)
        if inside.any():
            there = push.felt.T @ push.felt @ forces.force[inside].mean(axis=0)
            if np.linalg.norm(there - push.force) < REPEATED_MAX * np.linalg.norm(push.force):
                return True
    return False
