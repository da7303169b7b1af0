# SPDX-License-Identifier: BSD-3-Clause
r"""Fits the law of a cause's probability to answers whose truth is known, and judges it on varieties it has not seen.

The penalised likelihood of all named causes, small ones included, is maximised,

    \sum_j [y_j \log p_j + (1 - y_j) \log(1 - p_j)] - \sum_i (\beta_i d_i)^2 / (2 c^2) - b^2 / 18 - \log(s)^2 / 2,

y_j whether cause j is true, d_i the spread of feature i, b the log-odds where all features are average, and each
coefficient on its side of zero. The prior lets a feature change the odds by a factor of e^c = 2.7 over one spread of
it, so that few causes suffice; that of s is centred on one: what recordings cannot tell apart is equally likely.

For the figures each value of a dimension is left out in turn: no law was fitted to cases of the robot, the engine,
the controller, the stamps or the noise that it is judged on. A cause thus has one prediction per dimension; the
tables have the mean of their log-odds.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.blind.answers import is_cause
from benchmarks.blind.figures import Rate
from benchmarks.wide.blocks import SEALS, check_seals
from benchmarks.wide.reliability import brier_score, draw, table_of
from benchmarks.wide.run import SEALED
from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection import probability
from impedance_modules.diagnosis.model_selection.probability import FEATURES, ProbabilityLaw, features
from impedance_modules.diagnosis.result import Grounds

VARIETIES = ("robot", "engine", "controller", "stamps", "noise")
"""Dimensions of which each value is left out in turn."""

PRIOR = 1.0
"""c, standard deviation of a coefficient's prior, per spread of its feature [log-odds]."""

SPREAD_MIN = 0.3
"""Least spread of a feature: one that differs in few causes must not change the odds of others without limit."""

ALTERNATIVE_MIN = 0.02
"""Smallest s: an equivalent is never impossible."""

BASE_PRIOR = 3.0
"""Standard deviation of the log-odds of an average cause: 5 to 95 %."""

SOURCE = Path(probability.__file__)
LAW = re.compile(r"^LAW = ProbabilityLaw\(\n.*?^\)\n", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class NamedCause:
    """One cause of one answer.

    Attributes:
        case: Name.
        block: Letter.
        values: Dimension -> value, of its case.
        effect: Id.
        grounds: What is known of it.
        true: Whether it is a planted effect, at its joints.
        small: Whether the answer calls it too small to matter.
        first: Whether the answer ranks it first.
    """

    case: str
    block: str
    values: Mapping[str, str]
    effect: str
    grounds: Grounds
    true: bool
    small: bool
    first: bool


def named_causes(out: Path, answers: Path) -> list[NamedCause]:
    """Reads the causes of all answers to development cases.

    Raises:
        ValueError: A sealed file has changed, an answer was written by a version without ``grounds``, or there are no
            cases or no answers.
    """
    if not (out / SEALS).is_file():
        raise ValueError(f"{out}: no cases (valid: OUT of `generate`, with {SEALS})")
    check_seals(out)
    if not any(answers.glob("*.json")):
        raise ValueError(f"{answers}: no answers to the cases in {out} (valid: where `run` wrote them)")
    found: list[NamedCause] = []
    for sealed in sorted((out / SEALED).glob("*.json")):
        for name, truth in sorted(json.loads(sealed.read_text())["cases"].items()):
            path = answers / f"{name}.json"
            if truth["frozen"] is None and path.exists():
                found += _of_answer(path, truth)
    return found


def _of_answer(path: Path, truth: Mapping[str, Any]) -> list[NamedCause]:
    answer, found = json.loads(path.read_text()), []
    for part in ("causes", "small"):
        causes = answer.get(part, [])
        for at, cause in enumerate(causes):
            if "grounds" not in cause:
                raise ValueError(f"{path}: a cause without 'grounds' (valid: answers of `run --again`)")
            true = any(is_cause(causes, at, effect) for effect in truth["effects"])
            grounds = Grounds(**cause["grounds"])
            found.append(
                NamedCause(
                    path.stem, truth["block"], truth["values"], cause["effect"], grounds, true, part == "small", at == 0
                )
            )  # fmt: skip
    return found


def fit(causes: Sequence[NamedCause]) -> ProbabilityLaw:
    """Maximises the penalised likelihood.

    Raises:
        ValueError: There is no cause.
    """
    if not causes:
        raise ValueError("no cause was named in any answer (valid: OUT with answers of `run`)")
    y = np.array([cause.true for cause in causes], dtype=float)
    X = np.array([features(cause.grounds) for cause in causes])
    k = np.array([cause.grounds.alternatives for cause in causes], dtype=float)
    spread = np.maximum(X.std(axis=0), SPREAD_MIN)
    signs = np.array(list(FEATURES.values()))
    bounds = [
        (None, None),
        *((0.0, None) if sign > 0 else (None, 0.0) for sign in signs),
        (ALTERNATIVE_MIN, 1.0),
    ]
    start = np.array([0.0, *(0.1 * signs), 0.5])

    def loss(numbers: Array) -> tuple[float, Array]:
        return _loss(numbers, (X - X.mean(axis=0)) / spread, k, y)

    best = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds).x
    beta = best[1:-1] / spread
    return ProbabilityLaw(
        base=float(best[0] - beta @ X.mean(axis=0)),
        coefficients={name: float(b) for name, b in zip(FEATURES, beta, strict=True) if b != 0.0},
        alternative=float(best[-1]),
    )


