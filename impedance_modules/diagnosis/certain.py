# SPDX-License-Identifier: BSD-3-Clause
r"""Whether a cause's own number is there for certain: it lies more than its error from what would be no effect.

    |p - p_0| > 1.5 \sigma_p

A law that filters the command fits its noise too, and gains by that what its number does not say.
"""

from __future__ import annotations

from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.regression.parameter_estimates import ShapeRefiner, estimates

SIGMA = 1.5
"""Standard deviations, inflated as those in the answer are."""

NEUTRAL = {"torque_gain": 1.0}
"""Number of an effect that changes nothing, where it is not zero."""


def certain(bench: ModelFit, refiner: ShapeRefiner) -> list[ModelTerm]:
    """Terms of a fitted model whose number is there for certain; those of several numbers are not judged here."""
    return [term for index, term in enumerate(bench.model) if _certain(bench, refiner, index, term)]


def _certain(bench: ModelFit, refiner: ShapeRefiner, index: int, term: ModelTerm) -> bool:
    effect = term.candidate.effect
    if len(effect.description.parameters) != 1 or effect.replaces:
        return True
    (found,) = estimates(bench, refiner, index, prismatic=False).values()
    return abs(found.value - NEUTRAL.get(effect.id, 0.0)) > SIGMA * found.std
