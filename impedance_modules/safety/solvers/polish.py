# SPDX-License-Identifier: BSD-3-Clause
"""Turns a nearly optimal answer into the optimum, by guessing which constraints act and checking.

A residual tolerance bounds how far a row is broken, not how far the torque is off; near a row that
is barely active the torque can be wrong by 1 N.m at 1e-6. Once the acting set is known the optimum
is one linear solve, and the optimality conditions prove it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.safety.problem import Vector
from impedance_modules.safety.solvers.acting import acting_optimum
from impedance_modules.safety.solvers.normal_form import NormalForm

_ROUNDS = 30
_TOLERANCE = 1e-11

Sides = NDArray[np.int8]


@dataclass(frozen=True)
class Polished:
    """An optimum in metric coordinates: y (n,), multipliers (N,), rounds it took."""

    y: Vector
    multipliers: Vector
    rounds: int


def polish(form: NormalForm, guess: Vector) -> Polished | None:
    """Exact optimum, from the signs of approximate multipliers.

    The optimum of the acting constraints is exact; those with the wrong sign leave, broken ones join,
    until nothing changes: then all optimality conditions hold.

    Args:
        form: The problem in metric coordinates.
        guess: (N,) approximate multipliers, positive at upper bounds.

    Returns:
        The optimum, to about 1e-11 in the conditions, or None if 30 rounds did not find it.
    """
    noise = 1e-9 * max(1.0, float(np.abs(guess).max()))
    sides: Sides = (guess > noise).astype(np.int8) - (guess < -noise).astype(np.int8)
    for rounds in range(1, _ROUNDS + 1):
        acting = np.flatnonzero(sides)
        bound = np.where(sides[acting] > 0, form.upper[acting], form.lower[acting])
        y, multipliers = acting_optimum(form, acting, bound)
        following = _sides(form, sides, y, multipliers)
        if np.array_equal(following, sides):
            return Polished(y, multipliers, rounds)
        sides = following
    return None


def _sides(form: NormalForm, sides: Sides, y: Vector, multipliers: Vector) -> Sides:
    value = form.rows @ y
    slip = _TOLERANCE * max(1.0, float(np.abs(y).max()))
    keep = sides * multipliers >= -_TOLERANCE * max(1.0, float(np.abs(multipliers).max()))
    above, below = value > form.upper + slip, value < form.lower - slip
    joins = above.astype(np.int8) - below.astype(np.int8)
    following: Sides = np.where((sides != 0) & keep, sides, joins)
    return following
