# SPDX-License-Identifier: BSD-3-Clause
"""Torque that is off by a constant or by a factor, or is only reported so."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.effects.compensation_builder import CompensationBuilder, Diagnosed
from impedance_modules.effects.drive_effects import LAGS
from impedance_modules.effects.effect import NEEDED, Effect, JointLaw, Stepped, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port, joint_parameter
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.joint_transmission import Backlash, place_in_play
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.recorded_signals import lagged
from impedance_modules.effects.regressor import Regressor, Site, all_rows, ends, one_row
from impedance_modules.effects.residual_kinds import EFFORT_SIGN, Residual, Stage, uses_motion
from impedance_modules.effects.simulator_numbers import one_number
from impedance_modules.records import Matrix, Row, Vector

NO_SUCH_SENSOR = "what sensors report beside the truth is none of the numbers there"
"""Why an error of a sensor is in no simulator's file."""

ONLY_REPORTED = (
    "only what a sensor reports is wrong, and no torque sets a reading right"
    " (valid: the sensor's own calibration)"
)
"""Why an error of a sensor is not compensated."""

GAIN_MAX = 3.0
"""Factor by which a sensor is believed to read, or a drive to give, too much or too little: by a wrong constant or
ratio."""

SHARE_MAX = 0.5
"""Largest share of another joint's torque that is believed to be in a reading."""


@compiled
def constant_torque(sample: Row, shape: Vector, columns: Matrix) -> None:  # noqa: ARG001 - every law has these
    """Writes 1."""
    columns[0] = 1.0


class TorqueOffset(JointLaw):
    """A constant torque, consumed or only reported."""

    description = Description(
        id="torque_offset",
        sentence="A constant torque, at rest too: a cable that pulls, or an effort sensor with a wrong zero.",
        equation="tau = c; at the sensor: effort reported = effort + c",
        parameters=(joint_parameter("c", "N.m", "torque consumed, or added to the reading"),),
        ports=("actuator", "link", "sensor"),
        places={"sensor": "torque_sensor"},
        signature="constant, in holds as in moves",
        confusable_with=("encoder_offset", "base_tilt", "asymmetric_friction", "parallel_spring"),
        excitation="static poses with different weight on the joint",
        reference="Khalil & Dombre 2002",
        applied="The plant: as a torque at the motor or link, or in what its effort sensor reports.",
    )
    compensation = "potential"
    compensated_at = ("actuator", "link")
    not_compensated = ONLY_REPORTED
    not_exported = "a joint there has no constant torque of its own, and its sensor no bias"
    lower = -np.inf
    first_excitation = 5

    def shows(self, port: Port, residual: Residual) -> bool:
        """A reading shows wherever the effort enters."""
        return EFFORT_SIGN[residual] != 0.0 if port == "sensor" else super().shows(port, residual)

    law = constant_torque

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """A column of ones, with the sign of the effort if only the reading is off."""
        sign = EFFORT_SIGN[residual] if site.port == "sensor" else 1.0
        return one_row(site.joint, np.full(site.signals.samples, sign), lower=self.lower)

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Torque on the joint, or error of its sensor."""
        if port == "sensor":
            builder.effort_bias[builder.joints(parameters)] += [values["c"] for values in parameters.values()]
        else:
            super().apply_to_plant(builder, port, parameters)

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Adds the torque that the joint consumes."""
        for joint, numbers in found.numbers.items():
            builder.add_potential(joint, numbers["c"].value, 0.0)


