# SPDX-License-Identifier: BSD-3-Clause
"""Stage 4, the noise floor: read from the difference of repeats, or from what a flexible model leaves.

What moments in which something touched the arm add is taken away (`disturbed_moments`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.candidates import CandidateRegressor, Group
from impedance_modules.diagnosis.regression.disturbed_moments import (
    RobustFit,
    fit_robustly,
    without_disturbed,
)
from impedance_modules.diagnosis.regression.jumped_torques import jump_noise
from impedance_modules.diagnosis.regression.nuisance_columns import NuisanceColumns
from impedance_modules.diagnosis.regression.sensor_noise import (
    LEAST,
    Rounding,
    acceleration_noise,
    louder_sensors,
    made_by_positions,
    noise_shares,
    position_powers,
    sensor_powers,
    unseen_rounding,
)
from impedance_modules.diagnosis.regression.whitening import ORDER, SHORT, Whitening, spectrum, whitening_of
from impedance_modules.diagnosis.residuals.preparation import Prepared

Mask = NDArray[np.bool_]
T = TypeVar("T")

RIDGE = 1e-4
"""Of the flexible model, over its columns' power; more where it would use up too many samples."""

USED_MAX = 0.5
"""Part of all samples that a flexible model may use up: what is left of fewer says little about the noise."""

RIDGE_FACTOR = 2.0
"""Factor by which the ridge grows until that holds."""

LEFT_MIN = 0.1
"""Least part of all samples, and of the power at one frequency, that is taken to be left of a flexible model."""

DRAWS = 8
"""Series of white noise that show how much of the power at each frequency is left."""


