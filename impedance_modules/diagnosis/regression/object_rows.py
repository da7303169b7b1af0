# SPDX-License-Identifier: BSD-3-Clause
r"""Samples in which hands hold the task's object, and those of free motion, as rows of one linear regression.

    y = r - r_{causes} - Y_H \pi_{task} = Y_H (\pi - \pi_{task}) + Z \nu + noise

Y_H are the columns of the first holding hand's link while the object is held, and zero otherwise; Z what is uncertain
in every recording (`nuisance_columns`: the links' inertias, stamps, grids) and the joints' zeros, within their priors.

Noise of positions, differentiated twice, is in the residual and in every column of accelerations: least squares then
find inertias that are not there. It is strong at high frequencies, and a held object is slow. So a row is a mean over
`AVERAGED`, and the noise of a row that of such a mean.

Where several hands hold the object, they also press on each other through it, with forces that nobody knows:

    C = J_1^T - J_i^T X_i      (n, 6) for each further hand i

Rows are projected on what is orthogonal to these directions, after division by the noise: squeezing leaves no trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.task_object import TaskObject
from impedance_modules.diagnosis.regression.contact_rows import ZERO_PRIOR, position_noise
from impedance_modules.diagnosis.regression.nuisance_columns import build_nuisance
from impedance_modules.diagnosis.regression.sensor_noise import made_by_positions, white_noise
from impedance_modules.diagnosis.residuals.contact_mask import MARGIN, near_contact, near_marks
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.carried_object import CarriedObject
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.plant.rigid_object import principal_inertia
from impedance_modules.robot.rotation import skew

Mask = NDArray[np.bool_]

AVERAGED = 0.4
"""Time over which rows are averaged [s]."""

STANDING = 0.01
"""Distance of a hand from where it took an object up, or lets it go, within which the object may still stand [m]."""


@dataclass(frozen=True, eq=False)
class ObjectRows:
    """One recording's rows, whitened.

    Attributes:
        carried: The object; None of a recording without one.
        target: (R,) y.
        nuisance: (R, K) columns of links and zeros, in deviations of their priors.
        held: (R,) which of them are of samples while it is held; they come first.
        means: Number of means over time while it is held, each of as many rows.
        hand: (R, 10) columns of the hand's link, in all rows.
        change: (M, n, 10) the same before whitening, zero where the object is not held [N.m per parameter].
        load: (M, n) torque that the joints carry [N.m].
        seconds: While it is held.
    """

    carried: CarriedObject | None
    target: Array
    nuisance: Array
    held: Mask
    means: int
    hand: Array
    change: Array
    load: Array
    seconds: float


def object_rows(
    item: Prepared, held: TaskObject | None, hand: str, explained: Array, residual: Residual, uncertain: Array
) -> ObjectRows:
    """Takes a recording's rows while its object is held, and those of free motion.

    Args:
        item: The recording.
        held: Its object, with known effects applied; None where it has none.
        hand: Link of the first hand that holds it, also where this recording has no object.
        explained: (M, n) what named causes add to the residual [N.m].
        residual: Which compares torque and the links' motion.
        uncertain: (M, n, K) columns of `uncertain_columns`.
    """
    carried = None if held is None else carried_object(item, held)
    taken = np.zeros(item.samples, dtype=bool) if carried is None else carried.rows
    free = ~near_contact(item, MARGIN)
    columns = _condensed(item, hand)
    target = item.residuals[residual] - explained
    if carried is not None:
        target = target - taken[:, None] * (columns @ carried.nominal())
    size = max(1, round(AVERAGED * item.band.rate / item.band.step))
    noise = mean_noise(item, residual, size)
    zeros = item.band.condense(item.signals.position_derivative) * ZERO_PRIOR
    whole = np.concatenate([target[:, :, None], uncertain, zeros, columns], axis=2) / noise[:, None]
    held_rows = _means(whole, taken, size)
    if held is not None and len(held.hands) > 1:
        kept = _without_squeeze(_means(_squeeze(item, held) / noise[:, None], taken, size))
        held_rows = np.einsum("mnk,mnc->mkc", kept, held_rows)
    parts = [part.reshape(-1, whole.shape[2]) for part in (held_rows, _means(whole, free & ~taken, size))]
    flat = np.concatenate(parts)
    return ObjectRows(
        carried=carried,
        target=flat[:, 0],
        nuisance=flat[:, 1:-10],
        held=np.arange(len(flat)) < len(parts[0]),
        means=len(held_rows),
        hand=flat[:, -10:],
        change=columns * taken[:, None, None],
        load=item.load,
        seconds=float(taken.sum()) * item.band.step / item.band.rate,
    )


def uncertain_columns(prepared: Sequence[Prepared], residual: Residual) -> list[Array]:
    """Columns (M, n, K) of each recording, in a residual, of what is uncertain in all of them, within its prior."""
    nuisance = build_nuisance(prepared, prepared[0].tree.inertia)
    out = []
    for item, columns in zip(prepared, nuisance.columns, strict=True):
        whole = np.zeros((item.samples, item.signals.n, nuisance.size))
        for (name, joint), ids, block in zip(nuisance.groups, nuisance.ids, columns, strict=True):
            if name == residual:
                whole[:, joint, ids] = block
        out.append(whole)
    return out


def carried_object(item: Prepared, held: TaskObject) -> CarriedObject | None:
    """Places the object in its first hand's frame, as at the start; None where nobody holds it for long enough."""
    log, model = item.log, item.signals.model
    if log.carrying is None or any(hand not in model.bodies for hand in held.hands):
        return None
    rows = ~near_marks(item, ~log.carrying, MARGIN)
    if held.picked:
        rows &= _lifted(item, held.hands[0], log.carrying)
    if not rows.any():
        return None
    origins = np.array([model.place(hand, held.start[None])[0] for hand in held.hands])
    rotation = model.rotation(held.hands[0], held.start[None])[0]
    spec = held.spec
    centre = origins.mean(axis=0) if spec.position is None else np.array(spec.position)
    inertia = principal_inertia(spec.shape, spec.size, spec.mass)
    return CarriedObject(
        spec, held.hands[0], rotation.T @ (centre - origins[0]), rotation.T, inertia, np.asarray(rows)
    )


