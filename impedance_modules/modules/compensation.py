# SPDX-License-Identifier: BSD-3-Clause
r"""One more summand: torque against what was diagnosed, weights and springs, friction, motors that give too little.

    \tau_c = r (a + k q + \tau_w) + \tanh(v_d / v_0) (F(|v_d|) + \mu |load|)
    command = \tau + \tau_c + (1 / s - 1) (\tau + \tau_c + carried)

The first bracket is the gradient of an energy, relaxed by the spring scale r like every spring:

    U_c = \sum_joints (top - a q - k q^2 / 2) + U_w        tau = -dU_c/dq,    U_c >= 0

q is kept within the joint's range and a little more, top is the largest of a q + k q^2 / 2 there. Friction is overcome
along the desired velocity v_d, not the measured one: nothing is fed back, nothing shakes at rest, and a task that an
empty tank stops pushes no more. Like the force of a hybrid axis, that torque is in no energy: the tank pays its work. A
motor that gives s times what is asked gives that of the robot's own weight compensation too, the carried torque.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.equilibrium_velocity import EquilibriumVelocity, equilibrium_velocity
from impedance_modules.records import Flag, Matrix, Record, Scalar, Vector

COMPENSATION = "compensation"
"""Name of this summand among the modules."""


class Compensation(Record):
    """What is compensated, n joints, and the torque for it.

    Attributes:
        active: Whether anything is.
        motion: The desired velocity.
        lower, upper: (n,) range within which the joints' potentials change [rad].
        offset, stiffness: (n,) a [N.m] and k [N.m/rad].
        top: (n,) largest a q + k q^2 / 2 within the range [J].
        ahead, back: (n, speeds) F in either direction, at v_max (k / (speeds - 1))^2 [N.m].
        fastest: (n,) v_max of these tables [rad/s].
        regularisation: (n,) v_0 [rad/s].
        per_load: (n,) mu [1].
        inverse_gain: (n,) 1 / s.
        weight: (n,) torque that holds weight beyond the description, at the state [N.m].
        weight_energy: U_w at the state, never negative [J].
        carried: (n,) torque that the robot adds by itself at the state [N.m].
        held: (n,) last torque with a potential, relaxed [N.m].
        friction: (n,) last torque against friction [N.m].
        effort: (n,) all that was added to the other modules [N.m].
    """

    active: Flag
    motion: EquilibriumVelocity
    lower: Vector
    upper: Vector
    offset: Vector
    stiffness: Vector
    top: Vector
    ahead: Matrix
    back: Matrix
    fastest: Vector
    regularisation: Vector
    per_load: Vector
    inverse_gain: Vector
    weight: Vector
    weight_energy: Scalar = 0.0
    carried: Vector
    held: Vector
    friction: Vector
    effort: Vector


def no_compensation(n: int) -> Compensation:
    """Compensates nothing, on n joints."""
    return Compensation(
        active=False,
        motion=equilibrium_velocity(0, n, 1.0),
        lower=np.zeros(n),
        upper=np.zeros(n),
        offset=np.zeros(n),
        stiffness=np.zeros(n),
        top=np.zeros(n),
        ahead=np.zeros((n, 2)),
        back=np.zeros((n, 2)),
        fastest=np.ones(n),
        regularisation=np.ones(n),
        per_load=np.zeros(n),
        inverse_gain=np.ones(n),
        weight=np.zeros(n),
        carried=np.zeros(n),
        held=np.zeros(n),
        friction=np.zeros(n),
        effort=np.zeros(n),
    )


@compiled
def compensation_energy(found: Compensation, q: Array) -> float:
    """Returns U_c at positions q (n,) [rad], the weight's part as it was at the state: never negative [J]."""
    total = found.weight_energy
    for j in range(q.size):
        x = min(max(q[j], found.lower[j]), found.upper[j])
        total += found.top[j] - (found.offset[j] + 0.5 * found.stiffness[j] * x) * x
    return total


@compiled
def compensate(found: Compensation, others: Array, q: Array, scale: float) -> None:
    """Writes what is added to the other modules into ``effort``.

    Args:
        found: Its weight, carried torque and desired velocity are those of the state.
        others: (n,) sum of all other modules [N.m].
        q: (n,) [rad].
        scale: r in [0, 1].
    """
    for j in range(q.size):
        held = found.weight[j]
        if found.lower[j] <= q[j] <= found.upper[j]:
            held += found.offset[j] + found.stiffness[j] * q[j]
        found.held[j] = scale * held
        load = abs(others[j] + found.held[j] + found.carried[j])
        found.friction[j] = _friction(found, j, found.motion.velocity[j], load)
        added = found.held[j] + found.friction[j]
        asked = others[j] + added + found.carried[j]
        found.effort[j] = added + (found.inverse_gain[j] - 1.0) * asked


@compiled
def _friction(found: Compensation, j: int, velocity: float, load: float) -> float:
    """Returns the torque (N.m) that overcomes joint j's friction at a desired velocity [rad/s] under a load [N.m]."""
    last = found.ahead.shape[1] - 1
    place = min(math.sqrt(abs(velocity) / found.fastest[j]), 1.0) * last
    k = min(int(place), last - 1)
    part = place - k
    table = found.ahead if velocity >= 0.0 else found.back
    size = table[j, k] + part * (table[j, k + 1] - table[j, k]) + found.per_load[j] * load
    return math.tanh(velocity / found.regularisation[j]) * float(size)
