# SPDX-License-Identifier: BSD-3-Clause
r"""The drive, from the torque asked for to the motor's: delayed, lagging or limited.

With u asked for and y(u) given, the joint consumes u - y(u) in the drive. Near a guess p of the parameter the
regression is fixed = u - y(u; p), column = -dy/dp: its coefficient is the step of a Gauss-Newton iteration.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.effect import NEEDED, Stepped, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port, joint_parameter
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.recorded_signals import Signals, differentiate, lagged
from impedance_modules.effects.regressor import Regressor, Site, one_row
from impedance_modules.effects.residual_kinds import Residual, Stage
from impedance_modules.effects.simulator_numbers import one_number
from impedance_modules.spec.robot_spec import RobotSpec


class DriveLaw(Stepped):
    """A drive that gives something else than asked, by one parameter.

    Attributes:
        symbol: The parameter's.
        peaks: What happens at single peaks of the torque counts, which no cleaned signal shows.
    """

    symbol: str
    peaks: bool = False

    @abstractmethod
    def given(self, asked: Array, time: Array, value: float) -> tuple[Array, Array]:
        """Computes the torque given (N,) and its derivative by the parameter (N,)."""

    def asked(self, signals: Signals, drive: Array) -> Array:
        """Gives the torque (N, n) on which the effect acts; all of it unless said otherwise."""
        return drive

    def by_load(self, port: Port, shape: Mapping[str, float]) -> dict[str, float] | None:
        """At the same parameter: a limit that the motion's torque exceeds is none."""
        return {**shape, NEEDED: 1.0}

    def stage(self, port: Port) -> Stage | None:
        """The drive."""
        return "drive"

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Linearises at the shape."""
        signals = site.signals
        if signals.drive is None:
            return None
        value = float(shape[self.symbol])
        known = signals.drive if signals.clean_drive is None or self.peaks else signals.clean_drive
        known = signals.rigid if shape.get(NEEDED) else known
        asked = self.asked(signals, known)[:, site.joint]
        given, slope = self.given(asked, signals.time, value)
        lowest = self.description.parameter(self.symbol).lower - value
        return one_row(site.joint, -slope, asked - given, lowest)


LAGS = (0.0, 0.01, 0.04, 0.15)
"""Time constants of a lag from which its search starts [s]."""


class CommandDelay(DriveLaw):
    """u(t - T)."""

    symbol = "T"
    shape = ("T",)
    description = Description(
        id="command_delay",
        sentence="The command arrives late: the motor gives what was asked for a time T ago.",
        equation="motor torque = u(t - T), T beyond the robot file's command_delay",
        parameters=(Parameter("T", "s", "delay beyond the robot file's", lower=0.0, upper=1.0),),
        ports=("timing",),
        signature="follows the rate of the commanded torque; common to all joints, or one joint's own",
        confusable_with=("actuator_lag", "viscous_friction", "joint_elasticity", "clock_drift"),
        excitation="several tones over two or more octaves",
        reference="PACE 2025; Isaac Sim system identification (common and per-joint delay)",
        applied="The plant: each joint's command; what the robot adds by itself is not late. The model's delay"
        " grows by the largest T.",
    )
    delays_torque = True
    shared_by_joints = True
    exported = (one_number("late command", "T", "T"),)
    not_compensated = (
        "a torque that is predicted over a delay multiplies the sensors' noise, and gives energy to whatever it did not"
        " foresee (valid: --effects, so that check, damping and energy tank count the delay)"
    )
    starts = (0.0, 0.005, 0.015, 0.04, 0.1)  # a step of Newton might miss what lies between wider ones

    def computed_from_command(self, port: Port) -> bool:
        """Made of the torque asked for."""
        return True

    def asked(self, signals: Signals, drive: Array) -> Array:
        """Leaves out what the robot adds by itself."""
        return drive if signals.assistance is None else drive - signals.assistance

    def given(self, asked: Array, time: Array, value: float) -> tuple[Array, Array]:
        """Shifts by interpolation; before the recording began the first value acted."""
        late = np.interp(time - value, time, asked)
        return late, -differentiate(late, time)

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Adds the largest delay to the model's, so that predictions of stability include it."""
        late = robot.timing.command_delay + max(values["T"] for values in parameters.values())
        return replace(robot, timing=replace(robot.timing, command_delay=late))

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Delays commands."""
        builder.drive_delay[builder.joints(parameters)] += [values["T"] for values in parameters.values()]
        builder.modelled_delay += max(values["T"] for values in parameters.values())


class ActuatorLag(DriveLaw):
    """T dtau/dt = u - tau."""

    symbol = "T"
    shape = ("T",)
    description = Description(
        id="actuator_lag",
        sentence="The motor's current loop takes time: its torque follows the torque asked for as a first-order lag.",
        equation="T d(tau_m)/dt = u - tau_m",
        parameters=(Parameter("T", "s", "time constant", lower=0.0, upper=10.0),),
        ports=("actuator",),
        places={"actuator": "drive"},
        signature="like a delay at low frequency, smaller amplitude at high frequency",
        confusable_with=("command_delay", "viscous_friction", "reflected_inertia"),
        excitation="a chirp up to 3 / T",
        reference="Franklin, Powell & Emami-Naeini, first-order lag",
        applied="The plant: all torque of the joint's motor.",
    )
    delays_torque = True
    exported = (one_number("drive lag", "T_1", "T"),)
    not_compensated = (
        "undoing a lag differentiates the torque asked for, noise and all, and gives energy to whatever it did not"
        " foresee (valid: softer springs, which are slower than the motor)"
    )
    starts = LAGS

    def computed_from_command(self, port: Port) -> bool:
        """Made of the torque asked for."""
        return True

    def given(self, asked: Array, time: Array, value: float) -> tuple[Array, Array]:
        """Follows straight pieces between samples, exactly; the slope by a small change of T."""
        slow = lagged(asked, time, value)
        change = 0.02 * value + 1e-5
        return slow, (lagged(asked, time, value + change) - slow) / change

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Slows motors down; two lags on one joint add."""
        builder.drive_lag[builder.joints(parameters)] += [values["T"] for values in parameters.values()]