class TorqueGain(Effect):
    """A factor on the motor's torque or on the reported effort."""

    description = Description(
        id="torque_gain",
        sentence="A wrong torque constant or gear ratio: the motor gives, or the sensor reports, s times the torque.",
        equation="actuator: motor torque = s x torque asked for; sensor: effort reported = s x effort",
        parameters=(Parameter("s", "1", "factor; 1 is nominal", lower=0.0, positive=True, neutral=1.0),),
        ports=("actuator", "sensor"),
        places={"actuator": "drive", "sensor": "torque_sensor"},
        signature="in proportion to the joint's own torque, in every regime",
        confusable_with=("payload", "link_inertia", "load_dependent_friction", "torque_saturation"),
        excitation="a known added mass; other joints' rows tell it from a payload",
        reference="Gautier & Briot 2014",
        applied="The plant: in the drive of the motor, or in what its effort sensor reports.",
    )
    exported = (one_number("drive gain", "s", "s", ports=("actuator",)),)
    not_exported = NO_SUCH_SENSOR
    compensation = "gain"
    compensated_at = ("actuator",)
    not_compensated = ONLY_REPORTED

    def proportional_to_command(self, port: Port) -> bool:
        """In proportion to the torque asked for, unless only the reading is wrong."""
        return port == "actuator"

    def computed_from_command(self, port: Port) -> bool:
        """Made of the torque asked for, unless only the reading is wrong."""
        return port == "actuator"

    def by_load(self, port: Port, shape: Mapping[str, float]) -> dict[str, float] | None:
        """Of the motor's gain."""
        return {NEEDED: 1.0} if port == "actuator" else None

    def stage(self, port: Port) -> Stage | None:
        """The drive; a sensor consumes nothing."""
        return "drive" if port == "actuator" else None

    def shows(self, port: Port, residual: Residual) -> bool:
        """A reading shows wherever the effort enters."""
        return EFFORT_SIGN[residual] != 0.0 if port == "sensor" else super().shows(port, residual)

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Drive: -u with coefficient s - 1. Sensor: the reading e with coefficient 1 - 1/s, which is exact."""
        torque = site.signals.effort if site.port == "sensor" else site.signals.drive
        if torque is None:
            return None
        own = (site.signals.rigid if shape.get(NEEDED) else torque)[:, site.joint]
        if site.port == "sensor":
            sensed = EFFORT_SIGN[residual] * own
            return one_row(site.joint, sensed, lower=1.0 - GAIN_MAX, upper=1.0 - 1.0 / GAIN_MAX)
        return one_row(site.joint, -own, lower=1.0 / GAIN_MAX - 1.0, upper=GAIN_MAX - 1.0)

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """Drive: s - 1. Sensor: 1 - 1/s."""
        s = values["s"]
        return np.array([1.0 - 1.0 / s if site.port == "sensor" else s - 1.0]), {}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The inverse of ``coefficients``."""
        found = float(coefficients[0])
        return {"s": 1.0 / (1.0 - found) if site.port == "sensor" else 1.0 + found}

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Scales the drive or the sensor."""
        gains = builder.effort_gain if port == "sensor" else builder.drive_gain
        gains[builder.joints(parameters)] *= [values["s"] for values in parameters.values()]

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Divides what is asked for by s."""
        for joint, numbers in found.numbers.items():
            builder.divide_by(joint, numbers["s"])


