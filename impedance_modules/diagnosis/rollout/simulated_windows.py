# SPDX-License-Identifier: BSD-3-Clause
"""Lives windows of recordings through again, on one plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.rigid_dynamics import gravity_regressor
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.rollout.simulated_robot import PerturbedPlant
from impedance_modules.effects.joint_motion import JointMotion
from impedance_modules.errors import BadInput
from impedance_modules.plant.seeded import Seed

Array = NDArray[np.float64]

LOOKS = 20
"""Times within a window at which recording and rollout are compared."""

SINGULAR = 1e-9
"""Least over greatest eigenvalue of a mass matrix that can be inverted."""

LOST = float(np.pi)
"""A joint that is half a turn (or metres) off is lost: errors count up to here, in speed up to LOST / WINDOW."""

RUN_IN = 0.3
"""How long worn effects simulate_windows along the recording before a window begins [s]."""

MARGIN = 0.4
"""Left out at both ends of a recording, where filters have seen only one side [s]."""

WINDOW = 0.4
"""Length of a window [s]: long enough for friction to show, short enough for an open loop."""

WINDOWS = 20
"""Windows over all held-out recordings."""

FLOOR_WINDOWS = 4
"""Windows per recording of a fitted repeat, where no held-out recording has one."""


@dataclass(frozen=True)
class RolloutWindow:
    """A recording's index, and when the window begins after the recording's own first sample [s]."""

    recording: int
    start: float


def held_out_windows(prepared: Sequence[Prepared], heldout: Sequence[int]) -> tuple[RolloutWindow, ...]:
    """Spreads the windows over the held-out recordings; repeats are cut at the same times."""
    groups: dict[str, list[int]] = {}
    for index in heldout:
        groups.setdefault(prepared[index].log.group, []).append(index)
    chosen = list(groups.values())[:WINDOWS]
    out = []
    for members in chosen:
        count = max(1, round(WINDOWS / (len(chosen) * len(members))))
        out += place_windows(prepared, members, count)
    return tuple(out)


def floor_windows(
    prepared: Sequence[Prepared], pairs: Sequence[tuple[int, int]]
) -> tuple[RolloutWindow, ...]:
    """Windows of the first pair of recordings that repeat each other; none without one."""
    return tuple(place_windows(prepared, pairs[0], FLOOR_WINDOWS)) if pairs else ()


def place_windows(prepared: Sequence[Prepared], members: Sequence[int], count: int) -> list[RolloutWindow]:
    """Cuts windows of several recordings at the same, even times; none while one of them touches something.

    The plant that lives a window again knows no surroundings.
    """
    last = min(prepared[index].log.duration for index in members) - MARGIN - WINDOW
    if last <= MARGIN:
        return []
    if any(prepared[index].log.in_contact is not None for index in members):
        free = [
            start
            for start in np.arange(MARGIN, last, 0.25 * WINDOW)
            if not any(_touches(prepared[index], float(start)) for index in members)
        ]
        places = np.linspace(0, len(free) - 1, count + 2)[1:-1]
        starts = np.unique([free[round(place)] for place in places if free])
    else:
        starts = np.linspace(MARGIN, last, count + 2)[1:-1]
    return [RolloutWindow(index, float(start)) for index in members for start in starts]


def common_windows(
    windows: Sequence[RolloutWindow], pairs: Sequence[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Places of windows that show the same moment of two recordings that repeat each other."""
    place = {(window.recording, window.start): index for index, window in enumerate(windows)}
    return [
        (place[window.recording, window.start], place[other, window.start])
        for window in windows
        for one, other in pairs
        if window.recording == one and (other, window.start) in place
    ]


@dataclass(frozen=True, eq=False)
class WindowErrors:
    """Errors of all windows in the diagnosis's joint order.

    Attributes:
        time: (L,) since the seed [s].
        position, velocity: (W, L, n) rollout minus recording.
    """

    time: Array
    position: Array
    velocity: Array


