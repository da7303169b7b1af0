# SPDX-License-Identifier: BSD-3-Clause
r"""A held object whose mass or centre of mass is not what the task says.

    \tau = Y(q, v, a) (\pi(m, c) - \pi(m_0, 0))        while hands hold it rigidly

Y are the columns of the hand's link, \pi the object's ten inertial parameters about the hand's origin, in its axes. A
task's object is homogeneous: its centre of mass is its origin. One that several hands hold is written as if the first
of them carried all of it; what the others take off differs by forces that squeeze it, which nobody knows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.effect_description import Description, Parameter
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.regressor import Regressor, Site, all_rows
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.spec.task import ObjectSpec

OBJECT_KEY = "object"
"""How a patch names the task's object: a task has one."""

CENTRE = ("cx", "cy", "cz")

FARTHEST = 1.0
"""Distance from an object's origin beyond which no centre of mass is believed, along each axis [m]."""


class ObjectInertia(Effect):
    """A held object that is heavier or lighter than the task says, or whose centre of mass is elsewhere."""

    description = Description(
        id="object_inertia",
        sentence="The object in the hands has another mass, or its centre of mass elsewhere, than the task says.",
        equation="tau = Y(q, v, a) (pi(m, c) - pi(m_task, 0)) on the hand's link, while the object is held",
        parameters=(
            Parameter(
                "m",
                "kg",
                "its mass, instead of the task's",
                lower=0.0,
                positive=True,
                left_out="as the task says",
            ),
            *(
                Parameter(
                    symbol,
                    "m",
                    f"its centre of mass from its origin, along its own {symbol[1]} axis",
                    lower=-FARTHEST,
                    upper=FARTHEST,
                    left_out="at its origin",
                )
                for symbol in CENTRE
            ),
        ),
        ports=("link",),
        places={"link": "surroundings"},
        keys=("object",),
        signature="weight and inertia on all joints before the hand, only while the object is held",
        confusable_with=("payload", "link_inertia", "torque_gain"),
        excitation="hands that turn the object and move it, and the same arm without it",
        reference="Atkeson, An & Hollerbach 1986: estimation of a load's inertial parameters",
        applied="The plant's object, its inertia about its centre in proportion to its mass. The controller and the"
        " predictions of `check` know the task's.",
    )
    shape = CENTRE
    replaces = True
    of_accelerations = True
    searched = "while_held"
    not_exported = "it names the object of a task file, and nothing says which body of yours that is"
    not_compensated = (
        "the task says what the hands carry (valid: the object's 'mass' there, with 'carry_weight')"
    )

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Columns of m and h = m c while it is held, less what the task's object costs."""
        carried = site.signals.carried
        if carried is None:
            return None
        held = carried.rows[:, None, None]
        whole = held * site.signals.body_columns(carried.hand)
        columns = whole @ carried.columns(np.array([float(shape[name]) for name in CENTRE]))
        return all_rows(columns, -(whole @ carried.nominal()), (0.0, -np.inf, -np.inf, -np.inf))

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Starts at the object's origin."""
        return (dict.fromkeys(CENTRE, 0.0),)

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """M and m c; a mass that is left out is the task's."""
        carried = site.signals.carried
        mass = values.get("m", 0.0 if carried is None else carried.spec.mass)
        centre = np.array([values.get(name, 0.0) for name in CENTRE])
        return mass * np.array([1.0, *centre]), dict(zip(CENTRE, map(float, centre), strict=True))

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """C = (m c) / m; without mass there is no place."""
        m = float(coefficients[0])
        centre = coefficients[1:] / m if m > 0.0 else np.zeros(3)
        return {"m": m, **dict(zip(CENTRE, map(float, centre), strict=True))}

    def apply_to_object(self, held: ObjectSpec, values: Values) -> ObjectSpec:
        """Returns the object as it really is."""
        x, y, z = (float(values.get(name, 0.0)) for name in CENTRE)
        return replace(held, mass=float(values.get("m", held.mass)), centre=(x, y, z))
