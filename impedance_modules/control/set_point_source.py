# SPDX-License-Identifier: BSD-3-Clause
"""Where live set-points come from, as the loop sees it: a sender, a program in the same process, a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.controller import Controller
from impedance_modules.control.equilibrium_following import Following
from impedance_modules.robot.rotation import write_quaternion
from impedance_modules.robot.state import RobotState


@dataclass(frozen=True)
class RunReport:
    """What a sender of set-points is told of the run; all poses in world, wrenches in world axes.

    Attributes:
        time: Of the robot [s].
        phase: Its name.
        listening: Whether that phase listens.
        tank: Level [J].
        granted: Part in [0, 1] of the last step towards set-points that the tank could pay.
        position, velocity: Joint -> value [rad], [rad/s].
        poses: Hand -> (7,) position [m] and unit quaternion (x, y, z, w).
        wrenches: Hand -> (6,) of the surroundings on it [N, N.m].
        equilibria: Target -> (7,) where its equilibrium is; empty where nothing listens.
    """

    time: float
    phase: str
    listening: bool
    tank: float
    granted: float
    position: Mapping[str, float]
    velocity: Mapping[str, float]
    poses: Mapping[str, Array]
    wrenches: Mapping[str, Array]
    equilibria: Mapping[str, Array]

    def plain(self) -> dict[str, Any]:
        """Turns it into plain data, as JSON has it."""
        arrays = ("poses", "wrenches", "equilibria")
        given = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {
            name: {key: item.tolist() for key, item in value.items()} if name in arrays else value
            for name, value in given.items()
        }


class SetPointSource(Protocol):
    """Tells what counts in a cycle. Everything is called by the loop, so nothing may wait."""

    def begin(self, phase: str, following: Following) -> None:
        """Takes notice of a new phase; ``following`` is inactive if it does not listen. Old set-points are void."""

    def write(self, following: Following, state: RobotState) -> None:
        """Writes goals and which of them are fresh, before the law of a cycle that listens."""

    def look(self, report: RunReport) -> list[str]:
        """Takes the newest report, about a hundred times a second; returns what is worth telling since the last."""


def report_of(controller: Controller, wrench: Array, phase: str, state: RobotState) -> RunReport:
    """Gathers what a sender is told.

    Args:
        controller: After the tick for ``state``.
        wrench: (hands, 6) of the surroundings on each hand [N, N.m].
        phase: Name of the phase.
        state: The newest.
    """
    assembly, following, arms = controller.assembly, controller.following, controller.cycle.arms
    names, hands = assembly.model.joint_names, [arm.limb.hand for arm in assembly.modules.arms]
    limits = assembly.task.set_points
    targets = () if limits is None or not following.active else tuple(limits.targets)
    return RunReport(
        time=state.time,
        phase=phase,
        listening=following.active,
        tank=controller.tank.level,
        granted=following.granted,
        position=dict(zip(names, state.position.tolist(), strict=True)),
        velocity=dict(zip(names, state.velocity.tolist(), strict=True)),
        poses={hand: _seven(arms.rotation[h], arms.translation[h]) for h, hand in enumerate(hands)},
        wrenches={hand: wrench[h].copy() for h, hand in enumerate(hands)},
        equilibria={
            target: _seven(following.rotation[k], following.translation[k])
            for k, target in enumerate(targets)
        },
    )


def _seven(rotation: Array, translation: Array) -> Array:
    """A pose as position and unit quaternion."""
    found = np.empty(7)
    found[:3] = translation
    write_quaternion(rotation, found[3:])
    return found
