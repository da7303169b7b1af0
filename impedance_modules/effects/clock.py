# SPDX-License-Identifier: BSD-3-Clause
r"""Time stamps that are not true: the clock of a recording, or of one of its streams.

A stream that is late by T at the start and whose clock runs fast by c shows at t what was at

    t' = (t - T) / (1 + c),      x(t') - x(t) = -(T + c t) dx/dt + ...
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.regressor import Regressor, Site, all_rows
from impedance_modules.effects.residual_kinds import COVERS, EFFORT_SIGN, Residual, uses_motion
from impedance_modules.errors import BadInput

APART = "apart"
"""Shape: which stream has a clock of its own."""

ALL_ALIKE, READINGS, EFFORTS, VELOCITIES = 0, 1, 2, 3
"""None; all readings, against the commands; those of effort, against positions and commands; reported velocities."""

LATE_MAX = 0.5
"""Largest time by which a stream of efforts is late or early [s]."""


class ClockDrift(Effect):
    """Time stamps of a clock that runs fast or slow, or of a stream that has one of its own."""

    description = Description(
        id="clock_drift",
        sentence="The clock that stamps the samples runs fast: recorded seconds are shorter than true ones. Or one"
        " stream has a clock of its own: it runs away from the others, and starts late.",
        equation="t recorded = (1 + 1e-6 ppm) t; v reported - dq/dt = 1e-6 ppm dq/dt; tau = 2e-6 ppm (ID - weight);"
        " apart > 0: what is read at t was at (t - T) / (1 + 1e-6 ppm), of all readings (1), efforts (2) or velocities"
        " (3)",
        parameters=(
            Parameter("ppm", "ppm", "rate beyond the true one, in millionths", lower=-1e5, upper=1e5),
            Parameter(
                "apart",
                "1",
                "whose clock runs away from the others': 0 nobody's, all stamps are off alike; 1 all readings', from"
                " the commands'; 2 that of efforts; 3 that of velocities",
                lower=0.0,
                upper=3.0,
                left_out="0",
            ),
            Parameter(
                "T",
                "s",
                "by how much efforts with a clock of their own are late at the start",
                lower=-LATE_MAX,
                upper=LATE_MAX,
                left_out="0",
            ),
        ),
        ports=("timing",),
        places={"timing": "clock"},
        keys=("log",),
        signature="all joints alike: reported velocities and differences of position differ by a factor; efforts follow"
        " the motion later and later",
        confusable_with=("command_delay", "velocity_filter_lag", "actuator_lag"),
        excitation="a long recording, fast motion",
        reference="IEEE 1588 (clock rate offset)",
        applied="The plant: the time it reports.",
    )
    not_exported = "it belongs to the clock that stamped a recording, and a simulation has its own"
    not_compensated = "it belongs to the clock that stamps the samples, and no torque sets a clock right"

    def shows(self, port: Port, residual: Residual) -> bool:
        """Where velocities are compared, accelerations used, or commands laid beside readings."""
        return residual == "velocity" or uses_motion(residual) or "drive" in COVERS[residual]

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """What changes per millionth of the clock's rate and, of efforts, per second of their age."""
        signals, stream = site.signals, round(float(shape[APART]))
        rate = 1e-6 * self._per_rate(signals, residual, stream)
        ppm = self.description.parameter("ppm")
        if stream != EFFORTS:
            return all_rows(rate[:, :, None], lower=ppm.lower, upper=ppm.upper)
        late = EFFORT_SIGN[residual] * _per_age(signals.effort, signals)
        upper = np.array([ppm.upper, LATE_MAX])
        return all_rows(np.stack([rate, late], axis=2), lower=-upper, upper=upper)

    def _per_rate(self, signals: Signals, residual: Residual, stream: int) -> Array:
        """What a clock that is fast by one changes in a residual, to first order, (N, n)."""
        since = signals.time[:, None]
        values = np.zeros((signals.samples, signals.n))
        if stream == EFFORTS:
            return EFFORT_SIGN[residual] * since * _per_age(signals.effort, signals)
        if stream == VELOCITIES:
            return since * _per_age(signals.encoder_velocity, signals) if residual == "velocity" else values
        if residual == "velocity":
            values += signals.encoder_velocity
        if uses_motion(residual):
            values += 2.0 * (signals.rigid - signals.weight)
        if stream == READINGS and "drive" in COVERS[residual]:
            values -= since * _per_age(_asked(signals), signals)
        return values

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """All stamps alike, or each recorded stream apart that others can be compared with."""
        signals = site.signals
        streams = {
            ALL_ALIKE: True,
            READINGS: signals.drive is not None,
            EFFORTS: signals.effort is not None,
            VELOCITIES: True,
        }
        return tuple({APART: float(stream)} for stream, recorded in streams.items() if recorded)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """The rate and, of efforts, their age; which of the clocks it is says the shape."""
        stream = values.get(APART, float(ALL_ALIKE))
        numbers = [values["ppm"], values.get("T", 0.0)] if round(stream) == EFFORTS else [values["ppm"]]
        return np.array(numbers), {APART: stream}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The rate, whose clock it is, and the age at the start of efforts with a clock of their own."""
        late = float(coefficients[1]) if len(coefficients) > 1 else 0.0
        return {"ppm": float(coefficients[0]), APART: float(shape[APART]), "T": late}

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Speeds the reported clock up.

        Raises:
            BadInput: One stream's clock runs away, which belongs to a recording and to no robot.
        """
        for values in parameters.values():
            if values.get(APART, 0.0):
                raise BadInput(
                    f"clock_drift with apart = {values[APART]:g}: a stream with a clock of its own belongs to a"
                    " recording, no plant can have it (valid: apart 0, or none; `diagnose --effects` takes all)"
                )
            builder.clock *= 1.0 + 1e-6 * values["ppm"]


def _per_age(stream: Array | None, signals: Signals) -> Array:
    """How a stream (N, n) changes per second of its age; zero where it was not recorded."""
    return np.zeros((signals.samples, signals.n)) if stream is None else -signals.rate_of(stream)


def _asked(signals: Signals) -> Array | None:
    """The torque asked for by commands (N, n) [N.m], without its noise where that is known."""
    drive = signals.drive if signals.clean_drive is None else signals.clean_drive
    return drive if drive is None or signals.assistance is None else drive - signals.assistance
