# SPDX-License-Identifier: BSD-3-Clause
r"""Whether a joint is too fast, from how far its motor or its link travelled: no estimate of a velocity, no model.

Who keeps the declared speed travels at most v_max w T in w periods. Measured at both ends a joint is too fast if

    |theta_k - theta_{k-w}|  >  v_max w T + 2 e      or      |q_k - q_{k-w}|  >  v_max w T + 2 e

e the bound of the error of a measured motor angle (``motor_port.sensing_error``), more than that of a link's: a joint
that keeps its speed is never accused. Windows of w = 1, 2, 4, ... periods are looked at, up to the shortest in which
2 e is at most a fiftieth of the allowed travel: so a measured mean speed of 1.02 v_max over that longest window is
always found, and an excess that is larger sooner. On Baxter the longest window is 64 cycles at 1 kHz and 8 at 100 Hz.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Integer, Matrix, Record, Scalar, Vector
from impedance_modules.safety.motor_port import motor_position

SMALLEST_EXCESS = 0.02
"""Excess of a speed over its limit that the longest window finds."""


class TravelWatch(Record):
    """Where motors and links were in the last periods.

    Attributes:
        period: T [s].
        speed_bound: (n,) v_max [rad/s].
        compliance: (n,) 1 / K_sea [rad/(N.m)].
        error: (n,) e [rad].
        positions: (longest window + 1, 2 n) angles of motors, then of links, in turn [rad].
        newest: Row of the last sample.
        known: How many periods before it are known.
    """

    period: Scalar
    speed_bound: Vector
    compliance: Vector
    error: Vector
    positions: Matrix
    newest: Integer = 0
    known: Integer = -1


def travel_watch(period: float, speed_bound: Vector, compliance: Vector, error: Vector) -> TravelWatch:
    """Prepares to watch; arguments as in ``TravelWatch``."""
    longest = longest_window(period, speed_bound, error)
    return TravelWatch(
        period=period,
        speed_bound=speed_bound.copy(),
        compliance=compliance.copy(),
        error=error.copy(),
        positions=np.zeros((longest + 1, 2 * speed_bound.size)),
    )


def longest_window(period: float, speed_bound: Vector, error: Vector) -> int:
    """Periods after which an excess of ``SMALLEST_EXCESS`` is found: a power of two."""
    needed = float(np.max(2.0 * error / (SMALLEST_EXCESS * speed_bound * period), initial=1.0))
    return int(2 ** max(0, math.ceil(math.log2(needed) - 1e-9)))


def forget_travel(watch: TravelWatch) -> None:
    """Begins anew, at a first sample or after a gap."""
    watch.known = -1


@compiled
def too_fast_joint(watch: TravelWatch, q: Vector, effort: Vector) -> int:
    """Takes one sample, a period after the last, and looks for a joint that travelled too far.

    Args:
        watch: Overwritten, but for its constants.
        q: (n,) link angles [rad].
        effort: (n,) torques between gearbox and link [N.m].

    Returns:
        The first such joint, n for none.
    """
    n, rows = q.size, watch.positions.shape[0]
    watch.newest = (watch.newest + 1) % rows
    watch.known = min(watch.known + 1, rows - 1)
    for i in range(n):
        watch.positions[watch.newest, i] = motor_position(q[i], effort[i], watch.compliance[i])
        watch.positions[watch.newest, n + i] = q[i]
    found, window = n, 1
    while window <= watch.known:
        before = (watch.newest - window) % rows
        for k in range(2 * n):
            travel = abs(watch.positions[watch.newest, k] - watch.positions[before, k])
            allowed = watch.speed_bound[k % n] * window * watch.period + 2.0 * watch.error[k % n]
            if travel > allowed:
                found = min(found, k % n)
        window *= 2
    return found
