# SPDX-License-Identifier: BSD-3-Clause
"""Cross-validation folds and the hold-out: which recordings are fitted, and which no step of the fit uses.

One motion with its repeats makes one fold. A single motion is cut into segments of about equal motion.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import InsufficientData, Log
from impedance_modules.errors import BadInput

FOLDS_MIN = 2
"""Fewest folds for cross-validation, the hold-out not counted."""

FREE_MIN = 0.05
"""Part of a motion's samples that must be free of contact, by the phases, for the links to be judged by it."""

TAILS = (0.02, 0.98)
"""Quantiles that bound the range of a joint's positions and speeds."""

RANGE_TOLERANCE = 0.05
"""Motions without which the others cover nearly the same range, to this part, are equally good hold-outs."""

RUN_IN = 0.13
"""Length that the filter of the widest band (20 Hz) removes at each end [s]; that of a narrower band removes more."""

SEGMENTS_MAX = 6
"""Most segments that one motion is cut into."""

SEGMENT_LENGTH = 2.0
"""Least length of a segment where the recording is long enough [s]."""

SHORTEST_PART = 0.6
"""Part of that length which is enough for the fewest segments; below it segments of equal time are used."""

SEGMENTS_MIN = 4
"""Fewest segments where they are long enough; else there is one to hold out and the fewest folds."""

TIME_SHARE = 0.3
"""Part of a segment's weight that counts time instead of motion, so that rest does not become one long segment."""

MOTION_RATE = 20.0
"""Rate at which motion is summed; differences at a higher rate are mostly noise [Hz]."""


@dataclass(frozen=True, eq=False)
class DataSplit:
    """Logs by their role.

    Attributes:
        logs: All, in the order of every index below.
        folds: Indices of the fitted logs, one tuple per fold: one motion with its repeats.
        heldout: Indices of the logs that no step of the fit uses.
        warnings: What the reader should know about it.
    """

    logs: tuple[Log, ...]
    folds: tuple[tuple[int, ...], ...]
    heldout: tuple[int, ...]
    warnings: tuple[str, ...]

    @property
    def fitted(self) -> tuple[int, ...]:
        """Indices of all fitted logs."""
        return tuple(index for fold in self.folds for index in fold)

    def without(self, left_out: Collection[int], why: str) -> DataSplit:
        """Leaves some logs out, and says so; the last fold is held out where no held-out log remains.

        Raises:
            InsufficientData: Fewer than two folds and a held-out motion remain.
        """
        if not left_out:
            return self
        place = {old: new for new, old in enumerate(i for i in range(len(self.logs)) if i not in left_out)}
        folds = [tuple(place[i] for i in fold if i in place) for fold in self.folds]
        kept = [fold for fold in folds if fold]
        held = tuple(place[i] for i in self.heldout if i in place)
        if not held and kept:
            held = kept.pop()
        if len(kept) < FOLDS_MIN or not held:
            raise InsufficientData(f"{why}; what remains cannot be fitted on one part and tested on another")
        logs = tuple(log for i, log in enumerate(self.logs) if i in place)
        return DataSplit(logs, tuple(kept), held, (*self.warnings, why))


def assign_folds(
    logs: Sequence[Log], heldout: Collection[str], useful: float = 0.0, run_in: float = 0.0
) -> DataSplit:
    """Assigns every log to a fold or to the hold-out.

    A motion and its repeats stay together. Where the user names no hold-out, `select_holdout` chooses a motion.

    Args:
        logs: Admitted recordings.
        heldout: Names of those the user holds out; empty: `select_holdout` chooses.
        useful: Least length of a segment after the band's filter [s].
        run_in: Length that the filter removes at each end [s].

    Raises:
        BadInput: All recordings are held out.
        InsufficientData: Too short to fit on one part and to test on another.
    """
    groups: dict[str, list[Log]] = {}
    for log in logs:
        groups.setdefault(log.group, []).append(log)
    warnings: list[str] = []
    if heldout:
        tested = [log for log in logs if log.name in heldout]
        fitted = {name: [log for log in found if log.name not in heldout] for name, found in groups.items()}
        motions = [found for found in fitted.values() if found]
        if not motions:
            raise BadInput("--holdout: every recording is held out (valid: at least one LOG to fit)")
    elif len(groups) > 1:
        motions = sorted(groups.values(), key=lambda found: found[0].name)
        only = _only_free(motions, useful, run_in)
        if only is not None:
            place, pieces = only
            warnings.append("one motion in free air only: held-out parts are segments of it")
            held = pieces.pop(select_holdout_segment(pieces))
            return _numbered([*motions[:place], *motions[place + 1 :], *pieces], held, warnings)
        tested = motions.pop(_motion_to_hold_out(motions, useful, run_in))
    else:
        motions, tested = list(groups.values()), []
        warnings.append("one motion only: held-out parts are segments of the same recording")
    if not tested or len(motions) == 1:
        return _segmented(tested, warnings, segments_of(motions[0], useful, run_in))
    return _numbered(motions, tested, warnings)


