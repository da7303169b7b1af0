# SPDX-License-Identifier: BSD-3-Clause
"""Friction that follows from the present speed alone: dry, viscous, Stribeck's, quadratic."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.effect import JointLaw, Values
from impedance_modules.effects.joint_motion import SMOOTHING, Sample, Shape, smoothing
from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]

BOTH_SIDES: tuple[Port, ...] = ("actuator", "link")
WORN = "The plant, as a torque at the motor (port actuator) or at the link; the controller does not know it."
COULOMB = Parameter("fc", "N.m", "Coulomb friction", lower=0.0, linear_unit="N")
VISCOUS = Parameter("fv", "N.m.s/rad", "viscous friction", lower=0.0, linear_unit="N.s/m")


TURNED_OVER = 2.0 * SMOOTHING
"""Speed at which dry friction has turned over, nearly [rad/s]."""


class CoulombFriction(JointLaw):
    """fc sgn(v)."""

    description = Description(
        id="coulomb_friction",
        sentence="Dry surfaces rub: a torque of constant size against the motion, whatever the speed.",
        equation="tau = fc sgn(v), with sgn(v) ~ tanh(v / 0.01 rad/s); 0.001 m/s where it slides",
        parameters=(COULOMB,),
        ports=BOTH_SIDES,
        keys=("joint",),
        signature="a square wave in the sign of the speed, flat in its size",
        confusable_with=("viscous_friction", "asymmetric_friction", "hysteresis", "command_delay"),
        excitation="reversals at three or more speeds",
        reference="Armstrong-Helouvry, Dupont & Canudas de Wit 1994",
        worn=WORN,
    )

    dry = True

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes sgn(v)."""
        return sample.direction[..., None]


class ViscousFriction(JointLaw):
    """fv v."""

    description = Description(
        id="viscous_friction",
        sentence="A film of grease is sheared: a torque against the motion in proportion to the speed.",
        equation="tau = fv v",
        parameters=(VISCOUS,),
        ports=BOTH_SIDES,
        keys=("joint",),
        signature="linear in the speed",
        confusable_with=(
            "coulomb_friction",
            "quadratic_drag",
            "friction_drift",
            "controller_gain",
            "command_delay",
        ),
        excitation="three or more constant speeds",
        reference="Swevers et al. 1997",
        worn=WORN,
    )

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes v."""
        return sample.velocity[..., None]


class StribeckFriction(JointLaw):
    """Dry friction that falls from fs at rest to fc in motion."""

    description = Description(
        id="stribeck_friction",
        sentence="Dry friction that is higher at rest than in motion: it falls as a film of grease builds up.",
        equation="tau = (fc + (fs - fc) exp(-(v / vs)^2)) sgn(v); fs >= fc; it holds the whole dry friction",
        parameters=(
            COULOMB,
            Parameter("fs", "N.m", "friction at the onset of motion", lower=0.0, linear_unit="N"),
            Parameter(
                "vs", "rad/s", "speed over which it falls", lower=0.0, positive=True, linear_unit="m/s"
            ),
        ),
        ports=BOTH_SIDES,
        keys=("joint",),
        signature="a bump below three times vs on top of the square wave of Coulomb friction",
        confusable_with=("coulomb_friction", "backlash", "hysteresis"),
        excitation="slow ramps, 0.005 to 0.2 rad/s",
        reference="Bo & Pavelescu 1982; Armstrong-Helouvry 1994",
        worn=WORN,
    )
    shape = ("vs",)

    dry = True
    essence = ((0.0, 1.0),)

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes sgn(v), and the bump alone: neither coefficient is negative, so fs is not below fc."""
        slow = np.exp(-((sample.velocity / shape["vs"]) ** 2))
        return np.asarray(sample.direction[..., None] * np.stack([np.ones_like(slow), slow], axis=-1))

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients fc and fs - fc."""
        return np.array([values["fc"], values["fs"] - values["fc"]]), {"vs": values["vs"]}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """The inverse of ``linear``."""
        fc, bump = map(float, coefficients)
        return {"fc": fc, "fs": fc + bump, "vs": float(shape["vs"])}

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """Tries speeds from just above the sign's smoothing to a third of the largest one."""
        joint = signals.joint(key)
        fastest = float(np.abs(signals.velocity[:, joint]).max())
        least = float(smoothing(signals.model.sliding)[joint])
        speeds = np.geomspace(least, max(fastest / 3.0, 2.0 * least), 5)
        return self.ways(signals, key, tuple({"vs": float(speed)} for speed in speeds))

    def unresolved(self, shape: Shape, resolution: float) -> str | None:
        """A fall as fast as dry friction itself turns over cannot be told from how it turns over."""
        if float(shape["vs"]) >= TURNED_OVER:
            return None
        return "falls as fast as dry friction turns over: dry friction as far as it can be seen"

    def relations(self, values: Values) -> list[str]:
        """Friction at rest is not below that in motion."""
        if values["fs"] < values["fc"]:
            return [
                f"fs {values['fs']:g} is below fc {values['fc']:g}: friction cannot grow as motion begins"
            ]
        return []


class QuadraticDrag(JointLaw):
    """c v |v|."""

    description = Description(
        id="quadratic_drag",
        sentence="A body pushes a fluid aside: a torque against the motion that grows with the square of the speed.",
        equation="tau = c v |v|",
        parameters=(Parameter("c", "N.m.s^2/rad^2", "drag", lower=0.0, linear_unit="N.s^2/m^2"),),
        ports=BOTH_SIDES,
        keys=("joint",),
        signature="curvature at high speed",
        confusable_with=("viscous_friction",),
        excitation="a ladder of speeds up to 80 % of the limit",
        reference="Morison et al. 1950; thesis 6.2.5",
        worn=WORN,
    )

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes v |v|."""
        return np.asarray(sample.velocity * np.abs(sample.velocity))[..., None]
