# SPDX-License-Identifier: BSD-3-Clause
r"""How likely a named effect is present at its joints, in words that were calibrated on cases with known truth.

Weight says how much of the gap a cause explains; it does not say whether the cause is true. A logistic law of a few
numbers that the diagnosis has already computed does:

    p = \sigma(\beta_0 + \sum_i \beta_i x_i) / (1 + s k),        \sigma(z) = 1 / (1 + e^{-z})

The first factor is the probability that the true effect is the named one or one of its k equivalents. The second
shares it among them: s is how likely an equivalent is relative to the named one, so a cause with k equivalents is
never more likely than 1 / (1 + s k), whatever else speaks for it. The features x are functions of `Grounds`:

    gain, lead       log10(1 + nats) of its standing on unseen recordings
    weight           log10 of its part of the explained gap
    deviations       log10 of the standard deviations by which its numbers differ from no effect
    lack_of_fit      log10 of the residual power that the causes leave over what would pass, 0 where it passes
    unexplained      1 where the remainder does not pass
    motion           1, 0, -1: better, no different, worse simulated motion
    no_repeats       1 where no repeated motion measured the noise
    others           log2 of one plus the other causes

The first four and ``motion`` can only speak for a cause, the others only against it: the fit keeps their signs, so
that the law is monotone in each of them. It is fitted to the answers of the wide benchmark, and holds where effects
are as frequent as they are there (docs/wide-benchmark.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.naming import SHARE_THAT_MATTERS
from impedance_modules.diagnosis.result import Cause, Diagnosis, Estimate, Grounds
from impedance_modules.effects.catalogue import CATALOGUE

FEATURES: Mapping[str, int] = {
    "gain": 1,
    "lead": 1,
    "weight": 1,
    "deviations": 1,
    "lack_of_fit": -1,
    "unexplained": -1,
    "motion": 1,
    "no_repeats": -1,
    "others": -1,
}
"""Feature -> sign of its coefficient."""

LIMITS = {"weight": (1e-5, 1.0), "deviations": (1.0, 1e3), "lack_of_fit": (1.0, 1e3)}
"""Ranges outside which a number says no more: logarithms are taken within them."""

UNLIKELY = 0.1
"""Probability below which a cause of little weight is not named beside others."""


@dataclass(frozen=True)
class ProbabilityLaw:
    r"""The numbers of the law.

    Attributes:
        base: \beta_0, log-odds where all features are zero.
        coefficients: Feature -> \beta_i, log-odds per unit; one that is missing counts as zero.
        alternative: s, in [0, 1].
    """

    base: float
    coefficients: Mapping[str, float]
    alternative: float

    def __call__(self, grounds: Grounds) -> float:
        """Probability that the cause is true, strictly between 0 and 1."""
        x = dict(zip(FEATURES, features(grounds), strict=True))
        odds = self.base + sum(beta * x[name] for name, beta in self.coefficients.items())
        return logistic(odds) / (1.0 + self.alternative * grounds.alternatives)


LAW = ProbabilityLaw(
    base=-2.849,
    coefficients={
        "gain": 1.644,
        "weight": 0.676,
        "deviations": 0.685,
        "lack_of_fit": -1.333,
        "unexplained": -2.393,
        "motion": 0.979,
        "no_repeats": -0.501,
    },
    alternative=0.325,
)
"""Fitted, and printed, by `python -m benchmarks.wide calibrate OUT`; docs/wide-benchmark.md says to how many causes."""


def logistic(odds: float) -> float:
    """Probability of log-odds; within 1e-13 of certainty it stays short of it."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -30.0), 30.0)))


def features(grounds: Grounds) -> Array:
    """(features,) x, in the order of `FEATURES`."""
    return np.array(
        [
            math.log10(1.0 + max(grounds.gain, 0.0)),
            math.log10(1.0 + max(grounds.lead, 0.0)),
            _log10(grounds.weight, "weight"),
            _log10(grounds.deviations, "deviations"),
            _log10(grounds.lack_of_fit, "lack_of_fit"),
            float(not grounds.explained),
            float(grounds.motion),
            float(not grounds.repeats),
            math.log2(1.0 + grounds.others),
        ]
    )


