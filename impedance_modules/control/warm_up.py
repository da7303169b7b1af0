# SPDX-License-Identifier: BSD-3-Clause
"""A cycle gone through for nothing, so that the processor has code and data at hand when the real one is due.

At 100 Hz, a processor has forgotten everything within the 10 ms between two states: the first cycle after such a
pause takes twice as long as one right after another (docs/baxter.md, "Latency").
"""

from __future__ import annotations

import numpy as np

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.controller import Controller
from impedance_modules.robot.state import RobotState


class Rehearsal:
    """A twin of the controller that stands at the task's start for ever; nothing of it reaches a robot."""

    def __init__(self, assembly: Assembly) -> None:
        n = assembly.model.n
        parts = assembly.modules.posture.copy(), np.zeros(n), np.zeros(n)
        for part in parts:
            part.flags.writeable = False
        self._state = RobotState(0.0, *parts)
        self._twin = Controller(assembly)
        self._twin.start(FirstState(self._state, np.zeros(n)), assembly.task.phases[0])
        self._before = self._twin.memory.floats.copy()

    def __call__(self) -> None:
        """Computes the torque of the first cycle once more, on the memory as it was then."""
        np.copyto(self._twin.memory.floats, self._before)
        self._twin.tick(self._state)
