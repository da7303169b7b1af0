# SPDX-License-Identifier: BSD-3-Clause
r"""The accepted model, fitted, and its residuals on held-out recordings: the basis of all conclusions.

A gap is negligible where it is less than a thousandth of what the joint carries, or of its speed,

    |r|_{rms} \le 10^{-3} |\tau|_{rms}:

masses and gravity are not known to more digits. Where sensors are noisier than that, the noise decides.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.external_pushes import ExternalPush, rows_without_pushes
from impedance_modules.diagnosis.model_selection.forward_selection import Refusal, Selector
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.regression.design_matrix import Design
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.regression.parameter_estimates import UnwhitenedFit
from impedance_modules.diagnosis.regression.whitening import Whitening
from impedance_modules.diagnosis.residuals.contact_mask import Mask, near_contact
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import uses_motion

NEGLIGIBLE = 1e-3
"""Negligible part of a joint's own load, or speed."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The result of the search.

    Attributes:
        selector: The candidates and how they were searched.
        heldout: Recordings that no fit has used.
        prepared: All recordings.
        model_fit: The accepted model, fitted.
        floor: The noise floor, estimated with the causes known.
        plain: The fit in its own units, not whitened.
        refusal: Why the next best candidate was not accepted.
        pushes: External pushes; their rows are masked everywhere.
        disturbed: Recording and group -> (M,) rows that are masked because no law has what acts then.
        notes: What the search left out, a sentence each.
        weighed: Recordings by which causes are weighed; the held-out ones where empty.
    """

    selector: Selector
    heldout: tuple[int, ...]
    prepared: tuple[Prepared, ...]
    model_fit: ModelFit
    floor: Whitening
    plain: UnwhitenedFit
    refusal: Refusal | None
    pushes: tuple[ExternalPush, ...] = ()
    disturbed: Mapping[tuple[int, int], Mask] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    weighed: tuple[int, ...] = ()

    @property
    def judges(self) -> tuple[int, ...]:
        """Recordings by which causes are weighed."""
        return self.weighed or self.heldout

    @property
    def design(self) -> Design:
        """The rows."""
        return self.selector.design

    @cached_property
    def calibrated(self) -> ModelFit:
        """The nominal model with the nuisance fitted within its prior, and no cause."""
        return self.selector.model_fit(())

    @cached_property
    def heldout_noise(self) -> Array:
        """(groups,) rms of the noise on the held-out recordings."""
        return np.asarray(np.sqrt(np.mean(self.floor.rms[list(self.heldout)] ** 2, axis=0)))

    @cached_property
    def negligible(self) -> Array:
        """(groups,) rms below which a residual does not matter, in its unit."""
        return negligible(self.prepared, self.design.groups)

    def rms(self, model_fit: ModelFit | None, recordings: Sequence[int] | None = None) -> Array:
        """(groups,) rms residual of a model (None: nominal) on some recordings, by default the held-out ones."""
        chosen = self.heldout if recordings is None else recordings
        return self._rms_of(
            chosen,
            [self.design.raw[r] if model_fit is None else self.plain.left(model_fit, r) for r in chosen],
        )

    def rms_with(self, named: Collection[tuple[str, str]]) -> Array:
        """(groups,) rms held-out residual of the nominal model with some causes alone, as a patch has them.

        Args:
            named: Effect and port of each cause. Their numbers are those of the fit; links, weights and stamps, which
                were fitted beside them within their priors, stay as the nominal model has them.
        """
        return self._rms_of(self.heldout, [self.left_with(named, r) for r in self.heldout])

    def left_with(self, named: Collection[tuple[str, str]], recording: int) -> list[Array]:
        """Residuals of a recording of that model: group -> (M,) in the group's unit."""
        terms = [i for i, term in enumerate(self.model_fit.model) if (term.key[0], term.key[2]) in named]
        return self.plain.left_by_terms(self.model_fit, terms, recording)

    def _rms_of(self, recordings: Sequence[int], left: Sequence[Sequence[Array]]) -> Array:
        shown = [
            np.concatenate([x[g][self.counted(r, g)] for r, x in zip(recordings, left, strict=True)])
            for g in range(len(self.design.groups))
        ]
        return np.array([np.sqrt(np.mean(values**2)) if values.size else 0.0 for values in shown])

    def counted(self, recording: int, group: int) -> Mask:
        """(M,) rows of a residual in a recording that count: not masked for contact, pushes, gaps or reversals."""
        everything = np.ones(self.prepared[recording].samples, dtype=bool)
        return self.design.whitening.clear.get((recording, group), everything)

    def touched(self, recording: int, group: int) -> Mask:
        """(M,) rows of a residual in a recording that are masked because something is touched, pushes or disturbs."""
        outside = self._pushed(recording, group) | self.disturbed_rows(recording, group)
        return ~self.counted(recording, group) & (near_contact(self.prepared[recording]) | outside)

    def disturbed_rows(self, recording: int, group: int) -> Mask:
        """(M,) rows of a residual in a recording that are masked because no law has what acts then."""
        none = np.zeros(self.prepared[recording].samples, dtype=bool)
        return self.disturbed.get((recording, group), none)

    def _pushed(self, recording: int, group: int) -> Mask:
        outside = rows_without_pushes(self.pushes, self.prepared).get(recording)
        if outside is None or not uses_motion(self.design.groups[group][0]):
            return np.zeros(self.prepared[recording].samples, dtype=bool)
        return ~outside

    def disturbed_powers(self) -> Array:
        """(groups,) mean power of what the model leaves of disturbed rows, over the noise's; 0 where negligible."""
        squares, counts = np.zeros((2, len(self.design.groups)))
        for r in sorted({recording for recording, _ in self.disturbed}):
            for g, values in enumerate(self.plain.left(self.model_fit, r)):
                rows = values[self.disturbed_rows(r, g)] / self.floor.rms[r, g]
                squares[g] += float(rows @ rows)
                counts[g] += len(rows)
        power = squares / np.maximum(counts, 1.0)
        return np.where(power > (self.negligible / self.heldout_noise) ** 2, power, 0.0)

    @property
    def pushed_share(self) -> float:
        """Part of the excess power of all recordings, with the nuisance fitted, that comes from pushes; 0 without."""
        return self._outside_shares[0]

    @property
    def disturbed_share(self) -> float:
        """The same of moments that no law has."""
        return self._outside_shares[1]

    @property
    def outside_share(self) -> float:
        """Both together."""
        return self.pushed_share + self.disturbed_share

    @cached_property
    def _outside_shares(self) -> tuple[float, float]:
        """Of pushes and of disturbed moments.

        A residual that is quieter than its noise floor, which may be taken from others, has no excess, and takes none
        from the other residuals.
        """
        if not self.pushes and not self.disturbed:
            return 0.0, 0.0
        pushes, moments, others = np.zeros((3, len(self.design.groups)))
        for r in range(len(self.prepared)):
            for g, values in enumerate(self.plain.left(self.calibrated, r)):
                power = (values**2 - self.floor.rms[r, g] ** 2) / self.heldout_noise[g] ** 2
                pushed, disturbed = self._pushed(r, g), self.disturbed_rows(r, g)
                pushes[g] += float(power[pushed].sum())
                moments[g] += float(power[disturbed].sum())
                others[g] += float(power[self.counted(r, g) & ~pushed].sum())
        excess = np.clip([pushes, moments, others], 0.0, None).sum(axis=1)
        total = float(excess.sum())
        return (float(excess[0]) / total, float(excess[1]) / total) if total > 0.0 else (0.0, 0.0)

    def excess_torque(self, model_fit: ModelFit | None) -> float:
        """The same in units of the mean noise of a residual's joints: a large torque counts as one, quiet or not."""
        names = [residual for residual, _ in self.design.groups]
        noise = self.heldout_noise**2
        unit = np.array([np.mean(noise[[other == name for other in names]]) for name in names])
        return float(np.sum(np.clip(self.rms(model_fit) ** 2 - noise, 0.0, None) / unit))

    def whitened_power(self, model_fit: ModelFit | None) -> Array:
        """(groups,) power of whitened rows over the noise's, where causes are weighed; None: nominal.

        What is clear beside the noise at its frequency counts, however small it is beside all of it.
        """
        fit = self.calibrated if model_fit is None else model_fit
        coefficients = fit.whole.coefficients if model_fit is not None else np.zeros(fit.size)
        left = fit.squares(coefficients, self.judges)
        return np.asarray(left / np.maximum(self.design.count(self.judges), 1.0))

    def foretold_power(self, model_fit: ModelFit) -> Array:
        """(groups,) power that a model leaves where causes are weighed, over the noise's, by what it can foretell."""
        squares = self.foretold_squares(model_fit, self.judges)
        return np.asarray(squares / np.maximum(self.design.count(self.judges), 1.0))

    def foretold_squares(self, model_fit: ModelFit, recordings: Sequence[int]) -> Array:
        """(groups,) squares that a model leaves, of held-out recordings by what it can foretell of their links."""
        unseen = [r for r in recordings if r in self.heldout]
        left = {r: model_fit.residuals(model_fit.whole.coefficients, r) for r in unseen}
        seen = [model_fit.left_of(r) for r in recordings if r not in self.heldout]
        fitted = np.sum([[values @ values for values in own] for own in seen], axis=0) if seen else 0.0
        return np.asarray(fitted + model_fit.predicted_squares(left, unseen))

    def held_out_likelihood(self, model_fit: ModelFit) -> Array:
        """(groups,) log-likelihood of the held-out recordings [nats]."""
        squares = self.foretold_squares(model_fit, self.heldout)
        return self.design.log_likelihood(squares, self.design.count(self.heldout))

    def whitened_excess(self, model_fit: ModelFit | None) -> float:
        """That power beyond the noise, over all groups."""
        return float(np.sum(np.clip(self.whitened_power(model_fit) - 1.0, 0.0, None)))


def negligible(prepared: Sequence[Prepared], groups: Sequence[Group]) -> Array:
    """(groups,) rms below which a residual is negligible, in its unit."""
    load, speed = (
        NEGLIGIBLE * np.sqrt(np.mean(np.concatenate(values) ** 2, axis=0))
        for values in ([item.load for item in prepared], [item.velocity for item in prepared])
    )
    return np.array([speed[joint] if residual == "velocity" else load[joint] for residual, joint in groups])


def above_negligible(model_fit: ModelFit, plain: UnwhitenedFit, least: Array) -> list[ModelTerm]:
    """Terms of a fitted model whose torque is more than negligible in some group.

    Args:
        model_fit: The model.
        plain: The fit in its own units.
        least: (groups,) what is negligible.
    """
    recordings = range(len(model_fit.design.raw))
    kept = []
    for index, term in enumerate(model_fit.model):
        parts = [plain.torque(model_fit, index, r) for r in recordings]
        size = {g: np.sqrt(np.mean(np.concatenate([part[g] for part in parts]) ** 2)) for g in term.groups}
        if any(value > least[g] for g, value in size.items()):
            kept.append(term)
    return kept
