# SPDX-License-Identifier: BSD-3-Clause
"""One arm as it really is, and one episode of it: MuJoCo steps, drives and sensors around them."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.blind.arm_model import GRAVITY, STEP, Drive, Joints, Link, hand_of, write_mjcf
from benchmarks.blind.compiled import apply_drives, impedance_law, nominal_records, read_sensors
from benchmarks.blind.excitation import Motion
from benchmarks.blind.floor import Surface, Touch
from benchmarks.blind.records import STATE, Faults

Array = NDArray[np.float64]

PERIOD = 0.001
SETTLE = 0.5
"""Time [s] that the arm is held before the recording starts."""


@dataclass(frozen=True)
class Push:
    """A force [N] (3,) on the hand between two times [s], risen and fallen smoothly."""

    start: float
    end: float
    force: Array


@dataclass(frozen=True)
class Arm:
    """One arm as it really is.

    Attributes:
        side: Limb.
        drive: Numbers of the robot file (what the robot believes of itself).
        links: True links.
        believed: Links of the URDF, from which the robot compensates its weight.
        joints: True drives.
        faults: What is wrong.
        gravity: (3,) true gravity in the base's axes [m/s^2].
        surface: Floor under the hand as it is, or None.
        mapped: Floor as the task has it, or None.
        pushes: Per episode index, what touches the hand.
    """

    side: str
    drive: Drive
    links: tuple[Link, ...]
    believed: tuple[Link, ...]
    joints: Joints
    faults: Faults
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -GRAVITY]))
    surface: Surface | None = None
    mapped: Surface | None = None
    pushes: tuple[Push, ...] = ()


@dataclass(frozen=True)
class Noise:
    """Seed and level (1 = the robot file's) of the sensors' noise."""

    seed: int
    level: float


@dataclass(frozen=True)
class RawLog:
    """An episode at 1 kHz: (samples, n) arrays, and the force on the hand (samples,) [N]."""

    time: Array
    position: Array
    velocity: Array
    effort: Array
    command: Array
    target: Array
    touch: Array


def rigid_model(links: tuple[Link, ...], side: str, gravity: Array | None = None) -> mujoco.MjModel:
    """Returns the links alone, without drives."""
    down = np.array([0.0, 0.0, -GRAVITY]) if gravity is None else gravity
    return mujoco.MjModel.from_xml_string(write_mjcf(links, None, down, hand_of(side)))


class Weight:
    """The robot's own compensation: gravity torque of a model at a position."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Takes a rigid model."""
        self._model, self._data = model, mujoco.MjData(model)
        self._torque = np.zeros(model.nv)

    def at(self, q: Array) -> Array:
        """Returns g(q) (n,) [N.m]; the array is used again by the next call."""
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_rne(self._model, self._data, 0, self._torque)
        return self._torque


def simulate(arm: Arm, motion: Motion, stiffness: Array, damping: Array, noise: Noise | None) -> RawLog:
    """Runs one episode under joint impedance control at 1 kHz, physics at 2 kHz.

    Args:
        arm: The arm as it is.
        motion: Desired motion with feed-forward, at 1 kHz.
        stiffness: (n,) of the controller [N.m/rad].
        damping: (n,) of the controller [N.m.s/rad].
        noise: Of the sensors, or None for perfect (but still quantised) ones.
    """
    n = len(arm.drive.joints)
    text = write_mjcf(arm.links, arm.joints, arm.gravity, hand_of(arm.side))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    support_of = Weight(rigid_model(arm.believed, arm.side))
    start = motion.position[0] - SETTLE * motion.velocity[0]
    rest = Weight(rigid_model(arm.links, arm.side, arm.gravity)).at(start)
    data.qpos[:n] = start
    data.qpos[n:] = start + rest / arm.joints.stiffness + 0.5 * np.sign(rest) * arm.joints.gap
    mujoco.mj_forward(model, data)
    hand = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, hand_of(arm.side))

    settle = round(SETTLE / PERIOD)
    count = settle + motion.position.shape[0]
    rows = np.zeros((count, 4, n))
    touch = np.zeros(count)
    noises = draw_noise(arm.drive, count, n, noise)
    state, faults = nominal_records(n, STATE), arm.faults
    scale = np.array([arm.drive.position_resolution, arm.drive.effort_resolution, arm.drive.velocity_filter])
    seen, errors, out = np.zeros((3, n)), np.zeros((2, n)), np.zeros(2 * n)
    reference, estimate = np.zeros((3, n)), np.zeros((2, n))
    estimate[0] = np.nan
    commands = np.zeros((count, n))
    lost, frozen = _windows(faults.drop_times, count), _windows(faults.freeze_times, count)
    position, speed = data.qpos, data.qvel
    gap = arm.joints.gap if arm.joints.gap.any() else None
    floor = None if arm.surface is None else Touch(model, arm.surface)
    for k in range(count):
        time = (k - settle) * PERIOD
        j = max(k - settle, 0)
        spring = arm.joints.stiffness * _dead(position[n:] - position[:n], gap)
        read_sensors(
            faults.joint,
            state,
            faults.crosstalk,
            position[:n],
            spring,
            noises[k],
            scale,
            PERIOD,
            frozen[k],
            seen,
        )
        reference[0] = motion.position[j] + min(time, 0.0) * motion.velocity[0]
        reference[1], reference[2] = motion.velocity[j], motion.feed_forward[j]
        impedance_law(
            stiffness,
            damping,
            arm.drive.spring_stiffness,
            reference,
            seen,
            estimate,
            arm.drive.effort_max,
            commands[k],
        )
        errors[:] = reference[:2] - seen[:2]
        support = support_of.at(seen[0])
        rows[k, :3], rows[k, 3] = seen, commands[k]
        if arm.pushes:
            data.xfrc_applied[hand, :3] = pushed(arm.pushes, time)
        touch[k] = float(np.linalg.norm(data.xfrc_applied[hand, :3]))
        for part in range(round(PERIOD / STEP)):
            elapsed = k * PERIOD + part * STEP
            if part:
                spring = arm.joints.stiffness * _dead(position[n:] - position[:n], gap)
            age = max(elapsed - SETTLE, 0.0)
            apply_drives(
                faults.joint, faults.friction, state, faults.coupling, commands, support, position[:n], speed[:n],
                position[n:], speed[n:], spring, errors, elapsed, age, arm.drive.command_delay, lost[k], STEP, out,
            )  # fmt: skip
            data.qfrc_applied[:] = out
            pressed = 0.0 if floor is None else floor.press(data)
            if part == 0:
                touch[k] += pressed
            mujoco.mj_step(model, data)
    kept = rows[settle:]
    times = np.asarray(np.arange(kept.shape[0]) * PERIOD, dtype=np.float64)
    return RawLog(times, kept[:, 0], kept[:, 1], kept[:, 2], kept[:, 3], motion.position, touch[settle:])


