# SPDX-License-Identifier: BSD-3-Clause
"""Desired motions of one arm: what an experimenter would run, and what a careless one would.

Rich motions are scaled to the arm's limits and get the feed-forward of the nominal model. Poor ones cannot separate two
causes at one joint: one speed, one direction, one tone, no motion. There the other joints do just enough to be in the
log, and every shape is exact: nothing is scaled or faded afterwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Drive

Array = NDArray[np.float64]

RATE = 1000
FADE = 1.0
"""Time [s] in which a motion grows from rest."""
Shape = Callable[[Array, Drive, np.random.Generator], Array]
"""Time (samples,) -> deviation from the centre (samples, n) [rad], before scaling to the limits."""
MARGIN = 0.1
"""Distance [rad] kept from the joint limits."""
PoorShape = Callable[[Array, np.random.Generator], Array]
"""Time (samples,) -> deviation of the one joint from the centre (samples,) [rad]."""


@dataclass(frozen=True)
class Motion:
    """Desired (samples, n) position [rad], velocity [rad/s] and feed-forward torque [N.m], at 1 kHz.

    ``peak`` (n,) is the largest torque [N.m] that the motors need for it, ``weight`` (n,) the largest weight in it.
    """

    position: Array
    velocity: Array
    feed_forward: Array
    peak: Array
    weight: Array


def multisine(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Six tones per joint, 0.1 to 2.2 Hz, each joint its own: the richest motion."""
    shape = np.zeros((time.size, len(drive.joints)))
    for i in range(shape.shape[1]):
        tones = np.geomspace(0.1, 2.2, 6) * rng.uniform(0.85, 1.18, 6)
        shape[:, i] = _tones(time, tones, tones**-1.1, rng)
    return shape


