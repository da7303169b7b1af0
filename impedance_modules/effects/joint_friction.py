# SPDX-License-Identifier: BSD-3-Clause
"""Friction that follows from the present speed alone: dry, viscous, Stribeck's, quadratic."""

from __future__ import annotations

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.effects.compensation_builder import (
    CompensationBuilder,
    Diagnosed,
    IdentifiedNumber,
    IdentifiedNumbers,
)
from impedance_modules.effects.effect import JointLaw, Values
from impedance_modules.effects.effect_description import Description, Parameter, joint_parameter
from impedance_modules.effects.joint_motion import (
    REGULARISATION_VELOCITY,
    JointSample,
    Shape,
    regularisation_velocity,
)
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.simulator_numbers import one_number
from impedance_modules.records import Matrix, Row, Vector

COULOMB = joint_parameter("fc", "N.m", "Coulomb friction", lower=0.0)

VISCOUS = joint_parameter("fv", "N.m.s/rad", "viscous friction", lower=0.0)

FULL_SLIDING = 2.0 * REGULARISATION_VELOCITY
"""Speed beyond which the regularised sign is nearly one [rad/s]."""

WARMING_MIN = 2.0
"""Shortest time constant with which grease is taken to warm up [s]."""


@compiled
def dry_friction(sample: Row, shape: Vector, columns: Matrix) -> None:  # noqa: ARG001 - every law has these
    """Writes sgn(v)."""
    columns[0] = sample.direction


@compiled
def viscous_friction(sample: Row, shape: Vector, columns: Matrix) -> None:  # noqa: ARG001
    """Writes v."""
    columns[0] = sample.velocity


@compiled
def stribeck_friction(sample: Row, shape: Vector, columns: Matrix) -> None:
    """Writes sgn(v), and the bump alone: neither coefficient is negative, so fs is not below fc."""
    direction = sample.direction
    columns[0] = direction
    columns[1] = direction * np.exp(-((sample.velocity / shape[0]) ** 2))


@compiled
def quadratic_drag(sample: Row, shape: Vector, columns: Matrix) -> None:  # noqa: ARG001
    """Writes v |v|."""
    columns[0] = sample.velocity * np.abs(sample.velocity)


@compiled
def asymmetric_friction(sample: Row, shape: Vector, columns: Matrix) -> None:  # noqa: ARG001
    """Writes sgn(v) where v > 0, sgn(v) where v < 0, and |v|."""
    direction = sample.direction
    columns[0] = np.maximum(direction, 0.0)
    columns[1] = np.minimum(direction, 0.0)
    columns[2] = np.abs(sample.velocity)


@compiled
def load_dependent_friction(sample: Row, shape: Vector, columns: Matrix) -> None:  # noqa: ARG001
    """Writes |load| sgn(v)."""
    columns[0] = np.abs(sample.load) * sample.direction


@compiled
def drifting_friction(sample: Row, shape: Vector, columns: Matrix) -> None:
    """Writes the part of v that is still cold and the part that is warm; neither has negative friction."""
    cold = np.exp(-sample.time / shape[0])
    columns[0] = cold * sample.velocity
    columns[1] = (1.0 - cold) * sample.velocity


class CoulombFriction(JointLaw):
    """fc sgn(v)."""

    description = Description(
        id="coulomb_friction",
        sentence="Dry surfaces rub: a torque of constant size against the motion, whatever the speed.",
        equation="tau = fc sgn(v), with sgn(v) ~ tanh(v / 0.01 rad/s); 0.001 m/s where it slides",
        parameters=(COULOMB,),
        signature="a square wave in the sign of the speed, flat in its size",
        confusable_with=("viscous_friction", "asymmetric_friction", "hysteresis", "command_delay"),
        excitation="reversals at three or more speeds",
        reference="Armstrong-Helouvry, Dupont & Canudas de Wit 1994",
    )
    in_every_drive = True
    first_excitation = 1
    exported = (one_number("dry friction", "F", "fc"),)
    compensation = "friction"
    compensated_at = ("actuator", "link")

    dry = True

    law = dry_friction


