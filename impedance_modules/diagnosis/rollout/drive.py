# SPDX-License-Identifier: BSD-3-Clause
r"""A recording as a plant's driver: which torque acts when, and in which state a window begins.

Sensor errors that are worn are taken out of the readings first,

    q = q_reported - offset        e = (1 + X)^{-1} (e_reported - bias) / gain

Positions and efforts enter through the recording's own zero-phase filter; velocity is the filtered position's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.dynamics import gravity_regressor
from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.diagnosis.rollout.wearing import Dressed
from impedance_modules.effects.motion import JointMotion
from impedance_modules.errors import BadInput
from impedance_modules.plant.rollout_plant import RolloutStart

Array = NDArray[np.float64]

RUN_IN = 0.3
"""How long worn effects live along the recording before a window begins [s]."""


def choose_drive(prepared: Prepared) -> str:
    """Says which recorded torque drives the plant; empty where there is none."""
    log = prepared.log
    if log.command is not None:
        return "command"
    if log.effort is None:
        return ""
    return "motor" if log.effort_source == "motor" else "effort"


@dataclass(frozen=True, eq=False)
class Driver:
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


def driver_of(prepared: Prepared, drive: str, dressed: Dressed) -> Driver:
    """Turns a prepared recording into a driver of one plant."""
    log, s, sensors = prepared.log, prepared.signals, dressed.worn.sensors
    order = np.argsort(dressed.order)
    position = s.position[:, order] - sensors.offset
    effort = None if s.effort is None else _true_effort(s.effort[:, order], dressed)
    if effort is not None and log.effort_source == "joint_sensor":
        sprung = effort
    else:
        sprung = s.model.torque(s.position, s.velocity, s.acceleration)[:, order]
    torque = effort if drive != "command" else None if log.command is None else log.command[:, order]
    if torque is None:
        raise BadInput(f"{log.name}: does not hold the torque that is to drive the plant (valid: {drive})")
    return Driver(
        time=s.time,
        position=position,
        velocity=s.velocity[:, order],
        load=sprung,
        load_rate=np.gradient(sprung, 1.0 / log.rate, axis=0),
        command=torque,
        extra=_unknown_weight(prepared, drive, dressed)[:, order],
        aims=_aims(log.position_command, log.rate, order),
        delay=dressed.worn.command_delay + dressed.nuisance.delay if drive == "command" else 0.0,
    )


def _unknown_weight(prepared: Prepared, drive: str, dressed: Dressed) -> Array:
    """What the robot's own compensation carries beyond the model's weight (N, n)."""
    s, change = prepared.signals, dressed.nuisance.weights
    if drive != "command" or prepared.log.gravity_compensation != "robot" or not change.any():
        return np.zeros_like(s.position)
    return -np.asarray(gravity_regressor(prepared.tree, s.position) @ change)


def _true_effort(reported: Array, dressed: Dressed) -> Array:
    sensors = dressed.worn.sensors
    clean = (reported - sensors.bias) / sensors.gain
    return np.asarray(np.linalg.solve(np.eye(len(sensors.gain)) + sensors.crosstalk, clean.T).T)


def _aims(command: Array | None, rate: float, order: NDArray[np.intp]) -> Array | None:
    if command is None:
        return None
    moving = np.gradient(command, 1.0 / rate, axis=0)
    return np.stack([command[:, order], moving[:, order]], axis=1)


def seed_at(driver: Driver, start: float, dressed: Dressed) -> RolloutStart:
    """The state at a time, and the motion that led there."""
    step = dressed.plant.division.step
    remembers = bool(dressed.plant.torques)
    before = min(RUN_IN, start - float(driver.time[0])) if remembers else 0.0
    times = np.asarray(start - step * np.arange(round(before / step), -1, -1), dtype=float)
    q, v = _at(times, driver.time, driver.position), _at(times, driver.time, driver.velocity)
    load, load_rate = _at(times, driver.time, driver.load), _at(times, driver.time, driver.load_rate)
    compliance = np.array(dressed.plant.model.spring_compliance())
    acting, aims = driver.acting(times), driver.aimed(times)
    assist = dressed.plant.assistance(q[-1] + dressed.worn.sensors.offset)
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
    return RolloutStart(start, q[-1], v[-1], load[-1], load_rate[-1], acting[-1], past)


def _at(time: Array, grid: Array, values: Array) -> Array:
    """Interpolates (N, n) values linearly."""
    place = np.clip((time - grid[0]) / (grid[1] - grid[0]), 0.0, len(grid) - 1.000001)
    first = place.astype(np.intp)
    part = (place - first)[:, None]
    return np.asarray(values[first] * (1.0 - part) + values[first + 1] * part)