def squeeze_directions(model: RigidModel, hands: Sequence[str], q: Array) -> Array:
    """Torques (N, n, 6 (h - 1)) of unit wrenches with which each further hand presses against the first."""
    first, place = model.jacobian(hands[0], q), model.place(hands[0], q)
    out = []
    for hand in hands[1:]:
        lever = np.array([skew(offset) for offset in place - model.place(hand, q)])
        other = model.jacobian(hand, q)
        # A force at the first hand turns about the other one, too.
        across = other[:, :3] + np.einsum("ikj,ikl->ijl", lever, other[:, 3:])
        opposite = np.concatenate([across, other[:, 3:]], axis=1)
        out.append(np.swapaxes(first - opposite, 1, 2))
    return np.concatenate(out, axis=2)


def _squeeze(item: Prepared, held: TaskObject) -> Array:
    return squeeze_directions(item.signals.model, held.hands, item.position)


def _without_squeeze(directions: Array) -> Array:
    """Orthonormal directions (m, n, n - k) of torques over their noise that no squeeze (m, n, k) reaches."""
    base, _, _ = np.linalg.svd(directions, full_matrices=True)
    return np.asarray(base[:, :, directions.shape[2] :])


def mean_noise(item: Prepared, residual: Residual, size: int) -> Array:
    """Rms (n,) of a mean of some rows of a residual: by the torque's noise and the positions', as far as they show."""
    made = made_by_positions(item, 0)
    everywhere = np.ones(item.samples, dtype=bool)
    found = []
    for joint in range(item.signals.n):
        found.append(np.mean(_means(made.of((residual, joint)), everywhere, size) ** 2))
    shift = item.band.condense(item.signals.position_derivative) * position_noise(item, rate=False)
    read = item.log.effort if residual != "whole" else item.log.command
    in_band = 2.0 * item.band.cutoff / item.band.rate / size
    sensed = 0.0 if read is None else in_band * white_noise(read) ** 2
    return np.asarray(np.sqrt(np.array(found) + np.mean(np.sum(shift**2, axis=2), axis=0) + sensed + 1e-12))


def _means(values: Array, rows: Mask, size: int) -> Array:
    """Means (m, ...) over some consecutive rows of (M, ...), each within a stretch of rows that count."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int)))
    starts = [at for first, stop in edges.reshape(-1, 2) for at in range(first, stop - size + 1, size)]
    chosen = np.array(starts, dtype=np.intp)[:, None] + np.arange(size)
    return np.asarray(values[chosen].mean(axis=1))


def _condensed(item: Prepared, hand: str) -> Array:
    """Columns (M, n, 10) of the hand's link in the residual; zero of a hand that was not recorded."""
    signals = item.signals
    if hand not in signals.model.bodies:
        return np.zeros((item.samples, signals.n, 10))
    columns = signals.body_columns(hand)
    return item.band.condense(signals.through_springs(columns, range(signals.n), of_accelerations=True))


def _lifted(item: Prepared, hand: str, carrying: Mask) -> Mask:
    """Rows (M,) in which a hand is away from where it took the object up and from where it lets it go."""
    marks = np.flatnonzero(carrying)
    ends = item.signals.model.place(hand, item.log.position[[marks[0], marks[-1]]])
    place = item.signals.model.place(hand, item.position)
    return np.asarray(np.all(np.linalg.norm(place[:, None] - ends, axis=2) > STANDING, axis=1))