def repeat_pairs(prepared: Sequence[Prepared], recordings: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of recordings of one motion."""
    return [
        (i, j)
        for place, i in enumerate(recordings)
        for j in recordings[:place]
        if prepared[i].log.group == prepared[j].log.group
    ]


def noise_by_repeats(
    left: Sequence[Sequence[Array]],
    prepared: Sequence[Prepared],
    nuisance: NuisanceColumns,
    pairs: Sequence[tuple[int, int]],
    clear: Mapping[tuple[int, int], Mask] | None = None,
) -> Whitening:
    """Judges the noise by recordings that repeat each other.

    Args:
        left: Recording -> group -> (M,) residual, or what causes that are known by now leave of it.
        prepared: The recordings.
        nuisance: For its groups.
        pairs: Repeats.
        clear: Recording and group -> (M,) rows that count; all of them where it is missing.
    """
    shown = [_shown_twice(pairs, g, prepared, clear or {}) for g in range(len(nuisance.groups))]
    moved = np.mean([acceleration_noise(prepared[i], prepared[j]) for i, j in pairs], axis=0)
    rounding = [unseen_rounding(prepared[i], moved) for i, _ in pairs]
    unseen = [
        [_rounded(part, group, mask) for part, mask in _with_rows(rounding, masks)]
        for masks, group in zip(shown, nuisance.groups, strict=True)
    ]
    noise = _of_repeats(left, prepared, nuisance.groups, pairs, shown, unseen)
    power = [float(np.mean(np.concatenate(x) ** 2)) for x in noise]
    assumed = [float(np.mean(np.concatenate(x) ** 2)) for x in unseen]
    own = sensor_powers(prepared, nuisance.groups)
    own += position_powers([made_by_positions(item, r) for r, item in enumerate(prepared)], nuisance.groups)
    mean = np.mean([own[r] for pair in pairs for r in pair], axis=0)
    share = noise_shares(np.array(power), mean, own, louder_sensors(nuisance.groups, prepared, pairs))
    return whitening_of(
        noise,
        share,
        edge=_edge(prepared),
        lost=np.zeros(len(nuisance.groups)),
        assumed=np.clip(np.array(assumed) / np.maximum(power, LEAST), 0.0, 1.0),
        weak=False,
    )


def noise_by_smoothness(
    left: Sequence[Sequence[Array]],
    prepared: Sequence[Prepared],
    nuisance: NuisanceColumns,
    flexible: Sequence[CandidateRegressor],
    recordings: Sequence[int],
    clear: Mapping[tuple[int, int], Mask] | None = None,
) -> Whitening:
    """Judges the noise by what a flexible model leaves: smooth functions of a joint's motion, and the links'.

    It is at least what the positions' own noise makes (functions of the acceleration hold that noise and hide it), and
    what jumps of torques do. Where
    one joint was disturbed, windows of outlying power are no part of it on any joint.

    Args:
        left: Recording -> group -> (M,) residual.
        prepared: The recordings.
        nuisance: The links' columns.
        flexible: Generic basis and single-joint candidates.
        recordings: Those that are fitted.
        clear: Recording and group -> (M,) rows that count; all of them where it is missing.
    """
    everywhere = [made_by_positions(item, r) for r, item in enumerate(prepared)]
    shown = [_shown(recordings, g, left, clear or {}) for g in range(len(nuisance.groups))]
    rate = prepared[0].band.rate / prepared[0].band.step
    fits = []
    for index, group in enumerate(nuisance.groups):
        members = [regressor for regressor in flexible if all(group in blocks for blocks in regressor.blocks)]
        fits.append(_left_by(members, group, index, left, nuisance, shown[index], rate))
    disturbed = any(one.disturbed for one in fits)
    noise, lost = [], []
    for group, one, rows in zip(nuisance.groups, fits, shown, strict=True):
        pieces, used = one.robust if disturbed else one.ordinary
        made = [
            everywhere[r].of(group)[mask] + jump_noise(prepared[r], group, r)[mask]
            for r, mask in rows.items()
        ]
        noise.append(_not_below(pieces, used, made))
        lost.append(used)
    own = position_powers(everywhere, nuisance.groups) + sensor_powers(prepared, nuisance.groups)
    share = _noise_shares(noise, np.array(lost), own, [list(rows) for rows in shown])
    return whitening_of(
        noise, share, edge=_edge(prepared), lost=np.array(lost), assumed=np.ones(len(lost)), weak=True
    )


def _rounded(rounding: Rounding | None, group: Group, shown: Mask) -> Array:
    """What a grid adds to the difference of two repeats that were rounded alike."""
    return np.zeros(int(shown.sum())) if rounding is None else rounding.of(group)[: len(shown)][shown]


def _edge(prepared: Sequence[Prepared]) -> float:
    """End of the band in cycles per kept sample."""
    band = prepared[0].band
    return band.cutoff * band.step / band.rate


def _shown_twice(
    pairs: Sequence[tuple[int, int]],
    group: int,
    prepared: Sequence[Prepared],
    clear: Mapping[tuple[int, int], Mask],
) -> list[Mask]:
    """Rows of a group that count in both of two repeats, for each pair; all of them where hardly any would be left.

    Repeats that are held or pressed throughout differ by noise, too. A pair of which too few are left for a spectrum
    shows nothing beside others.
    """
    masks = [_both_clear(pair, group, prepared, clear) for pair in pairs]
    long = [mask if mask.sum() >= SHORT else np.zeros_like(mask) for mask in masks]
    if sum(int(mask.sum()) for mask in long) > SHORT + ORDER:
        return long
    return [np.ones_like(mask) for mask in masks]


def _with_rows(each: Sequence[T], masks: Sequence[Mask]) -> list[tuple[T, Mask]]:
    """What belongs to pairs that show anything, each with its rows."""
    return [(one, mask) for one, mask in zip(each, masks, strict=True) if mask.any()]


def _both_clear(
    pair: tuple[int, int],
    group: int,
    prepared: Sequence[Prepared],
    clear: Mapping[tuple[int, int], Mask],
) -> Mask:
    """Rows of a group that count in both of two repeats."""
    masks = [clear.get((r, group), np.ones(prepared[r].samples, dtype=bool)) for r in pair]
    size = min(map(len, masks))
    return np.asarray(masks[0][:size] & masks[1][:size])


def _shown(
    recordings: Sequence[int],
    group: int,
    left: Sequence[Sequence[Array]],
    clear: Mapping[tuple[int, int], Mask],
) -> dict[int, Mask]:
    """Recording -> (M,) rows of a group that count; a recording with hardly any is left out if others have more."""
    everything = {r: np.ones(len(left[r][group]), dtype=bool) for r in recordings}
    masks = {r: clear.get((r, group), rows) for r, rows in everything.items()}
    return {r: mask for r, mask in masks.items() if mask.sum() > SHORT + ORDER} or everything


def _of_repeats(
    left: Sequence[Sequence[Array]],
    prepared: Sequence[Prepared],
    groups: Sequence[Group],
    pairs: Sequence[tuple[int, int]],
    shown: Sequence[Sequence[Mask]],
    unseen: Sequence[Sequence[Array]],
) -> list[list[Array]]:
    """Noise of each group in each pair: their difference, what rounding hides of it, at least what jumps make."""
    apart = [
        [_difference(left[i][g], left[j][g], mask) for (i, j), mask in zip(pairs, masks, strict=True)]
        for g, masks in enumerate(shown)
    ]
    apart = without_disturbed(apart, shown, prepared[0].band.rate / prepared[0].band.step)
    out = []
    for group, differences, masks, hidden in zip(groups, apart, shown, unseen, strict=True):
        made = [
            jump_noise(prepared[i], group, i)[: len(mask)][mask] for (i, _), mask in _with_rows(pairs, masks)
        ]
        pieces = [one + part for (one, _), part in zip(_with_rows(differences, masks), hidden, strict=True)]
        out.append(_not_below(pieces, 0.0, made))
    return out


def _difference(one: Array, other: Array, shown: Mask) -> Array:
    size = len(shown)
    difference = (one[:size] - other[:size])[shown]
    return np.asarray((difference - np.median(difference)) / np.sqrt(2.0))


def _not_below(pieces: Sequence[Array], used: float, made: Sequence[Array]) -> list[Array]:
    """Adds to pieces of noise what they lack of a noise that is known."""
    count = sum(map(len, pieces))
    grow = count / max(count - used, LEFT_MIN * count)
    seen = grow * sum(float(piece @ piece) for piece in pieces)
    own = max(sum(float(piece @ piece) for piece in made), LEAST)
    share = np.sqrt(max(0.0, 1.0 - seen / own) / grow)
    return [piece + share * more for piece, more in zip(pieces, made, strict=True)]


def _noise_shares(
    noise: Sequence[Sequence[Array]], lost: Array, own: Array, recordings: Sequence[Sequence[int]]
) -> Array:
    """As `noise_shares`, of a floor without repeats.

    Args:
        noise: Group -> pieces of noise, one for each of its recordings.
        lost: (groups,) samples that were fitted away.
        own: (recordings, groups) power of the part that is read from each recording.
        recordings: Group -> those that its pieces are from.
    """
    lengths = [np.array([len(piece) for piece in pieces], dtype=float) for pieces in noise]
    mean = np.array(
        [
            np.average(own[list(chosen), group], weights=lengths[group])
            for group, chosen in enumerate(recordings)
        ]
    )
    count = np.array([float(sizes.sum()) for sizes in lengths])
    seen = np.array([sum(float(piece @ piece) for piece in pieces) for pieces in noise]) / count
    return noise_shares(seen * count / np.maximum(count - lost, LEFT_MIN * count), mean, own)


def _left_by(  # noqa: PLR0917 - all of them belong together
    members: Sequence[CandidateRegressor],
    group: Group,
    index: int,
    left: Sequence[Sequence[Array]],
    nuisance: NuisanceColumns,
    shown: Mapping[int, Mask],
    rate: float,
) -> RobustFit:
    """What functions of a group's motion leave of it, and the samples that they use up."""
    blocks = []
    for recording, mask in shown.items():
        own = [regressor.blocks[recording][group][mask] for regressor in members]
        blocks.append(np.concatenate([nuisance.columns[recording][index][mask], *own], axis=1).astype(float))
    X, y = np.concatenate(blocks), np.concatenate([left[r][index][mask] for r, mask in shown.items()])
    X = X / (np.sqrt(np.mean(X**2, axis=0)) + 1e-12)
    ends = np.cumsum([len(block) for block in blocks])[:-1]
    white = np.random.default_rng(index).standard_normal((len(y), DRAWS))

    def fit(weights: Array | None) -> tuple[list[Array], float]:
        weighted = X if weights is None else X * weights[:, None]
        power, axes = np.linalg.eigh(weighted.T @ X)
        power = np.maximum(power, 0.0)
        ridge = _ridge(power, len(y))
        both = np.column_stack([y, white])
        rest = both - X @ (axes @ ((axes.T @ (weighted.T @ both)) / (power + ridge)[:, None]))
        pieces = np.split(rest, ends)
        return _restored([piece[:, 0] for piece in pieces], [piece[:, 1:] for piece in pieces]), _used(
            power, ridge
        )

    return fit_robustly(fit, rate)


def _restored(pieces: Sequence[Array], white: Sequence[Array]) -> list[Array]:
    r"""Gives what a fit leaves of noise the noise's own colour back.

    A flexible model takes away noise where the motion is, at low frequencies, and nearly none beyond. A filter that
    whitens what is left would take the noise there for quieter than it is, and chance for a cause. What the same fit
    leaves of white noise shows the part \rho(f) that is left, and each piece is filtered by \sqrt{\bar\rho / \rho(f)}.

    Args:
        pieces: (M,) each.
        white: (M, k) what the fit leaves of white noise of unit power.
    """
    frequency, density = spectrum([column for piece in white for column in piece.T])
    order = np.argsort(frequency)
    left = np.maximum(density, LEFT_MIN)
    gain = np.sqrt(np.mean(left) / left)
    out = []
    for piece in pieces:
        own = np.interp(np.fft.rfftfreq(len(piece)), frequency[order], gain[order])
        out.append(np.fft.irfft(np.fft.rfft(piece) * own, len(piece)))
    return out


def _ridge(power: Array, samples: int) -> float:
    """Ridge of a regression with some eigenvalues of its normal matrix: the least that uses up no more than allowed."""
    ridge = RIDGE * samples
    while _used(power, ridge) > USED_MAX * samples:
        ridge *= RIDGE_FACTOR
    return ridge


def _used(power: Array, ridge: float) -> float:
    """Samples of white noise that such a regression takes away: tr(2 H - H^2), H what turns readings into its fit."""
    share = power / (power + ridge)
    return float(np.sum(share * (2.0 - share)))
