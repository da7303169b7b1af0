# SPDX-License-Identifier: BSD-3-Clause
"""The energy tank: what the controller may still spend beyond the potential of its declared springs.

``TankSettings`` are the constants of a run, ``Tank`` the record of one instant. The steps from one record
to the next are in ``ledger.py``; why they keep the controller passive is proved in ``docs/passivity.md``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impedance_modules.errors import BadInput
from impedance_modules.records import Vector


@dataclass(frozen=True)
class TankSettings:
    """Constants of the ledger; n joints.

    Attributes:
        initial, max, floor: Energy at the start, ceiling, and least energy while the task runs [J].
        period: Time between two cycles [s].
        delay: Whole periods from a command's issue to the beginning of its action; the command of cycle k
            acts in [k + delay, k + delay + 1]. 0 acts at once.
        hold: Longest time for which the robot keeps acting on a command when none follows [s], >= period.
        speed_bound: (n,) declared bound of the rotor speeds, v_max [rad/s].
        compliance: (n,) 1 / K_sea [rad/N.m], 0 for a rigid joint.
        sensing_error: (n,) bound of the error of a measured rotor angle, e [rad].
        sensing_deviation: (n,) standard deviation s of that error where it is white; None where only e is known.
        recovery_time: Time constant with which relaxed springs are tightened again [s].
    """

    initial: float
    max: float
    floor: float
    period: float
    delay: int
    hold: float
    speed_bound: Vector
    compliance: Vector
    sensing_error: Vector
    sensing_deviation: Vector | None
    recovery_time: float

    def __post_init__(self) -> None:
        for problem, wrong in (
            (
                f"needs 0 <= floor < initial <= max [J], has {self.floor}, {self.initial}, {self.max}",
                not 0 <= self.floor < self.initial <= self.max < math.inf,
            ),
            (f"period must be positive [s], is {self.period}", not 0 < self.period < math.inf),
            (f"delay must be a whole number of periods >= 0, is {self.delay}", self.delay < 0),
            (
                f"hold must be at least one period ({self.period} s), is {self.hold}",
                not self.period <= self.hold < math.inf,
            ),
            (f"recovery_time must be positive [s], is {self.recovery_time}", not self.recovery_time > 0),
            (
                f"every speed bound must be positive and finite [rad/s], are {self.speed_bound.tolist()}",
                not bool(np.all((self.speed_bound > 0) & (self.speed_bound < math.inf))),
            ),
            ("compliance must be >= 0 [rad/N.m]", not bool(np.all(self.compliance >= 0))),
            ("sensing_error must be >= 0 [rad]", not bool(np.all(self.sensing_error >= 0))),
        ):
            if wrong:
                raise BadInput(f"energy tank: {problem}")

    @property
    def reach(self) -> float:
        """Time over which a new command is answered for: period + delay [s] (design 4)."""
        return (1 + self.delay) * self.period

    @property
    def worst_travel(self) -> Vector:
        """(n,) The most that 1 N.m costs in one period, sensing included: v_max period + 4 e [rad]."""
        return self.speed_bound * self.period + 4.0 * self.sensing_error


@dataclass(frozen=True)
class Tank:
    """The ledger at one instant; arrays are read-only by convention and never changed in place.

    Attributes:
        level: T, energy that may still be spent [J].
        potential: U of the springs and joint bias as the modules declare it, unscaled, at the last
            measured state and the equilibrium and gains now in force [J].
        spring_scale: r in [0, 1]; springs and joint bias act as r times their declared selves.
        motor_position: (n,) rotor angles of the last measured cycle [rad].
        applied: (n,) torque that acted in the last interval [N.m]; of the last measured one
            in a gap, zero after one that was booked at its worst.
        pending: (delay + 1, n) commands issued and not yet over, oldest first [N.m]; the last row is zero
            between ``measure`` and ``pay``.
        need: Level above the floor at which the last wanted torque would be paid in full, for ever [J].
        short: In this cycle the tank had to relax the springs, could not tighten them again, or could pay for
            no part of a wanted change.
        starved_time: For how long torque or springs have been reduced without a break [s].
        missed: Cycles without a state sample since the last one.
        gap_work: What was booked for those cycles [J]; given back when the travel over all of them is seen.
        gap_spread: By how much their torques may have done more work than the last of them on that travel [J].
        overspeed: Joints whose rotor moved farther than v_max allows since the last cycle.
        initial_energy: T_0 + U_0 [J].
        work: Sum of tau_applied . dtheta as measured (an upper bound over missed cycles) [J].
        charged: Charged so far for what the sensors cannot see [J].
        variance: Of the error in ``work`` since the start, where the sensors' error is white [J^2].
        assumed: The part of ``work`` that was assumed, not measured, in missed cycles that were not made up for [J].
        spilled: Thrown away above the ceiling [J].
    """

    level: float
    potential: float
    spring_scale: float
    motor_position: Vector
    applied: Vector
    pending: Vector
    need: float
    short: bool
    starved_time: float
    missed: int
    gap_work: float
    gap_spread: float
    overspeed: tuple[int, ...]
    initial_energy: float
    work: float
    charged: float
    variance: float
    assumed: float
    spilled: float

    @property
    def declared(self) -> float:
        """U that the ledger counts: spring_scale times the modules' potential [J]."""
        return self.spring_scale * self.potential

    @property
    def work_bound(self) -> float:
        """The certificate: integral of tau_applied . dtheta <= T_0 + U_0 - U, against any environment [J]."""
        return self.initial_energy - self.declared


