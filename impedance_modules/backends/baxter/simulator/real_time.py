# SPDX-License-Identifier: BSD-3-Clause
"""Lets a double live in real time."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable

from impedance_modules.backends.baxter.simulator.journal import Journal
from impedance_modules.backends.baxter.simulator.pace import Pacer
from impedance_modules.backends.baxter.simulator.simulator_node import FakeNode

TURN = 0.0005
"""How long a thread may keep the others waiting [s]; commands come in threads of their own."""

COMPLAINT_PAUSE = 5.0
"""Slow machines are told about at most this often [s]."""


def live(
    node: FakeNode,
    journal: Journal,
    tell: Callable[[str], None],
    asked_to_end: Callable[[], bool],
    duration: float | None,
) -> float:
    """Lives until somebody asks for the end, or a duration [s] is over; closes the node in any case.

    Args:
        node: Open.
        journal: Takes notes.
        tell: Is told every event.
        asked_to_end: Asked every millisecond.
        duration: On the double's clock; None for no end.

    Returns:
        By how much its clock fell behind the wall's [s].
    """
    robot, pacer = node.robot, Pacer()
    told, complained = 0.0, -COMPLAINT_PAUSE
    turn = sys.getswitchinterval()
    sys.setswitchinterval(TURN)
    gc.freeze()
    gc.disable()
    try:
        while not asked_to_end() and (duration is None or robot.now < duration):
            pacer.wait()
            node.slipped = pacer.slipped
            node.tick()
            for text in journal.update():
                tell(f"{robot.now:9.3f} s  {text}")
            if pacer.slipped - told > 0.0 and robot.now - complained >= COMPLAINT_PAUSE:
                tell(f"{robot.now:9.3f} s  this machine is too slow: {pacer.slipped:.2f} s behind in all")
                told, complained = pacer.slipped, robot.now
    finally:
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(turn)
        node.close()
    return pacer.slipped
