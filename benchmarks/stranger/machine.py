# SPDX-License-Identifier: BSD-3-Clause
"""The machine that is recorded: controller at 1 kHz, drives, motors, gears, links in finer steps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.stranger.engine import Arm
from benchmarks.stranger.laws import Law, State
from benchmarks.stranger.motions import REST, TICK, Motion

Array = NDArray[np.float64]

STAGES = ("position", "command", "drive", "motor", "link", "effort")
SPEED_FILTER = 1.5e-3  # s, of the controller's own velocity
FINE_ENCODER = 2e-6  # rad, noise of the motors' own encoders, which the controller uses


ASTRAY = 0.9  # rad; an arm that is further from where it should be is not in use


class DoesNotFollowError(Exception):
    """The arm fell, or was shaken by its own controller."""


@dataclass
class Gear:
    """A joint whose gear gives: stiffness [N.m/rad], damping, rotor's inertia [kg.m^2], play [rad]."""

    joint: int
    stiffness: float
    damping: float
    rotor: float
    play: float = 0.0

    def torque(self, ahead: float, faster: float) -> float:
        """What the gear passes on when the motor is ahead of the link, and faster [rad, rad/s]."""
        half = 0.5 * self.play
        bent = ahead - np.clip(ahead, -half, half)
        if half > 0 and bent == 0.0:
            return 0.0
        return self.stiffness * float(bent) + self.damping * faster


@dataclass
class Build:
    """Everything of one machine, for one recording: laws keep memories, and are made anew for the next."""

    arm: Arm  # as it is
    model: Arm  # as its controller believes it is
    rotors: Array  # matrix of inertia on the motors' side [kg.m^2]
    laws: dict[str, list[Law]] = field(default_factory=lambda: {stage: [] for stage in STAGES})
    gear: Gear | None = None


@dataclass(frozen=True)
class Controller:
    """Kind, gains [N.m/rad, N.m.s/rad, N.m/(rad.s)], and who carries the weight: robot, command, none."""

    kind: str
    kp: Array
    kd: Array
    ki: Array
    omega: float
    belief: float  # computed torque: its model's masses over the drawing's
    gravity: str


@dataclass
class Trace:
    """One recording without noise, a row at each of the recorder's ticks."""

    t: Array
    q: Array  # what an ideal encoder reports
    v: Array
    a: Array
    command: Array
    asked: Array  # the same with what the robot adds
    motor: Array
    sensor: Array
    aim: Array


def gains(kind: str, model: Arm, middle: Array, omega: float, rotors: Array, gravity: str) -> Controller:
    """Gains by each joint's inertia in the middle of its range, limited by what it weighs alone."""
    model.at(middle, np.zeros_like(middle))
    mass = model.mass_and_bias()[0] + rotors
    alone = 1.0 / np.diag(np.linalg.inv(mass))
    kd = np.minimum(1.6 * omega * np.diag(mass), (150.0 if omega > 6.0 else 10.0) * alone)
    own = kd / (1.6 * np.diag(mass))  # rad/s that each joint reaches
    kp = kd * own / 1.6
    ki = kp * own * 0.25 if kind == "servo" else np.zeros_like(kp)
    return Controller(kind, kp, kd, ki, omega, 0.92, gravity)


def run(build: Build, control: Controller, motion: Motion, rate: int, number: int, seed: int) -> Trace:
    """Carries a motion out, and keeps a row every 1 / rate seconds once the rest is over."""
    return _Run(build, control, motion, number, seed).through(round(1.0 / (rate * TICK)))


