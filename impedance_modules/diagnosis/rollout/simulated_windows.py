# SPDX-License-Identifier: BSD-3-Clause
r"""Windows of recordings, simulated on a plant from the measured state and driven by the recorded torque.

Readings are first corrected for the applied sensor effects,

    q = q_reported - offset - lead        e = (1 + X)^{-1} (e_reported - bias) / gain

The lead of the motor, load / K and half the play, is that of joints whose encoders sit there; they are compared there.
Positions and efforts enter through the recording's own zero-phase filter; velocity is that of the filtered position.
Windows are placed evenly over the held-out recordings, at the same times in those that repeat each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.rigid_dynamics import gravity_regressor
from impedance_modules.diagnosis.data.rigid_tree import RigidTree
from impedance_modules.diagnosis.residuals.gap_mask import lost_stretches
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.rollout.simulated_robot import PerturbedPlant
from impedance_modules.effects.joint_motion import JointHistory
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.errors import BadInput
from impedance_modules.plant.rollout_plant import RolloutStart

COMPARISONS = 20
"""Number of times in a window at which recording and rollout are compared."""

MASS_RATIO_MIN = 1e-9
"""Least over greatest eigenvalue of a mass matrix that can be inverted."""

ERROR_MAX = float(np.pi)
"""Largest error that counts, half a turn or as many metres; in speed this over WINDOW."""

HISTORY = 0.3
"""How long effects with memory follow the recording before a window begins [s]."""

MARGIN = 0.4
"""Left out at both ends of a recording, where filters have data on one side only [s]."""

WINDOW = 0.4
"""Length of a window [s]: long enough for friction to show, short enough for an open loop."""

WINDOWS = 20
"""Windows over all held-out recordings."""

FLOOR_WINDOWS = 4
"""Windows per recording of a fitted repeat, where no held-out recording has one."""


@dataclass(frozen=True)
class RolloutWindow:
    """A recording's index, and the start of the window after the recording's first sample [s]."""

    recording: int
    start: float


def held_out_windows(prepared: Sequence[Prepared], heldout: Sequence[int]) -> tuple[RolloutWindow, ...]:
    """Places windows evenly over the held-out recordings, at the same times in repeats."""
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
    """Places windows at the same, even times in several recordings; none in contact or where samples are missing.

    The simulated plant has no environment.
    """
    last = min(prepared[index].log.duration for index in members) - MARGIN - WINDOW
    if last <= MARGIN:
        return []
    if any(
        prepared[index].log.in_contact is not None or lost_stretches(prepared[index]).size
        for index in members
    ):
        free = [
            start
            for start in np.arange(MARGIN, last, 0.25 * WINDOW)
            if not any(_unusable(prepared[index], float(start)) for index in members)
        ]
        places = np.linspace(0, len(free) - 1, count + 2)[1:-1]
        starts = np.unique([free[round(place)] for place in places if free])
    else:
        starts = np.linspace(MARGIN, last, count + 2)[1:-1]
    return [RolloutWindow(index, float(start)) for index in members for start in starts]


def common_windows(
    windows: Sequence[RolloutWindow], pairs: Sequence[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Pairs of indices of windows at the same time of two recordings that repeat each other."""
    place = {(window.recording, window.start): index for index, window in enumerate(windows)}
    return [
        (place[window.recording, window.start], place[other, window.start])
        for window in windows
        for one, other in pairs
        if window.recording == one and (other, window.start) in place
    ]


@dataclass(frozen=True, eq=False)
class WindowErrors:
    """Errors of all windows, in the diagnosis's joint order.

    Attributes:
        time: (L,) since the initial state [s].
        position, velocity: (W, L, n) rollout minus recording.
    """

    time: Array
    position: Array
    velocity: Array


@dataclass(frozen=True, eq=False)
class DrivenRecording:
    """What a simulation needs of a prepared recording.

    Attributes:
        log: As recorded.
        tree: The rigid bodies.
        signals: Filtered motion and torques.
    """

    log: Log
    tree: RigidTree
    signals: Signals

    @classmethod
    def of(cls, item: Prepared) -> DrivenRecording:
        """Leaves out what is needed for the residuals only."""
        return cls(item.log, item.tree, item.signals)


