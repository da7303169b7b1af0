# SPDX-License-Identifier: BSD-3-Clause
r"""How well a predicted recording separates two hypotheses: the expected difference of their chi-squares.

The motion is predicted from joint springs K_j with damping ratio \zeta on the inertia M + I_r at the start (thesis
eq. 4.25, damping of `modules.modal_damping`):

    (M + I_r) \ddot q + D \dot q + K_j (q - rest) = 0,      D = M_r \Phi diag(2 \zeta \omega) \Phi^T M_r
    q - q_0 = \Phi \eta,      \ddot\eta_i + 2 \zeta \omega_i \dot\eta_i + \omega_i^2 \eta_i = \omega_i^2 r_i

With y the torque that the first hypothesis adds, C the columns of the second, Z those of the links' inertia (3 %
prior, scaled to unit size), \sigma the noise of each residual and joint, and all rows counted as
2 f_c independent samples a second:

    \chi^2 = min_{b, z} \sum |y - C b - Z z|^2 / \sigma^2 + |z|^2,      share = \chi^2 / \sum |y|^2 / \sigma^2

share is the squared sine of the angle between the first hypothesis and the space of the second and the nuisance.
Where one of the two cannot show (play under a load that keeps its sign, a surface that nothing touches), the motion
rules the other out or confirms it: C has no columns.
Where the second contains the first (a spring with a preload contains an offset), the columns that distinguish the
second (the stiffness) must not fit as well alone; if there are no such columns, the roles are exchanged: what the
second has beyond the first must show.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import eigh
from scipy.signal import bilinear, lfilter

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_dynamics import inertial_regressor, mass_matrix
from impedance_modules.diagnosis.experiment_design.motion_library import ProbeMotion
from impedance_modules.diagnosis.experiment_design.probe_questions import (
    Hypothesis,
    ProbeQuestion,
    ProbeRequest,
)
from impedance_modules.diagnosis.regression.candidates import Candidate, columns_of
from impedance_modules.diagnosis.regression.nuisance_columns import inertia_prior
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect import predicted
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.recorded_signals import Signals, differentiate
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.effects.rigid_model import RigidModel

CUTOFF = 8.0
"""Assumed end of the band in which recordings are compared [Hz]."""

CONTAINED = 0.01
"""Below this share the second hypothesis can be the first."""

UNSIZED = 5.0
"""Assumed size of a hypothesis without parameters, in units of the noise's rms."""

ROWS = 20.0
"""Rows of a prediction that are used, per second [Hz]."""

RATE = 50.0
"""Samples per second of a predicted motion [Hz]."""

FREQUENCY = 1.2
"""Natural frequency of a joint's spring on its own inertia [Hz]; it follows strokes of half a second."""

RATIO = 0.8
"""Damping ratio of the joint springs."""


@dataclass(frozen=True, eq=False)
class MotionPredictor:
    """Predicts recordings of probes from one start.

    Attributes:
        model: The nominal model.
        rigid: Its links.
        start: (n,) [rad].
        stiffness: (n,) K_j [N.m/rad].
        effort_source: Where the robot measures torque.
    """

    model: NominalModel
    rigid: RigidModel
    start: Array
    stiffness: Array
    effort_source: str

    @cached_property
    def _inertia(self) -> Array:
        return _inertia(self.model, self.start)

    @cached_property
    def _modes(self) -> tuple[Array, Array]:
        """Squared frequencies (n,) and mode shapes (n, n) of the joint springs."""
        squared, modes = eigh(np.diag(self.stiffness), self._inertia)
        return np.asarray(squared), np.asarray(modes)

    def position(self, motion: ProbeMotion) -> tuple[Array, Array]:
        """Gives times (N,) [s] and angles (N, n) [rad]."""
        time = np.arange(0.0, motion.duration, 1.0 / RATE)
        squared, modes = self._modes
        asked = (motion.rest(time) - self.start) @ self._inertia @ modes
        for index, omega in enumerate(np.sqrt(squared)):
            numerator, denominator = bilinear([omega**2], [1.0, 2.0 * RATIO * omega, omega**2], RATE)
            asked[:, index] = lfilter(numerator, denominator, asked[:, index])
        return time, self.start + asked @ modes.T

    def record(self, motion: ProbeMotion) -> Signals:
        """Predicts what the nominal robot would record of a probe."""
        time, q = self.position(motion)
        v = differentiate(q, time)
        a = differentiate(v, time)
        effort = self.rigid.torque(q, v, a)
        model = self.model
        rotor = model.reflected_inertia * a + model.motor_damping * v
        sensor = self.effort_source == "joint_sensor"
        return Signals(
            model=self.rigid,
            time=time,
            position=q,
            velocity=v,
            acceleration=a,
            effort=effort if sensor else effort + rotor,
            drive=effort + rotor,
            position_command=motion.rest(time),
            reflected_inertia=model.reflected_inertia,
            motor_damping=model.motor_damping,
            effort_source="joint_sensor" if sensor else "motor",
            spring_compliance=model.compliance,
            encoders=model.encoders,
            assistance=self.rigid.weight(q),
        )


