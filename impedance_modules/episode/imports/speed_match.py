# SPDX-License-Identifier: BSD-3-Clause
"""Compares recorded velocities with the rate of change of recorded positions.

Their ratio is 1 in a log that was understood; 57.3 or its inverse where one of them is in degrees, -1 where a
sign differs, a gear ratio where one is on the motor's side, and the same number in every joint where the
stated rate is wrong.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.columns import joint_column
from impedance_modules.episode.imports.blocks import Block
from impedance_modules.episode.imports.import_map import ImportMap
from impedance_modules.errors import BadInput

SPAN = 10
"""Samples over which a velocity is summed up: the noise of single differences does not matter then."""

LEAST_SPANS = 20
LEAST_LIKENESS = 0.8
"""Squared correlation from which the two are comparable at all."""

LARGEST_RATIO = 1.5
"""Ratio, or its inverse, from which they contradict each other."""

SAME_RATIO = 1.1
"""Largest over smallest ratio of the joints for which one cause, the rate, is blamed."""

DEGREES = 180.0 / math.pi


class SpeedMatch:
    """Takes the blocks of one recording in order."""

    def __init__(self, what: ImportMap, path: Path, *, rate_stated: bool) -> None:
        """Starts before the first sample; arguments as of `Plausibility`."""
        self._path = path
        self._prismatic = what.prismatic
        self._rate = what.rate
        self._rate_stated = rate_stated
        self._step = 0.0
        both = {quantity.kind: quantity.columns for table in what.tables for quantity in table.quantities}
        self._joints = [
            joint
            for joint in what.joints
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
        with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are judged elsewhere
            self._sums += np.array([(moved * moved).sum(0), (moved * said).sum(0), (said * said).sum(0)])

    def ratios(self) -> dict[str, float]:
        """Returns velocity over rate of change of position, for the joints in which it can be seen."""
        if self._spans < LEAST_SPANS:
            return {}
        found = {}
        for joint, sums in zip(self._joints, self._sums.T.tolist(), strict=True):
            moved, both, said = sums
            if moved > 0.0 and said > 0.0 and both * both > LEAST_LIKENESS * moved * said:
                found[joint] = math.copysign(math.sqrt(said / moved), both)
        return found

    def finish(self) -> None:
        """Judges the whole.

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
