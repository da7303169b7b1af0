# SPDX-License-Identifier: BSD-3-Clause
r"""The energy tank: a ledger of what the controller may still spend beyond the potential of its springs.

The controller's port is the motor side of the joints (``motor_port.py``). Against any environment

    integral of tau_applied . dtheta  <=  T_0 + U_0 - r U                                        (claim)

T is the tank's level, U the potential of the declared springs and joint bias, r the spring scale. A cycle takes

1. ``measure``: book the work of the last interval;
2. ``budget``, ``change_cost``, ``admit``: move equilibria and gains as far as the tank can pay;
3. ``rescale_springs``: relax the springs if the tank alone is below its floor, tighten them again later;
4. ``limit_to_budget``: scale the torque until the tank can answer for all that it may spend.

A cycle without a usable state takes ``missed``. T + r U changes by the measured work alone, and by what is charged
or spilled. Proof: docs/passivity.md. Source: design section 4, "Passivity".
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Flag, Integer, Matrix, Record, Scalar, Vector
from impedance_modules.safety.motor_port import absolute_dot, motor_position
from impedance_modules.safety.tank_settings import TankSettings

DEVIATIONS = 6.0
"""Of the accumulated error of white sensors that are charged: exceeded by one run in a thousand million."""

ROUNDING = 1e-9
"""Relative tolerance of the overspeed test [-]."""


class Tank(Record):
    """The ledger: constants of the run as in ``TankSettings``, and what has been booked so far.

    Attributes:
        initial, max, floor, period, delay, hold, recovery_time, speed_bound, compliance, sensing_error: Constants.
        sensing_deviation: (n,) constant; counts only where ``white`` is true.
            These three are multiplied by ``most_gain``: a torque asked for acts as up to so much more.
        least_gain, most_gain: (n,) constants, ends of the interval of what a motor gives per torque asked for.
        worked: (n,) work of each joint's torque asked for, where it was measured [J].
        done: (n,) that of the last interval [J].
        white: Whether the sensors' error is white.
        level: T, energy that may still be spent [J].
        potential: U of the springs and joint bias as the modules declare it, unscaled, at the last
            measured state and the equilibrium and gains now in force [J].
        spring_scale: r in [0, 1]; springs and joint bias act as r times their declared selves.
        motor_position: (n,) rotor angles of the last measured cycle [rad].
        applied: (n,) torque that acted in the last interval [N.m]; of the last measured one
            in a gap, zero after one that was booked at its worst.
        pending: (d + 1, n) commands issued and not yet over, oldest first [N.m]; the last row is zero
            between ``measure`` and ``limit_to_budget``.
        need: Level above the floor at which the last wanted torque would be paid in full, for ever [J].
        short: In this cycle the tank had to relax the springs, could not tighten them again, or could pay for
            no part of a wanted change.
        starved_time: For how long torque or springs have been reduced without a break [s].
        missed_cycles: Cycles without a state sample since the last one.
        gap_work: What was booked for those cycles [J]; given back when the travel over all of them is seen.
        gap_spread: By how much their torques may have done more work than the last of them on that travel [J].
        initial_energy: T_0 + U_0 [J].
        work: Sum of tau_applied . dtheta as measured (an upper bound over missed cycles) [J].
        charged: Charged so far for what the sensors cannot see [J].
        variance: Of the error in ``work`` since the start, where the sensors' error is white [J^2].
        assumed: The part of ``work`` that was assumed, not measured, in missed cycles that were not made up for [J].
        spilled: Thrown away above the ceiling [J].
    """

    initial: Scalar
    max: Scalar
    floor: Scalar
    period: Scalar
    delay: Integer
    hold: Scalar
    recovery_time: Scalar
    speed_bound: Vector
    compliance: Vector
    sensing_error: Vector
    sensing_deviation: Vector
    least_gain: Vector
    most_gain: Vector
    worked: Vector
    done: Vector
    white: Flag
    level: Scalar
    potential: Scalar = 0.0
    spring_scale: Scalar = 1.0
    motor_position: Vector
    applied: Vector
    pending: Matrix
    need: Scalar = 0.0
    short: Flag = False
    starved_time: Scalar = 0.0
    missed_cycles: Integer = 0
    gap_work: Scalar = 0.0
    gap_spread: Scalar = 0.0
    initial_energy: Scalar
    work: Scalar = 0.0
    charged: Scalar = 0.0
    variance: Scalar = 0.0
    assumed: Scalar = 0.0
    spilled: Scalar = 0.0

    @property
    def work_bound(self) -> float:
        """The certificate: integral of tau_applied . dtheta <= T_0 + U_0 - r U, against any environment [J]."""
        return self.initial_energy - self.spring_scale * self.potential


def make_tank(settings: TankSettings) -> Tank:
    """Makes the ledger of a run; ``fill`` opens it at the first state."""
    n, deviation = settings.speed_bound.size, settings.sensing_deviation
    least, most = settings.gains
    return Tank(
        initial=settings.initial,
        max=settings.max,
        floor=settings.floor,
        period=settings.period,
        delay=settings.delay,
        hold=settings.hold,
        recovery_time=settings.recovery_time,
        speed_bound=most * settings.speed_bound,
        compliance=settings.compliance.copy(),
        sensing_error=most * settings.sensing_error,
        sensing_deviation=np.zeros(n) if deviation is None else most * deviation,
        least_gain=least.copy(),
        most_gain=most.copy(),
        worked=np.zeros(n),
        done=np.zeros(n),
        white=deviation is not None,
        level=settings.initial,
        initial_energy=settings.initial,
        motor_position=np.zeros(n),
        applied=np.zeros(n),
        pending=np.zeros((settings.delay + 1, n)),
    )


@compiled
def fill(tank: Tank, q: Vector, effort: Vector, potential: float) -> None:
    """Opens the ledger before the first command, nothing in flight and nothing booked.

    Args:
        tank: Overwritten, but for its constants.
        q: (n,) first measured link angles [rad].
        effort: (n,) first measured torques [N.m].
        potential: U of the declared springs at that state [J].
    """
    tank.level, tank.potential, tank.spring_scale = tank.initial, potential, 1.0
    for i in range(q.size):
        tank.motor_position[i] = motor_position(q[i], effort[i], tank.compliance[i])
    tank.applied[:] = 0.0
    tank.pending[:] = 0.0
    tank.worked[:] = 0.0
    tank.need, tank.short, tank.starved_time = 0.0, False, 0.0
    tank.missed_cycles, tank.gap_work, tank.gap_spread = 0, 0.0, 0.0
    tank.initial_energy = tank.initial + potential
    tank.work = tank.charged = tank.variance = tank.assumed = tank.spilled = 0.0


@compiled
def measure(tank: Tank, q: Vector, effort: Vector, potential: float) -> int:
    """Books what the last interval cost, at the motor side.

    ``T <- min(T_max, T - [tau_applied . dtheta + r (U - U_last)] - charge)``, see ``sensing_charge``. After missed
    cycles dtheta is the travel over all of them, and what their torques may have done beyond tau_applied on it is
    added (``missed``); what was booked for them comes back. If assuming the worst again, ``|tau_applied| . v_max h``,
    is cheaper, that is done, and ``|tau_before| . e`` charged to end the chain of samples. A motor that gives s times
    what is asked, s constant and somewhere between its ends, has done at most ``max(s_- W_i, s_+ W_i)``, W_i the work
    of joint i's torque asked for so far; what that grows by is booked.

    Args:
        tank: After the last ``limit_to_budget`` or ``missed``.
        q: (n,) link angles measured now [rad], finite.
        effort: (n,) torques between gearbox and link measured now [N.m], finite.
        potential: U now, at the equilibrium and gains of the *last* cycle, unscaled, >= 0 [J].

    Returns:
        The first joint whose rotor moved farther than ``v_max h`` per cycle, beyond the error of both samples; n for
        none.
    """
    n = q.size
    worst, seen, too_fast = 0.0, tank.gap_spread, n
    for i in range(n):
        theta = motor_position(q[i], effort[i], tank.compliance[i])
        travel = theta - tank.motor_position[i]
        allowed = tank.speed_bound[i] * tank.period * (1.0 + tank.missed_cycles) + 2.0 * tank.sensing_error[i]
        if too_fast == n and abs(travel) > allowed / tank.most_gain[i] * (1.0 + ROUNDING):
            too_fast = i
        tank.motor_position[i] = theta
        worst += abs(tank.pending[0, i]) * tank.speed_bound[i] * tank.period
        done = tank.pending[0, i] * travel
        surplus = max(tank.worked[i] + done, 0.0) - max(tank.worked[i], 0.0)
        seen += tank.least_gain[i] * done + (tank.most_gain[i] - tank.least_gain[i]) * surplus
        tank.done[i] = done
    if tank.missed_cycles == 0 or seen <= tank.gap_work + worst:
        work, assumed = seen - tank.gap_work, tank.gap_spread - tank.gap_work
        charge = sensing_charge(tank)
        for i in range(n):
            tank.worked[i] += tank.done[i]
        tank.applied[:] = tank.pending[0]
    else:
        work, assumed = worst, worst
        charge = absolute_dot(tank.applied, tank.sensing_error)
        tank.applied[:] = 0.0
    _book(tank, work, assumed, charge, potential)
    return too_fast


@compiled
def _book(tank: Tank, work: float, assumed: float, charge: float, potential: float) -> None:
    """Takes the cost of a measured interval from the level and ends the gap before it."""
    tank.level -= work + tank.spring_scale * (potential - tank.potential) + charge
    tank.potential = potential
    tank.missed_cycles, tank.gap_work, tank.gap_spread = 0, 0.0, 0.0
    tank.short = False
    tank.work += work
    tank.charged += charge
    tank.assumed += assumed
    _advance(tank.pending)
    tank.pending[-1, :] = 0.0
    _spill(tank)


@compiled
def sensing_charge(tank: Tank) -> float:
    """What an interval costs because rotor angles are measured with an error [J].

    The error in the work so far is ``-sum (tau_k - tau_(k-1)) . error_k``, at most ``sum |tau_k - tau_(k-1)| . e``.
    Where the error is white it is a random walk of variance ``V = sum_ki (change_ki s_i)^2``, and 6 sqrt(V) bound it:
    ``C <- min(C + |change| . e, 6 sqrt(V))``, C the sum of all charges. Adds the interval's part to V.
    """
    charge, variance = 0.0, tank.variance
    for i in range(tank.applied.size):
        change = tank.pending[0, i] - tank.applied[i]
        charge += abs(change) * tank.sensing_error[i]
        deviation = change * tank.sensing_deviation[i]
        variance += deviation * deviation
    if tank.white:
        charge = max(0.0, min(charge, DEVIATIONS * math.sqrt(variance) - tank.charged))
        tank.variance = variance
    return charge


@compiled
def missed(tank: Tank) -> None:
    """Books a cycle without a usable state, or too late to send: the robot keeps its last command one period more.

    Nobody saw the travel, so the worst is booked: ``T <- T - |tau_applied| . v_max h``. Later, ``measure`` knows the
    travel over all missed cycles. Its torques' work is then at most

        sum_k tau_k . dtheta_k  <=  tau_n . sum_k dtheta_k  +  sum_k |tau_k - tau_n| . v_max h

    and the last sum, over m missed cycles, at most ``sum_j j |tau_(j+1) - tau_j| . v_max h``: ``gap_spread``.
    """
    work = absolute_dot(tank.pending[0], tank.speed_bound) * tank.period
    tank.level -= work
    tank.missed_cycles += 1
    tank.gap_work += work
    tank.work += work
    tank.assumed += work
    change = 0.0
    if tank.pending.shape[0] > 1:
        for i in range(tank.speed_bound.size):
            change += abs(tank.pending[1, i] - tank.pending[0, i]) * tank.speed_bound[i] * tank.period
    tank.gap_spread += tank.missed_cycles * change
    _advance(tank.pending)


@compiled
def budget(tank: Tank) -> float:
    """What a change of equilibrium, gain or rest posture may cost: ``max(0, T - floor - need)`` [J].

    What it leaves in the tank still pays the wanted torque in full, so a starved task slows down instead of going
    limp.
    """
    return max(0.0, tank.level - tank.floor - tank.need)


@compiled
def change_cost(tank: Tank, potential: float) -> float:
    """What a new potential at an unmoved robot costs, ``r (U_new - U)``; a refund is negative [J]."""
    return tank.spring_scale * (potential - tank.potential)


@compiled
def admit(tank: Tank, potential: float) -> None:
    """Pays, or takes back, a change of equilibrium or gain at an unmoved robot: ``T <- T - r (U_new - U)``.

    Args:
        tank: After ``measure``.
        potential: U with the change made, unscaled [J]; its ``change_cost`` is at most the ``budget``.
    """
    tank.level -= change_cost(tank, potential)
    tank.potential = potential
    _spill(tank)


@compiled
def rescale_springs(tank: Tank) -> None:
    """Relaxes the springs when the tank alone is below its floor, tightens them when the tank can pay for it.

    An environment that deflects the springs while the torque is limited or late raises U without paying for it.
    With ``b = floor + |tau_applied| . e``: if ``T < b``, ``r <- x r`` and ``T <- T + (1 - x) r U`` with
    ``x = (T + r U - b) / (r U + need)``, so that afterwards ``T = b + x need``: the softer springs can be
    paid. ``T + r U >= b`` always (docs/passivity.md), so x is never negative. Otherwise r climbs to 1, paid
    by what the tank holds above ``floor + need``, with the time constant ``recovery_time``.
    """
    declared = tank.spring_scale * tank.potential
    base = tank.floor + absolute_dot(tank.applied, tank.sensing_error)
    if tank.level < base:
        tank.short = True
        if declared > 0.0:
            need = min(tank.need, max(0.0, tank.max - base))
            kept = (tank.level + declared - base) / (declared + need)
            kept = min(1.0, max(0.0, kept))
            tank.level += (1.0 - kept) * declared
            tank.spring_scale *= kept
    elif tank.spring_scale != 1.0:
        _tighten_springs(tank)


@compiled
def _tighten_springs(tank: Tank) -> None:
    """Raises r towards 1 by what the tank holds above what the present torque needs."""
    surplus = budget(tank)
    affordable = surplus * min(1.0, tank.period / tank.recovery_time)
    missing = (1.0 - tank.spring_scale) * tank.potential
    if missing <= affordable:
        tank.level -= missing
        tank.spring_scale = 1.0
        return
    tank.spring_scale += affordable / tank.potential
    tank.level -= affordable
    if not surplus > 0.0:
        tank.short = True


@compiled
def release_springs(tank: Tank) -> None:
    """Lets go of all springs, for a stop: what they hold goes back to the tank, ``T <- T + r U``, ``r U <- 0``."""
    tank.level += tank.spring_scale * tank.potential
    tank.spring_scale, tank.potential = 0.0, 0.0


@compiled
def available(tank: Tank) -> float:
    """What the filter's power row may spend, ``max(0, T - floor)`` [J]."""
    return max(0.0, tank.level - tank.floor)


