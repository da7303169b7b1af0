# SPDX-License-Identifier: BSD-3-Clause
r"""Small motions of elastic joints between two control samples, exactly: x_k+1 = A x_k + B tau.

    links    M qdd = \tau_s               with \tau_s = K_sea (\theta - q) + D_sea (\theta' - q')
    motors   I_r \theta'' + D \theta' = \tau - \tau_s                         (thesis 3.1-3.3)
    sensed   v_f' = (q' - v_f) / T_f      the robot's own velocity estimate

A joint without a series spring is one body with its rotor; a joint without rotor inertia passes its torque
on unchanged. Links that hold one object together move as q = N y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot import RobotSpec

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Drives:
    """Drives of k joints.

    Attributes:
        spring_stiffness: (k,) K_sea [N.m/rad]; infinite for a rigid joint.
        reflected_inertia: (k,) I_r [kg.m^2].
        motor_damping: (k,) D [N.m.s/rad].
        spring_damping: (k,) D_sea [N.m.s/rad].
    """

    spring_stiffness: Array
    reflected_inertia: Array
    motor_damping: Array
    spring_damping: Array

    @property
    def elastic(self) -> NDArray[np.bool_]:
        """(k,) which joints have a rotor that moves on its own."""
        return np.isfinite(self.spring_stiffness) & (self.reflected_inertia > 0.0)

    @property
    def rigid(self) -> NDArray[np.bool_]:
        """(k,) which joints are one body with their rotor."""
        return ~np.isfinite(self.spring_stiffness)


@dataclass(frozen=True)
class Sampling:
    """How the controller sees and reaches the robot.

    Attributes:
        rate: [Hz].
        delay_periods: Whole periods from a sample to the start of the period in which its torque acts.
        velocity_filter: Time constant of the velocity estimate [s]; 0 differentiates between samples.
    """

    rate: float
    delay_periods: int
    velocity_filter: float


@dataclass(frozen=True)
class SampledArm:
    """The arm between samples: x_k+1 = A x_k + B tau_k, with what is sensed of x.

    Attributes:
        A: (m, m). B: (m, k) for torques held over the period.
        position: (k, m) reads q from x.
        velocity: (k, m) reads the velocity estimate; None when it is differentiated from positions.
        sampling: Rate and delay.
    """

    A: Array
    B: Array
    position: Array
    velocity: Array | None
    sampling: Sampling


def drives_of(model: RobotModel, joints: NDArray[np.intp]) -> Drives:
    """Collects the drives of some joints of a robot."""
    compliance = model.spring_compliance()[joints]
    with np.errstate(divide="ignore"):
        stiffness = 1.0 / compliance
    return Drives(
        stiffness,
        model.reflected_inertia[joints],
        model.column("motor_damping")[joints],
        model.column("spring_damping")[joints],
    )


def sampling_of(robot: RobotSpec, rate: float) -> Sampling:
    """Takes a robot's delay, rounded up to whole periods, and its velocity filter."""
    # A delay that is a whole number of periods but for rounding is not one period longer.
    periods = int(np.ceil(robot.timing.command_delay * rate - 1e-9))
    return Sampling(rate, periods, robot.sensors.velocity_filter)


def sampled_arm(
    inertia: Array, drives: Drives, sampling: Sampling, motion: Array | None, carried: Array | None
) -> SampledArm:
    """Integrates the linear equations of motion over one period (zero-order hold).

    Args:
        inertia: (k, k) M + I_r at the posture.
        drives: Of the same joints.
        sampling: Rate, delay, filter.
        motion: (k, m) N for arms that hold an object together; None for free arms.
        carried: (m, m) inertia of the object seen in y, E^T Lambda_obj E; None without an object.
    """
    from scipy.linalg import expm  # noqa: PLC0415 - a slow import that only the analysis needs

    N = np.eye(len(inertia)) if motion is None else motion
    system, torque, reads = _first_order(inertia, drives, sampling.velocity_filter, N, carried)
    size, inputs = torque.shape
    generator = np.zeros((size + inputs, size + inputs))
    generator[:size, :size], generator[:size, size:] = system, torque
    step = expm(generator / sampling.rate)
    m = N.shape[1]
    position, velocity = np.zeros((len(N), size)), np.zeros((len(N), size))
    position[:, :m] = N
    velocity[:, reads] = N
    filtered = sampling.velocity_filter > 0.0
    return SampledArm(
        step[:size, :size], step[:size, size:], position, velocity if filtered else None, sampling
    )


def _first_order(
    inertia: Array, drives: Drives, lag: float, N: Array, carried: Array | None
) -> tuple[Array, Array, slice]:
    """Writes x' = S x + T tau for x = (y, theta, y', theta', v_f), with the slice that reads v_f."""
    elastic = drives.elastic
    select = np.eye(len(inertia))[elastic]
    m, e = N.shape[1], int(np.sum(elastic))
    stretch = np.hstack([-select @ N, np.eye(e)])
    spring = drives.spring_stiffness[elastic][:, None] * stretch
    damper = drives.spring_damping[elastic][:, None] * stretch
    rotor = np.where(drives.rigid, drives.reflected_inertia, 0.0)
    links = N.T @ (inertia - np.diag(drives.reflected_inertia - rotor)) @ N
    links = links + (0.0 if carried is None else carried)
    mass = np.zeros((m + e, m + e))
    mass[:m, :m], mass[m:, m:] = links, np.diag(drives.reflected_inertia[elastic])
    friction = np.zeros((m + e, m + e))
    friction[:m, :m] = N.T @ np.diag(np.where(drives.rigid, drives.motor_damping, 0.0)) @ N
    friction[m:, m:] = np.diag(drives.motor_damping[elastic])
    force = np.vstack([N.T @ np.diag(np.where(elastic, 0.0, 1.0)), select])
    solved = np.linalg.solve(mass, np.hstack([-stretch.T @ spring, -stretch.T @ damper - friction, force]))
    n, seen = m + e, m if lag > 0.0 else 0
    system, torque = np.zeros((2 * n + seen, 2 * n + seen)), np.zeros((2 * n + seen, len(inertia)))
    system[:n, n : 2 * n] = np.eye(n)
    system[n : 2 * n, : 2 * n] = solved[:, : 2 * n]
    torque[n : 2 * n] = solved[:, 2 * n :]
    if seen:
        system[2 * n :, n : n + m], system[2 * n :, 2 * n :] = np.eye(m) / lag, -np.eye(m) / lag
        return system, torque, slice(2 * n, 2 * n + m)
    return system, torque, slice(n, n + m)