def filled_tank(settings: TankSettings, q: Vector, effort: Vector, potential: float) -> Tank:
    """The tank before the first command, nothing in flight.

    Args:
        settings: Constants of the run.
        q: (n,) first measured link angles [rad].
        effort: (n,) first measured torques [N.m].
        potential: U of the declared springs at that state [J].
    """
    n = settings.speed_bound.size
    return Tank(
        level=settings.initial,
        potential=potential,
        spring_scale=1.0,
        motor_position=motor_positions(q, effort, settings.compliance),
        applied=np.zeros(n),
        pending=np.zeros((settings.delay + 1, n)),
        need=0.0,
        short=False,
        starved_time=0.0,
        missed=0,
        gap_work=0.0,
        gap_spread=0.0,
        overspeed=(),
        initial_energy=settings.initial + potential,
        work=0.0,
        charged=0.0,
        variance=0.0,
        assumed=0.0,
        spilled=0.0,
    )


def power_budget(tank: Tank, settings: TankSettings) -> float:
    """Right side of the QP's power row, >= 0 [W]: thetadot . tau <= (T - floor) / (period + delay)."""
    return max(0.0, tank.level - settings.floor) / settings.reach


def sensing_uncertainty(tank: Tank, settings: TankSettings) -> float:
    """How far ``tank.work`` can be from the true integral of tau_applied . dtheta [J].

    Summation by parts: ``sum_k |tau_k - tau_(k-1)| e`` (charged already) ``+ |tau_n| e`` (the end term, kept
    in the tank), and twice what was assumed in missed cycles. 0 with exact sensors.
    """
    end_term = absolute_dot(tank.applied, settings.sensing_error)
    return tank.charged + end_term + 2.0 * tank.assumed


def motor_positions(q: Vector, effort: Vector, compliance: Vector) -> Vector:
    """Where the rotors are, from the link angles and the twist of the springs.

    ``theta = q + effort / K_sea`` (thesis eq. 3.3; design 4 "Passivity"). ``effort`` must be the torque of
    the spring's deflection, K_sea (theta - q), without the spring's structural damping.

    Args:
        q: (n,) link angles [rad].
        effort: (n,) torque between gearbox and link [N.m].
        compliance: (n,) 1 / K_sea [rad/N.m], 0 for a rigid joint.

    Returns:
        (n,) rotor angles seen at the joint [rad].
    """
    return q + effort * compliance


def absolute_dot(effort: Vector, weight: Vector) -> float:
    """The most that torques of these sizes can spend: ``sum_i |tau_i| weight_i``, weight >= 0 [rad], [J]."""
    return float(np.abs(effort) @ weight)
