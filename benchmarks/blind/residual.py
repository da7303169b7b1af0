# SPDX-License-Identifier: BSD-3-Clause
"""What the nominal arm leaves unexplained in a log: the scale that sizes effects against the noise.

Actuator: command(t - delay) + g(q) - I theta'' - D theta' - tau - B tau' / K,   theta = q + tau / K;
link: tau + B tau' / K - (M q'' + C + g): the spring's damping is not sensed;
velocity: v + T v' - q'. All behind one zero-phase low-pass.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.arm_model import Drive, Inertial, Link
from benchmarks.blind.excitation import inverse_dynamics
from benchmarks.blind.plant import rigid_model

Array = NDArray[np.float64]

BAND = 8.0
RATE = 100.0
CUT = 40
"""Samples left out at each end, where the filter does not know what comes."""
FEW = 5
"""Every fifth sample is kept: behind the filter they are about independent."""


def residual(columns: Mapping[str, Array], drive: Drive, model: mujoco.MjModel) -> Array:
    """Returns (3, samples, n): actuator and link [N.m], velocity [rad/s]."""
    period = float(np.median(np.diff(columns["time"])))
    q, tau = low_pass(columns["position"]), low_pass(columns["effort"])
    v, a = _rate(q, period), _rate(_rate(q, period), period)
    still = np.zeros_like(q)
    theta = q + tau / drive.spring_stiffness
    late = _shift(columns["effort_command"], drive.command_delay + 0.0005)
    weight = inverse_dynamics(model, columns["position"], still, still)
    motor = low_pass(late + weight) - drive.rotor_inertia * _rate(_rate(theta, period), period)
    motor -= drive.motor_damping * _rate(theta, period) + tau
    twist = _rate(tau, period) / drive.spring_stiffness
    link = tau + drive.spring_damping * twist - inverse_dynamics(model, q, v, a)
    motor -= drive.spring_damping * twist
    told = low_pass(columns["velocity"])
    speed = told + drive.velocity_filter * _rate(told, period) - v
    return np.stack([motor, link, speed])[:, CUT:-CUT:FEW]


def inertia_columns(columns: Mapping[str, Array], links: tuple[Link, ...], side: str, error: float) -> Array:
    """Returns (samples, n, p): change of the link residual for one standard error of each inertial number."""
    q = low_pass(columns["position"])
    v, a = _rate(q)[CUT:-CUT:FEW], _rate(_rate(q))[CUT:-CUT:FEW]
    q = q[CUT:-CUT:FEW]
    base = inverse_dynamics(rigid_model(links, side), q, v, a)
    found = []
    for at, link in enumerate(links):
        for changed in _variants(link.inertial, error):
            varied = (*links[:at], replace(link, inertial=changed), *links[at + 1 :])
            found.append(inverse_dynamics(rigid_model(varied, side), q, v, a) - base)
    return np.stack(found, axis=-1)


def net_of_inertias(link: Array, noise: Array, columns: Array) -> Array:
    """Returns the link residual (samples, n) in units of noise, less what plausible inertias can imitate."""
    white = (link / noise).reshape(-1)
    basis = (columns / noise[None, :, None]).reshape(white.size, -1)
    gram = basis.T @ basis + np.eye(basis.shape[1])
    return np.asarray((white - basis @ np.linalg.solve(gram, basis.T @ white)).reshape(link.shape))


def low_pass(values: Array) -> Array:
    """Removes what is faster than 8 Hz, without delay."""
    return np.asarray(sosfiltfilt(butter(3, BAND, fs=RATE, output="sos"), values, axis=0))


def _variants(inertial: Inertial | None, error: float) -> list[Inertial]:
    if inertial is None or inertial.mass < 0.01:
        return []
    found = [replace(inertial, mass=inertial.mass * (1 + error), inertia=inertial.inertia * (1 + error))]
    reach = error * float(np.linalg.norm(inertial.com))
    found += [replace(inertial, com=inertial.com + reach * axis) for axis in np.eye(3)]
    found += [replace(inertial, inertia=inertial.inertia * (1 + error))]
    return found


def _rate(values: Array, period: float = 1 / RATE) -> Array:
    """Derivative by central differences of the eighth order, which bend nothing below 8 Hz."""
    padded = np.pad(values, ((4, 4), (0, 0)), mode="edge")
    total, last = np.zeros_like(values), padded.shape[0]
    for reach, weight in enumerate((4 / 5, -1 / 5, 4 / 105, -1 / 280), start=1):
        total += weight * (padded[4 + reach : last - 4 + reach] - padded[4 - reach : last - 4 - reach])
    return np.asarray(total / period)


def _shift(values: Array, delay: float) -> Array:
    time = np.arange(values.shape[0]) / RATE
    return np.stack([np.interp(time - delay, time, column) for column in values.T], axis=1)
