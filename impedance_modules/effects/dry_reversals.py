# SPDX-License-Identifier: BSD-3-Clause
r"""How the sign of dry friction changes where a joint reverses: shapes that the diagnosis tries beside a dry law.

    sgn(v) ~ \tanh\frac{v}{m v_0}     m a multiple of the usual regularisation velocity v_0

or Dahl's bristles, which bend over a presliding displacement before they slip. Neither is part of a law: what slips at
once looks like Stribeck friction beside a softer sign, and what bends first like a spring.
"""

from __future__ import annotations

from dataclasses import replace

from impedance_modules.effects.joint_motion import (
    REGULARISATION_VELOCITY,
    JointSample,
    Shape,
    regularisation_velocity,
)
from impedance_modules.effects.regressor import Site

PRESLIDING = "presliding"
"""Shape: presliding displacement [rad], over which dry friction changes its sign; zero where a speed decides."""

PRESLIDING_DISPLACEMENTS = (0.03, 0.1, 0.2)
"""Displacements tried, in multiples of the distance that a joint moves in a second at the regularisation velocity."""

PRESLIDING_EXPONENT = "presliding_exponent"
"""Shape: exponent of Dahl's law there, how slowly surfaces come to slip."""

PRESLIDING_EXPONENTS = (1.0, 2.0)
"""Those that are tried."""

REGULARISATION = "regularisation"
"""Shape: multiple m of the usual regularisation velocity of dry friction; missing where it is the usual one."""

OTHER_REGULARISATIONS = (0.1, 0.3, 3.0, 7.0)
"""Multiples tried: bearings and simulators' ideal friction turn at once, wet surfaces creep before they slide, and so
do the constraints of simulators."""

SHARP = 0.3
"""The one of them that laws of several numbers try: a softer sign than the true one changes their small numbers."""

OF_REVERSALS = (PRESLIDING, PRESLIDING_EXPONENT, REGULARISATION)
"""Symbols of a shape that belong to the reversals."""

REFINED = (PRESLIDING, REGULARISATION)
"""Symbols that the regression moves off their grid."""


def with_reversal_shapes(
    shapes: tuple[dict[str, float], ...], site: Site, *, one_number: bool
) -> tuple[dict[str, float], ...]:
    """Adds to the shapes of a dry law presliding displacements and other speeds.

    Args:
        shapes: The law's own.
        site: A joint of a recording.
        one_number: The law has one number only: beside more of them a slow turn is hardly told from the law.
    """
    second = float(regularisation_velocity(site.signals.model.sliding)[site.joint])
    others = OTHER_REGULARISATIONS if one_number else (SHARP,)
    return (
        *shapes,
        *(
            {**shape, PRESLIDING: part * second, PRESLIDING_EXPONENT: exponent}
            for exponent in PRESLIDING_EXPONENTS
            for part in PRESLIDING_DISPLACEMENTS
            for shape in shapes
        ),
        *({**shape, REGULARISATION: multiple} for multiple in others for shape in shapes),
    )


def of_reversals(shape: Shape) -> dict[str, float]:
    """The part of a dry law's shape that says how its sign changes."""
    return {symbol: float(value) for symbol, value in shape.items() if symbol in OF_REVERSALS}


def without_reversals(shape: Shape) -> dict[str, float]:
    """The other part: the law's own nonlinear numbers."""
    return {symbol: float(value) for symbol, value in shape.items() if symbol not in OF_REVERSALS}


def as_it_reverses(sample: JointSample, site: Site, shape: Shape) -> JointSample:
    """The joint's motion with the sign of dry friction as a shape has it."""
    presliding, multiple = float(shape.get(PRESLIDING, 0.0)), float(shape.get(REGULARISATION, 1.0))
    if presliding > 0.0:
        sample = replace(sample, bristles=site.bristles(presliding, float(shape[PRESLIDING_EXPONENT])))
    if multiple != 1.0:
        sample = replace(sample, regularisation=multiple * sample.regularisation)
    return sample


def nearest_reversal(symbol: str, value: float) -> float:
    """The number within what is tried that is nearest to one asked for."""
    if symbol == PRESLIDING:
        return min(value, PRESLIDING_DISPLACEMENTS[-1] * REGULARISATION_VELOCITY)
    return min(max(value, OTHER_REGULARISATIONS[0]), OTHER_REGULARISATIONS[-1])