def spring_stiffness(model: NominalModel, start: Array) -> Array:
    r"""Chooses joint springs K_j = (M + I_r)_jj (2 \pi f)^2, (n,) [N.m/rad], to two digits."""
    plain = np.diag(_inertia(model, start)) * (2.0 * np.pi * FREQUENCY) ** 2
    digits = 10.0 ** (np.floor(np.log10(plain)) - 1.0)
    return np.asarray(np.round(plain / digits) * digits)


@dataclass(frozen=True)
class Separation:
    """Expected outcome of a question: chi-square difference and its share of the effect's own power."""

    chi_square: float
    share: float


class SeparationPredictor:
    """Predicts how well recordings of one robot answer the questions of one request."""

    def __init__(self, request: ProbeRequest, model: NominalModel) -> None:
        self._request, self._model = request, model
        self._prior = inertia_prior(model.tree.inertia)

    def separate(self, signals: Signals, questions: Sequence[ProbeQuestion]) -> list[Separation]:
        """Predicts how well a recording would answer each question."""
        known: dict[tuple[str, ...], _Rows] = {}
        out = []
        for question in questions:
            if question.joints not in known:
                known[question.joints] = _Rows(
                    self._request, self._model, self._prior, signals, question.joints
                )
            out.append(_answer(known[question.joints], question))
        return out


def _answer(rows: _Rows, question: ProbeQuestion) -> Separation:
    sized = [y for y in rows.sized(question.first) if np.any(y)]
    spaces = list(rows.spaces(question.second))
    if not sized:
        return rows.ruled_out(question.second)
    one_way = _least(rows.left(y, C) for y in sized for C in spaces or [rows.nothing])
    if one_way.share > CONTAINED:
        return one_way
    kept = _distinguishing(question.second)
    if kept:
        return _least(rows.left(y, C[:, kept]) for y in sized for C in spaces)
    return _least(rows.beyond(C, question.first) for C in spaces)


def _least(found: Iterable[Separation]) -> Separation:
    """The separation from the nearest alternative; none without one."""
    return min(found, key=lambda one: one.share, default=Separation(0.0, 0.0))


def _distinguishing(hypothesis: Hypothesis) -> list[int]:
    """Columns that distinguish an effect, where each of its contrasts is a single column; empty otherwise."""
    rows = np.array(CATALOGUE[hypothesis.effect].contrasts)
    if rows.size == 0 or not np.all(np.count_nonzero(rows, axis=1) == 1):
        return []
    return [int(index) for index in np.flatnonzero(rows.any(axis=0))]