def simulate_windows(
    perturbed: PerturbedPlant, drive: str, prepared: Sequence[Prepared], windows: Sequence[RolloutWindow]
) -> WindowErrors:
    """Rolls every window out.

    Raises:
        BadInput: The plant's motion is not finite: the model has a body without inertia.
    """
    step = perturbed.plant.division.step
    steps = round(WINDOW / step)
    looks = np.unique(np.linspace(0, steps, LOOKS + 1).round().astype(int))[1:]
    order = list(perturbed.order)
    drivers = {
        index: plant_input(prepared[index], drive, perturbed) for index in {w.recording for w in windows}
    }
    offset = perturbed.worn.sensors.offset
    errors = []
    for driver in drivers.values():
        _refuse_without_inertia(perturbed, driver.position[0])
    for window in windows:
        driver = drivers[window.recording]
        begin = float(driver.time[0]) + window.start
        perturbed.plant.seed(seed_at(driver, begin, perturbed))
        middle = np.asarray(begin + step * (np.arange(steps) + 0.5), dtype=float)
        # A light joint that lacks its friction may fly off beyond all numbers within a window.
        with np.errstate(over="ignore", invalid="ignore"):
            q, v = perturbed.plant.roll(driver.acting(middle), driver.aimed(middle))
        reported = (q[looks - 1] + offset)[:, order], v[looks - 1][:, order]
        errors.append(_compare(prepared[window.recording], begin + step * looks, *reported))
    position, velocity = (np.array(part) for part in zip(*errors, strict=True))
    return WindowErrors(step * looks, _counted(position, LOST), _counted(velocity, LOST / WINDOW))


def choose_drive(prepared: Prepared) -> str:
    """Says which recorded torque drives the plant; empty where there is none."""
    log = prepared.log
    if log.command is not None:
        return "command"
    if log.effort is None:
        return ""
    return "motor" if log.effort_source == "motor" else "effort"


@dataclass(frozen=True, eq=False)
class PlantInput:
    """One recording in the joint order of a plant, as functions of time.

    Attributes:
        time: (N,) of the samples [s].
        position, velocity: (N, n) of the links.
        load, load_rate: (N, n) torque between gear and link and its rate.
        command: (N, n) the torque that drives, at the time when it was issued.
        extra: (N, n) what the robot adds beyond the model's weight [N.m].
        aims: (N, 2, n) joint motion aimed at; None where it was not recorded.
        delay: From issuing to acting [s].
    """

    time: Array
    position: Array
    velocity: Array
    load: Array
    load_rate: Array
    command: Array
    extra: Array
    aims: Array | None
    delay: float

    def acting(self, time: Array) -> Array:
        """The torque (M, n) that acts at some times."""
        return _at(time - self.delay, self.time, self.command) + _at(time, self.time, self.extra)

    def aimed(self, time: Array) -> Array | None:
        """The joint motion (M, 2, n) aimed at."""
        if self.aims is None:
            return None
        return np.stack([_at(time, self.time, self.aims[:, k]) for k in range(2)], axis=1)


def plant_input(prepared: Prepared, drive: str, perturbed: PerturbedPlant) -> PlantInput:
    """Turns a prepared recording into a driver of one plant."""
    log, s, sensors = prepared.log, prepared.signals, perturbed.worn.sensors
    order = np.argsort(perturbed.order)
    position = s.position[:, order] - sensors.offset
    effort = None if s.effort is None else _true_effort(s.effort[:, order], perturbed)
    if effort is not None and log.effort_source == "joint_sensor":
        sprung = effort
    else:
        sprung = s.model.torque(s.position, s.velocity, s.acceleration)[:, order]
    torque = effort if drive != "command" else None if log.command is None else log.command[:, order]
    if torque is None:
        raise BadInput(f"{log.name}: does not hold the torque that is to drive the plant (valid: {drive})")
    return PlantInput(
        time=s.time,
        position=position,
        velocity=s.velocity[:, order],
        load=sprung,
        load_rate=np.gradient(sprung, 1.0 / log.rate, axis=0),
        command=torque,
        extra=_unknown_weight(prepared, drive, perturbed)[:, order],
        aims=_aims(log.position_command, log.rate, order),
        delay=perturbed.worn.command_delay + perturbed.nuisance.delay if drive == "command" else 0.0,
    )