def with_probabilities(found: Diagnosis, *, repeats: bool, law: ProbabilityLaw = LAW) -> Diagnosis:
    """Gives every cause, and every small one, its probability and what it follows from.

    Args:
        found: The whole result, rollouts included.
        repeats: Whether repeated motions measured the noise.
        law: The law.

    Raises:
        ValueError: There are causes and no remainder was judged.
    """
    causes, small = (
        tuple(_judged(cause, found, len(part) - 1, repeats, law) for cause in part)
        for part in (found.causes, found.small)
    )
    return replace(found, causes=causes, small=small)


def unlikely_beside_others(found: Diagnosis, *, repeats: bool) -> tuple[Cause, ...]:
    """Causes of little weight beside the others that are hardly true, with their probabilities.

    A fit always finds something more to explain: most of what explains next to nothing is an error of the model. Where
    something remains that nothing explains, every cause is doubtful, and none is left out for it.
    """
    if not found.remainder.explained:
        return ()
    explained = sum(cause.weight for cause in found.causes)
    return tuple(
        cause
        for cause in with_probabilities(found, repeats=repeats).causes
        if cause.weight < SHARE_THAT_MATTERS * explained and (cause.probability or 0.0) < UNLIKELY
    )


def grounds_of(cause: Cause, found: Diagnosis, others: int, *, repeats: bool) -> Grounds:
    """Collects what is known of a cause.

    Args:
        cause: The cause.
        found: The result that it is part of.
        others: Number of causes beside it.
        repeats: Whether repeated motions measured the noise.

    Raises:
        ValueError: No remainder was judged.
    """
    left = found.remainder
    if left.limit is None:
        raise ValueError(
            f"{cause.effect}: a cause beside a remainder that nobody judged (valid: a remainder with its limit)"
        )
    motion = {"helps": 1, "no difference": 0, "worsens": -1}
    return Grounds(
        gain=max(cause.standing.gain, 0.0),
        lead=max(cause.standing.lead, 0.0),
        weight=cause.weight,
        deviations=deviations(cause),
        lack_of_fit=left.lack_of_fit / left.limit,
        explained=left.explained,
        motion=0 if cause.rollout is None else motion[cause.rollout.verdict],
        repeats=repeats,
        alternatives=len(cause.equivalent),
        others=others,
    )


def deviations(cause: Cause) -> float:
    """Standard deviations by which the surest number differs from no effect; of several carriers, where least.

    Of a push those of its whole force, sqrt(2 gain).
    """
    effect = CATALOGUE[cause.effect]
    if effect.bound_to_recording:
        # The joints may feel a push along none of its axes alone: its force counts as one.
        return min(math.sqrt(2.0 * max(cause.standing.gain, 0.0)), LIMITS["deviations"][1])
    neutral = {parameter.symbol: parameter.neutral for parameter in effect.description.parameters}
    each = [
        [_apart(e, neutral[symbol]) for symbol, e in symbols.items() if symbol in neutral]
        for symbols in cause.parameters.values()
    ]
    return min((max(numbers, default=0.0) for numbers in each), default=0.0)


def _apart(number: Estimate, neutral: float) -> float:
    """Standard deviations from the neutral value; at most as many as count, none where nothing bounds the number."""
    off, most = abs(number.value - neutral), LIMITS["deviations"][1]
    return min(off / max(number.std, off / most), most) if off > 0.0 and number.std < math.inf else 0.0


def _judged(cause: Cause, found: Diagnosis, others: int, repeats: bool, law: ProbabilityLaw) -> Cause:
    grounds = grounds_of(cause, found, others, repeats=repeats)
    return replace(cause, probability=law(grounds), grounds=grounds)


def _log10(value: float, name: str) -> float:
    low, high = LIMITS[name]
    return math.log10(min(max(value, low), high))