def _loss(numbers: Array, Z: Array, k: Array, y: Array) -> tuple[float, Array]:
    """Negative penalised log-likelihood and its gradient, of base, coefficients per spread, and alternative."""
    base, beta, alternative = numbers[0], numbers[1:-1], numbers[-1]
    sigma = 1.0 / (1.0 + np.exp(-np.clip(base + Z @ beta, -30.0, 30.0)))
    shared = 1.0 + alternative * k
    p = np.clip(sigma / shared, 1e-13, 1.0 - 1e-13)
    slope = -(y / p - (1.0 - y) / (1.0 - p))  # d loss / d p
    by_odds = slope * sigma * (1.0 - sigma) / shared
    by_alternative = float(np.sum(slope * -p / shared * k)) + float(np.log(alternative) / alternative)
    value = -float(np.sum(y * np.log(p) + (1.0 - y) * np.log(1.0 - p)))
    value += (
        float(beta @ beta) / (2.0 * PRIOR**2)
        + base**2 / (2.0 * BASE_PRIOR**2)
        + 0.5 * float(np.log(alternative) ** 2)
    )
    by_base = float(by_odds.sum()) + base / BASE_PRIOR**2
    return value, np.array([by_base, *(Z.T @ by_odds + beta / PRIOR**2), by_alternative])


def held_out(causes: Sequence[NamedCause], dimension: str) -> Array:
    """(causes,) probabilities by laws that were fitted without any case of the same value of a dimension."""
    return _by_others(causes, dimension, fit)


def base_rate(causes: Sequence[NamedCause], dimension: str) -> Array:
    """(causes,) share of true causes among those of other values: what is known without looking at a cause."""

    def share(others: Sequence[NamedCause]) -> Callable[[Grounds], float]:
        rate = float(np.mean([one.true for one in others]))
        return lambda _: rate

    return _by_others(causes, dimension, share)


def _by_others(
    causes: Sequence[NamedCause],
    dimension: str,
    fitted: Callable[[Sequence[NamedCause]], Callable[[Grounds], float]],
) -> Array:
    said = np.empty(len(causes))
    values = np.array([cause.values[dimension] for cause in causes])
    for value in np.unique(values):
        own: NDArray[np.bool_] = values == value
        law = fitted([cause for cause, inside in zip(causes, own, strict=True) if not inside])
        said[own] = [law(cause.grounds) for cause, inside in zip(causes, own, strict=True) if inside]
    return said


def pooled(predictions: Mapping[str, Array]) -> Array:
    """(causes,) one held-out prediction of several: the mean of their log-odds."""
    odds = [np.log(p / (1.0 - p)) for p in predictions.values()]
    return np.asarray(1.0 / (1.0 + np.exp(-np.mean(odds, axis=0))))


