# SPDX-License-Identifier: BSD-3-Clause
r"""Time stamps that are not true: the clock of a recording, or of one of its streams.

A stream that is late by T at the start and whose clock runs fast by c shows at t what was at

    t' = (t - T) / (1 + c),      x(t') - x(t) = -(T + c t) dx/dt + ...

After a minute a clock that is fast by 2000 ppm is 0.12 s ahead, where that series tells too little: the shape holds
the rate and the age about which the stream is shifted exactly, and the regression finds the step from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

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

AT_THE_END = (-0.5, -0.15, 0.15, 0.5)
"""By how much a stream may have run away at the end of a recording, where a search starts beside none [s]."""

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

    def computed_from_command(self, port: Port) -> bool:
        """Of readings with a clock of their own, by the commands that belong to them."""
        return True

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """What is off at the shape's rate and age, and what changes per millionth and per second beyond them."""
        stream, symbols = round(float(shape[APART])), ("ppm", "T")
        at = _Clock(1e-6 * float(shape.get("ppm", 0.0)), float(shape.get("T", 0.0)))
        law = {EFFORTS: _late_efforts, VELOCITIES: _late_velocities, READINGS: _late_readings}.get(
            stream, _stretched
        )
        off = law(site.signals, residual, at)
        columns = [1e-6 * off.per_rate] + ([] if off.per_age is None else [off.per_age])
        most = np.array([self.description.parameter(symbol).upper for symbol in symbols])[: len(columns)]
        around = np.array([1e6 * at.rate, at.late])[: len(columns)]
        return all_rows(np.stack(columns, axis=2), off.fixed, -most - around, most - around)

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """All stamps alike, or each recorded stream apart that others can be compared with."""
        signals = site.signals
        streams = {
            ALL_ALIKE: True,
            READINGS: signals.drive is not None,
            EFFORTS: signals.effort is not None,
            VELOCITIES: True,
        }
        found = [float(stream) for stream, recorded in streams.items() if recorded]
        every = [{APART: stream, **dict.fromkeys(_shifted_by(stream), 0.0)} for stream in found]
        rates = [1e6 * end / float(np.ptp(signals.time)) for end in AT_THE_END]
        return (*every, *({**shape, "ppm": ppm} for shape in every if "ppm" in shape for ppm in rates))

    def refined(self, shape: Shape) -> tuple[str, ...]:
        """The rate, and the age of efforts: the regression's step moves them."""
        return _shifted_by(float(shape[APART]))

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """The rate of all stamps, or no step from the shape of a stream with a clock of its own."""
        stream = values.get(APART, float(ALL_ALIKE))
        moved = {symbol: values.get(symbol, 0.0) for symbol in _shifted_by(stream)}
        return np.zeros(len(moved)) if moved else np.array([values["ppm"]]), {APART: stream, **moved}

    def from_none(self, coefficients: Array, shape: Values) -> Array:
        """A shape of a stream with a clock of its own, plus the step."""
        moved = [shape[symbol] for symbol in _shifted_by(shape[APART])]
        return coefficients + moved if moved else coefficients

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The rate, whose clock it is, and the age at the start of efforts with a clock of their own."""
        ppm, *late = map(float, self.from_none(coefficients, shape))
        return {"ppm": ppm, APART: float(shape[APART]), "T": late[0] if late else 0.0}

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


def _shifted_by(stream: float) -> tuple[str, ...]:
    """Numbers by which a stream with a clock of its own is shifted; none where all stamps are off alike."""
    return {ALL_ALIKE: (), EFFORTS: ("ppm", "T")}.get(round(stream), ("ppm",))


@dataclass(frozen=True)
class _Clock:
    """Fast by a rate [1], of a stream that is late at the start by a time [s]."""

    rate: float
    late: float


@dataclass(frozen=True)
class _Off:
    """What stamps change in a residual, all (N, n).

    Attributes:
        fixed: At a clock's rate and a stream's age.
        per_rate: Its derivative by the rate.
        per_age: By the age; None where a stream has none.
    """

    fixed: Array
    per_rate: Array
    per_age: Array | None = None


def _stretched(signals: Signals, residual: Residual, at: _Clock) -> _Off:
    """Stamps of all streams that are off alike: speeds and accelerations are smaller than what was recorded."""
    per_rate = np.zeros((signals.samples, signals.n))
    if residual == "velocity":
        per_rate += signals.encoder_velocity
    if uses_motion(residual):
        per_rate += 2.0 * (signals.rigid - signals.weight)
    return _Off(at.rate * per_rate, per_rate)


def _late_readings(signals: Signals, residual: Residual, at: _Clock) -> _Off:
    """Readings at t were at t / (1 + c), and so was the command that belongs to them."""
    own, asked = _stretched(signals, residual, at), _asked(signals)
    if asked is None or "drive" not in COVERS[residual]:
        return own
    then = signals.time / (1.0 + at.rate)
    was, slope = _at(then, asked, signals)
    return _Off(own.fixed + asked - was, own.per_rate + (then / (1.0 + at.rate))[:, None] * slope)


def _late_efforts(signals: Signals, residual: Residual, at: _Clock) -> _Off:
    """The effort at t is shown at (1 + c) t + T."""
    if signals.effort is None:
        nothing = np.zeros((signals.samples, signals.n))
        return _Off(nothing, nothing, nothing)
    sign = EFFORT_SIGN[residual]
    true, slope = _at((1.0 + at.rate) * signals.time + at.late, signals.effort, signals)
    return _Off(sign * (signals.effort - true), -sign * signals.time[:, None] * slope, -sign * slope)


def _late_velocities(signals: Signals, residual: Residual, at: _Clock) -> _Off:
    """The reported speed at t is that of the positions, through the stated filter, at t / (1 + c)."""
    true = signals.stated_velocity if residual == "velocity" else np.zeros((signals.samples, signals.n))
    then = signals.time / (1.0 + at.rate)
    was, slope = _at(then, true, signals)
    return _Off(was - true, -(then / (1.0 + at.rate))[:, None] * slope)


def _at(moments: Array, stream: Array, signals: Signals) -> tuple[Array, Array]:
    """A stream (N, n) and its rate of change at moments (N,) [s]; before and after it the first and last value."""
    values, rates = (
        np.stack([np.interp(moments, signals.time, column) for column in series.T], axis=1)
        for series in (stream, signals.rate_of(stream))
    )
    return values, rates


def _asked(signals: Signals) -> Array | None:
    """The torque asked for by commands (N, n) [N.m], without its noise where that is known."""
    drive = signals.drive if signals.clean_drive is None else signals.clean_drive
    return drive if drive is None or signals.assistance is None else drive - signals.assistance
