# SPDX-License-Identifier: BSD-3-Clause
"""Friction that depends on more than the speed: on direction, on load, on how long the joint has run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.effect import JointLaw, Values
from impedance_modules.effects.joint_friction import BOTH_SIDES, COULOMB, VISCOUS, WORN
from impedance_modules.effects.joint_motion import Sample, Shape
from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]


WARMING_MIN = 2.0
"""Shortest time constant with which grease is taken to warm up [s]."""


class AsymmetricFriction(JointLaw):
    """Friction that differs between the two directions."""

    description = Description(
        id="asymmetric_friction",
        sentence="Friction that differs between the two directions: half the difference acts like an offset in motion.",
        equation="tau = fc sgn(v) + da |sgn(v)| + dv |v|; |da| <= fc; |dv| <= viscous friction of the joint",
        parameters=(
            COULOMB,
            Parameter("da", "N.m", "half the difference of dry friction, + minus -", linear_unit="N"),
            Parameter(
                "dv",
                "N.m.s/rad",
                "half the difference of viscous friction, + minus -",
                left_out="the viscous part is the same in both directions",
                linear_unit="N.s/m",
            ),
        ),
        ports=BOTH_SIDES,
        keys=("joint",),
        signature="an offset that is there only while moving, or a V in the speed",
        confusable_with=("torque_offset", "coulomb_friction"),
        excitation="moves and holds, both directions at several speeds",
        reference="Janot, Gautier & Brunot 2019 (EMPS)",
        worn=WORN,
    )

    dry = True
    essence = ((1.0, -1.0, 0.0), (0.0, 0.0, 1.0))

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes sgn(v) where v > 0, sgn(v) where v < 0, and |v|."""
        s = sample.direction
        return np.stack([np.maximum(s, 0.0), np.minimum(s, 0.0), np.abs(sample.velocity)], axis=-1)

    def bounds(self) -> tuple[Array, Array]:
        """Dry friction takes energy in both directions; dv has a sign."""
        return np.array([0.0, 0.0, -np.inf]), np.full(3, np.inf)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients fc + da, fc - da, dv."""
        fc, da = values["fc"], values["da"]
        return np.array([fc + da, fc - da, values.get("dv", 0.0)]), {}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """The inverse of ``linear``."""
        ahead, back, dv = map(float, coefficients)
        return {"fc": 0.5 * (ahead + back), "da": 0.5 * (ahead - back), "dv": dv}

    def relations(self, values: Values) -> list[str]:
        """Dry friction takes energy in both directions."""
        if abs(values["da"]) > values["fc"]:
            return [
                f"|da| {abs(values['da']):g} is above fc {values['fc']:g}: friction would push in one direction"
            ]
        return []


class LoadDependentFriction(JointLaw):
    """kl |load| sgn(v)."""

    description = Description(
        id="load_dependent_friction",
        sentence="Teeth and bearings press harder under load: dry friction in proportion to the torque passed on.",
        equation="tau = kl |effort| sgn(v)",
        parameters=(Parameter("kl", "1", "friction per torque passed on", lower=0.0, upper=1.0),),
        ports=BOTH_SIDES,
        keys=("joint",),
        signature="the step at a reversal grows with the load",
        confusable_with=("coulomb_friction", "torque_gain"),
        excitation="the same motion in two or more poses or with two payloads",
        reference="Hamon, Gautier & Garrec 2010; Rhoban BAM 2025, models M3 to M6",
        worn=WORN,
    )

    dry = True

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes |load| sgn(v)."""
        return np.asarray(np.abs(sample.load) * sample.direction)[..., None]

    def bounds(self) -> tuple[Array, Array]:
        """From no friction to a gear that locks itself."""
        return np.zeros(1), np.ones(1)


class FrictionDrift(JointLaw):
    """fv (1 - k (1 - exp(-t / T))) v."""

    description = Description(
        id="friction_drift",
        sentence="The grease warms up: viscous friction fades over minutes towards a share of what it was.",
        equation="tau = fv (1 - k (1 - exp(-t / T))) v, t since the recording or the run began",
        parameters=(
            VISCOUS,
            Parameter("k", "1", "share of the friction that fades; negative where it grows", upper=1.0),
            Parameter("T", "s", "time constant of the fading", lower=0.0, positive=True),
        ),
        ports=BOTH_SIDES,
        keys=("joint",),
        signature="the same motion costs less torque later on",
        confusable_with=("viscous_friction",),
        excitation="the same motion cold and warm, over minutes",
        reference="Bittencourt et al. 2010",
        worn=WORN,
    )
    essence = ((1.0, -1.0),)
    shape = ("T",)

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes the part of v that is still cold and the part that is warm; neither has negative friction."""
        cold = np.exp(-sample.time / shape["T"])
        return np.stack([cold * sample.velocity, (1.0 - cold) * sample.velocity], axis=-1)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients fv (cold) and fv (1 - k) (warm)."""
        return np.array([values["fv"], values["fv"] * (1.0 - values["k"])]), {"T": values["T"]}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """The inverse of ``linear``; without friction there is nothing to fade, k = 0."""
        cold, warm = map(float, coefficients)
        return {"fv": cold, "k": 1.0 - warm / cold if cold > 0.0 else 0.0, "T": float(shape["T"])}

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """Tries time constants from a tenth to three times the recording's length: grease warms in no second."""
        least = max(WARMING_MIN, 0.1 * float(signals.time[-1] - signals.time[0]))
        most = max(3.0 * float(signals.time[-1] - signals.time[0]), 2.0 * least)
        return tuple({"T": float(T)} for T in np.geomspace(least, most, 6))