class _Run:
    """One recording while it is made."""

    def __init__(self, build: Build, control: Controller, motion: Motion, number: int, seed: int) -> None:
        self.build, self.control, self.motion = build, control, motion
        self.substeps = 4 if build.gear is not None else 2
        self.h = TICK / self.substeps
        rng = np.random.default_rng(seed)
        self.noise = FINE_ENCODER * rng.standard_normal(motion.q.shape)
        q = motion.q[0].copy()
        zero = np.zeros_like(q)
        arm = build.arm
        self.s = State(
            -REST, self.h, q, zero.copy(), zero.copy(), zero, q, zero, q, zero, arm.place, arm.lean, number
        )
        held = build.model.weight(q)
        self.integral = held.copy()
        self.motor_q, self.motor_v = 0.0, 0.0
        if build.gear is not None:
            j = build.gear.joint
            self.motor_q = q[j] + held[j] / build.gear.stiffness + 0.5 * build.gear.play * np.sign(held[j])

    def through(self, every: int) -> Trace:
        """All ticks; rows are kept once the rest is over."""
        first = round(REST / TICK)
        rows: list[tuple[Array, ...]] = []
        for k in range(len(self.motion.q)):
            kept = k >= first and (k - first) % every == 0
            if k % 200 == 0 and not np.abs(self.s.q - self.motion.q[k]).max() < ASTRAY:
                raise DoesNotFollowError
            row = self._tick(k, kept)
            if row is not None:
                rows.append(row)
        columns = [np.array(c) for c in zip(*rows, strict=True)]
        t: Array = np.arange(len(rows), dtype=np.float64) * (every * TICK)
        return Trace(t, *columns)

    def _apply(self, stage: str, x: Array) -> Array:
        for law in self.build.laws[stage]:
            x = law(self.s, x)
        return x

    def _reported(self) -> Array:
        q = self.s.q.copy()
        if self.build.gear is not None:
            q[self.build.gear.joint] = self.motor_q
        return self._apply("position", q)

    def _tick(self, k: int, kept: bool) -> tuple[Array, ...] | None:
        """Reads, computes, drives; then integrates to the next tick."""
        s = self.s
        s.t = k * TICK - REST
        s.aim_q, s.aim_v = self.motion.q[k], self.motion.v[k]
        reported = self._reported()
        seen = reported + self.noise[k]
        if k == 0:
            s.seen_q = seen
        s.seen_v = s.seen_v + TICK / (TICK + SPEED_FILTER) * ((seen - s.seen_q) / TICK - s.seen_v)
        s.seen_q = seen
        command, added = self._control(k)
        asked = command + added
        s.tau = self._apply("drive", self._apply("command", command.copy()) + added)
        row = None
        for i in range(self.substeps):
            acceleration, sensor = self._step()
            if i == 0 and kept:
                v = s.v - self.h * acceleration[0]
                motors = v.copy()
                if self.build.gear is not None:
                    motors[self.build.gear.joint] = self.motor_v - self.h * acceleration[1]
                row = self._row(k, reported, motors, acceleration, command, asked, sensor)
        return row

    def _row(
        self,
        k: int,
        q: Array,
        v: Array,
        acceleration: tuple[Array, float],
        command: Array,
        asked: Array,
        sensor: Array,
    ) -> tuple[Array, ...]:
        a = acceleration[0].copy()
        if self.build.gear is not None:
            a[self.build.gear.joint] = acceleration[1]
        motor = self.s.tau.copy()
        reports = self._apply("effort", np.concatenate([sensor, motor]))
        n = len(q)
        return q, v, a, command, asked, reports[n:], reports[:n], self.motion.q[k].copy()

    def _control(self, k: int) -> tuple[Array, Array]:
        """The controller's torque, and what the robot adds to it by itself to carry the weight."""
        s, c, m = self.s, self.control, self.motion
        error, rate = m.q[k] - s.seen_q, m.v[k] - s.seen_v
        nothing = np.zeros_like(error)
        if c.kind == "computed_torque":
            self.build.model.at(s.seen_q, s.seen_v)
            mass, bias = self.build.model.mass_and_bias()
            wanted = m.a[k] + c.omega**2 * error + 1.6 * c.omega * rate
            return c.belief * (mass @ wanted) + bias, nothing
        if c.kind == "servo":
            self.integral += TICK * c.ki * error
            return c.kp * error + c.kd * rate + self.integral, nothing
        held = self.build.model.weight(s.seen_q)
        u = c.kp * error + c.kd * rate
        return (u, held) if c.gravity == "robot" else (u + held, nothing)

    def _step(self) -> tuple[tuple[Array, float], Array]:
        """One step: accelerations of links and of the soft joint's motor, and torque behind the gears."""
        s, h, gear = self.s, self.h, self.build.gear
        s.vm = s.v.copy()
        if gear is not None:
            s.vm[gear.joint] = self.motor_v
        self.build.arm.at(s.q, s.v)
        mass, bias = self.build.arm.mass_and_bias()
        rubbed = self._apply("motor", np.zeros_like(s.q))
        consumed = self._apply("link", np.zeros_like(s.q)) if self.build.laws["link"] else 0.0
        driven = s.tau - rubbed
        motor_a = 0.0
        if gear is not None:
            j = gear.joint
            passed = gear.torque(self.motor_q - s.q[j], self.motor_v - s.v[j])
            motor_a = (driven[j] - passed) / gear.rotor
            driven[j] = passed
            self.motor_v += h * motor_a
            self.motor_q += h * self.motor_v
        a = np.linalg.solve(mass + self.build.rotors, driven - bias - consumed).astype(np.float64)
        s.v = s.v + h * a
        s.q = s.q + h * s.v
        return (a, motor_a), driven - self.build.rotors @ a