def calibrate(folders: Mapping[Path, Path], *, write: bool = False, diagram: Path | None = None) -> str:
    """Fits the law to all causes, and returns it with the figures of its held-out predictions.

    Args:
        folders: Cases -> answers to them.
        write: Puts the law into the source of the diagnosis.
        diagram: Where the reliability diagram is drawn.

    Raises:
        ValueError: As `named_causes` and `fit`.
    """
    causes = [cause for out, answers in folders.items() for cause in named_causes(out, answers)]
    law = fit(causes)
    said = pooled({dimension: held_out(causes, dimension) for dimension in VARIETIES})
    if write:
        SOURCE.write_text(LAW.sub(lambda _: law_text(law), SOURCE.read_text()))
    if diagram is not None:
        draw(said, [cause.true for cause in causes], diagram)
    lines = [
        law_text(law),
        *_summary(causes, said),
        "",
        *table_of(said, [cause.true for cause in causes]),
        "",
    ]
    lines += [*_by_dimension(causes), "", *_by_part(causes, said)]
    return "\n".join(lines) + "\n"


def law_text(law: ProbabilityLaw) -> str:
    """Returns the law as it stands in the source."""
    betas = "".join(f'        "{name}": {beta:.3f},\n' for name, beta in law.coefficients.items())
    return (
        f"LAW = ProbabilityLaw(\n    base={law.base:.3f},\n    coefficients={{\n{betas}    }},\n"
        f"    alternative={law.alternative:.3f},\n)\n"
    )


def _summary(causes: Sequence[NamedCause], said: Array) -> list[str]:
    true = [cause.true for cause in causes]
    cases = len({cause.case for cause in causes})
    by_chance = pooled({dimension: base_rate(causes, dimension) for dimension in VARIETIES})
    return [
        f"{len(causes)} causes of {cases} cases, {sum(true)} of them true; predictions held out by"
        f" {', '.join(VARIETIES)}:",
        f"Brier score {brier_score(said, true):.3f}, of the base rate {brier_score(by_chance, true):.3f};"
        f" said with 90 % or more and true: {_sure(said, true)}",
    ]


def _sure(said: Array, true: Sequence[bool]) -> Rate:
    """How many of the causes said with 90 % or more are true."""
    return Rate.of([flag for p, flag in zip(said, true, strict=True) if p >= 0.9])


def _by_dimension(causes: Sequence[NamedCause]) -> list[str]:
    """Returns one row per left-out dimension."""
    rows = [
        "| left out | Brier score | of the base rate | said with 90 % or more and true |",
        "|---|---|---|---|",
    ]
    true = [cause.true for cause in causes]
    for dimension in VARIETIES:
        said = held_out(causes, dimension)
        scores = brier_score(said, true), brier_score(base_rate(causes, dimension), true)
        rows.append(f"| {dimension} | {scores[0]:.3f} | {scores[1]:.3f} | {_sure(said, true)} |")
    return rows


def _by_part(causes: Sequence[NamedCause], said: Array) -> list[str]:
    """Returns one row per kind of cause: how many are true, and what was said of them on average."""
    rows = ["| causes | true | said, on average |", "|---|---|---|"]
    kinds: dict[str, Callable[[NamedCause], bool]] = {
        "ranked first": lambda cause: cause.first and not cause.small,
        "ranked later": lambda cause: not cause.first and not cause.small,
        "too small to matter": lambda cause: cause.small,
        "with equivalents": lambda cause: cause.grounds.alternatives > 0,
        **{f"of block {letter}": lambda cause, letter=letter: cause.block == letter for letter in "ABCE"},
    }
    for name, chosen in kinds.items():
        inside = [i for i, cause in enumerate(causes) if chosen(cause)]
        mean = f"{100 * float(np.mean(said[inside])):.0f} %" if inside else ""
        rows.append(f"| {name} | {Rate.of([causes[i].true for i in inside])} | {mean} |")
    return rows
