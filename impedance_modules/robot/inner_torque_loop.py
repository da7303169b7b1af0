# SPDX-License-Identifier: BSD-3-Clause
r"""A robot's own feedback of joint torque around an elastic joint: what it does to the rotor, and up to which gain.

    motor    \tau_m = u + k (u - H K (\theta - q)),  H: late by the loop's sampling and delay
    rotor    I_r \theta'' + D \theta' = \tau_m - \tau_s                                       (thesis eq. 3.3)
    H = 1    I_r / (1 + k) \theta'' + D / (1 + k) \theta' = u - \tau_s

To whoever commands u, and to the link, the rotor is lighter by 1 + k. A late loop does not only make it lighter. With
u = 0 the drive takes at the link, per torque of frequency w,

    Re Y(w) = Re (1 + k H K / (K + j w B)) / (D + j w I_r)  +  Re j w / (K + j w B)
    H = e^{-j w d} (1 - e^{-j w T}) / (j w T)

K (\theta - q) is measured; B, the spring's own damping, is not. Where Re Y < 0 the drive gives energy, and there is a
passive load, masses and springs, with which it oscillates more and more (Colgate & Hogan 1988). Re Y falls linearly
with k, so that the highest passive gain is the least over w of what the motor and the spring lose, over what k = 1
gives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.spec.robot_spec import InnerTorqueLoopSpec, JointSpec

SLOWEST = 0.1
"""Frequency from which an inner loop is judged [rad/s]; slower ones than the joints' own modes lose energy alone."""

FREQUENCIES = 4000
"""Between the slowest and half the loop's rate, evenly in their logarithm: 0.3 % from one to the next."""


@dataclass(frozen=True)
class LoopTiming:
    """When an inner loop acts.

    Attributes:
        period: Between two samples of the torque, T [s].
        delay: Of the sample, beyond the period for which it acts, d [s]; whole periods.
    """

    period: float
    delay: float


@dataclass(frozen=True)
class PassiveGain:
    """Up to which gain every joint is passive.

    Attributes:
        joint: Name of the joint that allows least.
        gain: k up to which its Re Y >= 0 [1]; infinite where nothing ever gives energy.
        frequency: Where that joint would give energy first [rad/s].
    """

    joint: str
    gain: float
    frequency: float


def loop_delay(loop: InnerTorqueLoopSpec, period: float) -> int:
    """Counts the whole loops by which the measured torque is late; rounds up."""
    return math.ceil(loop.delay / period - 1e-9)


def admittance(joint: JointSpec, gain: float, timing: LoopTiming, frequency: Array) -> Array:
    """Computes Y of a drive at its link: how fast it yields per torque, u = 0, (m,) complex [rad/s/(N.m)].

    Args:
        joint: Elastic, with a rotor.
        gain: Of the inner loop; 0 is none.
        timing: Of it.
        frequency: (m,) above 0 [rad/s].
    """
    s, K, B = 1j * frequency, _spring(joint), joint.spring_damping
    late = np.exp(-s * timing.delay) * -np.expm1(-s * timing.period) / (s * timing.period)
    rotor = (1.0 + gain * late * K / (K + s * B)) / (joint.motor_damping + s * joint.reflected_inertia)
    return np.asarray(rotor + s / (K + s * B))


def highest_passive_gain(joints: Sequence[JointSpec], timing: LoopTiming) -> PassiveGain:
    """Finds the joint that allows the least gain.

    Args:
        joints: Elastic, with rotors; at least one.
        timing: Of their loops.
    """
    return min((_passive_gain(joint, timing) for joint in joints), key=lambda found: found.gain)


def _passive_gain(joint: JointSpec, timing: LoopTiming) -> PassiveGain:
    frequency = np.geomspace(SLOWEST, math.pi / timing.period, FREQUENCIES)
    without = admittance(joint, 0.0, timing, frequency).real
    gives = without - admittance(joint, 1.0, timing, frequency).real
    allowed = np.divide(without, gives, out=np.full(FREQUENCIES, np.inf), where=gives > 0.0)
    least = int(np.argmin(allowed))
    return PassiveGain(joint.name, float(allowed[least]), float(frequency[least]))


def _spring(joint: JointSpec) -> float:
    """Gives K [N.m/rad]; a rigid joint has none that a loop could measure."""
    return math.inf if joint.spring_stiffness is None else joint.spring_stiffness