def _only_free(
    motions: Sequence[Sequence[Log]], useful: float, run_in: float
) -> tuple[int, list[list[Log]]] | None:
    """The only motion in free air and its segments; None where there are several, or it is too short to be cut."""
    free = [i for i, found in enumerate(motions) if is_free(found)]
    if len(free) != 1:
        return None
    pieces = _pieces_of(motions[free[0]], useful, run_in)
    return None if pieces is None else (free[0], pieces)


def _motion_to_hold_out(motions: Sequence[Sequence[Log]], useful: float, run_in: float) -> int:
    """Of two motions, the one that is fitted must be long enough to be cut; of more, any may be held out."""
    chosen = select_holdout(motions)
    if len(motions) > 2 or _pieces_of(motions[1 - chosen], useful, run_in) is not None:
        return chosen
    return chosen if _pieces_of(motions[chosen], useful, run_in) is None else 1 - chosen


def _pieces_of(motion: Sequence[Log], useful: float, run_in: float) -> list[list[Log]] | None:
    """The segments of a motion; None where it is too short to be cut."""
    try:
        return segments_of(motion, useful, run_in)
    except InsufficientData:
        return None


def _segmented(tested: Sequence[Log], warnings: list[str], pieces: list[list[Log]]) -> DataSplit:
    """Takes the segments of the only fitted motion, the same ones of each repeat, as motions."""
    if tested:
        warnings.append("one fitted motion only: the folds are segments of it")
        return _numbered(pieces, tested, warnings)
    held = pieces.pop(select_holdout_segment(pieces))
    return _numbered(pieces, held, warnings)


def _numbered(motions: Sequence[Sequence[Log]], tested: Sequence[Log], warnings: list[str]) -> DataSplit:
    logs = [log for motion in motions for log in motion] + list(tested)
    folds, first = [], 0
    for motion in motions:
        folds.append(tuple(range(first, first + len(motion))))
        first += len(motion)
    return DataSplit(tuple(logs), tuple(folds), tuple(range(first, len(logs))), tuple(warnings))


def select_holdout(motions: Sequence[Sequence[Log]]) -> int:
    """Chooses the motion to hold out so that the fitted ones still cover its range of positions and speeds.

    Repeated motions are fitted as long as there are others, because repeats measure the noise. Of the others the
    motion is chosen without which the rest covers the largest range; among equally good ones the one whose least
    moving joint moves most; then the last by name. The order of the recordings does not matter. Motions that are spent
    in contact are fitted as long as there are others: they tell nothing about the links.

    Args:
        motions: Two or more, each with its repeats.
    """
    single = [i for i, found in enumerate(motions) if len(found) == 1]
    asked = single or list(range(len(motions)))
    asked = [i for i in asked if is_free(motions[i])] or asked
    share = _shares(motions)
    return max(
        _hardly_missed(share, asked), key=lambda i: (round(float(share[i].min()), 3), motions[i][0].name)
    )


def _shares(motions: Sequence[Sequence[Log]]) -> Array:
    """(motions, 2 n) range of positions and speeds of each joint in each motion, over the largest."""
    reach = np.array([np.max([_range_covered(log) for log in found], axis=0) for found in motions])
    return np.asarray(reach / np.maximum(reach.max(axis=0), 1e-9))


def _hardly_missed(share: Array, asked: Sequence[int]) -> list[int]:
    """Those of some motions without which the others cover the largest part of all ranges, on average."""
    left = {i: float(np.delete(share, i, axis=0).max(axis=0).mean()) for i in asked}
    return [i for i in asked if left[i] >= max(left.values()) - RANGE_TOLERANCE]


