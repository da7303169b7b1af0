# SPDX-License-Identifier: BSD-3-Clause
"""Runs one plan on one engine: controller and sensors at 1 kHz, drives and frictions at every step of the physics."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.compiled import nominal_records, read_sensors
from benchmarks.blind.records import STATE
from benchmarks.wide.chain import drive_torques, law_number, motor_reading
from benchmarks.wide.control import Controller
from benchmarks.wide.noise import Noise, draw_noise
from benchmarks.wide.plan import PERIOD, SETTLE, STEP, Plan, RawLog

Array = NDArray[np.float64]


class RigidModel(Protocol):
    """Rigid links that a controller computes with."""

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Returns the joints' torques (n,) [N.m]."""


class Engine(Protocol):
    """What a simulator must offer."""

    believed: RigidModel
    sensed: Array

    @property
    def q(self) -> Array:
        """(n,) of the links [rad]."""

    @property
    def v(self) -> Array:
        """(n,) of the links [rad/s]."""

    @property
    def theta(self) -> Array:
        """(n,) of the motors [rad]."""

    @property
    def w(self) -> Array:
        """(n,) of the motors [rad/s]."""

    def start(self, q: Array, v: Array) -> None:
        """Puts the arm somewhere."""

    def step(self, link: Array, motor: Array, levels: Array, force: Array) -> None:
        """Goes on by one step."""


def make_engine(plan: Plan) -> Engine:
    """Builds the engine that a plan names; Drake's must be asked for in its own process (`drake_process`)."""
    if plan.engine == "drake":
        from benchmarks.wide.drake_engine import DrakeEngine

        return DrakeEngine(plan)
    from benchmarks.wide.mujoco_engine import MujocoEngine

    return MujocoEngine(plan)


def simulate(plan: Plan) -> RawLog:
    """Simulates one recording in this process."""
    engine = make_engine(plan)
    count, n = plan.reference.shape
    settle = round(SETTLE / PERIOD)
    speed = np.gradient(plan.reference, PERIOD, axis=0)
    reference = np.concatenate([np.repeat(plan.reference[:1], settle, axis=0), plan.reference])
    rate = np.concatenate([np.zeros((settle, n)), speed])
    controller = Controller(plan, engine.believed, reference, rate)
    engine.start(reference[0], np.zeros(n))
    faults, total = plan.faults, settle + count
    noise = draw_noise(plan.sensing, total, n, plan.seed)
    rows, truth = np.zeros((total, 3, n)), np.zeros((total, 2, n))
    commands, state = np.zeros((total, n)), nominal_records(n, STATE)
    lost, frozen = _windows(faults.drop_times, total), _windows(faults.freeze_times, total)
    motors = plan.sensing.effort_source == "motor"
    out, levels, felt = np.zeros((3, n)), np.zeros((2, n)), np.zeros((total, n))
    seen, errors, law = np.zeros((3, n)), np.zeros((2, n)), law_number(plan.friction_law)
    staggered = plan.engine == "mujoco_implicit"  # its speeds lie half a step before its positions
    delay = plan.control.delay - (0.0 if staggered else 0.5 * STEP)
    scale = np.array([noise.position_grid, 1e-12, 0.005])
    reading, last = np.zeros(n), engine.sensed.copy()
    for k in range(total):
        read_sensors(
            faults.joint, state, faults.crosstalk, engine.q, engine.sensed, noise.positions[k], scale, PERIOD,
            frozen[k], seen,
        )  # fmt: skip
        support = controller.step(k, seen, engine, commands[k])
        errors[0], errors[1] = controller.target - seen[0], rate[k] - seen[1]
        rows[k, 0], rows[k, 2] = seen[0], controller.target
        truth[k, 0], truth[k, 1] = engine.q, engine.v
        for part in range(round(PERIOD / STEP)):
            elapsed = k * PERIOD + part * STEP
            age = max(elapsed - SETTLE, 0.0)
            drive_torques(
                law, faults.joint, faults.friction, state, faults.coupling, commands, support, engine.q, engine.v,
                engine.theta, engine.w, engine.sensed, errors, elapsed, age, delay, lost[k], STEP, out,
                levels,
            )  # fmt: skip
            before = engine.sensed.copy()
            if motors:
                motor_reading(faults.joint, out[2], engine.theta, age, reading)
                if part == 0:
                    felt[k] = reading if staggered else 0.5 * (last + reading)
                last = reading.copy()
            engine.step(out[0], out[1], levels, _pushed(plan.pushes, elapsed - SETTLE))
            if part == 0 and not motors:
                felt[k] = _at_sample(plan, before, engine.sensed.copy(), staggered)
    rows[:, 1] = read_efforts(plan, felt, noise, frozen)
    kept = slice(settle, None)
    return RawLog(rows[kept, 0], rows[kept, 1], commands[kept], rows[kept, 2], truth[kept, 0], truth[kept, 1])


def _at_sample(plan: Plan, before: Array, after: Array, staggered: bool) -> Array:
    """Returns the joint torque at a sample from that of the steps before and after it (a rigid drive's is a mean)."""
    if not plan.rigid:
        return before
    return after if staggered else 0.5 * (before + after)


def read_efforts(plan: Plan, felt: Array, noise: Noise, frozen: Array) -> Array:
    """Returns what the torque sensors, or the drives, report of torques ``felt`` (samples, n) [N.m]."""
    joint = plan.faults.joint
    told = joint["effort_gain"] * felt + joint["effort_offset"] + felt @ plan.faults.crosstalk.T
    told = noise.add_to_efforts(told, felt)
    for k in np.flatnonzero(frozen):
        told[k] = np.where(joint["freeze"] > 0.0, told[max(k - 1, 0)], told[k])
    return told


def _pushed(pushes: Array, time: float) -> Array:
    force = np.zeros(3)
    for start, end, *way in pushes:
        if start < time < end:
            force += np.asarray(way) * np.sin(np.pi * (time - start) / (end - start)) ** 2
    return force


def _windows(times: list[tuple[float, float]], count: int) -> Array:
    flags = np.zeros(count)
    for start, end in times:
        flags[round((start + SETTLE) / PERIOD) : round((end + SETTLE) / PERIOD)] = 1.0
    return flags
