# SPDX-License-Identifier: BSD-3-Clause
"""The steps of the energy ledger, in the order of a cycle: measure, grant, settle, pay.

Pure functions from one ``Tank`` to the next. T + r U changes by the measured work alone (and what is charged
or spilled), ``pay`` keeps enough of it back for every command in flight, and ``settle`` moves energy from
the springs to the tank when the tank alone is below its floor. Proof: ``docs/passivity.md``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from impedance_modules.errors import SafetyStop
from impedance_modules.records import Vector
from impedance_modules.safety.clear_tank import Tank, TankSettings, absolute_dot, motor_positions

DEVIATIONS = 6.0
"""Of the accumulated error of white sensors that are charged: exceeded by one run in a thousand million."""

BISECTIONS = 12
"""Trials for the largest affordable part of a motion: a step of 1/4096."""

ROUNDING = 1e-9
"""Relative slack of the overspeed test [-]."""


def measure(tank: Tank, settings: TankSettings, q: Vector, effort: Vector, potential: float) -> Tank:
    """Books what the last interval cost, at the motor side.

    ``T <- min(T_max, T - [tau_applied . dtheta + r (U - U_last)] - charge)``, see ``sensing_charge``. After missed
    cycles dtheta is the travel over all of them, and what their torques may have done beyond tau_applied on it is
    added (``missed``); what was booked for them comes back. If assuming the worst again, ``|tau_applied| . v_max h``,
    is cheaper, that is done, and ``|tau_before| . e`` charged to end the chain of samples.

    Args:
        tank: The record after the last ``pay`` or ``missed``.
        settings: Constants of the run.
        q: (n,) link angles measured now [rad].
        effort: (n,) torques between gearbox and link measured now [N.m].
        potential: U now, at the equilibrium and gains of the *last* cycle, unscaled [J].

    Raises:
        SafetyStop: A state or potential that is not finite, or a negative potential; nothing is booked.
    """
    theta = motor_positions(q, effort, settings.compliance)
    if not (0 <= potential < math.inf and np.isfinite(theta).all()):
        raise SafetyStop(
            f"energy ledger: needs a finite state and a potential >= 0 J, has q {q.tolist()}, "
            f"effort {effort.tolist()}, potential {potential}"
        )
    travel = theta - tank.motor_position
    applied = tank.pending[0]
    worst = absolute_dot(applied, settings.speed_bound) * settings.period
    seen = float(applied @ travel) + tank.gap_spread
    told = not tank.missed or seen <= tank.gap_work + worst
    if told:
        work, assumed = seen - tank.gap_work, tank.gap_spread - tank.gap_work
        charge, variance = sensing_charge(tank, settings, applied - tank.applied)
    else:
        work = assumed = worst
        charge, variance = absolute_dot(tank.applied, settings.sensing_error), tank.variance
    change = tank.spring_scale * (potential - tank.potential)
    booked = replace(
        tank,
        level=tank.level - work - change - charge,
        potential=potential,
        motor_position=theta,
        applied=applied if told else np.zeros_like(applied),
        pending=_advanced(tank.pending, np.zeros_like(applied)),
        missed=0,
        gap_work=0.0,
        gap_spread=0.0,
        short=False,
        overspeed=_too_fast(travel, tank.missed, settings),
        work=tank.work + work,
        charged=tank.charged + charge,
        variance=variance,
        assumed=tank.assumed + assumed,
    )
    return _capped(booked, settings)


def sensing_charge(tank: Tank, settings: TankSettings, change: Vector) -> tuple[float, float]:
    """What an interval costs because rotor angles are measured with an error.

    The error in the work so far is ``-sum (tau_k - tau_(k-1)) . error_k``, at most ``sum |tau_k - tau_(k-1)| . e``.
    Where the error is white it is a random walk of variance ``V = sum_ki (change_ki s_i)^2``, and 6 sqrt(V) bound it:
    ``C <- min(C + |change| . e, 6 sqrt(V))``, C the sum of all charges.

    Args:
        tank: Before the interval.
        settings: Constants of the run.
        change: (n,) torque applied in it, less the one before [N.m].

    Returns:
        The charge [J], and V after it [J^2].
    """
    worst = absolute_dot(change, settings.sensing_error)
    if settings.sensing_deviation is None:
        return worst, tank.variance
    variance = tank.variance + float(np.sum((change * settings.sensing_deviation) ** 2))
    return max(0.0, min(worst, DEVIATIONS * math.sqrt(variance) - tank.charged)), variance


def missed(tank: Tank, settings: TankSettings) -> Tank:
    """A cycle without a usable state, or too late to send: the robot keeps its last command one period more.

    Nobody saw the travel, so the worst is booked: ``T <- T - |tau_applied| . v_max h``. Later, ``measure`` knows the
    travel over all missed cycles together. Its torques' work is then at most

        sum_k tau_k . dtheta_k  <=  tau_n . sum_k dtheta_k  +  sum_k |tau_k - tau_n| . v_max h

    and the last sum, over m missed cycles, at most ``sum_j j |tau_(j+1) - tau_j| . v_max h``: ``gap_spread``.
    """
    applied = tank.pending[0]
    pending = _advanced(tank.pending, tank.pending[-1])
    change = absolute_dot(pending[0] - applied, settings.speed_bound) * settings.period
    work = absolute_dot(applied, settings.speed_bound) * settings.period
    return replace(
        tank,
        level=tank.level - work,
        pending=pending,
        missed=tank.missed + 1,
        gap_work=tank.gap_work + work,
        gap_spread=tank.gap_spread + (tank.missed + 1) * change,
        work=tank.work + work,
        assumed=tank.assumed + work,
    )


def grant(tank: Tank, settings: TankSettings, potential_at: Callable[[float], float]) -> tuple[Tank, float]:
    """How much of a wanted change of equilibrium, gain or rest posture the tank can pay for.

    The change costs ``r (U(q; part s of it) - U(q; none of it))``. The largest part found by bisection whose
    cost is at most ``T - floor - need`` is granted; a refund always is. What it leaves in the tank still pays
    the wanted torque in full, so a starved task slows down instead of going limp.

    Args:
        tank: After ``measure``.
        settings: Constants of the run.
        potential_at: U at the measured state with part s in [0, 1] of the change made, unscaled [J].

    Returns:
        The tank, and the granted part s in [0, 1] (0 when the change cannot be paid or is not finite).
    """
    budget = max(0.0, tank.level - settings.floor - tank.need)

    def affordable(potential: float) -> bool:
        cost = tank.spring_scale * (potential - tank.potential)
        return 0 <= potential < math.inf and cost <= budget

    whole = potential_at(1.0)
    if affordable(whole):
        return _with_potential(tank, settings, whole), 1.0
    granted, granted_potential, refused = 0.0, tank.potential, 1.0
    for _ in range(BISECTIONS):
        part = 0.5 * (granted + refused)
        potential = potential_at(part)
        if affordable(potential):
            granted, granted_potential = part, potential
        else:
            refused = part
    nothing = replace(tank, short=True) if granted == 0.0 else tank
    return _with_potential(nothing, settings, granted_potential), granted


def settle(tank: Tank, settings: TankSettings) -> Tank:
    """Relaxes the springs when the tank alone is below its floor, tightens them as the tank can pay.

    An environment that winds the springs while the torque is limited or late raises U without paying for it.
    With ``b = floor + |tau_applied| . e``: if ``T < b``, ``r <- x r`` and ``T <- T + (1 - x) r U`` with
    ``x = (T + r U - b) / (r U + need)``, so that afterwards ``T = b + x need``: the softer springs can be
    paid. ``T + r U >= b`` always (docs/passivity.md), so x is never negative. Otherwise r climbs to 1, paid
    by what the tank holds above ``floor + need``, with the time constant ``recovery_time``.
    """
    declared = tank.declared
    base = settings.floor + absolute_dot(tank.applied, settings.sensing_error)
    if tank.level < base and not declared > 0:
        return replace(tank, short=True)
    if tank.level < base:
        need = min(tank.need, max(0.0, settings.max - base))
        kept = min(1.0, max(0.0, (tank.level + declared - base) / (declared + need)))
        relaxed = tank.level + (1.0 - kept) * declared
        return replace(tank, level=relaxed, spring_scale=kept * tank.spring_scale, short=True)
    if tank.spring_scale == 1.0:
        return tank
    surplus = max(0.0, tank.level - settings.floor - tank.need)
    affordable = surplus * min(1.0, settings.period / settings.recovery_time)
    missing = 1.0 - tank.spring_scale
    if missing * tank.potential <= affordable:
        return replace(tank, level=tank.level - missing * tank.potential, spring_scale=1.0)
    tightened = tank.spring_scale + affordable / tank.potential
    short = tank.short or not surplus > 0
    return replace(tank, level=tank.level - affordable, spring_scale=tightened, short=short)


def pay(tank: Tank, settings: TankSettings, effort: Vector, stopping: bool) -> tuple[Tank, Vector]:
    """The guarantee: scales a torque until the tank can answer for all it and its forerunners may spend.

    The largest ``s`` in [0, 1] with, ``h`` the period, ``A = T - floor``:

    - ``s |tau| . (v_max hold + 4 e) + sum_pending |tau_p| . (v_max h + 4 e) + |tau_applied| . e <= A`` and
    - ``s |tau| . v_max (h + delay) <= A`` (design 4).

    The first alone makes T + r U >= floor invariant; the second alone does not once there is a delay.

    Args:
        tank: After ``settle``.
        settings: Constants of the run.
        effort: (n,) wanted torque, springs already multiplied by ``tank.spring_scale`` [N.m].
        stopping: In a stop the floor itself may be spent: it was kept for that.

    Returns:
        The tank, and the torque that may leave: ``effort`` itself when nothing had to be scaled.

    Raises:
        SafetyStop: ``effort`` is not finite.
    """
    if not np.isfinite(effort).all():
        raise SafetyStop(f"energy ledger: refuses a torque that is not finite: {effort.tolist()}")
    available = tank.level - (0.0 if stopping else settings.floor)
    reserved = sum(absolute_dot(command, settings.worst_travel) for command in tank.pending[:-1])
    reserved += absolute_dot(tank.applied, settings.sensing_error)
    power = absolute_dot(effort, settings.speed_bound)
    blindness = absolute_dot(effort, settings.sensing_error)
    scale = min(
        _part(available - reserved, power * settings.hold + 4.0 * blindness),
        _part(available, power * settings.reach),
    )
    granted = effort if scale == 1.0 else scale * effort
    pending = tank.pending.copy()
    pending[-1] = granted
    # A blind command that acts at once would have to be part of the gap's changes: then the worst stays booked.
    replaced = tank.missed > 0 and len(pending) == 1
    starved = tank.short or scale < 1.0
    lasting = settings.hold + settings.delay * settings.period
    paid = replace(
        tank,
        pending=pending,
        gap_spread=math.inf if replaced else tank.gap_spread,
        need=power * lasting + (4 * settings.delay + 5) * blindness,
        starved_time=tank.starved_time + settings.period if starved else 0.0,
    )
    return paid, granted


def _part(available: float, wanted: float) -> float:
    """The part of ``wanted`` >= 0 that ``available`` covers, in [0, 1]."""
    if wanted <= 0.0:
        return 1.0
    return min(1.0, max(0.0, available / wanted))


def _advanced(pending: Vector, newest: Vector) -> Vector:
    """The commands in flight one period later: the oldest is over, ``newest`` joins."""
    return np.vstack((pending[1:], newest[np.newaxis]))


def _too_fast(travel: Vector, missed_cycles: int, settings: TankSettings) -> tuple[int, ...]:
    """Joints whose rotor moved farther than ``v_max h`` per cycle, beyond the error of both samples."""
    allowed = settings.speed_bound * settings.period * (1 + missed_cycles) + 2.0 * settings.sensing_error
    return tuple(int(i) for i in np.flatnonzero(np.abs(travel) > allowed * (1.0 + ROUNDING)))


def _with_potential(tank: Tank, settings: TankSettings, potential: float) -> Tank:
    """Pays (or refunds) a change of potential at an unmoved robot."""
    cost = tank.spring_scale * (potential - tank.potential)
    return _capped(replace(tank, level=tank.level - cost, potential=potential), settings)


def _capped(tank: Tank, settings: TankSettings) -> Tank:
    """Throws away what is above the ceiling."""
    excess = max(0.0, tank.level - settings.max)
    return replace(tank, level=tank.level - excess, spilled=tank.spilled + excess)
