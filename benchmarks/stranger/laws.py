# SPDX-License-Identifier: BSD-3-Clause
"""Laws of what is planted, in the stranger's own words: bristles that slip, springs, gains, pushes.

A law says at which stage of the machine it acts. Stages, in the order of a tick:

    position  what the encoder reports of where it is
    command   the controller's torque on its way to the drive
    drive     all torque that is asked for (the robot's own compensation included) to the motor's torque
    motor     torque that is consumed on the motor's side of the gear, from the motor's speed
    link      torque that is consumed on the link's side
    effort    what the torque sensor (or the current sensor) reports
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class State:
    """What laws may look at: of the links, of the motors, of the controller."""

    t: float
    h: float
    q: Array
    v: Array
    vm: Array
    tau: Array  # motor torque [N.m]
    aim_q: Array
    aim_v: Array
    seen_q: Array
    seen_v: Array
    place: Callable[[str, Array], tuple[Array, Array, Array]]
    lean: Callable[[float, float], None]
    recording: int = 0
    other: dict[str, Array] = field(default_factory=dict)


Law = Callable[[State, Array], Array]
"""Takes the stage's torque (or position), and gives it back changed."""


def bristles(j: int, level: Callable[[State, float], float], travel: float, at_motor: bool) -> Law:
    """Dry friction of joint j: bristles bend over a travel [rad], slip at a level [N.m] that may vary.

    LuGre's equation without its dampers, integrated exactly over a step, so that any stiffness is stable.
    """
    bent = [0.0]

    def law(s: State, torque: Array) -> Array:
        v = float((s.vm if at_motor else s.v)[j])
        limit = np.sign(v) * travel
        bent[0] = limit + (bent[0] - limit) * np.exp(-abs(v) * s.h / travel)
        torque[j] += level(s, v) * bent[0] / travel
        return torque

    return law


def of_speed(j: int, torque_of: Callable[[State, float], float], at_motor: bool) -> Law:
    """Any torque that is a smooth function of joint j's speed."""

    def law(s: State, torque: Array) -> Array:
        torque[j] += torque_of(s, float((s.vm if at_motor else s.v)[j]))
        return torque

    return law


def of_position(j: int, torque_of: Callable[[float], float]) -> Law:
    """Any torque that is a smooth function of joint j's position."""

    def law(s: State, torque: Array) -> Array:
        torque[j] += torque_of(float(s.q[j]))
        return torque

    return law


def shaft(j: int, k: int, fc: float, fv: float, travel: float) -> Law:
    """Friction of a motor that turns with two joints: at the sum of their speeds, on both of them."""
    bent = [0.0]

    def law(s: State, torque: Array) -> Array:
        v = float(s.vm[j] + s.vm[k])
        limit = np.sign(v) * travel
        bent[0] = limit + (bent[0] - limit) * np.exp(-abs(v) * s.h / travel)
        both = fv * v + fc * bent[0] / travel
        torque[j] += both
        torque[k] += both
        return torque

    return law


def late(j: int, seconds: float, tick: float) -> Law:
    """The command of joint j arrives some ticks later."""
    queue: deque[float] = deque()
    length = max(1, round(seconds / tick))

    def law(_: State, command: Array) -> Array:
        queue.append(float(command[j]))
        command[j] = queue.popleft() if len(queue) > length else queue[0]
        return command

    return law


def lag(j: int, seconds: float, tick: float) -> Law:
    """The motor of joint j follows what is asked for as a first-order lag."""
    held: list[float] = []

    def law(_: State, torque: Array) -> Array:
        if not held:
            held.append(float(torque[j]))
        held[0] += (1.0 - np.exp(-tick / seconds)) * (float(torque[j]) - held[0])
        torque[j] = held[0]
        return torque

    return law


def changed(j: int, to: Callable[[State, Array], float]) -> Law:
    """Joint j's number becomes another, computed from all."""

    def law(s: State, torque: Array) -> Array:
        torque[j] = to(s, torque)
        return torque

    return law


def push(link: str, force: Callable[[State], Array | None]) -> Law:
    """A force at a link's origin, in base axes [N]: the joints have to give J^T f less."""

    def law(s: State, torque: Array) -> Array:
        f = force(s)
        if f is None:
            return torque
        _, linear, _ = s.place(link, np.zeros(3))
        return torque - linear.T @ f

    return law
