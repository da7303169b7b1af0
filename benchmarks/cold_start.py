# SPDX-License-Identifier: BSD-3-Clause
"""How long ``impedance check`` takes from a cold process, and what it imports.

    python benchmarks/cold_start.py

Prints median and range of the whole command, beside importing pinocchio alone in the same run.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

ROUNDS = 7
SLOW = ("numba", "rerun", "pyarrow", "matplotlib")
CASES = {
    "python -c pass": ["-c", "pass"],
    "import pinocchio": ["-c", "import pinocchio"],
    "impedance check press-and-slide": ["-m", "impedance_modules", "check", "press-and-slide"],
}


def seconds(arguments: list[str]) -> float:
    """Times one cold process [s]."""
    began = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - began


def main() -> None:
    """Prints the table."""
    found: dict[str, list[float]] = {name: [] for name in CASES}
    for _ in range(ROUNDS):
        for name, arguments in CASES.items():
            found[name].append(seconds(arguments))
    print(f"| command | median [s] | range [s] ({ROUNDS} rounds, interleaved) |\n|---|---|---|")
    for name, values in found.items():
        print(f"| {name} | {statistics.median(values):.2f} | {min(values):.2f} to {max(values):.2f} |")
    probe = (
        "import sys; from impedance_modules.cli.main import impedance\n"
        "impedance.main(['check', 'press-and-slide'], standalone_mode=False)\n"
        f"print([name for name in {SLOW} if name in sys.modules], file=sys.stderr)"
    )
    imported = subprocess.run([sys.executable, "-c", probe], check=True, capture_output=True, text=True)
    print(f"slow modules imported by check: {imported.stderr.strip()}")


if __name__ == "__main__":
    main()
