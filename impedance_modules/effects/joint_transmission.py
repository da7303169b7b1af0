# SPDX-License-Identifier: BSD-3-Clause
r"""The transmission between motor and link: rotor inertia, elasticity and backlash.

With the link's position recorded, the motor is at \theta = q + \delta; a deflection \delta that the
nominal model does not know costs the motor I_r \ddot\delta + D \dot\delta. With the motor's position recorded
(port ``sensor``) it is the link that moves differently, at q = \theta - \delta, on which the torque of all joints
depends:

    ID(\theta - \delta) - ID(\theta) = -(M \ddot\delta + (dID/dv) \dot\delta + (dID/dq) \delta)

A joint that gives way under its load, \delta = \tau / K, then shows at rest too, by dg/dq.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.effects.effect import NEEDED, Effect, Values
from impedance_modules.effects.effect_description import Description, Port, joint_parameter
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.regressor import Regressor, Site, all_rows, one_row
from impedance_modules.effects.residual_kinds import Residual, uses_motion
from impedance_modules.effects.simulator_numbers import one_number
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import with_reflected_inertia
from impedance_modules.spec.robot_spec import EncoderSide, RobotSpec

READ = "read"
"""Shape of play: 1 where the flanks' sides are taken from the load as it was read."""

UNLOADED = 0.1
"""Share of a joint's typical load below which its teeth are taken to be apart."""

SYMBOLS = ("Ia", "fv", "fc")


def cost_of_deflection(signals: Signals, joint: int, deflection: Array, residual: Residual) -> Array | None:
    """Computes the torque (N,) that an unknown deflection (N,) of the motor costs it; None where nothing shows it."""
    rate = signals.rate_of(deflection)
    second = signals.rate_of(rate)
    if residual not in {"actuator", "motor", "whole"}:
        return None
    return np.asarray(signals.reflected_inertia[joint] * second + signals.motor_damping[joint] * rate)


def behind_encoder(signals: Signals, joint: int, deflection: Array, lower: float) -> Regressor:
    """Computes the torque that the links take less as one of them stays behind its encoder by a deflection (N,)."""
    return all_rows(-signals.torque_of_shift(joint, deflection)[:, :, None], lower=lower)


def may_sit_at(signals: Signals, joint: int, side: EncoderSide) -> bool:
    """Says whether a joint's encoder may sit on a side of its gear, for all that is known."""
    return signals.encoder(joint) in (None, side)


def with_encoders_at_motors(robot: RobotSpec, names: Iterable[str]) -> RobotSpec:
    """Returns the robot with some joints' encoders at their motors."""
    moved = {name: replace(robot.joints[name], encoder="motor") for name in names}
    return replace(robot, joints={**robot.joints, **moved})