def simulate_windows(
    perturbed: PerturbedPlant,
    drive: str,
    recordings: Mapping[int, DrivenRecording],
    windows: Sequence[RolloutWindow],
) -> WindowErrors:
    """Simulates every window.

    Raises:
        BadInput: The plant's motion is not finite: the model has a body without inertia.
    """
    step = perturbed.plant.division.step
    steps = round(WINDOW / step)
    steps_compared = np.unique(np.linspace(0, steps, COMPARISONS + 1).round().astype(int))[1:]
    order = list(perturbed.order)
    inputs_of = {
        index: plant_input(recordings[index], drive, perturbed)
        for index in dict.fromkeys(window.recording for window in windows)
    }
    offset = perturbed.applied.sensors.offset
    errors = []
    for inputs in inputs_of.values():
        _refuse_without_inertia(perturbed, inputs.position[0])
    for window in windows:
        inputs = inputs_of[window.recording]
        begin = float(inputs.time[0]) + window.start
        perturbed.plant.seed(seed_at(inputs, begin, perturbed))
        middle = np.asarray(begin + step * (np.arange(steps) + 0.5), dtype=float)
        # A light joint without its friction may diverge within a window.
        with np.errstate(over="ignore", invalid="ignore"):
            q, v = perturbed.plant.roll(inputs.acting(middle), inputs.aimed(middle))
        reported = (q[steps_compared - 1] + offset)[:, order], v[steps_compared - 1][:, order]
        errors.append(_compare(recordings[window.recording], begin + step * steps_compared, *reported))
    position, velocity = (np.array(part) for part in zip(*errors, strict=True))
    return WindowErrors(
        step * steps_compared, _limited(position, ERROR_MAX), _limited(velocity, ERROR_MAX / WINDOW)
    )


def choose_drive(prepared: Prepared) -> str:
    """Says which recorded torque drives the plant; empty where none was recorded."""
    log = prepared.log
    if log.command is not None:
        return "command"
    if log.effort is None:
        return ""
    return "motor" if log.effort_source == "motor" else "effort"


@dataclass(frozen=True, eq=False)
class PlantInput:
    """Inputs and states of one recording as functions of time, in the joint order of a plant.

    Attributes:
        time: (N,) of the samples [s].
        position, velocity: (N, n) of the links.
        lead: (N, n) by which the motors are ahead of them, at joints whose encoders sit there [rad].
        load, load_rate: (N, n) torque between gear and link and its rate.
        command: (N, n) driving torque, at the time when it was sent.
        extra: (N, n) what the robot adds beyond the model's weight [N.m].
        aims: (N, 2, n) commanded position and velocity; None where they were not recorded.
        delay: From sending to acting [s].
    """

    time: Array
    position: Array
    velocity: Array
    lead: Array
    load: Array
    load_rate: Array
    command: Array
    extra: Array
    aims: Array | None
    delay: float

    def acting(self, time: Array) -> Array:
        """Torque (M, n) that acts at given times."""
        return _at(time - self.delay, self.time, self.command) + _at(time, self.time, self.extra)

    def aimed(self, time: Array) -> Array | None:
        """Commanded position and velocity (M, 2, n)."""
        if self.aims is None:
            return None
        return np.stack([_at(time, self.time, self.aims[:, k]) for k in range(2)], axis=1)


def plant_input(recording: DrivenRecording, drive: str, perturbed: PerturbedPlant) -> PlantInput:
    """Turns a recording into the input of one plant."""
    log, s, sensors = recording.log, recording.signals, perturbed.applied.sensors
    order = np.argsort(perturbed.order)
    effort = None if s.effort is None else _true_effort(s.effort[:, order], perturbed)
    # Its rate sets the motors' speeds: noise of positions, three times differentiated, would throw them off.
    sprung = s.slow_load[:, order] if effort is None or log.effort_source == "motor" else effort
    compliance, gap = _leads(perturbed)
    lead = compliance * sprung + 0.5 * gap * np.sign(sprung)
    load_rate = np.gradient(sprung, 1.0 / log.rate, axis=0)
    torque = effort if drive != "command" else None if log.command is None else log.command[:, order]
    if torque is None:
        raise BadInput(f"{log.name}: does not hold the torque that is to drive the plant (valid: {drive})")
    return PlantInput(
        time=s.time,
        position=s.encoder_position[:, order] - sensors.offset - lead,
        velocity=s.encoder_velocity[:, order] - compliance * load_rate,
        lead=lead,
        load=sprung,
        load_rate=load_rate,
        command=torque,
        extra=_unknown_weight(recording, drive, perturbed)[:, order],
        aims=_aims(log.position_command, log.rate, order),
        delay=perturbed.applied.command_delay + perturbed.nuisance.delay if drive == "command" else 0.0,
    )


