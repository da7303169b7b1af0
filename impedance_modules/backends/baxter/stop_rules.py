# SPDX-License-Identifier: BSD-3-Clause
"""Words of the stop machine: what leaves, by which thresholds, and what a robot's own state forbids."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.messages import AssemblyState
from impedance_modules.safety.stop_levels import Event

Array = NDArray[np.float64]


class Mode(Enum):
    """What leaves for the arms."""

    IDLE = "idle"
    TORQUE = "torque"
    HOLD = "hold"
    OFF = "off"


@dataclass(frozen=True)
class StopRules:
    """Thresholds, and what braking needs.

    Attributes:
        stale, blind, lost: Ages of the last state: torque becomes braking; that ends ``blind`` later; hold [s].
        silent: Age of the last /robot/state at which the robot counts as gone [s].
        effort_max: (n,) [N.m].
        damping: (n, n) of the braking torque [N.m.s/rad].
    """

    stale: float
    blind: float
    lost: float
    silent: float
    effort_max: Array
    damping: Array


@dataclass(frozen=True)
class Order:
    """What is sent now, to each limb at most one thing.

    Attributes:
        effort: (n,) torque [N.m] for ``limbs``, or None.
        position: (n,) angles [rad] for ``limbs`` in position mode, or None.
        limbs: Whom it is for.
    """

    effort: Array | None
    position: Array | None
    limbs: tuple[str, ...]


NOTHING = Order(None, None, ())


@dataclass(frozen=True)
class Fault:
    """Why torque control ended by itself; ``event`` as in the table of ``safety.stop_levels``."""

    event: Event
    detail: str


def stop_rules(period: float, effort_max: Array, velocity_max: Array, braking_share: float) -> StopRules:
    """Makes the thresholds of a control period.

    Three periods without a state, but no less than 30 ms, which is three of the slowest rate: at 500 Hz an
    ordinary kernel's hiccup is longer than three periods.

    Args:
        period: Of the control loop [s].
        effort_max: (n,) of the joints [N.m].
        velocity_max: (n,) of the joints [rad/s].
        braking_share: Part of its torque limit with which a joint at its top speed is braked.
    """
    return StopRules(
        stale=max(3.0 * period, 0.03),
        blind=max(2.0 * period, 0.02),
        lost=max(0.1, 6.0 * period),
        silent=0.5,
        effort_max=effort_max,
        damping=np.diag(braking_share * effort_max / velocity_max),
    )


def why_off(robot: AssemblyState) -> str | None:
    """Says why a robot in this state must not be sent anything; None where it may."""
    if robot.estop_button == robot.BUTTON_PRESSED:
        return "the e-stop is pressed"
    if robot.estop_source != robot.SOURCE_NONE:
        sources = {1: "a person", 2: "an unknown source", 3: "a joint fault", 4: "a lost heartbeat"}
        return f"stopped by {sources.get(robot.estop_source, f'source {robot.estop_source}')}"
    if robot.stopped:
        return "the robot is stopped"
    if not robot.enabled:
        return "the robot is disabled"
    return None