class TorqueSaturation(DriveLaw):
    """clip(u, -limit, limit)."""

    symbol = "limit"
    peaks = True
    shape = ("limit",)
    exported = (one_number("torque limit", "L", "limit"),)
    not_compensated = "a motor at its limit has nothing left to add (valid: --scale, or a slower motion)"
    description = Description(
        id="torque_saturation",
        sentence="The motor gives no more than a limit, however much is asked for.",
        equation="motor torque = min(max(u, -limit), limit)",
        parameters=(joint_parameter("limit", "N.m", "largest torque", lower=0.0),),
        ports=("actuator",),
        places={"actuator": "drive"},
        signature="only where the torque asked for is beyond the limit",
        confusable_with=("torque_gain",),
        excitation="moves that reach the limit",
        reference="PACE 2025 (motor envelope)",
        applied="The plant: all torque of the joint's motor.",
    )

    def given(self, asked: Array, time: Array, value: float) -> tuple[Array, Array]:
        """Clips."""
        beyond = np.abs(asked) > value
        return np.clip(asked, -value, value), np.where(beyond, np.sign(asked), 0.0)

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Starts from shares of the largest torque asked for."""
        if site.signals.drive is None:
            return ()
        asked = np.abs(site.signals.drive[:, site.joint])
        limits = np.unique(np.quantile(asked, (0.05, 0.2, 0.5, 0.7, 0.85, 0.95, 0.99)))
        return tuple({"limit": float(limit)} for limit in limits)

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Limits motors; the smaller of two limits counts."""
        joints = builder.joints(parameters)
        limits = np.array([values["limit"] for values in parameters.values()])
        builder.drive_limit[joints] = np.minimum(builder.drive_limit[joints], limits)
