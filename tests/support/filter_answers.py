# SPDX-License-Identifier: BSD-3-Clause
"""What tests of the filter's solvers ask of an answer, and problems that mean the same in other units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from impedance_modules.safety.filter_problem import FilterProblem
from tests.reference.exact_filter import FLAT, OPTIMUM, Exact
from tests.reference.optimality import residual
from tests.support import filter_problems as fp
from tests.support.degenerate_problems import small

SHARP = 1e-9
"""Most that an answer is away from the exact one, as a part of the torque that the joint gives or may give."""


FIELDS = ("metric", "matrix", "desired", "effort_max", "penalty", "kappa", "lower", "upper")


def scale_of(problem: FilterProblem, exact: np.ndarray) -> np.ndarray:
    """Of each joint [N.m]."""
    return np.maximum(np.abs(exact), np.minimum(problem.effort_max, np.abs(problem.desired))) + 1e-30


def check(problem: FilterProblem, answer: tuple[np.ndarray, np.ndarray], truth: Exact) -> None:
    """An answer is the optimum; where the metric cannot choose, it meets the optimality conditions."""
    effort, duals = answer
    assert (np.abs(effort) <= problem.effort_max).all()
    assert residual(problem, effort, duals) < 1e-7
    if truth.outcome == OPTIMUM:
        exact = np.asarray(truth.effort, dtype=float)
        assert (np.abs(effort - exact) <= SHARP * scale_of(problem, exact)).all()
    else:
        assert truth.outcome == FLAT


def in_other_units(
    problem: FilterProblem, torque: float, joints: np.ndarray, rows: np.ndarray
) -> FilterProblem:
    """The same problem: all torques ``torque`` times as large, each joint and each row in units of its own."""
    unit = torque * joints
    return fp.changed(
        problem,
        desired=problem.desired * unit,
        effort_max=problem.effort_max * unit,
        metric=problem.metric / joints / joints[:, None],
        matrix=problem.matrix / joints * rows[:, None],
        lower=problem.lower * torque * rows,
        upper=problem.upper * torque * rows,
        penalty=problem.penalty / rows**2,
    )


def calm() -> FilterProblem:
    """A problem whose desired torque breaks nothing."""
    problem = fp.blank()
    problem.desired[:], problem.effort_max[:] = 1.0, 10.0
    return problem


def spoilt(field: str) -> Iterator[FilterProblem]:
    """Problems with one NaN in a field, wherever it stands: used or not, even where nothing has to be solved."""
    random = np.random.default_rng(8)
    for problem in (small(random, 3), fp.problem(random, 0.8, 0.2), calm()):
        size = getattr(problem, field).size
        for place in random.choice(size, min(size, 12), replace=False):
            values = getattr(problem, field).copy()
            values.flat[place] = np.nan
            yield fp.changed(problem, **{field: values})
