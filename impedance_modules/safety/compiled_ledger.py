# SPDX-License-Identifier: BSD-3-Clause
"""The energy ledger compiled for the control loop; the law and its proof are in ``ledger.py``.

``Book`` holds the same record as ``tank.Tank`` in arrays that are written in place. Every function here does
exactly what its namesake in ``ledger.py`` does; ``tests/laws/test_compiled_ledger.py`` holds them together.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.safety.clear_tank import Tank, TankSettings
from impedance_modules.safety.ledger import DEVIATIONS

Array = NDArray[np.float64]

LEVEL, POTENTIAL, SCALE, NEED, SHORT, STARVED, MISSED, OVERSPEED = 0, 1, 2, 3, 4, 5, 6, 7
INITIAL, WORK, CHARGED, ASSUMED, SPILLED, VARIANCE = 8, 9, 10, 11, 12, 13
GAP_WORK, GAP_SPREAD = 14, 15
ENTRIES = 16
"""Places of the ledger's scalars in ``Book.scalars``; names as in ``tank.Tank``."""

MAX, FLOOR, PERIOD, DELAY, HOLD, RECOVERY, WHITE = 0, 1, 2, 3, 4, 5, 6
"""Places of the constants in ``Book.constants``; names as in ``tank.TankSettings``; WHITE is 1 where its
``sensing_deviation`` is known."""


class Book(NamedTuple):
    """A ledger that is written in place.

    Attributes:
        scalars: (ENTRIES,).
        constants: (7,).
        speed_bound, compliance, sensing_error, sensing_deviation: (n,) as in ``TankSettings``.
        motor_position, applied: (n,) as in ``Tank``.
        pending: (delay + 1, n) as in ``Tank``.
    """

    scalars: Array
    constants: Array
    speed_bound: Array
    compliance: Array
    sensing_error: Array
    sensing_deviation: Array
    motor_position: Array
    applied: Array
    pending: Array


def open_book(tank: Tank, settings: TankSettings) -> Book:
    """Copies a record and its constants into arrays."""
    scalars = np.zeros(ENTRIES)
    scalars[[LEVEL, POTENTIAL, SCALE, NEED]] = tank.level, tank.potential, tank.spring_scale, tank.need
    scalars[[GAP_WORK, GAP_SPREAD]] = tank.gap_work, tank.gap_spread
    scalars[[SHORT, STARVED, MISSED]] = float(tank.short), tank.starved_time, float(tank.missed)
    scalars[[INITIAL, WORK, CHARGED]] = tank.initial_energy, tank.work, tank.charged
    scalars[[ASSUMED, SPILLED, VARIANCE]] = tank.assumed, tank.spilled, tank.variance
    deviation = settings.sensing_deviation
    constants = np.array(
        [
            settings.max,
            settings.floor,
            settings.period,
            float(settings.delay),
            settings.hold,
            settings.recovery_time,
            0.0 if deviation is None else 1.0,
        ]
    )
    return Book(
        scalars,
        constants,
        settings.speed_bound.copy(),
        settings.compliance.copy(),
        settings.sensing_error.copy(),
        np.zeros_like(settings.sensing_error) if deviation is None else deviation.copy(),
        tank.motor_position.copy(),
        tank.applied.copy(),
        tank.pending.copy(),
    )


def record(book: Book, overspeed: tuple[int, ...] = ()) -> Tank:
    """Copies the arrays back into the record that the rest of the package reads."""
    entry = book.scalars
    return Tank(
        level=float(entry[LEVEL]),
        potential=float(entry[POTENTIAL]),
        spring_scale=float(entry[SCALE]),
        motor_position=book.motor_position.copy(),
        applied=book.applied.copy(),
        pending=book.pending.copy(),
        need=float(entry[NEED]),
        short=bool(entry[SHORT]),
        starved_time=float(entry[STARVED]),
        missed=int(entry[MISSED]),
        gap_work=float(entry[GAP_WORK]),
        gap_spread=float(entry[GAP_SPREAD]),
        overspeed=overspeed,
        initial_energy=float(entry[INITIAL]),
        work=float(entry[WORK]),
        charged=float(entry[CHARGED]),
        variance=float(entry[VARIANCE]),
        assumed=float(entry[ASSUMED]),
        spilled=float(entry[SPILLED]),
    )