def is_free(motion: Sequence[Log]) -> bool:
    """Whether a motion and its repeats are, by their phases, not spent in contact."""
    marked = sum(0 if log.in_contact is None else int(log.in_contact.sum()) for log in motion)
    whole = sum(log.samples for log in motion)
    return whole - marked >= FREE_MIN * whole


def _range_covered(log: Log) -> Array:
    """Range of positions and speeds of each joint in a recording, (2 n,)."""
    speed = np.diff(log.position, axis=0) * log.rate
    return np.concatenate([np.subtract(*np.quantile(x, TAILS[::-1], axis=0)) for x in (log.position, speed)])


def segments_of(motion: Sequence[Log], useful: float, run_in: float = 0.0) -> list[list[Log]]:
    """Cuts one motion, its repeats alike, into segments of about equal motion, in order of time.

    A segment overlaps its neighbours by what the filter removes, so that each sample is used once.

    Args:
        motion: A recording and its repeats.
        useful: Least length of a segment after the filter [s].
        run_in: Length that the filter removes at each end [s].

    Raises:
        InsufficientData: Too short to fit on one part and to test on another.
    """
    shortest = min(motion, key=lambda log: log.samples)
    run_in = max(run_in, RUN_IN)
    left = shortest.duration - 2.0 * run_in
    least = max(SHORTEST_PART * SEGMENT_LENGTH, useful)
    pieces = min(SEGMENTS_MAX, max(int((left + 2.0 * RUN_IN) / max(SEGMENT_LENGTH, useful)), SEGMENTS_MIN))
    if left < pieces * least:
        pieces = FOLDS_MIN + 1
    if left < pieces * least:
        raise InsufficientData(
            f"{shortest.name}: {shortest.duration:.3g} s is too short to fit one part and test on another"
            f" (valid: {pieces * least + 2.0 * run_in:.2g} s, or several motions)"
        )
    edges = _edges(shortest, pieces, least, run_in)
    return [[_segment(log, edges, index, run_in) for log in motion] for index in range(pieces)]


def _edges(log: Log, pieces: int, least: float, run_in: float) -> list[int]:
    """Sample numbers that bound segments of equal motion, or of equal time where one would be too short."""
    step = max(1, round(log.rate / MOTION_RATE))
    path = np.abs(np.diff(log.position[::step], axis=0))
    whole = path.sum(axis=0)
    moving = whole > 0.0
    motion = (path[:, moving] / whole[moving]).mean(axis=1) if moving.any() else np.zeros(len(path))
    weight = np.concatenate([[0.0], np.cumsum((1.0 - TIME_SHARE) * motion + TIME_SHARE / len(path))])
    found = np.interp(np.linspace(0.0, weight[-1], pieces + 1), weight, step * np.arange(len(weight)))
    lost = run_in * log.rate
    kept = np.diff(np.concatenate([[lost], found[1:-1], [log.samples - lost]]))
    if kept.min() < least * log.rate:
        found = np.linspace(lost, log.samples - lost, pieces + 1)  # nearly all motion in one place
    return [0, *(round(edge) for edge in found[1:-1]), log.samples]


def _segment(log: Log, edges: Sequence[int], index: int, run_in: float) -> Log:
    over = int(run_in * log.rate)
    last = index + 2 == len(edges)
    first, stop = max(0, edges[index] - over), log.samples if last else edges[index + 1] + over
    return log.part(first, min(stop, log.samples), f"[{index + 1}/{len(edges) - 1}]")


def select_holdout_segment(pieces: Sequence[Sequence[Log]]) -> int:
    """Chooses the segment in which the joint that moves least, compared with its average, moves most.

    Of those without which the others still cover all ranges: the one fast stretch of a motion is fitted.
    """
    size = np.array([np.ptp(piece[0].position, axis=0) for piece in pieces])
    usual = size.mean(axis=0)
    moving = usual > 0.0
    if not moving.any():
        return len(pieces) - 1
    least = (size[:, moving] / usual[moving]).min(axis=1)
    return max(_hardly_missed(_shares(pieces), range(len(pieces))), key=lambda i: (float(least[i]), i))
