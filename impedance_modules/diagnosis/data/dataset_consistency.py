# SPDX-License-Identifier: BSD-3-Clause
"""Which recordings may stand beside each other: one robot, the same joints and sensors, each recording once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput, nearest

Rows = NDArray[np.float64]

COPIED_SHARE = 0.5
"""Part of a recording's samples that stand, to the last digit, in another one, too: noise never does that."""

DISTINCT_MIN = 50
"""Fewer different samples prove no copy: simulated rest looks alike everywhere."""


def refuse_company(episodes: Sequence[Episode]) -> None:
    """Refuses recordings that do not belong together.

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


def refuse_copies(logs: Sequence[Log]) -> None:
    """Refuses a recording whose samples stand in another one: as a repeat or a test it would prove nothing.

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
                    f"{log.name} and {other.name} hold the same numbers in {shared} samples: one is a copy, or"
                    " a part, of the other (valid: separate recordings; even a repeated motion has new noise)"
                )


def _rows(log: Log, kinds: Sequence[str]) -> Rows:
    """The different samples of a recording, one mark for each."""
    table = np.hstack([log.position, *(getattr(log, kind) for kind in kinds)])
    weights = np.random.default_rng(0).normal(size=table.shape[1])
    return np.unique(table @ weights)
