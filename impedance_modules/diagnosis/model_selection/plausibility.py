# SPDX-License-Identifier: BSD-3-Clause
r"""Plausibility: reasons in a candidate's own numbers to reject it, however well it fits.

One of them is that its torque does not come back when the motion is repeated, and is a response to noise:

    \rho = \sum_{pairs} x_i \cdot x_j / \sum_{pairs} |x_i| |x_j|,      x what the candidate explains, whitened

In slow motion accelerations are mostly noise of the velocity's reading that went through the controller's damping; an
inertia or a lag fitted to them follows the very noise that the residual holds. Repeats tell: their noise differs.

Without repeats, a column of accelerations, or of their second derivatives, holds the noise of the positions, and so
does the residual. Least squares then find a coefficient without any cause (errors in variables: a rotor that looks
lighter, a joint that looks elastic), which follows from the noise of the positions alone:

    b_n = \sum x_n \cdot y_n / \sum |x|^2,      x_n, y_n what that noise makes of column and residual
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.rigid_tree import can_exist
from impedance_modules.diagnosis.model_selection.acceptance import joints_disagree
from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial
from impedance_modules.diagnosis.regression.model_fit import ModelTerm
from impedance_modules.diagnosis.regression.noise_floor import repeat_pairs
from impedance_modules.diagnosis.regression.sensor_noise import made_by_positions
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.effect import JointLaw
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.residual_kinds import EFFORT_SIGN

CONTRAST_MIN = 12.0
"""Least chi-square of what makes an effect this effect: three and a half standard deviations of one number."""

FAR = 1.5
"""Farthest place of a load on a link, over the robot's longest link."""

CANCELLED_MAX = 0.5
"""Part of one constant torque that another on the same joint may cancel."""

RESOLVED = 3.5
"""Standard deviations by which a coefficient must differ from what the positions' noise makes of it."""

REPEATED_MIN = 0.5
"""Least correlation: from there on more than half of a candidate's power belongs to the motion."""


@dataclass(frozen=True, eq=False)
class Plausibility:
    """What the robot and its recordings allow a candidate to be.

    Attributes:
        signals: Of one recording, for the model behind them.
        bodies: Link -> (10,) its inertial parameters.
        reach: Farthest place of a load on a link [m].
        pairs: Recordings that repeat each other.
        resolution: Grid of the position sensors [rad]; zero where nothing is stated.
        prepared: The recordings.
    """

    signals: Signals
    bodies: Mapping[str, Array]
    reach: float
    pairs: Sequence[tuple[int, int]]
    resolution: float
    prepared: Sequence[Prepared] = ()

    @classmethod
    def of(cls, prepared: Sequence[Prepared], fitted: Sequence[int], resolution: float) -> Plausibility:
        """Reads it off recordings, of which some are fitted."""
        bodies = prepared[0].tree.bodies
        longest = max(float(np.linalg.norm(body.translation)) for body in bodies)
        return cls(
            signals=prepared[0].signals,
            bodies={body.link: body.inertia for body in bodies},
            reach=FAR * longest or float("inf"),
            pairs=repeat_pairs(prepared, fitted),
            resolution=resolution,
            prepared=prepared,
        )

    def implausible(self, trial: CandidateTrial) -> str | None:
        """Why a trial's own numbers reject it."""
        if trial.in_sample.contrast_chi_square < CONTRAST_MIN:
            return "what makes it this effect rather than a simpler one is not there for certain"
        candidate = trial.term.candidate
        if not self.pairs and candidate.effect.imitates_noise(candidate.port, self.signals):
            return "only a motion that is repeated tells it from the positions' noise, which it contains"
        made = None if self.pairs else made_by_noise(trial, self.prepared)
        if (
            made is not None
            and abs(float(trial.in_sample.own[0]) - made) < RESOLVED * trial.in_sample.spread[0]
        ):
            return "the positions' noise alone makes as much of it, in column and residual alike"
        return self.unphysical(trial)

    def unphysical(self, trial: CandidateTrial) -> str | None:
        """Why a trial's numbers cannot be: too fine to be seen, against each other, no body's, or beyond bounds."""
        if any(_contains_law(other, trial.term) for other in trial.model_fit.model):
            return "another cause on the same joint contains it"
        if not comes_back(trial, self.pairs):
            return (
                "what it rests on does not come back when the motion does: noise, and the arm's answer to it"
            )
        if _constant_parts_cancel(trial, self.signals):
            return "an offset and an asymmetry on one joint take each other back wherever it moves"
        if trial.outside or joints_disagree(trial):
            return "its parameters are at the end of what is physical, or beyond"
        term, effect = trial.term, trial.term.candidate.effect
        body = self.bodies.get(term.candidate.key)
        change = trial.coefficients.mean(axis=0) / term.layout.scale
        if body is not None and len(change) == len(body) and not can_exist(body, change):
            return "no body has such an inertia: its mass would be negative somewhere"
        spread = trial.in_sample.spread / term.layout.scale
        reason = effect.unresolved(term.shaped.shape, self.resolution) or effect.out_of_reach(
            change, spread, self.reach
        )
        values = effect.values(change, term.shaped.shape, term.candidate.site(self.signals))
        return reason or next(iter(effect.relations(values)), None)

    def of_body(self, trial: CandidateTrial) -> bool:
        """Whether a trial is about a body: several numbers, of which one may be a rotor's or an offset's."""
        return trial.term.candidate.key in self.bodies