class EncoderOffset(Stepped):
    """A joint whose reported angle is off by a constant."""

    description = Description(
        id="encoder_offset",
        sentence="The encoder's zero is off: the joint reports q + dq0, so every weight is computed at a wrong pose.",
        equation="q reported = q + dq0; tau = ID(q reported - dq0) - ID(q reported) = -(dID/dq) dq0",
        parameters=(joint_parameter("dq0", "rad", "angle reported too much"),),
        ports=("sensor",),
        places={"sensor": "encoder"},
        signature="like weight, on the joint itself and on the joints before and after it",
        confusable_with=("base_tilt", "torque_offset", "payload", "backlash"),
        excitation="poses over the whole workspace",
        reference="Khalil & Dombre 2002; PACE 2025 (bias)",
        applied="The plant: its position sensor, and the robot's own gravity compensation with it.",
    )
    shape = ("dq0",)
    starts = (0.0,)
    nearly_linear = True
    exported = (one_number("encoder zero", "q_e", "dq0"),)
    not_compensated = (
        "no torque sets a joint's zero right, and every spring would still pull to a wrong place (valid: the zero of"
        " the robot's own calibration)"
    )

    def shows(self, port: Port, residual: Residual) -> bool:
        """Wherever the links' model is evaluated."""
        return uses_motion(residual)

    def bends_springs(self, port: Port) -> bool:
        """The links' torque is another than their reported places say."""
        return True

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Linearises the inverse dynamics about the angle less the shape's offset, on all joints."""
        signals = site.signals
        joint, offset = site.joint, float(shape["dq0"])
        if offset == 0.0:
            return all_rows(-signals.position_derivative[:, :, joint, None])
        v, a = signals.velocity, signals.acceleration
        there = signals.position.copy()
        there[:, joint] -= offset
        columns = -signals.model.position_derivative(there, v, a)[:, :, joint, None]
        return all_rows(columns, signals.model.torque(there, v, a) - signals.rigid)

    def imitated_by(self, site: Site, values: Values) -> tuple[str, ...]:
        """Play before an encoder at the motor, where the load holds the link at one flank: half the gap behind."""
        signals, joint = site.signals, site.joint
        place = place_in_play(signals.load[:, joint])
        one_flank = np.ptp(place) == 0.0 and place[0] * values["dq0"] > 0.0
        return (Backlash.description.id,) if one_flank and signals.encoder_at_motor[joint] else ()

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Shifts what the encoder reports."""
        builder.offset[builder.joints(parameters)] += [values["dq0"] for values in parameters.values()]


class Crosstalk(Effect):
    """One joint's torque in another's effort reading, or in what another's drive gives."""

    description = Description(
        id="crosstalk",
        sentence="A neighbour's torque bends this joint's effort sensor too, or its current reaches this joint's motor:"
        " what is reported, or given, follows the other joint.",
        equation="sensor: effort reported of JOINT = effort + c x effort of OTHER;"
        " actuator: motor torque of JOINT = u + c x u of OTHER",
        parameters=(Parameter("c", "1", "share of the other joint's torque", lower=-1.0, upper=1.0),),
        ports=("sensor", "actuator"),
        places={"sensor": "torque_sensor", "actuator": "drive"},
        keys=("pair",),
        signature="the residual of one joint follows the torque of another; of drives, before the sensor only",
        confusable_with=("payload", "link_inertia", "transmission_coupling"),
        excitation="one joint at a time",
        reference="Rethink Robotics: crosstalk_model_effort in SEAJointState",
        applied="The plant: what its effort sensors report, or what its drives give.",
    )
    imitates_carried = True
    not_exported = "sensors and drives there each know one joint"
    not_compensated = (
        "sensors that are mixed report wrongly, which no torque sets right, and drives that are mixed are told apart by"
        " their wiring (valid: the robot's own calibration)"
    )

    def proportional_to_command(self, port: Port) -> bool:
        """In proportion to the torque asked of the other joint, unless only readings are mixed."""
        return port == "actuator"

    def computed_from_command(self, port: Port) -> bool:
        """Made of the torque asked for, unless only readings are mixed."""
        return port == "actuator"

    def stage(self, port: Port) -> Stage | None:
        """The drive; a sensor consumes nothing."""
        return "drive" if port == "actuator" else None

    def shows(self, port: Port, residual: Residual) -> bool:
        """A reading shows wherever the effort enters."""
        return EFFORT_SIGN[residual] != 0.0 if port == "sensor" else super().shows(port, residual)

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """The other joint's reading, or minus the torque asked of it."""
        signals, sensed = site.signals, site.port == "sensor"
        torque = signals.effort if sensed else signals.drive
        if torque is None:
            return None
        joint, other = (signals.joint(name) for name in ends(site.key))
        sign, most = (EFFORT_SIGN[residual], SHARE_MAX) if sensed else (-1.0, 1.0)
        return one_row(joint, sign * torque[:, other], lower=-most, upper=most)

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Adds shares of other joints' torques to readings or to what drives give."""
        shares = builder.crosstalk if port == "sensor" else builder.drive_crosstalk
        for key, values in parameters.items():
            joint, other = ends(key)
            shares[builder.joint(joint), builder.joint(other)] += values["c"]


class VelocityFilterLag(Stepped):
    """A reported velocity that lags."""

    description = Description(
        id="velocity_filter_lag",
        sentence="The reported velocity is filtered more than stated: it follows the true one as a first-order lag.",
        equation="T d(v_reported)/dt = v - v_reported, beyond the robot file's velocity_filter",
        parameters=(Parameter("T", "s", "time constant beyond the robot file's", lower=0.0, upper=10.0),),
        ports=("sensor",),
        places={"sensor": "velocity_estimate"},
        signature="the reported velocity trails the differences of the reported position",
        confusable_with=("command_delay", "clock_drift"),
        excitation="fast reversals; compare the reported velocity with differences of position",
        reference="Brown, Schneider & Mulligan 1992",
        applied="The plant: the velocity that its sensors report.",
    )
    not_exported = NO_SUCH_SENSOR
    not_compensated = ONLY_REPORTED
    shape = ("T",)
    starts = LAGS

    def shows(self, port: Port, residual: Residual) -> bool:
        """In the reported velocity alone."""
        return residual == "velocity"

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """The lag at T of what the stated filter gives, and its slope by T."""
        signals = site.signals
        joint, T = site.joint, float(shape["T"])
        true, change = signals.stated_velocity[:, joint], 0.02 * T + 1e-5
        # A segment begins in the middle of a motion: what the lag gives there is what was reported.
        known = signals.reported_velocity
        start = None if known is None else float(known[0, joint])
        slow = lagged(true, signals.time, T, start)
        slope = (lagged(true, signals.time, T + change, start) - slow) / change
        return one_row(joint, slope, slow - true, lower=-T)

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Filters reported velocities once more."""
        builder.velocity_lag[builder.joints(parameters)] += [values["T"] for values in parameters.values()]
