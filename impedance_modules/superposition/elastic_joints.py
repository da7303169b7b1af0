# SPDX-License-Identifier: BSD-3-Clause
r"""Small motions of elastic joints between two control samples, exactly: x_k+1 = A x_k + B \tau_k.

    links    M qdd = \tau_s               with \tau_s = K_sea (\theta - q) + D_sea (\theta' - q')
    motors   I_r \theta'' + D \theta' = \tau - \tau_s                         (thesis 3.1-3.3)
    sensed   v <- v + (1 - exp(-T / T_f)) ((q_k - q_k-1) / T - v)     in the robot's own loop of period T

    inner    \tau <- (1 + k) \tau - k K_sea (\theta - q), sampled likewise      (``robot/inner_torque_loop.py``)

A joint without a series spring is one body with its rotor; a joint without rotor inertia passes its torque
on unchanged. Links that hold one object together move as q = N y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.robot.inner_torque_loop import loop_delay
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import ROBOT_LOOP_PERIOD, InnerTorqueLoopSpec, RobotSpec

TAYLOR_TERMS = 14
"""Of the exponential of a matrix of norm 1/4: the first that is left out is below 1e-19."""


@dataclass(frozen=True)
class Drives:
    """Drives of k joints.

    Attributes:
        spring_stiffness: (k,) K_sea [N.m/rad]; infinite for a rigid joint.
        reflected_inertia: (k,) I_r [kg.m^2].
        motor_damping: (k,) D [N.m.s/rad].
        spring_damping: (k,) D_sea [N.m.s/rad].
        inner_loop: The robot's own torque loop around them, all elastic then; None without.
        encoder_at_motor: (k,) whose reported position is the motor's; None for none.
    """

    spring_stiffness: Array
    reflected_inertia: Array
    motor_damping: Array
    spring_damping: Array
    inner_loop: InnerTorqueLoopSpec | None = None
    encoder_at_motor: NDArray[np.bool_] | None = None

    @property
    def apparent_inertia(self) -> Array:
        """(k,) I_r as a commanded torque meets it, I_r / (1 + gain) [kg.m^2]."""
        loop = self.inner_loop
        return self.reflected_inertia if loop is None else self.reflected_inertia / loop.lighter

    @property
    def elastic(self) -> NDArray[np.bool_]:
        """(k,) which joints have a rotor that moves on its own."""
        return np.isfinite(self.spring_stiffness) & (self.reflected_inertia > 0.0)

    @property
    def rigid(self) -> NDArray[np.bool_]:
        """(k,) which joints are one body with their rotor."""
        return ~np.isfinite(self.spring_stiffness) & (self.reflected_inertia > 0.0)

    @property
    def reads_rotor(self) -> NDArray[np.bool_]:
        """(k,) which joints report a rotor that moves on its own, and not the link."""
        return self.elastic & (False if self.encoder_at_motor is None else self.encoder_at_motor)


@dataclass(frozen=True)
class Sampling:
    """How the controller sees and reaches the robot.

    Attributes:
        rate: Of the controller [Hz].
        delay_periods: Whole periods from a sample to the start of the period in which its torque acts.
        robot_loops: Loops of the robot's own estimator per period.
        velocity_filter: Time constant of its velocity estimate [s]; 0 differentiates.
        motor_side: The controller's dampers act on the motors' velocity (``modules.motor_velocity``),
            not on the links'.
    """

    rate: float
    delay_periods: int
    robot_loops: int
    velocity_filter: float
    motor_side: bool


@dataclass(frozen=True)
class SampledArm:
    """The arm between samples, with what the robot reports of it.

    Attributes:
        A: (m, m) one control period without torque.
        B: (m, k) adds torques held over the period.
        position: (k, m) reads the reported q.
        velocity: (k, m) reads the velocity that the controller damps.
        sampling: Rate and delay.
    """

    A: Array
    B: Array
    position: Array
    velocity: Array
    sampling: Sampling


def drives_of(model: RobotModel, joints: NDArray[np.intp]) -> Drives:
    """Collects the drives of some joints of a robot."""
    compliance = model.spring_compliance()[joints]
    with np.errstate(divide="ignore"):
        stiffness = 1.0 / compliance
    return Drives(
        stiffness,
        model.rotor_inertia[joints],
        model.column("motor_damping")[joints],
        model.column("spring_damping")[joints],
        model.spec.inner_torque_loop,
        model.encoder_at_motor[joints],
    )


def sampling_of(robot: RobotSpec, rate: float, motor_side: bool) -> Sampling:
    """Takes a robot's delay, rounded up to whole periods, its own whole loops per period, and its estimate's lag."""
    delay, loops = robot.timing.command_delay * rate, 1.0 / (ROBOT_LOOP_PERIOD * rate)
    return Sampling(rate, _whole(delay), max(1, _whole(loops)), robot.sensors.velocity_filter, motor_side)


def _whole(ratio: float) -> int:
    """Rounds up; a ratio that is whole but for rounding stays."""
    return math.ceil(ratio - 1e-9)


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
    N = np.eye(len(inertia)) if motion is None else motion
    system, torque = _first_order(inertia, drives, N, carried)
    size, k = torque.shape
    period = 1.0 / (sampling.rate * sampling.robot_loops)
    generator = np.zeros((size + k, size + k))
    generator[:size, :size], generator[:size, size:] = system, torque
    step = _exponential(generator * period)
    own, push = step[:size, :size], step[:size, size:]
    if drives.inner_loop is not None:
        own, push = _with_inner_loop(
            drives.inner_loop, own, push, _spring_torque(drives, N, len(own)), period
        )
    size = len(own)
    read = _read_positions(drives, N, size)
    loop, push = _with_estimate(own, push, read, period, sampling.velocity_filter)
    A, B = np.eye(len(loop)), np.zeros_like(push)
    for _ in range(sampling.robot_loops):
        A, B = loop @ A, loop @ B + push
    reads = np.eye(len(loop))
    arm = SampledArm(A, B, reads[size : size + k], reads[size + k :], sampling)
    return _on_motor_side(arm, drives, N) if sampling.motor_side else arm


def _read_positions(drives: Drives, N: Array, size: int) -> Array:
    """Gives the rows (k, size) that read what the encoders report from the state: N y, or the rotor's theta."""
    m, elastic = N.shape[1], drives.elastic
    read = np.zeros((len(N), size))
    read[:, :m] = N
    at_motor = np.flatnonzero(drives.reads_rotor)
    read[at_motor] = 0.0
    read[at_motor, m + np.cumsum(elastic)[at_motor] - 1] = 1.0
    return read


