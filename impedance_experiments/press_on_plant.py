# SPDX-License-Identifier: BSD-3-Clause
"""Pressing on the plant's table with joint springs that rest in different postures, until the hand is at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from impedance_experiments.task_run import watch_task
from impedance_experiments.thesis_page import Settings
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task_text import changed, task_document

TASK = "slide-flat"
LEAN, HOLD = 3.0, 4.0
"""How long the equilibria go down, and how long the hand is then left alone [s]."""
LAST = 1.0
"""Time at the end in which the force is read [s]."""
EVERY = 10
"""One in so many milliseconds is kept."""
HELD, HELD_DAMPING = 60.0, 2.0
"""Rotational spring and damper at the hand that stand for a flat contact [N.m/rad], [N.m.s/rad]."""
TANK = {"initial": 60.0, "max": 120.0, "floor": 0.5}
"""Enough for all cases [J]."""


@dataclass(frozen=True)
class PlantPress:
    """A hand that was pressed on the plant's table.

    Attributes:
        name: Of the case.
        reading: Of the thesis, as the statics name it.
        time: (N,) since the start [s].
        forces: (N,) that the table bears [N].
        moved: How far the hand moved along the table since it touched [m].
    """

    name: str
    reading: str
    time: Array
    forces: Array
    moved: float

    @property
    def force(self) -> float:
        """Mean of the last second [N]."""
        return float(self._last.mean())

    @property
    def least(self) -> float:
        """Least of the last second [N]."""
        return float(self._last.min())

    @property
    def most(self) -> float:
        """Largest of the last second [N]."""
        return float(self._last.max())

    @property
    def _last(self) -> Array:
        return np.asarray(self.forces[self.time > self.time[-1] - LAST])


@dataclass(frozen=True)
class PressCase:
    """One case: its name, the statics' reading, whether the hand lies flat, friction, and time to lean [s]."""

    name: str
    reading: str
    flat: bool
    friction: float = 0.2
    lean: float = LEAN


def press_all(
    rests: Mapping[str, Array], table: float, depth: float, settings: Settings
) -> tuple[PlantPress, ...]:
    """Presses in all cases.

    Args:
        rests: Reading -> (k,) where the joint springs rest [rad]; the first is the posture on the table.
        table: Its height [m].
        depth: Of the spring's equilibrium under the table [m].
        settings: Of the experiment; task files are written into its folder.
    """
    at_table, above, deep_point, deep_flat = rests
    cases = [
        PressCase("rest at the table", at_table, False),
        PressCase("rest above it", above, False),
        PressCase("rest deep, point", deep_point, False),
        PressCase("rest deep, flat", deep_flat, True),
        PressCase("rest deep, flat, no friction", deep_flat, True, friction=0.0),
        PressCase("rest deep, flat, rough, quick", deep_flat, True, friction=0.6, lean=1.0),
    ]
    chosen = cases[: settings.choose(4, 6, 6)]
    start = rests[above]
    found = []
    for number, case in enumerate(chosen):
        settings.on_progress(0.7 + 0.3 * number / len(chosen), case.name)
        path = settings.work / f"press-{number}.yaml"
        path.write_text(_task_text(case, start, rests[case.reading], table, depth), encoding="utf-8")
        found.append(
            _press(case, assemble(str(path), effects=None, rate=None, scale=1.0, arm=None), settings.seed)
        )
    return tuple(found)


def _task_text(case: PressCase, start: Array, rest: Array, table: float, depth: float) -> str:
    """Writes ``slide-flat`` with the hand over the place, that leans and is then left alone."""
    document = task_document(TASK)
    data: Any = document.data
    arm = next(iter(data["arms"]))
    names, spring = list(data["arms"][arm]["posture"]), data["arms"][arm]["springs"][0]
    moved = f"{arm}.{spring['name']}"
    held = {axis: HELD for axis in ("rx", "ry", "rz")} if case.flat else {}
    braked = {axis: HELD_DAMPING for axis in ("rx", "ry", "rz")} if case.flat else {}
    posture = dict(zip(names, start.tolist(), strict=True))
    lean = {
        "name": "lean",
        "equilibrium": {moved: {"z": table - depth}},
        "posture": {arm: dict(zip(names, rest.tolist(), strict=True))},
        "duration": case.lean,
    }
    return changed(
        document,
        {
            ("name",): "press",
            ("arms", arm, "posture"): posture,
            ("arms", arm, "springs", 0, "stiffness"): {**spring["stiffness"], **held},
            ("arms", arm, "springs", 0, "damping"): {**spring["damping"], **braked},
            ("safety",): {"tank": TANK},
            ("environment", 0, "height"): table,
            ("environment", 0, "friction"): case.friction,
            ("phases",): [
                {"name": "lower", "equilibrium": {moved: {"z": table - 0.01}}, "duration": 2.0},
                lean,
                {"name": "hold", "duration": HOLD},
            ],
        },
    )


def _press(case: PressCase, assembly: Assembly, seed: int) -> PlantPress:
    hand, ticks = assembly.modules.arms[0].limb.hand, 0
    rows: list[tuple[float, float, Array]] = []

    def observe(state: RobotState, plant: Plant, _: Supervisor) -> None:
        nonlocal ticks
        if ticks % EVERY == 0:
            force = float(plant.contact_wrench(hand)[2])
            rows.append((state.time, force, plant.pose(hand).translation.copy()))
        ticks += 1

    watch_task(assembly, observe, seed=seed)
    time, force = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    touched = int(np.argmax(force > 0.0))
    moved = float(np.linalg.norm((rows[-1][2] - rows[touched][2])[:2]))
    return PlantPress(case.name, case.reading, time, force, moved)
