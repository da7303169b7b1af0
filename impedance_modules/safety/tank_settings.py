# SPDX-License-Identifier: BSD-3-Clause
"""Constants of the energy tank, and what they must keep to."""

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
        period: Time between two cycles, h [s].
        delay: Whole periods from a command's issue to the beginning of its action, d; the command of cycle k
            acts in [k + d, k + d + 1]. 0 acts at once.
        hold: Longest time for which the robot keeps acting on a command when none follows, H >= h [s].
        speed_bound: (n,) declared bound of the rotor speeds, v_max [rad/s].
        compliance: (n,) 1 / K_sea [rad/N.m], 0 for a rigid joint.
        sensing_error: (n,) bound of the error of a measured rotor angle, e [rad].
        sensing_deviation: (n,) standard deviation s of that error where it is white [rad]; None where only e is
            known.
        recovery_time: Time constant with which relaxed springs are tightened again [s].
        least_gain, most_gain: (n,) ends of the interval in which a motor's torque per torque asked for lies; None
            where motors give what is asked.
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
    least_gain: Vector | None = None
    most_gain: Vector | None = None

    @property
    def gains(self) -> tuple[Vector, Vector]:
        """Both ends of the motors' gains, (n,) each; ones where they give what is asked."""
        ones = np.ones(self.speed_bound.size)
        least = ones if self.least_gain is None else self.least_gain
        return least, ones if self.most_gain is None else self.most_gain

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
            (
                "every motor gain must be positive, its least end not above its most",
                not bool(np.all((self.gains[0] > 0) & (self.gains[0] <= self.gains[1]))),
            ),
        ):
            if wrong:
                raise BadInput(f"energy tank: {problem}")