@compiled
def absolute_dot(effort: Array, weight: Array) -> float:
    """Returns sum |tau_i| weight_i."""
    total = 0.0
    for i in range(effort.size):
        total += abs(effort[i]) * weight[i]
    return total


@compiled
def measure(
    scalars: Array,
    constants: Array,
    speed_bound: Array,
    compliance: Array,
    sensing_error: Array,
    sensing_deviation: Array,
    motor_position: Array,
    applied: Array,
    pending: Array,
    q: Array,
    effort: Array,
    potential: float,
) -> int:
    """Books what the last interval cost; returns the first joint that was too fast, or n for none.

    The state must be finite and the potential not negative: the caller checks before.
    """
    n = q.size
    skipped = scalars[MISSED]
    worst, seen, charge, too_fast = 0.0, scalars[GAP_SPREAD], 0.0, n
    variance = scalars[VARIANCE]
    for i in range(n):
        theta = q[i] + effort[i] * compliance[i]
        travel = theta - motor_position[i]
        allowed = speed_bound[i] * constants[PERIOD] * (1.0 + skipped) + 2.0 * sensing_error[i]
        if too_fast == n and abs(travel) > allowed * (1.0 + 1e-9):
            too_fast = i
        motor_position[i] = theta
        worst += abs(pending[0, i]) * speed_bound[i] * constants[PERIOD]
        seen += pending[0, i] * travel
        change = pending[0, i] - applied[i]
        charge += abs(change) * sensing_error[i]
        variance += (change * sensing_deviation[i]) ** 2
    told = skipped == 0.0 or seen <= scalars[GAP_WORK] + worst
    if told:
        work, assumed = seen - scalars[GAP_WORK], scalars[GAP_SPREAD] - scalars[GAP_WORK]
        applied[:] = pending[0]
    else:
        work, assumed, charge = worst, worst, absolute_dot(applied, sensing_error)
        applied[:] = 0.0
    if constants[WHITE] > 0.0 and told:
        charge = max(0.0, min(charge, DEVIATIONS * math.sqrt(variance) - scalars[CHARGED]))
        scalars[VARIANCE] = variance
    scalars[LEVEL] -= work + scalars[SCALE] * (potential - scalars[POTENTIAL]) + charge
    scalars[POTENTIAL] = potential
    scalars[MISSED] = scalars[GAP_WORK] = scalars[GAP_SPREAD] = 0.0
    scalars[SHORT] = 0.0
    scalars[OVERSPEED] = float(too_fast)
    scalars[WORK] += work
    scalars[CHARGED] += charge
    scalars[ASSUMED] += assumed
    _advance(pending)
    pending[-1, :] = 0.0
    _cap(scalars, constants)
    return too_fast


@compiled
def missed(
    scalars: Array,
    constants: Array,
    speed_bound: Array,
    pending: Array,
) -> None:
    """Books a cycle without a usable state, or whose torque came too late."""
    work = absolute_dot(pending[0], speed_bound) * constants[PERIOD]
    scalars[LEVEL] -= work
    scalars[MISSED] += 1.0
    scalars[GAP_WORK] += work
    scalars[WORK] += work
    scalars[ASSUMED] += work
    change = 0.0
    if pending.shape[0] > 1:
        for i in range(speed_bound.size):
            change += abs(pending[1, i] - pending[0, i]) * speed_bound[i] * constants[PERIOD]
    scalars[GAP_SPREAD] += scalars[MISSED] * change
    _advance(pending)


@compiled
def change_cost(scalars: Array, potential: float) -> float:
    """Returns what a new potential at an unmoved robot costs, r (U_new - U) [J]."""
    return float(scalars[SCALE] * (potential - scalars[POTENTIAL]))