def seed_at(driver: PlantInput, start: float, perturbed: PerturbedPlant) -> Seed:
    """The state at a time, and the motion that led there."""
    step = perturbed.plant.division.step
    remembers = bool(perturbed.plant.torques)
    before = min(RUN_IN, start - float(driver.time[0])) if remembers else 0.0
    times = np.asarray(start - step * np.arange(round(before / step), -1, -1), dtype=float)
    q, v = _at(times, driver.time, driver.position), _at(times, driver.time, driver.velocity)
    load, load_rate = _at(times, driver.time, driver.load), _at(times, driver.time, driver.load_rate)
    compliance = np.array(perturbed.plant.model.spring_compliance())
    acting, aims = driver.acting(times), driver.aimed(times)
    assist = perturbed.plant.assistance(q[-1] + perturbed.worn.sensors.offset)
    past = [
        JointMotion(
            time=float(times[k]),
            position=q[k],
            velocity=v[k],
            motor_position=q[k] + compliance * load[k],
            motor_velocity=v[k] + compliance * load_rate[k],
            command=acting[k],
            load=load[k],
            drive=acting[k] + assist,
            position_command=q[k] if aims is None else aims[k, 0],
            velocity_command=v[k] if aims is None else aims[k, 1],
        )
        for k in range(len(times))
    ]
    return Seed(start, q[-1], v[-1], load[-1], load_rate[-1], acting[-1], past)


def _unknown_weight(prepared: Prepared, drive: str, perturbed: PerturbedPlant) -> Array:
    """What the robot's own compensation carries beyond the model's weight (N, n)."""
    s, change = prepared.signals, perturbed.nuisance.weights
    if drive != "command" or prepared.log.gravity_compensation != "robot" or not change.any():
        return np.zeros_like(s.position)
    return -np.asarray(gravity_regressor(prepared.tree, s.position) @ change)


def _true_effort(reported: Array, perturbed: PerturbedPlant) -> Array:
    sensors = perturbed.worn.sensors
    clean = (reported - sensors.bias) / sensors.gain
    return np.asarray(np.linalg.solve(np.eye(len(sensors.gain)) + sensors.crosstalk, clean.T).T)


def _aims(command: Array | None, rate: float, order: NDArray[np.intp]) -> Array | None:
    if command is None:
        return None
    moving = np.gradient(command, 1.0 / rate, axis=0)
    return np.stack([command[:, order], moving[:, order]], axis=1)


def _at(time: Array, grid: Array, values: Array) -> Array:
    """Interpolates (N, n) values linearly."""
    place = np.clip((time - grid[0]) / (grid[1] - grid[0]), 0.0, len(grid) - 1.000001)
    first = place.astype(np.intp)
    part = (place - first)[:, None]
    return np.asarray(values[first] * (1.0 - part) + values[first + 1] * part)


def _touches(item: Prepared, start: float) -> bool:
    """Whether a recording's phases say that a window is spent in contact, were it for a moment."""
    in_contact, rate = item.log.in_contact, item.log.rate
    if in_contact is None:
        return False
    return bool(in_contact[round((start - RUN_IN) * rate) : round((start + WINDOW) * rate) + 1].any())


def _refuse_without_inertia(perturbed: PerturbedPlant, position: Array) -> None:
    model = perturbed.plant.model
    values, vectors = np.linalg.eigh(model.mass_matrix(position))
    if values[0] > SINGULAR * values[-1]:
        return
    joint = model.joint_names[int(np.argmax(np.abs(vectors[:, 0])))]
    raise BadInput(
        f"the model cannot be simulated: around '{joint}' nothing has inertia"
        " (valid: a moment of inertia about every joint's axis, or a reflected_inertia)"
    )


def _counted(errors: Array, most: float) -> Array:
    """Counts what is lost, or no number any more, as lost."""
    return np.clip(np.nan_to_num(errors, nan=most, posinf=most, neginf=-most), -most, most)


def _compare(prepared: Prepared, time: Array, position: Array, velocity: Array) -> tuple[Array, Array]:
    """Subtracts the recording, at the looks' times: the position as it was read, the filtered velocity."""
    s = prepared.signals
    measured = [_between(time, s.time, values) for values in (prepared.log.position, s.velocity)]
    return position - measured[0], velocity - measured[1]


def _between(time: Array, grid: Array, values: Array) -> Array:
    return np.column_stack([np.interp(time, grid, column) for column in values.T])