class ViscousFriction(JointLaw):
    """fv v."""

    description = Description(
        id="viscous_friction",
        sentence="A film of grease is sheared: a torque against the motion in proportion to the speed.",
        equation="tau = fv v",
        parameters=(VISCOUS,),
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
    )
    in_every_drive = True
    first_excitation = 2
    exported = (one_number("viscous friction", "D", "fv"),)
    compensation = "friction"
    compensated_at = ("actuator", "link")

    law = viscous_friction


class StribeckFriction(JointLaw):
    """Dry friction that falls from fs at rest to fc in motion."""

    description = Description(
        id="stribeck_friction",
        sentence="Dry friction that is higher at rest than in motion: it falls as a film of grease builds up.",
        equation="tau = (fc + (fs - fc) exp(-(v / vs)^2)) sgn(v); fs >= fc; it holds the whole dry friction",
        parameters=(
            COULOMB,
            joint_parameter("fs", "N.m", "friction at the onset of motion", lower=0.0),
            joint_parameter("vs", "rad/s", "speed over which it falls", lower=0.0, positive=True),
        ),
        signature="a bump below three times vs on top of the square wave of Coulomb friction",
        confusable_with=("coulomb_friction", "backlash", "hysteresis"),
        excitation="slow ramps, 0.005 to 0.2 rad/s",
        reference="Bo & Pavelescu 1982; Armstrong-Helouvry 1994",
    )
    not_exported = "dry friction that falls with the speed needs three numbers, and a joint there has one"
    compensation = "friction"
    compensated_at = ("actuator", "link")
    shape = ("vs",)

    dry = True
    contrasts = ((0.0, 1.0),)

    law = stribeck_friction
    terms = 2

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients fc and fs - fc."""
        return np.array([values["fc"], values["fs"] - values["fc"]]), {"vs": values["vs"]}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The inverse of ``linear``."""
        fc, bump = map(float, coefficients)
        return {"fc": fc, "fs": fc + bump, "vs": float(shape["vs"])}

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Tries speeds from just above the regularisation velocity to a third of the largest one."""
        fastest = float(np.abs(site.signals.velocity[:, site.joint]).max())
        least = float(regularisation_velocity(site.signals.model.sliding)[site.joint])
        speeds = np.geomspace(least, max(fastest / 3.0, 2.0 * least), 5)
        return self.with_reversal_shapes(site, tuple({"vs": float(speed)} for speed in speeds))

    def least(self, numbers: IdentifiedNumbers) -> Values:
        """Lower ends; friction at rest is not below that in motion."""
        fc = max(0.0, numbers["fc"].low)
        return {"fc": fc, "fs": max(fc, numbers["fs"].low), "vs": numbers["vs"].value}

    def unresolved(self, shape: Shape, resolution: float) -> str | None:
        """A fall within the regularisation velocity of dry friction cannot be told from the regularisation."""
        if float(shape["vs"]) >= FULL_SLIDING:
            return None
        return (
            "falls within the regularisation velocity of dry friction: dry friction as far as it can be seen"
        )

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
        parameters=(joint_parameter("c", "N.m.s^2/rad^2", "drag", lower=0.0),),
        signature="curvature at high speed",
        confusable_with=("viscous_friction",),
        excitation="a ladder of speeds up to 80 % of the limit",
        reference="Morison et al. 1950; thesis 6.2.5",
    )
    exported = (one_number("drag", "C", "c"),)
    compensation = "friction"
    compensated_at = ("actuator", "link")

    law = quadratic_drag


class AsymmetricFriction(JointLaw):
    """Friction that differs between the two directions."""

    description = Description(
        id="asymmetric_friction",
        sentence="Friction that differs between the two directions: half the difference acts like an offset in motion.",
        equation="tau = fc sgn(v) + da |sgn(v)| + dv |v|; |da| <= fc; |dv| <= viscous friction of the joint",
        parameters=(
            COULOMB,
            joint_parameter("da", "N.m", "half the difference of dry friction, + minus -"),
            joint_parameter(
                "dv",
                "N.m.s/rad",
                "half the difference of viscous friction, + minus -",
                left_out="the viscous part is the same in both directions",
            ),
        ),
        signature="an offset that is there only while moving, or a V in the speed",
        confusable_with=("torque_offset", "coulomb_friction"),
        excitation="moves and holds, both directions at several speeds",
        reference="Janot, Gautier & Brunot 2019 (EMPS)",
    )
    not_exported = "friction of a joint there is the same in both directions"
    compensation = "friction"
    compensated_at = ("actuator", "link")

    dry = True
    lower = (0.0, 0.0, -np.inf)  # dry friction takes energy in both directions; dv has a sign
    contrasts = ((1.0, -1.0, 0.0), (0.0, 0.0, 1.0))

    law = asymmetric_friction
    terms = 3

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients fc + da, fc - da, dv."""
        fc, da = values["fc"], values["da"]
        return np.array([fc + da, fc - da, values.get("dv", 0.0)]), {}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The inverse of ``linear``."""
        ahead, back, dv = map(float, coefficients)
        return {"fc": 0.5 * (ahead + back), "da": 0.5 * (ahead - back), "dv": dv}

    def least(self, numbers: IdentifiedNumbers) -> Values:
        """Less dry friction in both directions by what fc and da may be wrong together; less difference of dv."""
        fc, da = numbers["fc"], numbers["da"]
        both = IdentifiedNumber(fc.value, fc.std + da.std).low
        dv = numbers.get("dv", IdentifiedNumber(0.0, 0.0))
        sure = max(0.0, IdentifiedNumber(abs(dv.value), dv.std).low)
        return {"fc": both, "da": da.value, "dv": float(np.copysign(sure, dv.value))}

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
        signature="the step at a reversal grows with the load",
        confusable_with=("coulomb_friction", "torque_gain"),
        excitation="the same motion in two or more poses or with two payloads",
        reference="Hamon, Gautier & Garrec 2010; Rhoban BAM 2025, models M3 to M6",
    )
    not_exported = "friction of a joint there does not depend on the torque that it passes on"
    compensation = "friction"
    compensated_at = ("actuator", "link")
    dry = True
    upper = 1.0  # a gear that locks itself

    law = load_dependent_friction

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Overcomes it with the load that is asked for, not the measured one: nothing is fed back."""
        for joint, numbers in found.numbers.items():
            builder.per_load[builder.joint(joint)] += self.least(numbers)["kl"]


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
        signature="the same motion costs less torque later on",
        confusable_with=("viscous_friction",),
        excitation="the same motion cold and warm, over minutes",
        reference="Bittencourt et al. 2010",
    )
    not_exported = "friction of a joint there does not change with time"
    compensation = "friction"
    compensated_at = ("actuator", "link")
    contrasts = ((1.0, -1.0),)
    shape = ("T",)

    law = drifting_friction
    terms = 2

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients fv (cold) and fv (1 - k) (warm)."""
        return np.array([values["fv"], values["fv"] * (1.0 - values["k"])]), {"T": values["T"]}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The inverse of ``linear``; without friction there is nothing to fade, k = 0."""
        cold, warm = map(float, coefficients)
        return {"fv": cold, "k": 1.0 - warm / cold if cold > 0.0 else 0.0, "T": float(shape["T"])}

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Tries time constants from a tenth to three times the time since it began: grease warms in no second."""
        length = float(site.signals.time[-1])
        least = max(WARMING_MIN, 0.1 * length)
        most = max(3.0 * length, 2.0 * least)
        return tuple({"T": float(T)} for T in np.geomspace(least, most, 6))

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Overcomes what is left of it at any time, cold or warm: nobody knows how long the joint has run."""
        for joint, numbers in found.numbers.items():
            left = max(0.0, numbers["fv"].low * min(1.0, 1.0 - numbers["k"].high))

            def law(sample: JointSample, c: float = left) -> Array:
                return np.asarray(c * sample.velocity)

            builder.add_friction(joint, law, found.speeds.get(joint))
