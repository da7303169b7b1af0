# SPDX-License-Identifier: BSD-3-Clause
"""Consistency of a data set: one robot, the same joints and sensors, each recording once; and which are repeats.

Recordings that repeat one motion measure the noise floor without any model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput, nearest

Rows = NDArray[np.float64]
COPIED_SHARE = 0.5
"""Recordings that share this part of their samples to the last digit, in their order, are copies."""

IN_A_ROW = 8
"""Samples that must follow each other in both: on coarse grids one sample is soon seen again, a row of them never."""

DISTINCT_MIN = 50
"""Fewer different samples prove no copy: a simulated robot at rest repeats its samples."""

REPEAT_TOLERANCE = 0.1
"""Two motions repeat each other if they differ by less than this part of their size."""

START_DIFFERENCE_MAX = 1.0
"""Largest difference in start time of repeats that were started by hand [s]."""

LAG_SEARCH = 3
"""Lags searched on either side of the first estimate [samples]."""

LENGTH_TOLERANCE = 0.05
"""Repeats differ in length by less than this part, and by less than twice `START_DIFFERENCE_MAX`."""


def refuse_mixed_recordings(episodes: Sequence[Episode]) -> None:
    """Refuses recordings that are not of one robot, one set of joints and one kind of torque.

    Raises:
        BadInput: One given twice or under two names, two robots, other joints, another meaning of the torque.
    """
    _refuse_same_names(episodes)
    first = episodes[0]
    for episode in episodes[1:]:
        for what in ("robot", "gravity_compensation"):
            one, other = getattr(first, what), getattr(episode, what)
            if one != other:
                raise BadInput(
                    f"{episode.source}: its {what.replace('_', ' ')} is '{other}', that of {first.source} is"
                    f" '{one}' (valid: recordings of one robot, made in one way; diagnose the others apart)"
                )
        _refuse_other_joints(first, episode)


def refuse_copies(logs: Sequence[Log]) -> None:
    """Refuses a recording whose samples are also in another one: it could serve neither as a repeat nor as a test.

    Raises:
        BadInput: Two names for the same samples, all of them or a part.
    """
    kinds = [kind for kind in ("effort", "command") if all(getattr(log, kind) is not None for log in logs)]
    rows = [_rows(log, kinds) for log in logs]
    for index, log in enumerate(logs):
        for place, other in enumerate(logs[:index]):
            few, many = sorted((rows[index], rows[place]), key=len)
            shared = np.intersect1d(few, many, assume_unique=True).size
            if shared >= max(DISTINCT_MIN, COPIED_SHARE * len(few)):
                raise BadInput(
                    f"{log.name} and {other.name} hold the same numbers in {shared + IN_A_ROW - 1} samples: one is a"
                    " copy, or a part, of the other (valid: separate recordings; even a repeated motion has new noise)"
                )


def group_repeats(logs: Sequence[Log], stated: Sequence[str | None], warnings: list[str]) -> tuple[Log, ...]:
    """Puts recordings of one motion into one group, and cuts them to a common start and end.

    Args:
        logs: Recordings.
        stated: What each says it repeats; None where it says nothing.
        warnings: Gets a sentence for each recording that is no repeat of what it says it repeats.
    """
    by_name = {log.name: index for index, log in enumerate(logs)}
    leader = list(range(len(logs)))
    lag = [0] * len(logs)
    for index, (log, original) in enumerate(zip(logs, stated, strict=True)):
        others = [by_name[original]] if original in by_name else list(range(index))
        if original in by_name and _lag(logs[by_name[original]], log) is None:
            warnings.append(
                f"{log.name} says it repeats {original}, but its motion differs: not taken as a repeat"
            )
            continue
        for other in others:
            if other != index and leader[index] == index:
                found = _lag(logs[leader[other]], log)
                if found is not None and leader[other] != index:
                    leader[index], lag[index] = leader[other], found
    return tuple(_aligned(logs, leader, lag))


def _refuse_same_names(episodes: Sequence[Episode]) -> None:
    for index, episode in enumerate(episodes):
        for other in episodes[:index]:
            if other.name != episode.name:
                continue
            if other.source.resolve() == episode.source.resolve():
                raise BadInput(
                    f"{episode.source} is given twice: a recording that was fitted cannot test the fit"
                    " (valid: each once, as LOG or as --holdout)"
                )
            raise BadInput(
                f"two recordings are called '{episode.name}' ({other.source}, {episode.source});"
                " valid: each recording once, under its own name"
            )


def _refuse_other_joints(first: Episode, episode: Episode) -> None:
    for one, other in ((first, episode), (episode, first)):
        missing = [joint for joint in one.joints if joint not in other.position]
        if missing:
            raise BadInput(
                f"{other.source}: no position.{missing[0]}{nearest(missing[0], other.joints)}, which {one.source}"
                f" has (valid: the same joints in every recording; it has {', '.join(other.joints)})"
            )


def _rows(log: Log, kinds: Sequence[str]) -> Rows:
    """The different rows of samples of a recording, as one number each."""
    table = np.hstack([log.position, *(getattr(log, kind) for kind in kinds)])
    random = np.random.default_rng(0)
    samples = table @ random.normal(size=table.shape[1])
    last = len(samples) - IN_A_ROW + 1
    # Term by term: the same samples give the same number to the last digit, wherever they stand.
    return np.unique(
        sum(weight * samples[k : last + k] for k, weight in enumerate(random.normal(size=IN_A_ROW)))
    )


def _aligned(logs: Sequence[Log], leader: Sequence[int], lag: Sequence[int]) -> list[Log]:
    """Cuts the recordings of each group to what they have in common."""
    out = list(logs)
    for first in set(leader):
        members = [index for index, found in enumerate(leader) if found == first]
        begin = max(-lag[index] for index in members)
        end = min(logs[index].samples - lag[index] for index in members)
        for index in members:
            whole = logs[index]
            part = whole.part(begin + lag[index], end + lag[index]) if len(members) > 1 else whole
            out[index] = replace(part, group=logs[first].name)
    return out


def _lag(log: Log, other: Log) -> int | None:
    """By how many samples ``other`` runs behind ``log``; None where they show two motions."""
    longer, shorter = max(log.samples, other.samples), min(log.samples, other.samples)
    if abs(log.rate - other.rate) > 0.01 * log.rate:
        return None
    if longer - shorter > min(LENGTH_TOLERANCE * longer, 2.0 * START_DIFFERENCE_MAX * log.rate):
        return None
    near = _shift(log.position, other.position, int(START_DIFFERENCE_MAX * log.rate))
    late = min(range(near - LAG_SEARCH, near + LAG_SEARCH + 1), key=lambda shift: _apart(log, other, shift))
    size = float(np.sqrt(np.mean((log.position - log.position.mean(axis=0)) ** 2)))
    return late if _apart(log, other, late) < REPEAT_TOLERANCE * size else None


def _apart(log: Log, other: Log, late: int) -> float:
    """Rms distance of two motions, the second shifted back [rad]."""
    first, second = log.position[max(0, -late) :], other.position[max(0, late) :]
    samples = min(len(first), len(second))
    return float(np.sqrt(np.mean((first[:samples] - second[:samples]) ** 2)))


def _shift(one: Array, other: Array, most: int) -> int:
    """Lag of ``other`` behind ``one`` at which they agree best [samples]."""
    samples = min(len(one), len(other))
    size = 2 ** int(np.ceil(np.log2(2 * samples)))
    a, b = (np.diff(x[:samples], axis=0) for x in (one, other))
    spectrum = np.conj(np.fft.rfft(a, size, axis=0)) * np.fft.rfft(b, size, axis=0)
    correlation = np.fft.irfft(spectrum.sum(axis=1), size)
    most = min(most, samples // 4)
    window = np.concatenate([correlation[-most:], correlation[: most + 1]])
    return int(np.argmax(window)) - most
