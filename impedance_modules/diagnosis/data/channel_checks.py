# SPDX-License-Identifier: BSD-3-Clause
"""Checks of single channels: commands recorded as readings, constant channels, wrapped angles, units, signs.

Undetected, each of these faults would be diagnosed as physics. Wrong units (degrees for radians, milliseconds,
newton-millimetres) are reported with the unit that the numbers look like.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_tree import Body
from impedance_modules.diagnosis.data.torque_sign import (
    CoarseComparison,
    compare_coarsely,
    refuse_flipped_torque,
    residual_of_fit,
)
from impedance_modules.errors import BadInput

STEP_MAX = 1.0
"""Largest step between two samples that a real joint makes at any admitted rate [rad]."""

TURN_TOLERANCE = 0.05
"""A jump within this distance of a full turn is a wrapped angle [rad]."""

DEGREES = 180.0 / np.pi

POSITION_MAX, VELOCITY_MAX, TORQUE_MAX = 1e4, 1e4, 1e6
"""Bounds on position [rad], velocity [rad/s] and torque [N.m] in any unit that may be meant."""

OVERLOAD_MAX = 50.0
"""Readings beyond this multiple of a joint's stated largest torque are glitches or in another unit."""

TURNS_MAX = 2.0
"""Largest plausible position of a joint whose URDF states no limits [rev]."""

RANGE_TOLERANCE = 1.3
"""Positions beyond this part of half the joint range, from its middle, are refused where no torque shows that they
are radians."""

RATE_RATIO = (0.67, 1.5)
"""Ratios of velocity to the position's rate of change that a slow filter can explain."""

SPEED_UNITS = {
    DEGREES: "deg/s for rad/s",
    1.0 / DEGREES: "positions in degrees",
    30.0 / np.pi: "rev/min for rad/s",
    0.5 / np.pi: "rev/s for rad/s",
    1e3: "time in milliseconds, or positions in thousandths",
    1e-3: "velocities in thousandths",
    -1.0: "opposite signs",
}
"""Ratio of velocity to rate of change -> the unit that it looks like."""

BETTER_UNIT = 0.2
"""Another unit of position is suspected if it leaves less than this part of the torque's remainder."""

RADIANS_LEFT = 0.5
"""Largest part of the torque's power that radians beyond the limits may leave, also of what degrees would leave: a
payload is not in the model, and angles that are too large by 57 leave more than the whole torque."""

FACTOR_OF_1000 = (300.0, 3000.0)
"""Ratios of measured to model torque that look like a factor of a thousand."""

BEFORE_GEAR = 0.125
"""Ratio of measured to model torque, at every joint where both correlate, below which no effect is searched."""


def refuse_faulty_channels(log: Log, model: NominalModel, warnings: list[str]) -> None:
    """Refuses a recording whose numbers cannot mean what they claim; what is odd and not wrong is added to warnings.

    Raises:
        BadInput: A reading that is the command, a stuck channel, wrong units, a torque of the wrong sign.
    """
    for reading, command in (("position", "position_command"), ("effort", "command")):
        _refuse_echo(log, model, reading, command)
    _refuse_stuck(log, model)
    refuse_units(log, model, warnings)
    refuse_flipped_torque(log, model)


def unwrapped(log: Log, model: NominalModel, warnings: list[str]) -> Log:
    """Unwraps angles that are counted from zero again after each turn.

    Raises:
        BadInput: A position jumps otherwise.
    """
    steps = np.diff(log.position, axis=0)
    turns = np.array([not body.prismatic for body in model.tree.bodies])
    jumps = (np.abs(steps) > STEP_MAX) & turns
    if not jumps.any():
        return log
    joint = int(np.argmax(jumps.any(axis=0)))
    size = steps[jumps[:, joint], joint]
    row = int(np.argmax(jumps[:, joint])) + 1
    name = model.joints[joint]
    if (
        np.abs(np.abs(size) - 2.0 * np.pi).max()
        > TURN_TOLERANCE + np.abs(steps[~jumps[:, joint], joint]).max()
    ):
        return (
            log if np.abs(log.position).max() > 4.0 * np.pi else _refuse_jump(log, name, row, float(size[0]))
        )
    warnings.append(f"{log.name}: position.{name} wraps around after a turn; unwrapped")
    return replace(log, position=np.where(turns, np.unwrap(log.position, axis=0), log.position))


def _refuse_jump(log: Log, joint: str, row: int, size: float) -> Log:
    raise BadInput(
        f"{log.name}: position.{joint} jumps by {size:.3g} rad at row {row} (valid: a continuous position in rad;"
        " cut the recording there, or fix the encoder's fault)"
    )


