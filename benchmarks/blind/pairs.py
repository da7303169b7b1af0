# SPDX-License-Identifier: BSD-3-Clause
"""Causes that a poor motion cannot tell apart, and that motion: the right answer is to name both and refuse."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.blind.poor import PoorShape, held, one_speed, one_speed_small, one_way, slow_tone

BOTH_TORQUES = ("actuator", "link")
UPRIGHT = (0,)
"""The joint that carries no weight: elsewhere a lag of the motor holds back the robot's own compensation of the weight
too, which a late command does not."""


@dataclass(frozen=True)
class Pair:
    """What is true, what it cannot be told from, on which motion, and the ports and joints where that holds."""

    truth: str
    partner: str
    motion: PoorShape
    ports: tuple[str, ...]
    joints: tuple[int, ...] = tuple(range(7))


PAIRS: tuple[Pair, ...] = (
    Pair("coulomb_friction", "viscous_friction", one_speed, BOTH_TORQUES),
    Pair("viscous_friction", "coulomb_friction", one_speed, BOTH_TORQUES),
    Pair("quadratic_drag", "viscous_friction", one_speed, BOTH_TORQUES),
    Pair("load_dependent_friction", "coulomb_friction", one_speed_small, BOTH_TORQUES),
    Pair("coulomb_friction", "torque_offset", one_way, BOTH_TORQUES),
    Pair("torque_offset", "coulomb_friction", one_way, BOTH_TORQUES),
    Pair("torque_offset", "parallel_spring", held, ("link",)),
    Pair("parallel_spring", "torque_offset", held, ("link",)),
    Pair("command_delay", "actuator_lag", slow_tone, ("timing",), UPRIGHT),
    Pair("actuator_lag", "command_delay", slow_tone, ("actuator",), UPRIGHT),
)
