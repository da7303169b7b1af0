# SPDX-License-Identifier: BSD-3-Clause
"""Choice of a probe: the shortest safe chain of library motions that answers every open question."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.experiment_design.motion_library import SIZES, ProbeMotion, motions
from impedance_modules.diagnosis.experiment_design.motion_limits import (
    EFFORT_SHARE,
    STEP,
    Clearance,
    MotionLimits,
    choose_start,
    limits_of_model,
    limits_of_robot,
)
from impedance_modules.diagnosis.experiment_design.open_reasons import (
    CERTAIN,
    CHI_SQUARE,
    SHARE_PERHAPS,
    open_reason,
)
from impedance_modules.diagnosis.experiment_design.probe_questions import (
    ProbeQuestion,
    ProbeRequest,
    general_request,
    request_of_diagnosis,
    with_assumed_noise,
)
from impedance_modules.diagnosis.experiment_design.separation import (
    RATE,
    MotionPredictor,
    Separation,
    SeparationPredictor,
    spring_stiffness,
)
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.errors import BadInput
from impedance_modules.spec.robot_spec import RobotSpec

SHARE = 0.1
"""Least share of the effect's power that the rival must leave unexplained: noise is not the only error."""

NOISE_SHARE = 0.002
"""Noise that is assumed without a diagnosis, over a joint's torque limit."""

GAP_SHARE = 2.0
"""Torque that may resist a probe over its whole path, as a multiple of the gap's rms."""

NOISE_UNSTATED = 0.05
"""Assumed noise where no torque limit is stated [N.m]."""


@dataclass(frozen=True, eq=False)
class Probe:
    """The result of `impedance probe`."""

    request: ProbeRequest
    predictor: MotionPredictor
    proposal: Proposal


def propose_probe(
    answer: Mapping[str, Any] | None,
    model: NominalModel,
    urdf: Path,
    spec: RobotSpec | None,
    progress: Callable[[str], None] = lambda _: None,
) -> Probe:
    """Finds the next motion to record.

    Args:
        answer: A diagnosis JSON, or None.
        model: Of all joints that may move.
        urdf: Its links.
        spec: The robot's folder; None for a bare URDF, whose links are not measured for collisions.
        progress: Called with a sentence for each step.

    Raises:
        BadInput: The diagnosis and the model do not fit, or no motion is safe.
    """
    limits = limits_of_model(model) if spec is None else limits_of_robot(spec, model.joints)
    request = (
        general_request(model.joints, _assumed(limits))
        if answer is None
        else with_assumed_noise(request_of_diagnosis(answer, model.tree), _assumed(limits))
    )
    clearance = None if spec is None else Clearance(spec, model.joints)
    rigid = BatchedRigidModel.of_tree(urdf, model.tree)
    start = choose_start(limits, request.start, clearance, rigid.weight)
    sensor = "motor" if {"motor", "whole", "drive"} & set(request.residuals) else "joint_sensor"
    predictor = MotionPredictor(model, rigid, start, spring_stiffness(model, start), sensor)
    return Probe(request, predictor, ProbeSearch(request, predictor, limits, clearance, progress).choose())


def resisting_work(probe: Probe) -> float:
    r"""Work [J] that the gap itself may take out of the energy tank, friction at worst: \sum 2 gap_j \int |dq_j|."""
    _, position = probe.predictor.position(probe.proposal.motion)
    path = np.sum(np.abs(np.diff(position, axis=0)), axis=0)
    joints = probe.predictor.model.joints
    return float(sum(GAP_SHARE * gap * path[joints.index(joint)] for joint, gap in probe.request.gap.items()))


@dataclass(frozen=True, eq=False)
class Proposal:
    """A probe.

    Attributes:
        motion: What the joint springs do.
        expected: One per question.
        nearest: Smallest distance of declared pairs of links [m]; infinite where none are declared or known.
        pair: Which.
    """

    motion: ProbeMotion
    expected: tuple[ExpectedAnswer, ...]
    nearest: float
    pair: str


@dataclass(frozen=True)
class ExpectedAnswer:
    """A question and how well a motion is expected to answer it.

    Attributes:
        question: Which.
        separation: Expected of the motion.
        reason: Why no motion of the library answers it, and what to record instead; empty where one may.
    """

    question: ProbeQuestion
    separation: Separation
    reason: str = ""

    @property
    def met(self) -> bool:
        """Whether it will be answered."""
        return self.separation.chi_square >= CHI_SQUARE and self.separation.share >= SHARE

    @property
    def outlook(self) -> str:
        """Description for printing."""
        if self.met:
            return "yes"
        return "no motion of the library does" if self.reason else "perhaps: the rival comes near"

    @property
    def likely(self) -> bool:
        """Whether an answer can be hoped for."""
        found = self.separation
        enough = found.share >= SHARE_PERHAPS or found.chi_square >= CERTAIN
        return enough and found.chi_square >= CHI_SQUARE

    @property
    def progress(self) -> float:
        """Degree of completion of the answer, at most 1."""
        return min(1.0, self.separation.chi_square / CHI_SQUARE, self.separation.share / SHARE)