class ReflectedInertia(Effect):
    """The rotor's inertia seen through the gear."""

    description = Description(
        id="reflected_inertia",
        sentence="The rotor turns N times faster than the joint and weighs N^2 times its inertia there.",
        equation="tau = (Ia - I_r) a, I_r the robot file's; Ia is the joint's whole reflected inertia",
        parameters=(joint_parameter("Ia", "kg.m^2", "rotor inertia at the joint; replaces I_r", lower=0.0),),
        ports=("actuator",),
        signature="in proportion to the acceleration, on one joint only",
        confusable_with=("parallel_spring", "payload", "link_inertia", "controller_gain"),
        excitation="two or more frequencies; a single tone cannot tell it from a spring",
        reference="thesis eq. 3.2, 3.12; Gautier & Khalil 1990",
        applied="Plant and model: the robot's I_r. Zero makes an ideal torque source (thesis 3.3).",
    )
    in_every_drive = True
    first_excitation = 3
    replaces = True
    exported = (one_number("rotor inertia", "I", "Ia"),)
    not_compensated = (
        "it asks for torque in proportion to an acceleration that nobody measures (valid: --effects, so that model and"
        " damping know it)"
    )

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """The motor's acceleration; the coefficient is what I_r lacks."""
        signals, joint = site.signals, site.joint
        lowest = -float(signals.reflected_inertia[joint])
        return one_row(joint, signals.motor_acceleration[:, joint], lower=lowest)

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """Coefficient Ia - I_r."""
        return np.array([values["Ia"] - site.signals.reflected_inertia[site.joint]]), {}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """Ia = I_r + coefficient."""
        return {"Ia": float(site.signals.reflected_inertia[site.joint] + coefficients[0])}

    def joint_numbers(self, values: Values) -> dict[str, float]:
        """Replaces I_r."""
        return {"reflected_inertia": values["Ia"]}

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Replaces I_r."""
        return with_reflected_inertia(robot, {joint: values["Ia"] for joint, values in parameters.items()})


class JointElasticity(Effect):
    """A spring between motor and link."""

    description = Description(
        id="joint_elasticity",
        sentence="The gear, or the spring built in behind it, gives: the motor turns ahead of the link by tau / K.",
        equation="theta = q + effort / K; K replaces the robot file's stiffness; D likewise;"
        " sensor: the encoder sits at the motor and reports theta, tau = ID(theta - effort / K) - ID(theta)",
        parameters=(
            joint_parameter("K", "N.m/rad", "stiffness", lower=0.0, positive=True),
            joint_parameter(
                "D",
                "N.m.s/rad",
                "structural damping beside the spring",
                lower=0.0,
                left_out="the robot file's",
            ),
        ),
        ports=("actuator", "sensor"),
        places={"actuator": "transmission", "sensor": "motor_encoder"},
        signature="a resonance; grows with the square of the frequency below it; at the sensor at rest too",
        confusable_with=("command_delay", "actuator_lag", "backlash", "reflected_inertia", "encoder_offset"),
        excitation="a chirp through the resonance, or steps",
        reference="Spong 1987; thesis eq. 3.1 to 3.3",
        applied="Plant and model: the robot's series spring, and at the sensor its encoder at the motor. A rigid joint"
        " gets one.",
    )
    replaces = True
    not_exported = "the rotor would have to be a body of its own, with a joint of its own"
    not_compensated = (
        "how far a joint gives is no torque that is missing (valid: --effects, so that model and tank know"
        " the spring)"
    )

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """What a compliance of one more rad per N.m costs."""
        signals, joint = site.signals, site.joint
        if site.port == "sensor":
            if not may_sit_at(signals, joint, "motor"):
                return None
            bending = (
                signals.slow_load if NEEDED not in shape else signals.slowly(signals.rigid, range(signals.n))
            )
            return behind_encoder(signals, joint, bending[:, joint], -float(signals.spring_compliance[joint]))
        if not may_sit_at(signals, joint, "link"):
            return None
        load = signals.load if signals.measures_springs else signals.slow_load
        column = cost_of_deflection(signals, joint, load[:, joint], residual)
        if column is None:
            return None
        return one_row(joint, column, lower=-float(signals.spring_compliance[joint]))

    def shows(self, port: Port, residual: Residual) -> bool:
        """An encoder at the motor misleads wherever the links' model is evaluated."""
        return uses_motion(residual) if port == "sensor" else super().shows(port, residual)

    def by_load(self, port: Port, shape: Mapping[str, float]) -> dict[str, float] | None:
        """Bent by the torque that the motion needs: as it was read, the reading's noise bends it, too."""
        return {NEEDED: 1.0} if port == "sensor" else None

    def encoder_side(self, port: Port) -> EncoderSide | None:
        """At the sensor, the motor's."""
        return "motor" if port == "sensor" else "link"

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """Coefficient 1/K - 1/K_nominal."""
        return np.array([1.0 / values["K"] - site.signals.spring_compliance[site.joint]]), {}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """K = 1 / (1/K_nominal + coefficient); infinite for a joint found to be rigid."""
        compliance = float(site.signals.spring_compliance[site.joint] + coefficients[0])
        return {"K": 1.0 / compliance if compliance > 0.0 else float("inf")}

    def joint_numbers(self, values: Values) -> dict[str, float]:
        """Replaces the series spring."""
        damping = {"spring_damping": values["D"]} if "D" in values else {}
        return {"compliance": 1.0 / values["K"], **damping}

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Replaces the series spring."""
        joints = dict(robot.joints)
        for name, values in parameters.items():
            damping = values.get("D", joints[name].spring_damping)
            joints[name] = replace(joints[name], spring_stiffness=values["K"], spring_damping=damping)
        sprung = replace(robot, joints=joints)
        return with_encoders_at_motors(sprung, parameters) if port == "sensor" else sprung


class Backlash(Effect):
    """Play between motor and link."""

    description = Description(
        id="backlash",
        sentence="Teeth have play: when the torque changes sign the motor first crosses a gap and drives nothing.",
        equation="effort = K (theta - q - clamp(theta - q, -b/2, b/2)); delta = (b/2) sgn(effort);"
        " sensor: the encoder sits at the motor and reports theta, tau = ID(theta - delta) - ID(theta)",
        parameters=(joint_parameter("b", "rad", "full gap", lower=0.0),),
        ports=("actuator", "sensor"),
        places={"actuator": "transmission", "sensor": "motor_encoder"},
        signature="a loop where the torque, not the speed, changes sign",
        confusable_with=("stribeck_friction", "hysteresis", "joint_elasticity", "command_delay"),
        excitation="slow reversals of the torque around zero load",
        reference="Nordin & Gutman 2002",
        applied="The plant: a dead zone in series with the joint's spring; the joint needs one. At the sensor, its"
        " encoder at the motor.",
    )
    not_exported = "the rotor would have to be a body of its own, with a joint of its own"
    not_compensated = (
        "while the motor crosses the gap, no torque reaches the link, and more of it only meets the teeth harder"
        " (valid: a preloaded gear, or a motion that keeps the torque's sign)"
    )

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """What crossing a gap of one radian costs."""
        signals = site.signals
        if not may_sit_at(signals, site.joint, "motor" if site.port == "sensor" else "link"):
            return None
        load = signals.touch if shape.get(READ) else signals.load
        place = place_in_play(load[:, site.joint])
        if np.ptp(place) == 0.0:
            return None
        if site.port == "sensor":
            return behind_encoder(signals, site.joint, place, 0.0)
        column = cost_of_deflection(signals, site.joint, place, residual)
        return None if column is None else one_row(site.joint, column)

    def shows(self, port: Port, residual: Residual) -> bool:
        """An encoder at the motor misleads wherever the links' model is evaluated."""
        return uses_motion(residual) if port == "sensor" else super().shows(port, residual)

    def encoder_side(self, port: Port) -> EncoderSide | None:
        """At the sensor, the motor's."""
        return "motor" if port == "sensor" else "link"

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """At the sensor, the encoder sits at the motor."""
        return with_encoders_at_motors(robot, parameters) if port == "sensor" else robot

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Flanks touch by the load that motion and model make, and by the one that was read where noise allows."""
        return ({READ: 0.0},) if site.signals.reading is None else ({READ: 0.0}, {READ: 1.0})

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """The gap."""
        return np.array([values["b"]]), {READ: 0.0}

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Opens gaps in series with springs."""
        for name, values in parameters.items():
            joint = builder.joint(name)
            if builder.model.joints[joint].spring_stiffness is None:
                raise BadInput(
                    f"backlash on '{name}': a rigid joint has nothing between motor and link that could have play"
                    " (valid: a joint with spring_stiffness in robot.yaml, or joint_elasticity in the same patch)"
                )
            builder.gap[joint] += values["b"]


