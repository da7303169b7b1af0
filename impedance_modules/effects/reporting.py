# SPDX-License-Identifier: BSD-3-Clause
"""Speeds that are reported late, and a clock that runs at a rate of its own."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.bodies import all_rows
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.drive_effects import lagged
from impedance_modules.effects.effect import Effect, Regressor, Values, one_row
from impedance_modules.effects.residual_kinds import COVERS, Residual, uses_motion
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.stepped import Stepped
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

APART = "apart"
"""Shape: 1 where the readings' clock runs away from the commands'."""


class VelocityFilterLag(Stepped):
    """A reported velocity that lags."""

    description = Description(
        id="velocity_filter_lag",
        sentence="The reported velocity is filtered more than stated: it follows the true one as a first-order lag.",
        equation="T d(v_reported)/dt = v - v_reported, beyond the robot file's velocity_filter",
        parameters=(Parameter("T", "s", "time constant beyond the robot file's", lower=0.0, upper=10.0),),
        ports=("sensor",),
        keys=("joint",),
        signature="the reported velocity trails the differences of the reported position",
        confusable_with=("command_delay", "clock_drift"),
        excitation="fast reversals; compare the reported velocity with differences of position",
        reference="Brown, Schneider & Mulligan 1992",
        worn="The plant: the velocity that its sensors report.",
    )
    shape = ("T",)

    def shows(self, port: Port, residual: Residual) -> bool:
        """In the reported velocity alone."""
        return residual == "velocity"

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """The lag at T, and its slope by T."""
        if not self.shows(port, residual):
            return None
        joint, T = signals.joint(key), float(shape["T"])
        true, change = signals.velocity[:, joint], 0.02 * T + 1e-5
        slow = lagged(true, signals.time, T)
        slope = (lagged(true, signals.time, T + change) - slow) / change
        return one_row(joint, slope[:, None], slow - true, np.array([-T]), np.full(1, np.inf))

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """Starts between an instant and a quarter of a second."""
        return tuple({"T": T} for T in (0.0, 0.01, 0.04, 0.15))

    def wear_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Filters reported velocities once more."""
        builder.velocity_lag[builder.joints(parameters)] += [values["T"] for values in parameters.values()]


class ClockDrift(Effect):
    """Time stamps of a clock that runs fast or slow."""

    description = Description(
        id="clock_drift",
        sentence="The clock that stamps the samples runs fast: recorded seconds are shorter than true ones.",
        equation="t recorded = (1 + 1e-6 ppm) t; v reported - dq/dt = 1e-6 ppm dq/dt; tau = 2e-6 ppm (ID - weight);"
        " apart = 1: readings at t show what was at t / (1 + 1e-6 ppm), commands do not",
        parameters=(
            Parameter("ppm", "ppm", "rate beyond the true one, in millionths", lower=-1e5, upper=1e5),
            Parameter(
                "apart",
                "1",
                "1 where the readings' clock runs away from the commands', 0 where all stamps are off alike",
                lower=0.0,
                upper=1.0,
                left_out="0",
            ),
        ),
        ports=("timing",),
        keys=("log",),
        signature="all joints alike: reported velocities and differences of position differ by a factor",
        confusable_with=("command_delay", "velocity_filter_lag"),
        excitation="a long recording, fast motion",
        reference="IEEE 1588 (clock rate offset)",
        worn="The plant: the time it reports.",
    )

    def shows(self, port: Port, residual: Residual) -> bool:
        """Where velocities are compared, accelerations used, or commands laid beside readings."""
        return residual == "velocity" or uses_motion(residual) or "drive" in COVERS[residual]

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Velocity in its own residual, twice the inertial torque in the links', what the command changes meanwhile."""
        if not self.shows(port, residual):
            return None
        values = np.zeros((signals.samples, signals.n))
        if residual == "velocity":
            values += signals.velocity
        if uses_motion(residual):
            values += 2.0 * (signals.rigid - signals.weight)
        if shape.get(APART) and "drive" in COVERS[residual]:
            values += _run_away(signals)
        ppm = self.description.parameter("ppm")
        bounds = np.full(1, ppm.lower), np.full(1, ppm.upper)
        return all_rows(signals, 1e-6 * values[:, :, None], *bounds)

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """All stamps alike, or the readings' against the commands'."""
        return ({APART: 0.0},) if signals.drive is None else ({APART: 0.0}, {APART: 1.0})

    @property
    def free(self) -> tuple[str, ...]:
        """The rate."""
        return ("ppm",)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """The rate; which of the clocks it is says the shape."""
        return np.array([values["ppm"]]), {APART: values.get(APART, 0.0)}

    def wear_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Speeds the reported clock up.

        Raises:
            BadInput: The clocks run apart, which belongs to a recording's readings and to no robot.
        """
        for values in parameters.values():
            if values.get(APART, 0.0):
                raise BadInput(
                    "clock_drift with apart = 1: readings that run away from the commands belong to a recording, no"
                    " plant wears them (valid: apart 0, or none; `diagnose --effects` takes both)"
                )
            builder.clock *= 1.0 + 1e-6 * values["ppm"]


def _run_away(signals: Signals) -> Array:
    """What the torque asked for changes per second of the readings' age, times the time since the start, (N, n)."""
    drive = signals.drive if signals.clean_drive is None else signals.clean_drive
    if drive is None:
        return np.zeros((signals.samples, signals.n))
    asked = drive if signals.assistance is None else drive - signals.assistance
    return np.asarray(signals.time[:, None] * signals.rate_of(asked))
