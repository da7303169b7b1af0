# SPDX-License-Identifier: BSD-3-Clause
"""From errors to the outcome: per joint, over the horizon, and the window that shows most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.rollout.rollout_error import judge, power, rms, shrink, yardsticks
from impedance_modules.diagnosis.rollout.outcome import CauseRollout, Drift, Growth, LeftOut, Rollout, Trace
from impedance_modules.diagnosis.rollout.simulated_windows import Lived
from impedance_modules.diagnosis.rollout.windows import WINDOW, Window

Array = NDArray[np.float64]

GROWTH_EVERY = 4
"""Every which look is told in the growth over the horizon."""


@dataclass(frozen=True, eq=False)
class Sides:
    """Errors before and after, and the floors (n,) of position and velocity."""

    before: Lived
    after: Lived
    floors: tuple[Array, Array]


def summarise(  # noqa: PLR0917 - all of them are the outcome
    evidence: Evidence,
    drive: str,
    windows: Sequence[Window],
    sides: Sides,
    floor: str,
    verdicts: Mapping[tuple[str, str], CauseRollout],
    left_out: tuple[LeftOut, ...],
) -> Rollout:
    """Puts the outcome together."""
    first = [rms(sides.before.position), rms(sides.before.velocity)]
    last = [rms(sides.after.position), rms(sides.after.velocity)]
    bodies = evidence.prepared[0].tree.bodies
    drifts = [
        {
            body.joint: Drift(
                float(first[k][i]),
                float(last[k][i]),
                float(sides.floors[k][i]),
                ("m" if body.prismatic else "rad") + ("/s" if k else ""),
            )
            for i, body in enumerate(bodies)
        }
        for k in range(2)
    ]
    sticks = yardsticks(sides.after, sides.floors)
    every = range(len(bodies))
    names = dict.fromkeys(evidence.prepared[window.recording].log.name for window in windows)
    return Rollout(
        drive=drive,
        window=WINDOW,
        windows=len(windows),
        episodes=tuple(names),
        floor=floor,
        position=drifts[0],
        velocity=drifts[1],
        growth=_growth(sides, [body.joint for body in bodies]),
        shrink=shrink(first, last, sides.floors),
        whole=judge(power(sides.before, sticks, every), power(sides.after, sticks, every)),
        causes=verdicts,
        left_out=left_out,
        traces=tuple(_trace(evidence, windows, sides, i) for i in range(len(bodies))),
    )


def _growth(sides: Sides, joints: Sequence[str]) -> Growth:
    picked = slice(GROWTH_EVERY - 1, None, GROWTH_EVERY)

    def told(lived: Lived) -> dict[str, tuple[float, ...]]:
        over = np.sqrt(np.mean(lived.position**2, axis=0))[picked]
        return {joint: tuple(map(float, over[:, i])) for i, joint in enumerate(joints)}

    return Growth(tuple(map(float, sides.before.time[picked])), told(sides.before), told(sides.after))


def _trace(evidence: Evidence, windows: Sequence[Window], sides: Sides, joint: int) -> Trace:
    """The window of one joint that the nominal plant misses most, seen from its seed on."""
    worst = int(np.argmax(np.mean(sides.before.position[:, :, joint] ** 2, axis=1)))
    window = windows[worst]
    item = evidence.prepared[window.recording]
    time = item.signals.time[0] + window.start + sides.before.time
    measured = np.interp(time, item.signals.time, item.log.position[:, joint])
    return Trace(
        joint=item.tree.joints[joint],
        episode=item.log.name,
        time=time,
        measured=measured,
        before=measured + sides.before.position[worst, :, joint],
        after=measured + sides.after.position[worst, :, joint],
    )