@compiled
def budget(scalars: Array, constants: Array) -> float:
    """Returns what a change of equilibrium or gain may cost [J]."""
    return max(0.0, float(scalars[LEVEL] - constants[FLOOR] - scalars[NEED]))


@compiled
def take_change(scalars: Array, constants: Array, potential: float) -> None:
    """Pays, or takes back, a change of potential at an unmoved robot."""
    scalars[LEVEL] -= change_cost(scalars, potential)
    scalars[POTENTIAL] = potential
    _cap(scalars, constants)


@compiled
def settle(scalars: Array, constants: Array, applied: Array, sensing_error: Array) -> None:
    """Relaxes the springs when the tank alone is below its floor, tightens them as it can pay."""
    declared = scalars[SCALE] * scalars[POTENTIAL]
    base = constants[FLOOR] + absolute_dot(applied, sensing_error)
    if scalars[LEVEL] < base:
        scalars[SHORT] = 1.0
        if declared > 0.0:
            need = min(scalars[NEED], max(0.0, constants[MAX] - base))
            kept = (scalars[LEVEL] + declared - base) / (declared + need)
            kept = min(1.0, max(0.0, kept))
            scalars[LEVEL] += (1.0 - kept) * declared
            scalars[SCALE] *= kept
        return
    if scalars[SCALE] == 1.0:
        return
    surplus = budget(scalars, constants)
    affordable = surplus * min(1.0, constants[PERIOD] / constants[RECOVERY])
    missing = (1.0 - scalars[SCALE]) * scalars[POTENTIAL]
    if missing <= affordable:
        scalars[LEVEL] -= missing
        scalars[SCALE] = 1.0
        return
    scalars[SCALE] += affordable / scalars[POTENTIAL]
    scalars[LEVEL] -= affordable
    if not surplus > 0.0:
        scalars[SHORT] = 1.0


@compiled
def pay(
    scalars: Array,
    constants: Array,
    speed_bound: Array,
    sensing_error: Array,
    applied: Array,
    pending: Array,
    effort: Array,
    stopping: bool,
) -> float:
    """Scales ``effort`` in place until the tank can answer for it; returns the scale in [0, 1].

    ``effort`` must be finite: the caller checks before.
    """
    available = scalars[LEVEL] - (0.0 if stopping else constants[FLOOR])
    reserved = absolute_dot(applied, sensing_error)
    period, delay = constants[PERIOD], constants[DELAY]
    for k in range(pending.shape[0] - 1):
        for i in range(effort.size):
            reserved += abs(pending[k, i]) * (speed_bound[i] * period + 4.0 * sensing_error[i])
    power = absolute_dot(effort, speed_bound)
    blindness = absolute_dot(effort, sensing_error)
    scale = min(
        _part(available - reserved, power * constants[HOLD] + 4.0 * blindness),
        _part(available, power * ((1.0 + delay) * period)),
    )
    for i in range(effort.size):
        if scale < 1.0:
            effort[i] *= scale
        pending[-1, i] = effort[i]
    if scalars[MISSED] > 0.0 and pending.shape[0] == 1:
        scalars[GAP_SPREAD] = math.inf
    starved = scalars[SHORT] > 0.0 or scale < 1.0
    scalars[NEED] = power * (constants[HOLD] + delay * period) + (4.0 * delay + 5.0) * blindness
    scalars[STARVED] = scalars[STARVED] + period if starved else 0.0
    return scale


@compiled
def _part(available: float, wanted: float) -> float:
    if wanted <= 0.0:
        return 1.0
    return min(1.0, max(0.0, available / wanted))


@compiled
def _advance(pending: Array) -> None:
    for k in range(pending.shape[0] - 1):
        pending[k, :] = pending[k + 1, :]


@compiled
def _cap(scalars: Array, constants: Array) -> None:
    excess = max(0.0, scalars[LEVEL] - constants[MAX])
    scalars[LEVEL] -= excess
    scalars[SPILLED] += excess
