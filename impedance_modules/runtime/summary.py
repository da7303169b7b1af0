# SPDX-License-Identifier: BSD-3-Clause
"""What a run came to, in numbers: gathered cycle by cycle, written to ``summary.json`` at the end."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.summary import write_summary
from impedance_modules.robot.state import RobotState
from impedance_modules.runtime.assembly import Assembly
from impedance_modules.runtime.supervisor import Supervisor
from impedance_modules.safety.attribute import attribute

Array = NDArray[np.float64]

PACED_SHARE = 10
"""Where time is real, one in so many of the cycles that the filter changed is attributed; else every one."""


class Summary:
    """Peaks, sums and lows of a run."""

    def __init__(
        self, assembly: Assembly, supervisor: Supervisor, backend: str, seed: int, *, paced: bool
    ) -> None:
        self._every = PACED_SHARE if paced else 1
        self._assembly, self._supervisor = assembly, supervisor
        self._backend, self._seed = backend, seed
        arms = assembly.modules.arms
        self._time = (np.inf, -np.inf)
        self._peak = np.zeros(assembly.model.n)
        self._force = np.zeros(len(arms))
        self._error = np.zeros(len(arms))
        self._error_peak = np.zeros(len(arms))
        self._cycles = self._late = self._changed = self._slowed = 0
        self._lowest = assembly.tank.initial
        self._softest = 1.0
        self._reduced: dict[tuple[str, str], float] = defaultdict(float)
        self._attributed = 0

    def add(self, state: RobotState, effort: Array, *, late: bool) -> None:
        """Takes one cycle."""
        controller, supervisor = self._supervisor.controller, self._supervisor
        self._time = min(self._time[0], state.time), max(self._time[1], state.time)
        self._cycles += 1
        self._late += late
        np.maximum(self._peak, np.abs(effort), out=self._peak)
        self._lowest = min(self._lowest, controller.level)
        self._softest = min(self._softest, controller.spring_scale)
        self._slowed += controller.granted < 1.0 or controller.paid < 1.0
        if controller.changed:
            self._changed += 1
            if self._changed % self._every == 0:
                self._attribute()
        if self._cycles % 10 == 0:
            self._hands(supervisor)

    def _hands(self, supervisor: Supervisor) -> None:
        memory, kinematics = supervisor.controller.memory, supervisor.controller.kinematics
        slots = memory.index("slots")
        for row in range(len(self._force)):
            force = float(np.linalg.norm(supervisor.touch.wrench[row, :3]))
            self._force[row] = max(self._force[row], force)
            springs = np.flatnonzero(slots == row)
            if springs.size:
                target = memory["target_translation"][springs[0]]
                error = float(np.linalg.norm(kinematics.translation[row] - target))
                self._error[row] += error**2
                self._error_peak[row] = max(self._error_peak[row], error)

    def _attribute(self) -> None:
        controller = self._supervisor.controller
        if controller.solution is None:
            return
        self._attributed += 1
        found = attribute(
            controller.workspace.problem,
            controller.solution,
            controller.module_names,
            controller.memory["efforts"],
        )
        for reduction in found:
            self._reduced[reduction.row, reduction.module or "motion"] += reduction.amount

    def _reductions(self) -> list[dict[str, Any]]:
        """Mean torque that each row took from each module while the filter was at work, largest first."""
        ranked = sorted(self._reduced.items(), key=lambda item: -item[1])
        return [
            {"row": row, "module": module, "mean": amount / self._attributed, "unit": "N.m"}
            for (row, module), amount in ranked[:20]
        ]

    def _tank(self) -> dict[str, Any]:
        tank = self._supervisor.controller.tank
        return {
            "initial": self._assembly.tank.initial,
            "lowest": self._lowest,
            "final": tank.level,
            "floor": self._assembly.tank.floor,
            "max": self._assembly.tank.max,
            "spilled": tank.spilled,
            "charged_for_sensing": tank.charged,
            "work": tank.work,
            "work_bound": tank.work_bound,
            "softest_springs": self._softest,
            "cycles_slowed": self._slowed,
            "unit": "J",
        }

    def _hand_numbers(self) -> dict[str, Any]:
        looks = max(1, self._cycles // 10)
        return {
            arm.limb.hand: {
                "tracking_rms": float(np.sqrt(self._error[row] / looks)),
                "tracking_peak": float(self._error_peak[row]),
                "peak_force": float(self._force[row]),
                "units": "m, m, N",
            }
            for row, arm in enumerate(self._assembly.modules.arms)
        }

    def write(self, directory: Path, *, interrupted: bool) -> dict[str, Any]:
        """Writes the summary and returns it."""
        supervisor, assembly = self._supervisor, self._assembly
        names = assembly.model.joint_names
        limits = assembly.limits.effort_max
        summary = {
            "format": 1,
            "task": assembly.task.name,
            "robot": assembly.robot.name,
            "backend": self._backend,
            "seed": self._seed,
            "rate": assembly.rate,
            "scale": assembly.scale,
            "ending": "recording ended" if supervisor.ending is None else supervisor.ending.value,
            "reason": supervisor.reason,
            "interrupted": interrupted,
            "duration": float(self._time[1] - self._time[0]) if self._cycles else 0.0,
            "cycles": self._cycles,
            "late_cycles": self._late,
            "phases": [
                {"name": name, "seconds": seconds, "ended_by": why}
                for name, seconds, why in supervisor.sequence.ended
            ],
            "tank": self._tank(),
            "torque_peak_over_limit": dict(zip(names, (self._peak / limits).tolist(), strict=True)),
            "hands": self._hand_numbers(),
            "filter": {"cycles_changed": self._changed, "reductions": self._reductions()},
            "messages": [{"time": time, "text": text} for time, text in supervisor.messages],
        }
        write_summary(directory, summary)
        return summary