class ProbeSearch:
    """Searches the library of motions."""

    def __init__(
        self,
        request: ProbeRequest,
        predictor: MotionPredictor,
        limits: MotionLimits,
        clearance: Clearance | None,
        progress: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._request, self._motion_predictor, self._limits, self._clearance = (
            request,
            predictor,
            limits,
            clearance,
        )
        self._predictor = SeparationPredictor(request, predictor.model)
        self._progress = progress

    def choose(self) -> Proposal:
        """Adds, as long as questions are open, the motion that answers most of them per second.

        One motion that answers everything is taken if it is shorter than the chain.

        Raises:
            BadInput: No motion of the library is safe from this start.
        """
        tried = [
            found
            for joint in dict.fromkeys(joint for q in self._request.questions for joint in q.joints)
            for found in self._safe(self._limits.joints.index(joint))
        ]
        if not tried:
            raise BadInput(
                "no motion of the library is safe from the start posture: it is too near a limit or another link"
                " (valid: a start with 0.05 rad of room on the joints to be moved)"
            )
        chain = self._chain(tried)
        alone = [item for item in tried if all(e.met for e in item.expected)]
        best = min([chain, *(item.motion for item in alone)], key=lambda motion: motion.duration)
        signals = self._motion_predictor.record(best)
        nearest, pair = self._nearest(signals)
        expected = self._asked(signals, self._request.questions)
        return Proposal(best, tuple(_with_reason(e, i, tried) for i, e in enumerate(expected)), nearest, pair)

    def _chain(self, tried: Sequence[_Tried]) -> ProbeMotion:
        reached = dict.fromkeys(range(len(self._request.questions)), 0.0)
        chain: ProbeMotion | None = None
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
        self._progress(f"trying motions of {self._limits.joints[joint]}")
        done: set[str] = set()
        for size in SIZES:
            for motion in motions(
                self._limits, self._motion_predictor.start, joint, size, self._motion_predictor.rigid.weight
            ):
                if motion.kinds[0] in done:
                    continue
                signals = self._motion_predictor.record(motion)
                if self.objection(signals) is not None:
                    continue
                done.add(motion.kinds[0])
                asked = [q for q in self._request.questions if self._limits.joints[joint] in q.joints]
                found = {id(e.question): e for e in self._asked(signals, asked)}
                nothing = Separation(0.0, 0.0)
                yield _Tried(
                    motion,
                    tuple(found.get(id(q), ExpectedAnswer(q, nothing)) for q in self._request.questions),
                )

    def objection(self, signals: Signals) -> str | None:
        """Says why a predicted motion is not safe; None where it is."""
        effort = signals.drive if signals.drive is not None else signals.rigid
        found = self._limits.violation(signals.position, signals.velocity, effort)
        if found is None and self._clearance is not None:
            nearest, pair = self._nearest(signals)
            if nearest < self._clearance.needed:
                return f"{pair} come within {nearest:.3f} m"
        return found

    def _nearest(self, signals: Signals) -> tuple[float, str]:
        if self._clearance is None:
            return np.inf, ""
        return self._clearance.nearest(signals.position[:: max(1, round(STEP * RATE))])

    def _asked(self, signals: Signals, questions: Sequence[ProbeQuestion]) -> tuple[ExpectedAnswer, ...]:
        found = self._predictor.separate(signals, questions)
        return tuple(ExpectedAnswer(question, item) for question, item in zip(questions, found, strict=True))


@dataclass(frozen=True, eq=False)
class _Tried:
    """A safe motion of one joint and its expected answers."""

    motion: ProbeMotion
    expected: tuple[ExpectedAnswer, ...]


def _with_reason(expected: ExpectedAnswer, index: int, tried: Sequence[_Tried]) -> ExpectedAnswer:
    """Adds why a question stays open, judged by the motion that comes nearest to an answer."""
    every = [expected, *(item.expected[index] for item in tried)]
    if any(one.likely for one in every):
        return expected
    best = max(every, key=lambda one: one.progress)
    return replace(expected, reason=open_reason(expected.question, best.separation))


def _assumed(limits: MotionLimits) -> dict[tuple[Residual, str], float]:
    """Assumed noise of torques at both ports, from each joint's limit."""
    out: dict[tuple[Residual, str], float] = {}
    for joint, effort in zip(limits.joints, limits.effort / EFFORT_SHARE, strict=True):
        size = NOISE_SHARE * float(effort) if np.isfinite(effort) else NOISE_UNSTATED
        out["actuator", joint] = out["link", joint] = size
    return out
