# SPDX-License-Identifier: BSD-3-Clause
"""Faults in the control loop: the stop level that follows, the time to it, torque and speed after it; one table.

Run: ``python -m benchmarks.control.loop_faults``. Real time matters for one fault only, a slow cycle.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

from impedance_modules.safety.stop_levels import StopLevel
from tests.support.loop_faults import RATE, faults, faults_task, run_with


def main() -> None:
    """Prints one row per fault."""
    heads = ("stop", "after [s]", "torque / limit", "speed / declared", "reason")
    table = Table("fault", *heads, title=f"two arms lift their hands at {RATE:g} Hz")
    with tempfile.TemporaryDirectory() as folder:
        assembly = faults_task(Path(folder))
        for name in faults():
            verdict = run_with(assembly, name)
            went_on = verdict.level is StopLevel.RUN
            table.add_row(
                name,
                "goes on" if went_on else verdict.level.name.lower(),
                "" if went_on else f"{verdict.seconds:.3f}",
                f"{verdict.effort:.2f}",
                f"{verdict.speed:.2f}",
                verdict.reason,
            )
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
