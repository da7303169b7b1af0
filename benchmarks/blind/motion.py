# SPDX-License-Identifier: BSD-3-Clause
"""Scales a motion to the arm's limits and adds the feed-forward of the nominal model."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.excitation import RATE, Motion, Shape, fade_in
from benchmarks.blind.arm_model import Drive

Array = NDArray[np.float64]

MARGIN = 0.1
"""Distance [rad] kept from the joint limits."""


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