def draw_noise(drive: Drive, count: int, n: int, noise: Noise | None) -> Array:
    """Returns (count, 2, n): white noise of positions, autoregressive (8 ms) noise of efforts."""
    if noise is None:
        return np.zeros((count, 2, n))
    source = np.random.default_rng(noise.seed)
    white = source.standard_normal((count, 2, n))
    keep = np.exp(-PERIOD / 0.008)
    white[:, 1] = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], white[:, 1], axis=0)
    white[:, 0] *= noise.level * drive.position_noise
    white[:, 1] *= noise.level * drive.effort_noise
    return white


def pushed(pushes: tuple[Push, ...], time: float) -> Array:
    """Returns the force (3,) [N] on the hand at a time."""
    total = np.zeros(3)
    for push in pushes:
        if push.start < time < push.end:
            total += push.force * np.sin(np.pi * (time - push.start) / (push.end - push.start)) ** 2
    return total


def _dead(length: Array, gap: Array | None) -> Array:
    if gap is None:
        return length
    return np.asarray(np.sign(length) * np.maximum(np.abs(length) - 0.5 * gap, 0.0))


def _windows(times: list[tuple[float, float]], count: int) -> Array:
    flags = np.zeros(count)
    for start, end in times:
        flags[round((start + SETTLE) / PERIOD) : round((end + SETTLE) / PERIOD)] = 1.0
    return flags
