# SPDX-License-Identifier: BSD-3-Clause
r"""The torque of a stop: per joint a spring whose anchor follows the motor slowly; it takes energy and returns none.

    \tau_k = -K x_k,    x_k = e^{-h / T} x_{k-1} + (\theta_k - \theta_{k-1}),    x = 0 when the stop begins

x is the spring's deflection [rad], \theta the motor's position (``motor_port``), h the control period, T the time in
which the anchor follows. Fast motion meets a spring K, slow motion a damper K T, and nothing pulls the joint back to a
place (Maxwell's element). The position is read, not the velocity: no filter of the robot lies in this loop, and
the motor is where the torque acts, so the swinging of motor against link is not fed.

Why it always calms. A spring that is sampled every h and acts d periods later pushes a little too long at every turn
of the motion. The motor's own viscous damping B takes that energy away at every frequency, and the joint with its
brake is passive, if (Colgate and Schenkel 1997, with the delay in H)

    B  >  sup_\phi  h / (2 (1 - cos \phi)) Re{(1 - e^{-j \phi}) H(e^{j \phi})},
    H(z) = K z^{-d} (1 - z^{-1}) / (1 - e^{-h/T} z^{-1})

and the right side is at most K h (d + 1) for every T. A lag or delay T_u that nobody told the controller adds at most
K T_u, and a motor that gives g times the torque multiplies all of it. Hence

    K = B / (g (h (d + 1) + T_u))

Springs, links, weight that the robot carries, surfaces, a held object: whatever lies behind the motor is passive,
at any posture and speed, so kinetic plus spring energy never grows, but for what the sensors' errors add. Where a motor
has no damping that one may count on, or is a torque source without a rotor, K is 0: the stop sends zero torque.
Source: J. E. Colgate and G. G. Schenkel, "Passivity of a class of sampled-data systems: application to haptic
interfaces", Journal of Robotic Systems 14(1), 1997.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Record, Vector

LARGEST_GAIN = 1.8
"""A motor may give this many times the torque it is asked for, and the brake still calms."""

UNKNOWN_DELAY = 0.02
"""Delay and lag in sum that the robot file does not know of, and the brake still calms [s]."""


@dataclass(frozen=True)
class BrakeGains:
    """Constants of the brakes of n joints.

    Attributes:
        stiffness: (n,) K [N.m/rad]; 0 where no brake is stable.
        relaxation: (n,) T [s].
    """

    stiffness: Vector
    relaxation: Vector


def brake_gains(motor_damping: Vector, inertia: Vector, period: float, delay: int) -> BrakeGains:
    r"""Gives each joint the stiffest brake that always calms, and the relaxation that then calms soonest.

    K as above. A body of inertia M on this brake has M T s^2 + (M + B T) s + B + K T = 0, with a double root for

        T = M / (B + 2 sqrt(M K))

    A lighter body decays faster than that root, so M is the largest the joint ever moves.

    Args:
        motor_damping: (n,) B, viscous damping of the motors; 0 where it cannot be counted on [N.m.s/rad].
        inertia: (n,) largest inertia about the joint, rotor included [kg.m^2].
        period: Control period [s].
        delay: Whole periods from a sample to its torque.
    """
    stiffness = motor_damping / (LARGEST_GAIN * (period * (delay + 1) + UNKNOWN_DELAY))
    resistance = motor_damping + 2.0 * np.sqrt(inertia * stiffness)
    relaxation = np.divide(inertia, resistance, out=np.full(inertia.size, period), where=resistance > 0.0)
    return BrakeGains(stiffness, relaxation)


class Brake(Record):
    """The brakes of n joints.

    Attributes:
        stiffness: (n,) K [N.m/rad].
        kept: (n,) e^{-h/T}, the part of a deflection that is left after a period.
        deflection: (n,) x [rad].
        motor_position: (n,) of the last sample [rad].
        effort_max: (n,) [N.m].
    """

    stiffness: Vector
    kept: Vector
    deflection: Vector
    motor_position: Vector
    effort_max: Vector


def make_brake(gains: BrakeGains, period: float, effort_max: Vector) -> Brake:
    """Makes brakes at rest for a control period [s] and torque limits (n,) [N.m]."""
    n = effort_max.size
    return Brake(
        stiffness=gains.stiffness.copy(),
        kept=np.exp(-period / gains.relaxation),
        deflection=np.zeros(n),
        motor_position=np.zeros(n),
        effort_max=effort_max.copy(),
    )


@compiled
def apply_brake(brake: Brake, motor_position: Vector) -> None:
    """Begins a stop at a motor position (n,) [rad]: no spring is deflected."""
    brake.deflection[:] = 0.0
    brake.motor_position[:] = motor_position


@compiled
def brake_effort(brake: Brake, motor_position: Vector, effort: Vector) -> None:
    """Writes the torque of one period, -K x, within the torque limits.

    Without a new sample the motor position is the last one: the springs relax.

    Args:
        brake: Its springs follow the motors.
        motor_position: (n,) [rad].
        effort: (n,) overwritten [N.m].
    """
    for i in range(effort.size):
        moved = motor_position[i] - brake.motor_position[i]
        brake.motor_position[i] = motor_position[i]
        brake.deflection[i] = brake.kept[i] * brake.deflection[i] + moved
        wanted = -brake.stiffness[i] * brake.deflection[i]
        effort[i] = min(max(wanted, -brake.effort_max[i]), brake.effort_max[i])


@compiled
def slip_to(brake: Brake, effort: Vector) -> None:
    """Moves the anchors to where the springs carry a smaller torque (n,) [N.m], the one that leaves.

    What a limit takes away from a spring's torque is so lost for good, and a limit that opens again gives nothing back.
    """
    for i in range(effort.size):
        if brake.stiffness[i] > 0.0:
            brake.deflection[i] = -effort[i] / brake.stiffness[i]


def trusted_motor_damping(motor_damping: Vector, reflected_inertia: Vector) -> Vector:
    """The damping that stands at the motors (n,) [N.m.s/rad]: 0 for a torque source, which has no rotor to damp."""
    return np.where(reflected_inertia > 0.0, motor_damping, 0.0)