def _spring_torque(drives: Drives, N: Array, size: int) -> Array:
    """Gives the rows (k, size) that read the torques in the joints' springs, K (theta - N y), from the state."""
    k = len(N)
    measured = np.zeros((k, size))
    measured[:, : N.shape[1] + k] = drives.spring_stiffness[:, None] * np.hstack([-N, np.eye(k)])
    return measured


def _with_inner_loop(
    loop: InnerTorqueLoopSpec, step: Array, push: Array, measured: Array, period: float
) -> tuple[Array, Array]:
    """Closes the drives' own torque loop; torques that were measured and are still under way join the state."""
    (k, size), late = measured.shape, loop_delay(loop, period)
    if late == 0:
        return step - loop.gain * push @ measured, loop.lighter * push
    closed = np.zeros((size + k * late, size + k * late))
    closed[:size, :size] = step
    closed[:size, size : size + k] = -loop.gain * push
    closed[size:-k, size + k :] = np.eye(k * (late - 1))
    closed[-k:, :size] = measured
    return closed, np.vstack([loop.lighter * push, np.zeros((k * late, k))])


def _exponential(matrix: Array) -> Array:
    """Computes exp(A) by its Taylor series of A / 2^s, squared s times.

    ``scipy.linalg.expm`` gives the same; importing it takes a fifth of the processor time of ``check``.
    """
    squarings = max(0, math.ceil(math.log2(max(float(np.linalg.norm(matrix, 1)), 1e-300))) + 2)
    scaled = matrix / 2.0**squarings
    found = term = np.eye(len(matrix))
    for order in range(1, TAYLOR_TERMS):
        term = term @ scaled / order
        found = found + term
    for _ in range(squarings):
        found = found @ found
    return found