def _refuse_echo(log: Log, model: NominalModel, reading: str, command: str) -> None:
    measured: Array | None = getattr(log, reading)
    asked: Array | None = getattr(log, command)
    if measured is None or asked is None:
        return
    same = np.all(measured == asked, axis=0) & (np.ptp(measured, axis=0) > 0.0)
    if same.any():
        joint = model.joints[int(np.argmax(same))]
        name = command if command == "position_command" else "effort_command"
        raise BadInput(
            f"{log.name}: {reading}.{joint} equals {name}.{joint} in every sample: it is the command,"
            f" not a measurement (valid: a measured {reading}; leave the column out if there is none)"
        )


def _refuse_stuck(log: Log, model: NominalModel) -> None:
    if log.effort is None:
        return
    stuck = (np.ptp(log.effort, axis=0) == 0.0) & (np.ptp(log.position, axis=0) > 0.0)
    if stuck.any():
        index = int(np.argmax(stuck))
        joint, value = model.joints[index], log.effort[0, index]
        raise BadInput(
            f"{log.name}: effort.{joint} is {value:.4g} in every sample although the joint moves: nothing was"
            " measured there (valid: a measured torque; leave the column out if there is none)"
        )


def refuse_units(log: Log, model: NominalModel, warnings: list[str]) -> None:
    """Refuses numbers in another unit than they claim to have.

    Raises:
        BadInput: With the joint, the number and the unit that it looks like.
    """
    _refuse_absurd(log, model)
    for index, body in enumerate(model.tree.bodies):
        _refuse_range(log, model, index, warnings)
        if log.velocity is not None:
            _refuse_speed(log, body, log.position[:, index], log.velocity[:, index])
    _refuse_by_torque(log, model)


def _refuse_absurd(log: Log, model: NominalModel) -> None:
    """Refuses single numbers that no robot reaches; one glitch would dominate every fit."""
    n = model.n
    _refuse_beyond(log, model, "position", log.position, np.full(n, POSITION_MAX))
    _refuse_beyond(log, model, "velocity", log.velocity, np.full(n, VELOCITY_MAX))
    for name, values in (("effort", log.effort), ("effort_command", log.command)):
        _refuse_beyond(log, model, name, values, np.full(n, TORQUE_MAX))
    _refuse_thousandths(log, model)
    for name, values in (("effort", log.effort), ("effort_command", log.command)):
        _refuse_beyond(log, model, name, values, OVERLOAD_MAX * model.effort_max)


def _refuse_beyond(log: Log, model: NominalModel, name: str, values: Array | None, most: Array) -> None:
    if values is None or not (beyond := np.abs(values) > most).any():
        return
    row, joint = (int(x[0]) for x in np.nonzero(beyond))
    raise BadInput(
        f"{log.name}: {name}.{model.joints[joint]} is {values[row, joint]:.4g} in sample {row},"
        f" {int(beyond.sum())} such samples in all: a glitch, or another unit (valid: at most"
        f" {most[joint]:.4g} in SI units there; cut the glitches out, or state the unit in the import map)"
    )


def _refuse_range(log: Log, model: NominalModel, index: int, warnings: list[str]) -> None:
    """Refuses positions far beyond a joint's range; limits of models are often narrow, so torques count more."""
    body, reach = model.tree.bodies[index], float(np.abs(log.position[:, index]).max())
    allowed = _most(body)
    if body.prismatic or reach <= allowed:
        return
    end = f"the joint's range ends at {allowed / RANGE_TOLERANCE:.3g} rad"
    if _are_radians(log, model):
        warnings.append(
            f"{log.name}: position.{body.joint} reaches {reach:.4g} rad, and {end} in the model: taken as it is, since"
            " the torques agree with radians and not with degrees"
        )
        return
    looks = "which looks like degrees" if reach < 1.1 * DEGREES * allowed else "which is no angle"
    raise BadInput(
        f"{log.name}: position.{body.joint} reaches {reach:.4g}, {looks}: {end}. Is it in degrees? (valid: rad, within"
        " the range or with torques that agree with the links; state 'unit: deg' in the import map)"
    )


def _most(body: Body) -> float:
    """Largest position of a joint that needs no other evidence [rad]."""
    limits = body.limits
    if limits is None or limits.upper <= limits.lower:
        return TURNS_MAX * 2.0 * np.pi
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    return max(abs(middle + RANGE_TOLERANCE * half), abs(middle - RANGE_TOLERANCE * half))


def _are_radians(log: Log, model: NominalModel) -> bool:
    """Whether the links' weight and inertia explain most of the torques, and would not if positions were degrees."""
    radians, degrees = (_unexplained_share(log, model, scale) for scale in (1.0, 1.0 / DEGREES))
    return radians is not None and degrees is not None and radians < RADIANS_LEFT * min(1.0, degrees)


