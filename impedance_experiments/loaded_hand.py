# SPDX-License-Identifier: BSD-3-Clause
"""A hand displaced slowly along one axis after the other: slope and intercept of force over way (thesis Table 5.3)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.pushing import PushTrace, first_pushes, only_arm, trace_pushed
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.prediction.analysis import analyse_task

Array = NDArray[np.float64]

TASK = "net-stiffness"
SHARE = (0.15, 0.98)
"""Part of the full push between which the lines are fitted; at the ends the hand turns round."""


@dataclass(frozen=True)
class FittedLine:
    """Force over way, fitted by a line.

    Attributes:
        slope: [N/m].
        intercept: [N]; positive where friction resists the outward way.
    """

    slope: float
    intercept: float


@dataclass(frozen=True)
class Displacement:
    """One push and its return.

    Attributes:
        axis: 0, 1 or 2.
        sign: Of the push along it.
        out, back: The lines of the way out and of the way back, both counted along the push.
        turned: Largest turn of the hand [rad].
    """

    axis: int
    sign: float
    out: FittedLine
    back: FittedLine
    turned: float


@dataclass(frozen=True)
class Displaced:
    """A whole run: what K_net says, and what the plant did."""

    stiffness: Array
    trace: PushTrace
    found: tuple[Displacement, ...]


def displace(effects: Path | None, pushes: int, seed: int) -> Displaced:
    """Runs the task, on a plant that wears ``effects``, with its first pushes."""
    assembly = first_pushes(assemble(TASK, effects=effects, rate=None, scale=1.0, arm=None), pushes, 0.2)
    stiffness = analyse_task(assembly, None).arms[only_arm(assembly)].stiffness
    if stiffness is None:
        raise ValueError("the displaced hand has no net stiffness at its posture")
    trace = trace_pushed(assembly, only_arm(assembly), seed=seed, noise=True)
    return Displaced(stiffness, trace, _displacements(assembly, trace))


def _displacements(assembly: Assembly, trace: PushTrace) -> tuple[Displacement, ...]:
    found = []
    for push in assembly.task.pushes:
        wrench = np.array(push.wrench)
        axis = int(np.argmax(np.abs(wrench[:3])))
        sign = float(np.sign(wrench[axis]))
        full = push.start + push.rise
        out = trace.over(push.start, full)
        back = trace.over(full + push.hold, full + push.hold + push.fall)
        lines = [_line(trace, part, axis, sign, abs(float(wrench[axis]))) for part in (out, back)]
        first = int(np.argmax(out))
        turned = np.linalg.norm(trace.place[out | back, 3:] - trace.place[first, 3:], axis=1).max()
        found.append(Displacement(axis, sign, lines[0], lines[1], float(turned)))
    return tuple(found)


def _line(trace: PushTrace, part: NDArray[np.bool_], axis: int, sign: float, full: float) -> FittedLine:
    force, way = sign * trace.push[part, axis], sign * trace.place[part, axis]
    fitted = (force > SHARE[0] * full) & (force < SHARE[1] * full)
    slope, intercept = np.polyfit(way[fitted], force[fitted], 1)
    return FittedLine(float(slope), float(intercept))