def _with_estimate(step: Array, push: Array, read: Array, period: float, lag: float) -> tuple[Array, Array]:
    """Adds a filtered derivative of what ``read`` (k, m) reads: the state becomes (x, reading, rate)."""
    size, k = len(step), len(read)
    share = 1.0 - math.exp(-period / lag) if lag > 0.0 else 1.0
    loop = np.zeros((size + 2 * k, size + 2 * k))
    loop[:size, :size] = step
    loop[size : size + k, :size] = read @ step
    loop[size + k :, :size] = share / period * read @ step
    loop[size + k :, size : size + k] = -share / period * np.eye(k)
    loop[size + k :, size + k :] = (1.0 - share) * np.eye(k)
    return loop, np.vstack([push, read @ push, share / period * read @ push])


def _on_motor_side(arm: SampledArm, drives: Drives, N: Array) -> SampledArm:
    r"""Adds the rate of the springs' deflection \theta - q to the velocity that is damped, where it lacks it.

    The effort sensor sees the spring's deflection, not its damping: effort / K_sea = \theta - q.
    """
    elastic, m = drives.elastic, N.shape[1]
    e, k, size = int(np.sum(elastic)), len(elastic), len(arm.A)
    select = np.eye(k)[:, elastic]
    deflect = np.hstack([-np.diag(elastic.astype(float)) @ N, select])
    deflect[drives.reads_rotor] = 0.0
    deflection = np.zeros((k, size))
    deflection[:, : m + e] = deflect
    sampling = arm.sampling
    A, B = _with_estimate(arm.A, arm.B, deflection, 1.0 / sampling.rate, sampling.velocity_filter)
    position, velocity = (np.hstack([read, np.zeros((k, 2 * k))]) for read in (arm.position, arm.velocity))
    velocity[:, size + k :] = np.eye(k)
    return SampledArm(A, B, position, velocity, sampling)


def _first_order(inertia: Array, drives: Drives, N: Array, carried: Array | None) -> tuple[Array, Array]:
    """Writes x' = S x + T tau for x = (y, theta, y', theta') of links and free rotors."""
    mass, stiffness, damping, force = _second_order(inertia, drives, N, carried)
    n = len(mass)
    solved = np.linalg.solve(mass, np.hstack([-stiffness, -damping, force]))
    system = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), solved[:, : 2 * n]])
    return system, np.vstack([np.zeros((n, len(inertia))), solved[:, 2 * n :]])


def _second_order(
    inertia: Array, drives: Drives, N: Array, carried: Array | None
) -> tuple[Array, Array, Array, Array]:
    """Writes mass, stiffness and damping of (y, theta), and where the torques act."""
    elastic, rigid = drives.elastic, drives.rigid
    select = np.eye(len(inertia))[elastic]
    m, e = N.shape[1], len(select)
    deflect = np.hstack([-select @ N, np.eye(e)])
    stiffness = deflect.T @ (drives.spring_stiffness[elastic][:, None] * deflect)
    damping = deflect.T @ (drives.spring_damping[elastic][:, None] * deflect)
    damping[:m, :m] += N.T @ np.diag(np.where(rigid, drives.motor_damping, 0.0)) @ N
    damping[m:, m:] += np.diag(drives.motor_damping[elastic])
    # Rotors on springs move on their own; those of rigid joints stay with the links.
    links = inertia - np.diag(np.where(rigid, 0.0, drives.apparent_inertia))
    mass = np.zeros((m + e, m + e))
    mass[:m, :m] = N.T @ links @ N + (0.0 if carried is None else carried)
    mass[m:, m:] = np.diag(drives.reflected_inertia[elastic])
    force = np.vstack([N.T @ np.diag(np.where(elastic, 0.0, 1.0)), select])
    return mass, stiffness, damping, force
