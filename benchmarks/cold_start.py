# SPDX-License-Identifier: BSD-3-Clause
"""How long ``impedance check`` takes from a cold process, and what it imports.

    python -m benchmarks.cold_start

Prints median and range of the whole command, beside importing pinocchio alone in the same run: wall time, and processor
time, which other jobs on the machine stretch less. Byte code is on disk, as after any first use.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence

ROUNDS = 7
SLOW = ("numba", "rerun", "pyarrow", "matplotlib", "scipy.signal")
CASES = {
    "python -c pass": ["-c", "pass"],
    "import pinocchio": ["-c", "import pinocchio"],
    "impedance check press-and-slide": ["-m", "impedance_modules", "check", "press-and-slide"],
}


def seconds(arguments: list[str]) -> tuple[float, float]:
    """Times one cold process: wall and processor [s]."""
    began, worked = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL, env=environment)
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = ended.ru_utime + ended.ru_stime - worked.ru_utime - worked.ru_stime
    return time.perf_counter() - began, processor


def spread(values: Sequence[float]) -> str:
    """Writes a median with its range."""
    return f"{statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


def main() -> None:
    """Prints the table."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in CASES}
    for arguments in CASES.values():
        seconds(arguments)
    for _ in range(ROUNDS):
        for name, arguments in CASES.items():
            found[name].append(seconds(arguments))
    print(f"| command | wall [s], {ROUNDS} rounds, interleaved | processor [s] |\n|---|---|---|")
    for name, values in found.items():
        print(f"| {name} | {' | '.join(spread(column) for column in zip(*values, strict=True))} |")
    probe = (
        "import sys; from impedance_modules.cli.main import impedance\n"
        "impedance.main(['check', 'press-and-slide'], standalone_mode=False)\n"
        f"print([name for name in {SLOW} if name in sys.modules], file=sys.stderr)"
    )
    imported = subprocess.run([sys.executable, "-c", probe], check=True, capture_output=True, text=True)
    print(f"slow modules imported by check: {imported.stderr.strip()}")


if __name__ == "__main__":
    main()