def seed_at(inputs: PlantInput, start: float, perturbed: PerturbedPlant) -> RolloutStart:
    """The plant's initial state at a time, with the motion before it."""
    step = perturbed.plant.division.step
    remembers = bool(perturbed.applied.torques)
    before = min(HISTORY, start - float(inputs.time[0])) if remembers else 0.0
    times = np.asarray(start - step * np.arange(round(before / step), -1, -1), dtype=float)
    q, v = _at(times, inputs.time, inputs.position), _at(times, inputs.time, inputs.velocity)
    load, load_rate = _at(times, inputs.time, inputs.load), _at(times, inputs.time, inputs.load_rate)
    compliance = np.array(perturbed.plant.model.spring_compliance())
    acting, aims = inputs.acting(times), inputs.aimed(times)
    reported = q[-1] + _at(times[-1:], inputs.time, inputs.lead)[0] + perturbed.applied.sensors.offset
    assist = perturbed.plant.assistance(reported)
    past = JointHistory(
        time=times,
        position=q,
        velocity=v,
        motor_position=q + compliance * load,
        motor_velocity=v + compliance * load_rate,
        command=acting,
        load=load,
        drive=acting + assist,
        position_command=q if aims is None else np.ascontiguousarray(aims[:, 0]),
        velocity_command=v if aims is None else np.ascontiguousarray(aims[:, 1]),
    )
    return RolloutStart(start, q[-1], v[-1], load[-1], load_rate[-1], acting[-1], past)


def _leads(perturbed: PerturbedPlant) -> tuple[Array, Array]:
    """Compliance (n,) [rad/(N.m)] and play (n,) [rad] of joints whose encoders sit at their motors; zero of others."""
    model, at_motor = perturbed.plant.model, perturbed.plant.model.encoder_at_motor
    return at_motor * model.spring_compliance(), at_motor * perturbed.applied.gap


def _unknown_weight(recording: DrivenRecording, drive: str, perturbed: PerturbedPlant) -> Array:
    """Torque of the robot's own compensation beyond the model's weight (N, n) [N.m]."""
    s, change = recording.signals, perturbed.nuisance.weights
    if drive != "command" or recording.log.gravity_compensation != "robot" or not change.any():
        return np.zeros_like(s.position)
    return -np.asarray(gravity_regressor(recording.tree, s.position) @ change)


def _true_effort(reported: Array, perturbed: PerturbedPlant) -> Array:
    sensors = perturbed.applied.sensors
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


def _unusable(item: Prepared, start: float) -> bool:
    """Whether any sample of a window is in contact, by the recording's phases, or missing."""
    in_contact, rate = item.log.in_contact, item.log.rate
    begin, end = item.log.start + start - HISTORY, item.log.start + start + WINDOW
    first, after = lost_stretches(item).T
    if np.any((first < end) & (after > begin)):
        return True
    if in_contact is None:
        return False
    return bool(in_contact[round((start - HISTORY) * rate) : round((start + WINDOW) * rate) + 1].any())


def _refuse_without_inertia(perturbed: PerturbedPlant, position: Array) -> None:
    model = perturbed.plant.model
    values, vectors = np.linalg.eigh(model.mass_matrix(position))
    if values[0] > MASS_RATIO_MIN * values[-1]:
        return
    joint = model.joint_names[int(np.argmax(np.abs(vectors[:, 0])))]
    raise BadInput(
        f"the model cannot be simulated: around '{joint}' nothing has inertia"
        " (valid: a moment of inertia about every joint's axis, or a reflected_inertia)"
    )


def _limited(errors: Array, most: float) -> Array:
    """Limits errors; what is not finite counts as the limit."""
    return np.clip(np.nan_to_num(errors, nan=most, posinf=most, neginf=-most), -most, most)


def _compare(
    recording: DrivenRecording, time: Array, position: Array, velocity: Array
) -> tuple[Array, Array]:
    """Subtracts the recorded position and its filtered velocity, at the times of comparison."""
    s = recording.signals
    measured = [_between(time, s.time, values) for values in (recording.log.position, s.encoder_velocity)]
    return position - measured[0], velocity - measured[1]


def _between(time: Array, grid: Array, values: Array) -> Array:
    return np.column_stack([np.interp(time, grid, column) for column in values.T])