def made_by_noise(trial: CandidateTrial, prepared: Sequence[Prepared]) -> float | None:
    """Gives the scaled coefficient that the positions' noise makes by itself; None where the column is not its own."""
    term, design = trial.term, trial.model_fit.design
    effect, scale = term.candidate.effect, float(term.layout.scale[0])
    both = power = 0.0
    for r, item in enumerate(prepared):
        if r not in trial.model_fit.fitted:
            continue
        errors = made_by_positions(item, r)
        for g in term.groups:
            residual, joint = design.groups[g]
            column = effect.noise_column(term.candidate.site(item.signals), joint, errors.drive)
            if column is None:
                return None
            both += float(
                design.whitening.apply(column / scale, r, g)
                @ design.whitening.apply(errors.of((residual, joint)), r, g)
            )
            power += float(np.sum(term.columns[r][g][:, 0] ** 2))
    return both / power if power > 0.0 else None


def comes_back(trial: CandidateTrial, pairs: Sequence[tuple[int, int]]) -> bool:
    """Whether a candidate's torque comes back in recordings of one motion, or need not.

    It need not where none was repeated, or where the command makes it.

    Args:
        trial: The candidate.
        pairs: Recordings that repeat each other.
    """
    candidate = trial.term.candidate
    if candidate.effect.computed_from_command(candidate.port):
        return True  # the command is known exactly as it was sent, its noise included
    shared, whole = 0.0, 0.0
    for i, j in pairs:
        one, other = _torque(trial, i), _torque(trial, j)
        for group in one.keys() & other.keys():
            size = min(len(one[group]), len(other[group]))
            first, second = one[group][:size], other[group][:size]
            shared += float(first @ second)
            whole += float(np.linalg.norm(first) * np.linalg.norm(second))
    return whole <= 0.0 or shared >= REPEATED_MIN * whole


def _contains_law(one: ModelTerm, other: ModelTerm) -> bool:
    """Whether one law of friction has the other's numbers among its own: they would share them out at will."""
    laws = [term.candidate.effect for term in (one, other)]
    if one.key[1:] != other.key[1:] or not all(isinstance(law, JointLaw) and law.dry for law in laws):
        return False
    more, less = (set(law.description.symbols) for law in laws)
    return more > less


def _constant_parts_cancel(trial: CandidateTrial, signals: Signals) -> bool:
    """Whether the constant parts of two effects on one joint cancel, but where the joint is at rest.

    An asymmetry of dry friction is an offset wherever the joint moves.
    """
    term, model_fit = trial.term, trial.model_fit
    for other, start in zip(model_fit.model, model_fit.starts, strict=False):
        shared = set(term.groups) & set(other.groups)
        parts = [one.candidate.effect.constant_part for one in (term, other)]
        if term.key[0] == other.key[0] or None in parts or not shared:
            continue
        sizes: list[float] = []
        for one, coefficients in ((term, trial.in_sample.own), (other, trial.in_sample.beside[start:])):
            own = coefficients[: one.shaped.size] / one.layout.scale
            candidate = one.candidate
            found = candidate.effect.values(own, one.shaped.shape, candidate.site(signals))
            read = EFFORT_SIGN[model_fit.design.groups[min(shared)][0]] if candidate.port == "sensor" else 1.0
            sizes.append(read * found[str(candidate.effect.constant_part)])
        if abs(sum(sizes)) < CANCELLED_MAX * max(map(abs, sizes)):
            return True
    return False


def _torque(trial: CandidateTrial, recording: int) -> dict[int, Array]:
    """Group -> (M,) what a candidate explains of a recording, whitened."""
    term, own = trial.term, trial.in_sample.own
    fixed = term.fixed[recording]
    return {
        group: np.asarray(block @ own + fixed[group] if group in fixed else block @ own)
        for group, block in term.columns[recording].items()
    }