class _Rows:
    """Whitened rows of one predicted recording: groups one below the other."""

    def __init__(
        self,
        request: ProbeRequest,
        model: NominalModel,
        prior: Array,
        signals: Signals,
        joints: Sequence[str],
    ) -> None:
        period = float(signals.time[1] - signals.time[0])
        self._signals, self._step = signals, max(1, round(1.0 / (ROWS * period)))
        independent = np.sqrt(min(1.0, 2.0 * CUTOFF * self._step * period))
        self._weight = {
            (residual, model.joints.index(joint)): independent / noise
            for (residual, joint), noise in request.noise.items()
            if joint in joints and residual in request.residuals
        }
        self._groups = tuple(self._weight)
        self._residuals = request.residuals
        if not any(residual in LINK_RESIDUALS for residual, _ in self._groups):
            self._nuisance = self.nothing
            return
        picked = slice(None, None, self._step)
        body = inertial_regressor(
            model.tree, signals.position[picked], signals.velocity[picked], signals.acceleration[picked]
        )
        blocks = {g: body[:, g[1]] * prior for g in self._groups if g[0] in LINK_RESIDUALS}
        seen = np.max([np.abs(block).max(axis=0) for block in blocks.values()], axis=0) > 0.0
        self._nuisance = self._stack({g: block[:, seen] for g, block in blocks.items()}, int(seen.sum()))

    def sized(self, hypothesis: Hypothesis) -> Iterator[Array]:
        """Gives what a hypothesis adds to the rows, at every port where it may act."""
        effect = CATALOGUE[hypothesis.effect]
        for port in hypothesis.ports:
            if hypothesis.values is not None:
                blocks: dict[tuple[Residual, int], Array] = {}
                site = Site(self._signals, hypothesis.key, port)
                for residual in self._residuals:
                    torque = predicted(effect, site, residual, hypothesis.values)
                    picked = torque[:: self._step]
                    blocks |= {g: picked[:, [g[1]]] for g in self._groups if g[0] == residual}
                yield self._stack(blocks, 1)[:, 0]
            else:
                yield from (
                    _unit(_distinguished(C, effect.contrasts)) for C in self._columns(hypothesis, port)
                )

    def spaces(self, hypothesis: Hypothesis) -> Iterator[Array]:
        """Gives a hypothesis's column spaces, one per port and shape."""
        for port in hypothesis.ports:
            yield from self._columns(hypothesis, port)

    @property
    def nothing(self) -> Array:
        """The space of a hypothesis that cannot show in this motion: no column."""
        return np.zeros((len(self._groups) * len(self._signals.time[:: self._step]), 0))

    def ruled_out(self, second: Hypothesis) -> Separation:
        """How well a hypothesis is ruled out because it shows in a motion where the other one cannot."""
        unsized = replace(second, values=None)
        return _least(self.left(y, self.nothing) for y in self.sized(unsized))

    def left(self, y: Array, C: Array) -> Separation:
        """Fits y by C and the nuisance."""
        size = np.linalg.norm(C, axis=0)
        power = float(y @ y)
        if power <= 0.0:
            return Separation(0.0, 0.0)
        found = self._remaining(y, C[:, size > 0.0] / size[size > 0.0])
        return Separation(found, min(1.0, found / power))

    def _remaining(self, y: Array, C: Array) -> float:
        """Chi-square of y after columns of unit length and the nuisance within its prior."""
        columns = np.column_stack([C, self._nuisance])
        if columns.shape[1] == 0:
            return float(y @ y)
        ridge = np.concatenate([np.full(C.shape[1], 1e-9), np.ones(self._nuisance.shape[1])])
        target = columns.T @ y
        gained = float(target @ np.linalg.solve(columns.T @ columns + np.diag(ridge), target))
        return max(0.0, float(y @ y) - gained)

    def beyond(self, C: Array, first: Hypothesis) -> Separation:
        """How well columns show beyond a hypothesis that they contain: the best one, at the hypothesis's size."""
        best = Separation(0.0, 0.0)
        for y in self.sized(first):
            for base in self.spaces(first):
                for column in C.T:
                    size = float(np.linalg.norm(column))
                    if size > 0.0:
                        found = self.left(column / size * float(np.linalg.norm(y)), base)
                        best = max(best, found, key=lambda item: item.share)
        return best

    def _columns(self, hypothesis: Hypothesis, port: Port) -> Iterator[Array]:
        effect = CATALOGUE[hypothesis.effect]
        candidate = Candidate(effect, port, hypothesis.key, ())
        shapes = effect.shapes(candidate.site(self._signals))
        for found in columns_of(candidate, shapes, self._signals, self._residuals):
            if found is not None:
                width = next(iter(found.blocks.values())).shape[1]
                yield self._stack({g: block[:: self._step] for g, block in found.blocks.items()}, width)

    def _stack(self, blocks: Mapping[tuple[Residual, int], Array], width: int) -> Array:
        count = len(self._signals.time[:: self._step])
        parts: Sequence[Array] = [
            blocks[g] * self._weight[g] if g in blocks else np.zeros((count, width)) for g in self._groups
        ]
        return np.concatenate(parts)


LINK_RESIDUALS: tuple[Residual, ...] = ("link", "motor", "whole")
"""Residuals that depend on the links' inertia."""


def _distinguished(C: Array, contrasts: Sequence[Sequence[float]]) -> Array:
    """Adds up the columns that distinguish an effect; all columns where it states none."""
    weights = np.zeros(C.shape[1])
    known = np.any(np.array(contrasts), axis=0) if contrasts else np.ones(C.shape[1])
    weights[: min(len(known), len(weights))] = known[: len(weights)]
    return np.asarray(C @ weights)


def _unit(y: Array) -> Array:
    """Scales a hypothesis without parameters to `UNSIZED` times the noise."""
    busy = y[np.abs(y) > 0.0]
    return y if busy.size == 0 else y * (UNSIZED / float(np.sqrt(np.mean(busy**2))))


def _inertia(model: NominalModel, start: Array) -> Array:
    return np.asarray(mass_matrix(model.tree, start[None])[0] + np.diag(model.reflected_inertia))