def place_in_play(load: Array) -> Array:
    """Says where in a gap of size one the motor is (N,), from which side its teeth are loaded.

    Between two loads of opposite sign it crosses under a nearly constant torque, from rest: along a parabola.
    Where a joint is never loaded nothing is known, and it is taken to be in the middle.
    """
    touching = np.flatnonzero(np.abs(load) > _least_load(load))
    if touching.size == 0:
        return np.zeros(load.size)
    side = 0.5 * np.sign(load[touching])
    every = np.arange(load.size)
    after = np.searchsorted(touching, every, side="left").clip(0, touching.size - 1)
    before = (np.searchsorted(touching, every, side="right") - 1).clip(0)
    begin, end = touching[before], touching[after]
    share = np.where(end > begin, (every - begin) / np.maximum(end - begin, 1), 0.0)
    return np.asarray(side[before] + (side[after] - side[before]) * np.clip(share, 0.0, 1.0) ** 2)


def unloaded(load: Array) -> NDArray[np.bool_]:
    """Samples (N,) in which the teeth may be apart, or after which the other flank carries the load (N,)."""
    apart = np.abs(load) <= _least_load(load)
    apart[1:] |= load[1:] * load[:-1] <= 0.0
    return np.asarray(apart)


def _least_load(load: Array) -> float:
    return UNLOADED * float(np.sqrt(np.mean(load**2)))
