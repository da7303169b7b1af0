# SPDX-License-Identifier: BSD-3-Clause
"""Watches a recording for numbers that cannot mean what its map says: degrees, echoes, wrong rates and ratios.

A mistake of a map that is not noticed here would be diagnosed as physics later.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from impedance_modules.episode.columns import joint_column
from impedance_modules.episode.imports.blocks import Block, Vector
from impedance_modules.episode.imports.import_map import ImportMap
from impedance_modules.episode.imports.speed_match import SpeedMatch
from impedance_modules.errors import BadInput

DEGREES = 180.0 / math.pi
TWO_TURNS = 4.0 * math.pi
"""Positions of a turning joint beyond it are doubted where no limit is known [rad]."""

TEN_METRES = 10.0
"""Positions of a sliding joint beyond it are doubted where no limit is known [m]."""

SLACK_TURNING = 0.5
"""By how much a position may lie beyond a limit that is known [rad]."""

SLACK_SLIDING = 0.1
"""The same for a sliding joint [m]."""

MEASURED = ("velocity", "effort")


class Plausibility:
    """Takes the blocks of one recording in order.

    Attributes:
        notes: What looked odd without being refused; complete after `finish`.
    """

    def __init__(self, what: ImportMap, path: Path, *, rate_stated: bool) -> None:
        """Starts before the first sample.

        Args:
            what: The map.
            path: First source, for messages.
            rate_stated: The time base was stated rather than recorded.
        """
        self.notes: list[str] = []
        self._what = what
        self._path = path
        self._lowest: dict[str, tuple[float, int]] = {}
        self._highest: dict[str, tuple[float, int]] = {}
        self._echoes: set[str] | None = None
        self._silent: dict[str, set[str]] = {kind: set(what.joints) for kind in MEASURED}
        self._seen: dict[str, set[str]] = {kind: set() for kind in MEASURED}
        self._speeds = SpeedMatch(what, path, rate_stated=rate_stated)

    def take(self, block: Block) -> None:
        """Looks at the next samples."""
        for joint in self._what.joints:
            position = block.columns.get(joint_column("position", joint))
            if position is not None:
                self._take_range(joint, position, block)
        self._take_echoes(block.columns)
        self._take_silence(block.columns)
        self._speeds.take(block)

    def finish(self) -> None:
        """Judges the whole.

        Raises:
            BadInput: The numbers contradict each other, the robot, or the units of the map.
        """
        for joint in self._lowest:
            self._judge_range(joint)
        self._judge_echoes()
        self._speeds.finish()
        self._judge_silence()

    def _take_range(self, joint: str, position: Vector, block: Block) -> None:
        low, high = int(np.argmin(position)), int(np.argmax(position))
        self._lowest[joint] = min(
            self._lowest.get(joint, (math.inf, 0)), (float(position[low]), int(block.places[low]))
        )
        self._highest[joint] = max(
            self._highest.get(joint, (-math.inf, 0)), (float(position[high]), int(block.places[high]))
        )

    def _take_echoes(self, columns: Mapping[str, Vector]) -> None:
        equal = {
            joint
            for joint in self._what.joints
            if np.array_equal(
                columns.get(joint_column("position", joint), np.empty(0)),
                columns.get(joint_column("position_command", joint), np.ones(1)),
            )
        }
        self._echoes = equal if self._echoes is None else self._echoes & equal

    def _take_silence(self, columns: Mapping[str, Vector]) -> None:
        for kind in MEASURED:
            for joint in self._what.joints:
                values = columns.get(joint_column(kind, joint))
                if values is not None:
                    self._seen[kind].add(joint)
                    if values.any():
                        self._silent[kind].discard(joint)

    def _travel(self, joint: str) -> float:
        return self._highest[joint][0] - self._lowest[joint][0]

    def _judge_range(self, joint: str) -> None:
        if joint in self._what.beyond_limits:
            return
        sliding = joint in self._what.prismatic
        unit = "m" if sliding else "rad"
        widest = TEN_METRES if sliding else TWO_TURNS
        low, high = self._what.limits.get(joint, (-widest, widest))
        slack = SLACK_SLIDING if sliding else SLACK_TURNING
        for value, place in (self._lowest[joint], self._highest[joint]):
            if low - slack <= value <= high + slack:
                continue
            guess = self._guess(joint, low - slack, high + slack)
            raise BadInput(
                f"{self._path}:{place}: position.{joint} is {value:.5g} {unit}, and its range is {low:.5g} to"
                f" {high:.5g} {unit}{guess} (valid: the right unit, offset or transmission in the map; or, if this"
                f" is true, 'beyond_limits: [{joint}]')"
            )

    def _guess(self, joint: str, low: float, high: float) -> str:
        """What the map may have missed."""
        sliding = joint in self._what.prismatic
        per, missed = (1000.0, "mm") if sliding else (DEGREES, "deg")
        lowest, highest = self._lowest[joint][0], self._highest[joint][0]
        far = max(-lowest, highest) > (TEN_METRES if sliding else TWO_TURNS)
        if far and low <= lowest / per and highest / per <= high:
            return f": these look like {missed}, so say 'unit: {missed}' for position"
        return ""

    def _judge_echoes(self) -> None:
        for joint in sorted(self._echoes or ()):
            if joint in self._lowest and self._travel(joint) > 0.0:
                raise BadInput(
                    f"{self._path}: position.{joint} equals position_command.{joint} in every sample: it is the"
                    " command, not a measurement (valid: the column of the measured positions, or no"
                    " 'position_command')"
                )

    def _judge_silence(self) -> None:
        """A quantity that is zero throughout in every joint was not measured, and absent is not zero."""
        moves = any(self._travel(joint) > 0.0 for joint in self._lowest)
        for kind in MEASURED:
            if moves and self._seen[kind] and self._seen[kind] <= self._silent[kind]:
                raise BadInput(
                    f"{self._path}: {kind} is 0 in every sample of every joint, and the robot moves: it was not"
                    f" measured (valid: leave '{kind}' out of the map)"
                )
        if not moves:
            self.notes.append("no joint moves")