def _refuse_speed(log: Log, body: Body, q: Array, v: Array) -> None:
    step = max(1, round(log.rate / 20.0))
    moved = q[2 * step :] - q[: -2 * step]
    slope = _slope(moved * (log.rate / (2.0 * step)), _interval_mean(v, step))
    if slope is None or RATE_RATIO[0] < slope < RATE_RATIO[1]:
        return
    near = min(SPEED_UNITS, key=lambda unit: abs(unit / slope - 1.0))
    looks = f": {SPEED_UNITS[near]}?" if abs(near / slope - 1.0) < 0.2 else ": a gear ratio, or a wrong rate?"
    raise BadInput(
        f"{log.name}: velocity.{body.joint} is {slope:.3g} times the position's rate of change{looks}"
        " (valid: rad, rad/s and s; state 'unit' or 'sign' in the import map)"
    )


def _interval_mean(v: Array, step: int) -> Array:
    """Mean velocity over the same intervals as the positions' differences."""
    total = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]))])
    return np.asarray((total[2 * step :] - total[: -2 * step]) / (2.0 * step))


def _slope(cause: Array, effect: Array) -> float | None:
    """Least-squares slope about the means; None where the two hardly correlate."""
    a, b = cause - cause.mean(), effect - effect.mean()
    power, size = float(a @ a), float(b @ b)
    if power == 0.0 or size == 0.0 or abs(float(a @ b)) < 0.9 * np.sqrt(power * size):
        return None
    return float(a @ b) / power


def _refuse_by_torque(log: Log, model: NominalModel) -> None:
    """Asks whether another unit of position, or of torque, would agree with the model far better."""
    left = {scale: _unexplained_share(log, model, scale) for scale in (1.0, DEGREES, 1.0 / DEGREES)}
    now = left[1.0]
    if now is None:
        return
    for scale, words in ((1.0 / DEGREES, "degrees"), (DEGREES, "radians that were divided by 57.3")):
        other = left[scale]
        if other is not None and other < BETTER_UNIT * now and other < BETTER_UNIT:
            raise BadInput(
                f"{log.name}: the torques agree with the links' weight and inertia far better if the positions"
                f" are {words} ({100 * other:.0f} % of the torque's power is left over, now {100 * now:.0f} %)."
                " Are they? (valid: rad; state 'unit' in the import map)"
            )


def _unexplained_share(log: Log, model: NominalModel, scale: float) -> float | None:
    """Part of the torque's power that the model leaves, over all revolute joints."""
    if all(body.prismatic for body in model.tree.bodies):
        return None
    found = compare_coarsely(log, model, scale)
    if found is None:
        return None
    rest, power = 0.0, 0.0
    for index, body in enumerate(model.tree.bodies):
        if body.prismatic:
            continue
        own = np.ones((len(found.position), 1))
        whole = float(np.sum(residual_of_fit(found.effort[:, index], own) ** 2))
        rest += float(np.sum(residual_of_fit(found.effort[:, index] - found.model[:, index], own) ** 2))
        power += whole
    return rest / power if power > 0.0 else None


def _refuse_thousandths(log: Log, model: NominalModel) -> None:
    found = compare_coarsely(log, model)
    if found is None:
        return
    for index, joint in enumerate(model.joints):
        slope = _slope(found.model[:, index], found.effort[:, index])
        if slope is None or not (
            FACTOR_OF_1000[0] < abs(slope) < FACTOR_OF_1000[1]
            or FACTOR_OF_1000[0] < 1 / abs(slope) < FACTOR_OF_1000[1]
        ):
            continue
        looks = "mN.m" if abs(slope) > 1.0 else "kN.m"
        raise BadInput(
            f"{log.name}: the torque of {joint} is {abs(slope):.3g} times what the links need, which looks like {looks}"
            " (valid: N.m; state its unit in the import map)"
        )
    _refuse_before_gear(log, model, found)


def _refuse_before_gear(log: Log, model: NominalModel, found: CoarseComparison) -> None:
    """Refuses torques that are a small part of what the links need, at every joint where that can be seen."""
    slopes = [_slope(found.model[:, index], found.effort[:, index]) for index in range(model.n)]
    seen = {joint: slope for joint, slope in zip(model.joints, slopes, strict=True) if slope is not None}
    if not seen or max(map(abs, seen.values())) > BEFORE_GEAR:
        return
    listed = ", ".join(f"{joint} {abs(slope):.3g}" for joint, slope in seen.items())
    raise BadInput(
        f"{log.name}: the torques are a small part of what the links need ({listed}): were they measured at the motors,"
        " before a gear, or are they currents? (valid: N.m at the joints; state 'transmission' and 'side: motor', or"
        " the unit and its 'gain', in the import map)"
    )
