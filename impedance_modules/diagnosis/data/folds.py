# SPDX-License-Identifier: BSD-3-Clause
"""Stage 2b: which recordings are fitted, in which folds, and which no step of the fit ever sees."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from impedance_modules.diagnosis.data.log import InsufficientData, Log
from impedance_modules.diagnosis.spare import most_spared
from impedance_modules.diagnosis.stretch import cut, most_typical
from impedance_modules.errors import BadInput

FOLDS_MIN = 2
"""Fewest folds that a fit is tested on, beside what is held out."""


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Logs by their role.

    Attributes:
        logs: All, in the order of every index below.
        folds: Indices of the fitted logs, one tuple per fold: one motion with its repeats.
        heldout: Indices of the logs that no step of the fit sees.
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

    def without(self, left_out: Collection[int], why: str) -> Arrangement:
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
        return Arrangement(logs, tuple(kept), held, (*self.warnings, why))


def arrange(
    logs: Sequence[Log], heldout: Collection[str], useful: float = 0.0, run_in: float = 0.0
) -> Arrangement:
    """Gives every log its role.

    A motion and its repeats stay together. Without a named holdout the motion that can best be spared is held out.

    Args:
        logs: Admitted recordings.
        heldout: Names of those the user holds out; empty lets their motions decide (`spare`).
        useful: What must be left of a stretch behind the band's filter [s].
        run_in: What the filter throws away at each end [s].

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
        tested = motions.pop(most_spared(motions))
    else:
        motions, tested = list(groups.values()), []
        warnings.append("one motion only: held-out parts are stretches of the same recording")
    if not tested or len(motions) == 1:
        return _stretched(tested, warnings, cut(motions[0], useful, run_in))
    return _numbered(motions, tested, warnings)


def _stretched(tested: Sequence[Log], warnings: list[str], pieces: list[list[Log]]) -> Arrangement:
    """Takes stretches of the only fitted motion, the same ones of each repeat, as motions."""
    if tested:
        warnings.append("one fitted motion only: the folds are stretches of it")
        return _numbered(pieces, tested, warnings)
    held = pieces.pop(most_typical(pieces))
    return _numbered(pieces, held, warnings)


def _numbered(motions: Sequence[Sequence[Log]], tested: Sequence[Log], warnings: list[str]) -> Arrangement:
    logs = [log for motion in motions for log in motion] + list(tested)
    folds, first = [], 0
    for motion in motions:
        folds.append(tuple(range(first, first + len(motion))))
        first += len(motion)
    return Arrangement(tuple(logs), tuple(folds), tuple(range(first, len(logs))), tuple(warnings))