@compiled
def limit_to_budget(tank: Tank, effort: Vector, stopping: bool) -> float:
    """The guarantee: scales a torque until the tank can answer for all it and its forerunners may spend.

    The largest ``s`` in [0, 1] with, ``h`` the period, ``A = T - floor``:

    - ``s |tau| . (v_max hold + 4 e) + sum_pending |tau_p| . (v_max h + 4 e) + |tau_applied| . e <= A`` and
    - ``s |tau| . v_max (h + delay) <= A`` (design section 4).

    The first alone makes T + r U >= floor invariant; the second alone does not once there is a delay.

    Args:
        tank: After ``rescale_springs``.
        effort: (n,) wanted torque, springs already multiplied by ``tank.spring_scale``; finite; scaled in place [N.m].
        stopping: In a stop the floor itself may be spent: it was kept for that.

    Returns:
        s; the torque is untouched where it is 1.
    """
    spendable = tank.level - (0.0 if stopping else tank.floor)
    reserved = absolute_dot(tank.applied, tank.sensing_error)
    for k in range(tank.pending.shape[0] - 1):
        for i in range(effort.size):
            worst_travel = tank.speed_bound[i] * tank.period + 4.0 * tank.sensing_error[i]
            reserved += abs(tank.pending[k, i]) * worst_travel
    power = absolute_dot(effort, tank.speed_bound)
    blindness = absolute_dot(effort, tank.sensing_error)
    scale = min(
        _part(spendable - reserved, power * tank.hold + 4.0 * blindness),
        _part(spendable, power * ((1.0 + tank.delay) * tank.period)),
    )
    for i in range(effort.size):
        if scale < 1.0:
            effort[i] *= scale
        tank.pending[-1, i] = effort[i]
    if tank.missed_cycles > 0 and tank.pending.shape[0] == 1:
        # A blind command that acts at once would be one of the gap's changes: then the worst stays booked.
        tank.gap_spread = math.inf
    lasting = tank.hold + tank.delay * tank.period
    tank.need = power * lasting + (4.0 * tank.delay + 5.0) * blindness
    tank.starved_time = tank.starved_time + tank.period if tank.short or scale < 1.0 else 0.0
    return scale


@compiled
def _part(available: float, wanted: float) -> float:
    """The part of ``wanted`` >= 0 that ``available`` covers, in [0, 1]."""
    if wanted <= 0.0:
        return 1.0
    return min(1.0, max(0.0, available / wanted))


@compiled
def _advance(pending: Matrix) -> None:
    """Moves the commands in flight one period on; the newest stays in the last row."""
    for k in range(pending.shape[0] - 1):
        pending[k, :] = pending[k + 1, :]


@compiled
def _spill(tank: Tank) -> None:
    """Throws away what is above the ceiling."""
    excess = max(0.0, tank.level - tank.max)
    tank.level -= excess
    tank.spilled += excess
