# SPDX-License-Identifier: BSD-3-Clause
"""Checks of a recording that is being imported: its clock, its ranges, and its velocities against its positions.

What a wrong map would make of a log (degrees, commands taken for measurements, wrong rates and gear ratios) is found
here; unnoticed, it would be diagnosed as physics later.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.columns import joint_column
from impedance_modules.episode.imports.import_map import ImportMap
from impedance_modules.episode.imports.table import Block, Vector
from impedance_modules.errors import BadInput

DEGREES = 180.0 / math.pi

TWO_TURNS = 4.0 * math.pi
"""Positions of a revolute joint beyond it are refused where no limit is known [rad]."""

TEN_METRES = 10.0
"""Positions of a prismatic joint beyond it are refused where no limit is known [m]."""

SLACK_TURNING = 0.5
"""By how much a position may lie beyond a limit that is known [rad]."""

SLACK_SLIDING = 0.1
"""The same for a prismatic joint [m]."""

MEASURED = ("velocity", "effort")

TURN = 2.0 * math.pi

WRAP_TOLERANCE = 1.0
"""By how much a step from one sample to the next may differ from a whole turn, and still be one [rad]."""

STRETCH = 32
"""Samples whose typical step is compared with that of the whole."""

OTHER_RATE = 1.5
"""Ratio of typical steps from which two stretches have different rates."""

OTHER_SHARE = 0.1
"""Part of a recording that must have another rate before it counts: a recorder may miss samples now and then."""

SPAN = 10
"""Samples over which a velocity is integrated: the noise of single differences does not matter then."""

LEAST_SPANS = 20

LEAST_CORRELATION = 0.8
"""Squared correlation of moved distance and integrated velocity, below which they are not compared."""

LARGEST_RATIO = 1.5
"""Ratio of velocity to rate of change of position, or its inverse, above which they contradict each other."""

SAME_RATIO = 1.1
"""Largest over smallest ratio of the joints for which a wrong rate is named as the cause."""


class Clock:
    """Checks that time runs forwards and at one rate; takes the blocks of one recording in order.

    Attributes:
        samples: So far.
    """

    def __init__(self, path: Path, row_word: str) -> None:
        """Starts before the first sample.

        Args:
            path: First source, for messages.
            row_word: What a row is called there.
        """
        self.samples = 0
        self._path = path
        self._row_word = row_word
        self._first = 0.0
        self._last: float | None = None
        self._steps: list[float] = []
        self._stretch_places: list[int] = []

    def take(self, block: Block) -> None:
        """Looks at the next samples.

        Raises:
            BadInput: Time stands still or runs backwards.
        """
        time = block.time
        if self._last is None:
            self._first = float(time[0])
            before, places = time, block.places[1:]
        else:
            before, places = np.concatenate([[self._last], time]), block.places
        steps = np.diff(before)
        wrong = steps <= 0.0
        if wrong.any():
            row = int(np.argmax(wrong))
            how = "repeats" if steps[row] == 0.0 else "runs backwards:"
            raise BadInput(
                f"{self._path}:{places[row]}: time {how} {before[row + 1]:.9g} s after {before[row]:.9g} s in this"
                f" {self._row_word} (valid: rising times; sort the log, or remove what was written twice)"
            )
        for start in range(0, len(steps) - STRETCH + 1, STRETCH):
            self._steps.append(float(np.median(steps[start : start + STRETCH])))
            self._stretch_places.append(int(places[start]))
        if self.samples + len(time) <= STRETCH and len(steps):
            self._steps, self._stretch_places = [float(np.median(steps))], [int(places[0])]
        self.samples += len(time)
        self._last = float(time[-1])

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return 0.0 if self._last is None else self._last - self._first

    @property
    def rate(self) -> float:
        """Typical samples per second [Hz]."""
        return 1.0 / self._typical

    @property
    def _typical(self) -> float:
        """A step that really occurs: with two rates the mean of both would be neither."""
        return sorted(self._steps)[len(self._steps) // 2]

    def finish(self) -> None:
        """Checks the whole recording.

        Raises:
            BadInput: No or one sample, or parts of different rates.
        """
        if self.samples < 2:
            count = "no sample" if self.samples == 0 else "a single sample: nothing can be seen to move"
            raise BadInput(f"{self._path}: {count} (valid: two or more)")
        steps = np.array(self._steps)
        ratio = steps / self._typical
        other = (ratio > OTHER_RATE) | (ratio < 1.0 / OTHER_RATE)
        lasting = other[1:] & other[:-1]
        if np.count_nonzero(other) >= max(2.0, OTHER_SHARE * len(steps)) and lasting.any():
            stretch = int(np.argmax(lasting))
            raise BadInput(
                f"{self._path}:{self._stretch_places[stretch]}: about {1.0 / steps[stretch]:.4g} Hz from this"
                f" {self._row_word} on, and {self.rate:.4g} Hz elsewhere (valid: one rate; split the log there)"
            )


def is_wrap(steps: Vector) -> NDArray[np.bool_]:
    """Says which steps (rows,) of an angle [rad] are those of one that is counted from zero again after a turn."""
    found: NDArray[np.bool_] = np.abs(np.abs(steps) - TURN) < WRAP_TOLERANCE
    return found


class PlausibilityCheck:
    """Finds numbers that cannot mean what the map says; takes the blocks of one recording in order.

    Attributes:
        notes: What is unusual but accepted; complete after `finish`.
    """

    def __init__(self, mapping: ImportMap, path: Path, *, rate_stated: bool) -> None:
        """Starts before the first sample.

        Args:
            mapping: The map.
            path: First source, for messages.
            rate_stated: The time base was stated rather than recorded.
        """
        self.notes: list[str] = []
        self._mapping = mapping
        self._path = path
        self._lowest: dict[str, tuple[float, int]] = {}
        self._highest: dict[str, tuple[float, int]] = {}
        self._copied_commands: set[str] | None = None
        self._zero: dict[str, set[str]] = {kind: set(mapping.joints) for kind in MEASURED}
        self._seen: dict[str, set[str]] = {kind: set() for kind in MEASURED}
        self._wraps: dict[str, tuple[int, int]] = {}
        self._speeds = SpeedMatch(mapping, path, rate_stated=rate_stated)

    def take(self, block: Block) -> None:
        """Looks at the next samples."""
        for joint in self._mapping.joints:
            position = block.columns.get(joint_column("position", joint))
            if position is not None:
                self._take_range(joint, position, block)
                self._take_wraps(joint, position, block)
        self._compare_with_commands(block.columns)
        self._take_zeros(block.columns)
        self._speeds.take(block)

    def finish(self) -> None:
        """Checks the whole recording.

        Raises:
            BadInput: The numbers contradict each other, the robot, or the units of the map.
        """
        for joint in self._lowest:
            self._check_range(joint)
        for joint, (count, place) in self._wraps.items():
            times = "once" if count == 1 else f"{count} times"
            self.notes.append(
                f"position.{joint} jumps by a turn {times}, first at {place}: counted on by diagnose"
            )
        self._refuse_copied_commands()
        self._speeds.finish()
        self._refuse_zeros()

    def _take_range(self, joint: str, position: Vector, block: Block) -> None:
        low, high = int(np.argmin(position)), int(np.argmax(position))
        self._lowest[joint] = min(
            self._lowest.get(joint, (math.inf, 0)), (float(position[low]), int(block.places[low]))
        )
        self._highest[joint] = max(
            self._highest.get(joint, (-math.inf, 0)), (float(position[high]), int(block.places[high]))
        )

    def _take_wraps(self, joint: str, position: Vector, block: Block) -> None:
        wraps = np.flatnonzero(is_wrap(np.diff(position)))
        if joint not in self._mapping.prismatic and len(wraps):
            count, place = self._wraps.get(joint, (0, int(block.places[wraps[0] + 1])))
            self._wraps[joint] = count + len(wraps), place

    def _compare_with_commands(self, columns: Mapping[str, Vector]) -> None:
        equal = {
            joint
            for joint in self._mapping.joints
            if np.array_equal(
                columns.get(joint_column("position", joint), np.empty(0)),
                columns.get(joint_column("position_command", joint), np.ones(1)),
            )
        }
        self._copied_commands = equal if self._copied_commands is None else self._copied_commands & equal

    def _take_zeros(self, columns: Mapping[str, Vector]) -> None:
        for kind in MEASURED:
            for joint in self._mapping.joints:
                values = columns.get(joint_column(kind, joint))
                if values is not None:
                    self._seen[kind].add(joint)
                    if values.any():
                        self._zero[kind].discard(joint)

    def _travel(self, joint: str) -> float:
        return self._highest[joint][0] - self._lowest[joint][0]

    def _check_range(self, joint: str) -> None:
        if joint in self._mapping.beyond_limits:
            return
        sliding = joint in self._mapping.prismatic
        unit = "m" if sliding else "rad"
        widest = TEN_METRES if sliding else TWO_TURNS
        low, high = self._mapping.limits.get(joint, (-widest, widest))
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
        """Names the unit that the map may have wrong; empty where no unit explains it."""
        sliding = joint in self._mapping.prismatic
        per, missed = (1000.0, "mm") if sliding else (DEGREES, "deg")
        lowest, highest = self._lowest[joint][0], self._highest[joint][0]
        far = max(-lowest, highest) > (TEN_METRES if sliding else TWO_TURNS)
        if far and low <= lowest / per and highest / per <= high:
            return f": these look like {missed}, so say 'unit: {missed}' for position"
        return ""

    def _refuse_copied_commands(self) -> None:
        for joint in sorted(self._copied_commands or ()):
            if joint in self._lowest and self._travel(joint) > 0.0:
                raise BadInput(
                    f"{self._path}: position.{joint} equals position_command.{joint} in every sample: it is the"
                    " command, not a measurement (valid: the column of the measured positions, or no"
                    " 'position_command')"
                )

    def _refuse_zeros(self) -> None:
        """A quantity that is zero throughout in every joint was not measured, and absent is not zero."""
        moves = any(self._travel(joint) > 0.0 for joint in self._lowest)
        for kind in MEASURED:
            if moves and self._seen[kind] and self._seen[kind] <= self._zero[kind]:
                raise BadInput(
                    f"{self._path}: {kind} is 0 in every sample of every joint, and the robot moves: it was not"
                    f" measured (valid: leave '{kind}' out of the map)"
                )
        if not moves:
            self.notes.append("no joint moves")


class SpeedMatch:
    """Compares recorded velocities with the rate of change of recorded positions; takes blocks in order.

    Their ratio is 1 in a log whose map is right; 57.3 or its inverse where one of them is in degrees, -1 where a sign
    differs, a gear ratio where one is on the motor's side, and the same number in every joint where the stated rate
    is wrong.
    """

    def __init__(self, mapping: ImportMap, path: Path, *, rate_stated: bool) -> None:
        """Starts before the first sample; arguments as of `PlausibilityCheck`."""
        self._path = path
        self._prismatic = mapping.prismatic
        self._rate = mapping.rate
        self._rate_stated = rate_stated
        self._step = 0.0
        both = {quantity.kind: quantity.columns for table in mapping.tables for quantity in table.quantities}
        self._joints = [
            joint
            for joint in mapping.joints
            if joint in both.get("position", ()) and joint in both.get("velocity", ())
        ]
        self._spans = 0
        self._sums: NDArray[np.float64] = np.zeros((3, len(self._joints)))

    def take(self, block: Block) -> None:
        """Adds sums over spans: of moved^2, moved * summed velocity, and summed velocity^2."""
        if not self._joints or len(block.time) <= SPAN:
            return
        steps = np.diff(block.time)[:, None]
        self._step = float(np.median(steps))
        position = np.column_stack([block.columns[joint_column("position", j)] for j in self._joints])
        velocity = np.column_stack([block.columns[joint_column("velocity", j)] for j in self._joints])
        summed = np.vstack(
            [np.zeros(len(self._joints)), 0.5 * (velocity[1:] + velocity[:-1]) * steps]
        ).cumsum(0)
        moved, said = np.diff(position[::SPAN], axis=0), np.diff(summed[::SPAN], axis=0)
        self._spans += len(moved)
        with np.errstate(over="ignore", invalid="ignore"):  # PlausibilityCheck refuses absurd numbers
            self._sums += np.array([(moved * moved).sum(0), (moved * said).sum(0), (said * said).sum(0)])

    def ratios(self) -> dict[str, float]:
        """Returns velocity over rate of change of position, for the joints in which it can be seen."""
        if self._spans < LEAST_SPANS:
            return {}
        found = {}
        for joint, sums in zip(self._joints, self._sums.T.tolist(), strict=True):
            moved, both, said = sums
            if moved > 0.0 and said > 0.0 and both * both > LEAST_CORRELATION * moved * said:
                found[joint] = math.copysign(math.sqrt(said / moved), both)
        return found

    def finish(self) -> None:
        """Compares over the whole recording.

        Raises:
            BadInput: Velocities and positions contradict each other.
        """
        ratios = self.ratios()
        wrong = {joint: ratio for joint, ratio in ratios.items() if not _near(ratio, 1.0)}
        if not wrong:
            return
        joint, ratio = next(iter(wrong.items()))
        guess = self._unit_guess(joint, ratio) or self._rate_guess(ratios) or _other_guess(ratio)
        raise BadInput(
            f"{self._path}: velocity.{joint} is {ratio:.4g} times the rate of change of position.{joint}: {guess}"
        )

    def _unit_guess(self, joint: str, ratio: float) -> str:
        sliding = joint in self._prismatic
        per, fast, slow = (1000.0, "mm/s", "mm") if sliding else (DEGREES, "deg/s", "deg")
        if _near(ratio, per):
            return f"it looks like {fast} (valid: 'unit: {fast}' for velocity)"
        if _near(ratio, 1.0 / per):
            return f"the position looks like {slow} (valid: 'unit: {slow}' for position)"
        return ""

    def _rate_guess(self, ratios: dict[str, float]) -> str:
        values = list(ratios.values())
        if not self._rate_stated or min(values) <= 0.0 or max(values) > SAME_RATIO * min(values):
            return ""
        rate = float(np.median(values)) / self._step
        return (
            f"so it is in every joint; the stated rate is {1.0 / self._step:.6g} Hz, and they would agree at"
            f" {rate:.4g} Hz (valid: the true rate, 'rate: {rate:.3g}' or --rate {rate:.3g} if that is it)"
        )


def _other_guess(ratio: float) -> str:
    if ratio < 0.0:
        return "a sign differs (valid: 'sign: {JOINT: -1}' for one of them)"
    return "a unit, a gear ratio ('transmission', 'side') or the time base is wrong (valid: a ratio of 1)"


def _near(ratio: float, expected: float) -> bool:
    return expected / LARGEST_RATIO < ratio < expected * LARGEST_RATIO
