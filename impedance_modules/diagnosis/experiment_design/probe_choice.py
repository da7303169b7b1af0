# SPDX-License-Identifier: BSD-3-Clause
"""The shortest safe chain of library motions that answers every question of a brief."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.experiment_design.clearance import STEP, Clearance
from impedance_modules.diagnosis.experiment_design.follow import RATE, Follower
from impedance_modules.diagnosis.experiment_design.motion_library import SIZES, motions
from impedance_modules.diagnosis.experiment_design.probe_questions import Brief, Question
from impedance_modules.diagnosis.experiment_design.motion_limits import Room
from impedance_modules.diagnosis.experiment_design.separation import Predictor, Separation
from impedance_modules.diagnosis.experiment_design.strokes import Motion
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

CHI_SQUARE = 200.0
"""Expected chi-square difference that a question needs."""

SHARE = 0.1
"""Share of the effect's own power that the rival must leave, at least: noise is not all that is wrong."""

SHARE_PERHAPS = 0.02
"""Below it nothing is to be expected: a diagnosis takes two causes within a hundredth for one."""


@dataclass(frozen=True)
class Expected:
    """A question and what the chosen motion is expected to say to it."""

    question: Question
    separation: Separation

    @property
    def met(self) -> bool:
        """Whether it will be answered."""
        return self.separation.chi_square >= CHI_SQUARE and self.separation.share >= SHARE

    @property
    def outlook(self) -> str:
        """In words."""
        if self.met:
            return "yes"
        likely = self.separation.chi_square >= CHI_SQUARE and self.separation.share >= SHARE_PERHAPS
        return "perhaps: the rival comes near" if likely else "no motion of the library does"

    @property
    def progress(self) -> float:
        """How near the answer is, at most 1."""
        return min(1.0, self.separation.chi_square / CHI_SQUARE, self.separation.share / SHARE)


@dataclass(frozen=True, eq=False)
class Proposal:
    """A probe.

    Attributes:
        motion: What the joint springs do.
        expected: One per question.
        nearest: Smallest distance of declared pairs of links [m]; infinite where none are declared or known.
        pair: Which.
    """

    motion: Motion
    expected: tuple[Expected, ...]
    nearest: float
    pair: str


@dataclass(frozen=True, eq=False)
class _Tried:
    """A safe motion of one joint and what it says to the questions."""

    motion: Motion
    expected: tuple[Expected, ...]


class Chooser:
    """Searches the library."""

    def __init__(
        self,
        brief: Brief,
        follower: Follower,
        room: Room,
        clearance: Clearance | None,
        progress: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._brief, self._follower, self._room, self._clearance = brief, follower, room, clearance
        self._predictor = Predictor(brief, follower.model)
        self._progress = progress

    def choose(self) -> Proposal:
        """Adds, as long as questions are open, the motion that answers most of them per second.

        One motion that answers everything is taken if it is shorter than the chain.

        Raises:
            BadInput: No motion of the library is safe from this start.
        """
        tried = [
            found
            for joint in dict.fromkeys(joint for q in self._brief.questions for joint in q.joints)
            for found in self._safe(self._room.joints.index(joint))
        ]
        if not tried:
            raise BadInput(
                "no motion of the library is safe from the start posture: it is too near a limit or another link"
                " (valid: a start with 0.05 rad of room on the joints to be moved)"
            )
        chain = self._chain(tried)
        alone = [item for item in tried if all(e.met for e in item.expected)]
        best = min([chain, *(item.motion for item in alone)], key=lambda motion: motion.duration)
        signals = self._follower.record(best)
        nearest, pair = self._nearest(signals)
        return Proposal(best, self._asked(signals, self._brief.questions), nearest, pair)

    def _chain(self, tried: Sequence[_Tried]) -> Motion:
        reached = dict.fromkeys(range(len(self._brief.questions)), 0.0)
        chain: Motion | None = None
        pool = list(tried)
        while pool and any(value < 1.0 for value in reached.values()):

            def gain(item: _Tried) -> float:
                more = sum(max(0.0, e.progress - reached[i]) for i, e in enumerate(item.expected))
                return more / item.motion.duration

            best = max(pool, key=gain)
            if gain(best) <= 0.0 and chain is not None:
                break
            pool.remove(best)
            chain = best.motion if chain is None else chain.then(best.motion)
            for i, e in enumerate(best.expected):
                reached[i] = max(reached[i], e.progress)
        return tried[0].motion if chain is None else chain

    def _safe(self, joint: int) -> Iterator[_Tried]:
        self._progress(f"trying motions of {self._room.joints[joint]}")
        done: set[str] = set()
        for size in SIZES:
            for motion in motions(self._room, self._follower.start, joint, size, self._follower.rigid.weight):
                if motion.kinds[0] in done:
                    continue
                signals = self._follower.record(motion)
                if self.objection(signals) is not None:
                    continue
                done.add(motion.kinds[0])
                asked = [q for q in self._brief.questions if self._room.joints[joint] in q.joints]
                found = {id(e.question): e for e in self._asked(signals, asked)}
                nothing = Separation(0.0, 0.0)
                yield _Tried(
                    motion, tuple(found.get(id(q), Expected(q, nothing)) for q in self._brief.questions)
                )

    def objection(self, signals: Signals) -> str | None:
        """Says why a predicted motion is not safe; None where it is."""
        effort = signals.drive if signals.drive is not None else signals.rigid
        found = self._room.violation(signals.position, signals.velocity, effort)
        if found is None and self._clearance is not None:
            nearest, pair = self._nearest(signals)
            if nearest < self._clearance.needed:
                return f"{pair} come within {nearest:.3f} m"
        return found

    def _nearest(self, signals: Signals) -> tuple[float, str]:
        if self._clearance is None:
            return np.inf, ""
        return self._clearance.nearest(signals.position[:: max(1, round(STEP * RATE))])

    def _asked(self, signals: Signals, questions: Sequence[Question]) -> tuple[Expected, ...]:
        found = self._predictor.separate(signals, questions)
        return tuple(Expected(question, item) for question, item in zip(questions, found, strict=True))
