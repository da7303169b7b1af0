# SPDX-License-Identifier: BSD-3-Clause
"""How the simulated robot is run: rate, integration step, noise, and the constants of its mechanics."""

from __future__ import annotations

import math
from dataclasses import dataclass

from impedance_modules.errors import BadInput

ROBOT_LOOP = 1e-3
"""Longest period of the robot's own loop: gravity compensation and velocity estimate [s]."""


@dataclass(frozen=True)
class PlantOptions:
    """How the plant is stepped.

    Attributes:
        rate: Of the control cycle: one ``advance`` lasts 1 / rate [Hz].
        seed: Of the sensor noise; the same seed gives the same run, bit by bit.
        noise: Sensor noise as the robot file declares it; False switches it off.
        step: Longest integration step [s]; whole steps fill the robot's own loop.
        gravity: Acceleration in world axes [m/s^2].
    """

    rate: float
    seed: int
    noise: bool = True
    step: float = 0.25e-3
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def __post_init__(self) -> None:
        for name in ("rate", "step"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise BadInput(f"plant option {name} is {value}; valid: a finite number above 0")


@dataclass(frozen=True)
class Division:
    """How a control period divides: ``loops`` loops of the robot, each of ``steps`` steps [s]."""

    loops: int
    steps: int
    step: float
    loop: float


def divide(options: PlantOptions) -> Division:
    """Divides the control period into the fewest loops of at most 1 ms, and those into whole steps."""
    period = 1.0 / options.rate
    loops = _whole(period / ROBOT_LOOP)
    steps = _whole(period / loops / options.step)
    return Division(loops, steps, period / (loops * steps), period / loops)


def _whole(ratio: float) -> int:
    """Rounds up, forgiving the last digits of a quotient that should be whole."""
    return max(1, math.ceil(ratio - 1e-9))