def fourier(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Five harmonics of one slow tone, as in the textbooks of identification."""
    base = rng.uniform(0.1, 0.16)
    shape = np.zeros((time.size, len(drive.joints)))
    for i in range(shape.shape[1]):
        shape[:, i] = _tones(
            time,
            np.asarray(base * np.arange(1, 6), np.float64),
            rng.uniform(0.3, 1.0, 5) / np.arange(1, 6),
            rng,
        )
    return shape


def point_to_point(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Quick and slow moves between postures, with rests."""
    return _moves(time, drive, rng, duration=(0.6, 2.0), rest=(0.3, 1.0))


def ramps(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Constant speeds from creeping to brisk, back and forth, with short rests: friction's motion."""
    n = len(drive.joints)
    shape = np.zeros((time.size, n))
    for i in range(n):
        times, places = [0.0], [0.0]
        while times[-1] < time[-1]:
            speed = np.exp(rng.uniform(np.log(0.03), np.log(0.5)))
            length = min(speed * rng.uniform(0.8, 2.0), 0.5)
            places.append(-np.sign(places[-1] or rng.choice([-1.0, 1.0])) * 0.5 * length)
            times.append(times[-1] + max(abs(places[-1] - places[-2]) / speed, 0.3))
            if rng.random() < 0.35:
                places.append(places[-1])
                times.append(times[-1] + rng.uniform(0.3, 0.7))
        shape[:, i] = smooth(np.interp(time, times, places), 0.08)
    return shape


def reaching(time: Array, drive: Drive, rng: np.random.Generator) -> Array:
    """Slow reaches with all joints together, as a task would ask for."""
    return _moves(time, drive, rng, duration=(1.2, 2.5), rest=(0.1, 0.6), together=True)


def _tones(time: Array, tones: Array, sizes: Array, rng: np.random.Generator) -> Array:
    phases = rng.uniform(0, 2 * np.pi, tones.size)
    return np.asarray((sizes * np.sin(2 * np.pi * np.outer(time, tones) + phases)).sum(axis=1))


def _moves(
    time: Array,
    drive: Drive,
    rng: np.random.Generator,
    duration: tuple[float, float],
    rest: tuple[float, float],
    together: bool = False,
) -> Array:
    n = len(drive.joints)
    shape = np.zeros((time.size, n))
    clock, here = 0.5, np.zeros(n)
    while clock < time[-1]:
        takes = rng.uniform(*duration) * np.ones(n) if together else rng.uniform(*duration, n)
        there = rng.uniform(-0.45, 0.45, n)
        part = np.clip((time[:, None] - clock) / takes, 0.0, 1.0)
        jerkless = part**3 * (10 - 15 * part + 6 * part**2)
        shape = np.where(time[:, None] >= clock, here + (there - here) * jerkless, shape)
        clock += float(takes.max()) + rng.uniform(*rest)
        here = there
    return shape


def smooth(values: Array, width: float) -> Array:
    """Rounds corners over ``width`` [s] by two running means."""
    half = round(width * RATE / 2)
    kernel = np.ones(2 * half + 1) / (2 * half + 1)
    for _ in range(2):
        values = np.convolve(np.pad(values, half, mode="edge"), kernel, mode="valid")
    return values


def fade_in(time: Array) -> Array:
    """Grows smoothly from 0 to 1 over the first second."""
    part = np.clip(time / FADE, 0.0, 1.0)
    return np.asarray(part**3 * (10 - 15 * part + 6 * part**2))


RICH: dict[str, Shape] = {
    "multisine": multisine,
    "fourier": fourier,
    "point_to_point": point_to_point,
    "ramps": ramps,
    "reaching": reaching,
}


def inverse_dynamics(model: mujoco.MjModel, q: Array, v: Array, a: Array) -> Array:
    """Returns the joint torques (samples, n) [N.m] of a rigid arm."""
    data = mujoco.MjData(model)
    torque = np.zeros(q.shape)
    for k in range(q.shape[0]):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, torque[k])
    return torque


def choose_centre(model: mujoco.MjModel, drive: Drive, rng: np.random.Generator) -> Array:
    """Returns a posture (n,) in the middle of the ranges where the arm's weight leaves torque for motion."""
    middle = 0.5 * (drive.position_min + drive.position_max)
    reach = np.minimum(0.3 * (drive.position_max - drive.position_min), 0.9)
    while True:
        centre = middle + reach * rng.uniform(-1, 1, middle.size)
        still = np.zeros((1, centre.size))
        weight = inverse_dynamics(model, centre[None], still, still)[0]
        if np.all(np.abs(weight) < 0.6 * drive.effort_max):
            return centre


def rich_motion(
    shape: Shape, seconds: float, model: mujoco.MjModel, drive: Drive, rng: np.random.Generator
) -> Motion:
    """Draws a motion around a random posture, as large as range, speed (70 %) and torque (90 %) allow."""
    while True:
        deviation, centre = _within_range(shape, seconds, model, drive, rng)
        for scale in (1.0, 0.85, 0.7):
            motion = _with_feed_forward(centre + scale * deviation, model, drive)
            if np.all(motion.peak <= 0.9 * drive.effort_max):
                return motion


def _within_range(
    shape: Shape, seconds: float, model: mujoco.MjModel, drive: Drive, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Returns a deviation (samples, n) that keeps to range and speed around a posture (n,), and that posture."""
    time = np.arange(round(seconds * RATE)) / RATE
    centre = choose_centre(model, drive, rng)
    deviation = shape(time, drive, rng)
    deviation = (deviation - deviation[0]) * fade_in(time)[:, None]
    room = np.minimum(centre - drive.position_min, drive.position_max - centre) - MARGIN
    size = np.minimum(room, 0.6) / np.maximum(np.abs(deviation).max(axis=0), 1e-9)
    speed = np.abs(np.gradient(deviation, 1 / RATE, axis=0)).max(axis=0)
    return deviation * np.minimum.reduce(
        [size, 0.7 * drive.velocity_max / speed, np.full(size.size, 1.3)]
    ), centre


def poor_motion(
    path: Array, joint: int, centre: Array, model: mujoco.MjModel, drive: Drive, rng: np.random.Generator
) -> Motion:
    """Draws a motion in which one joint follows ``path`` (samples,) about its ``centre``.

    The others sway by a tenth of a radian so that they can be judged at all.
    """
    time = np.arange(path.size) / RATE
    deviation = np.zeros((time.size, centre.size))
    for i in range(centre.size):
        phase = rng.uniform(0, 2 * np.pi)
        sway = np.sin(2 * np.pi * rng.uniform(0.15, 0.3) * time + phase) - np.sin(phase)
        deviation[:, i] = 0.1 * sway * fade_in(time)
    deviation[:, joint] = path
    return _with_feed_forward(centre + deviation, model, drive)


def _with_feed_forward(q: Array, model: mujoco.MjModel, drive: Drive) -> Motion:
    """Returns the motion; its feed-forward leaves out the weight, which the robot carries."""
    v = np.gradient(q, 1 / RATE, axis=0)
    a = np.gradient(v, 1 / RATE, axis=0)
    few = slice(None, None, 10)
    torque = inverse_dynamics(model, q[few], v[few], a[few])
    weight = inverse_dynamics(model, q[few], 0 * q[few], 0 * q[few])
    rotor = drive.rotor_inertia * a[few] + drive.motor_damping * v[few]
    coarse = np.arange(q.shape[0])[few]
    moving = torque - weight + rotor
    every = np.arange(q.shape[0])
    ahead = np.stack([np.interp(every, coarse, moving[:, i]) for i in range(q.shape[1])], axis=1)
    peak, heaviest = (np.abs(one).max(axis=0) for one in (torque + rotor, weight))
    return Motion(q, v, ahead, peak, heaviest)


def one_speed(time: Array, rng: np.random.Generator) -> Array:
    """Back and forth at one speed, without a rest."""
    speed, period = rng.uniform(0.1, 0.2), rng.uniform(4.0, 6.0)
    return _triangle(time + 0.25 * period, period, speed)


def one_speed_small(time: Array, rng: np.random.Generator) -> Array:
    """As `one_speed`, so small that the arm's weight hardly changes."""
    return _triangle(time + rng.uniform(0.0, 0.5), rng.uniform(0.8, 1.2), 0.08)


def one_way(time: Array, rng: np.random.Generator) -> Array:
    """Creeps in one direction from before the first sample until after the last."""
    return np.asarray(rng.uniform(0.02, 0.03) * (time - 0.5 * time[-1]) * rng.choice([-1.0, 1.0]))


def held(time: Array, rng: np.random.Generator) -> Array:  # noqa: ARG001
    """Does not move."""
    return np.zeros(time.size)


def slow_tone(time: Array, rng: np.random.Generator) -> Array:
    """One slow sinusoid."""
    return np.asarray(0.45 * fade_in(time) * np.sin(2 * np.pi * rng.uniform(0.2, 0.35) * time))


def _triangle(time: Array, period: float, speed: float) -> Array:
    part = (time / period) % 1.0
    wave = 4 * np.abs(part - 0.5) - 1.0
    return smooth(wave * speed * period / 4, 0.06)
