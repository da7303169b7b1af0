# SPDX-License-Identifier: BSD-3-Clause
"""What a run came to, in numbers: gathered cycle by cycle, written to ``summary.json`` at the end."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.summary import write_summary
from impedance_modules.runs.tally import Tally
from impedance_modules.safety.attribute import attribute

Array = NDArray[np.float64]

ATTRIBUTED = 5
"""One in so many of the cycles that the filter changed is attributed to rows and modules."""


class Summary:
    """Gathers a run: peaks and sums from its recorded rows, the filter's reductions from the controller."""

    def __init__(
        self, assembly: Assembly, supervisor: Supervisor, columns: Sequence[str], backend: str, seed: int
    ) -> None:
        """Args are the run's, with the columns of its rows (``record.Recorder``)."""
        self._assembly, self._supervisor = assembly, supervisor
        self._backend, self._seed = backend, seed
        self._tally = Tally(assembly, columns)
        self._changed = self._attributed = 0
        self._reduced: dict[tuple[str, str], float] = defaultdict(float)

    def add(self, row: Array) -> None:
        """Takes one cycle's recorded row."""
        self._tally.add(row)
        if self._supervisor.controller.changed:
            if self._changed % ATTRIBUTED == 0:
                self._attribute()
            self._changed += 1

    def _attribute(self) -> None:
        controller = self._supervisor.controller
        if controller.solution is None:
            return
        self._attributed += 1
        found = attribute(
            controller.cycle.problem,
            controller.layout,
            controller.solution,
            controller.module_names,
            controller.cycle.modules.efforts,
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
        tank, tally = self._supervisor.controller.tank, self._tally
        return {
            "initial": self._assembly.tank.initial,
            "lowest": tally.lowest,
            "final": tank.level,
            "floor": self._assembly.tank.floor,
            "max": self._assembly.tank.max,
            "spilled": tank.spilled,
            "charged_for_sensing": tank.charged,
            "work": tank.work,
            "work_bound": tank.work_bound,
            "softest_springs": tally.softest,
            "cycles_slowed": tally.slowed,
            "unit": "J",
        }

    def _hand_numbers(self) -> dict[str, Any]:
        return {
            hand.frame: {
                "tracking_rms": hand.error_rms,
                "tracking_peak": hand.error_peak,
                "start_force": hand.force_start,
                "peak_force": hand.force_peak,
                "units": "m, m, N, N",
            }
            for hand in self._tally.hands
        }

    def write(self, directory: Path, *, interrupted: bool) -> dict[str, Any]:
        """Writes the summary and returns it."""
        supervisor, assembly, tally = self._supervisor, self._assembly, self._tally
        tally.finish()
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
            "duration": tally.duration,
            "cycles": tally.cycles,
            "late_cycles": tally.late,
            "phases": [
                {"name": name, "seconds": seconds, "ended_by": why}
                for name, seconds, why in supervisor.sequence.ended
            ],
            "tank": self._tank(),
            "torque_peak_over_limit": dict(zip(names, (tally.effort_peak / limits).tolist(), strict=True)),
            "hands": self._hand_numbers(),
            "filter": {"cycles_changed": self._changed, "reductions": self._reductions()},
            "messages": [{"time": time, "text": text} for time, text in supervisor.messages],
        }
        write_summary(directory, summary)
        return summary
