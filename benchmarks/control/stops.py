# SPDX-License-Identifier: BSD-3-Clause
"""Do stops calm? From random states inside the limits, at every rate, on plants that differ from the model.

Energy is kinetic plus that of the joints' springs and stops, counted once the torques under way have ended. The
difference between plant and model is unknown to the controller. Run: ``python -m benchmarks.control.stops``.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import product
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from impedance_modules.effects.apply import apply_to_plant
from impedance_modules.spec.patch_file import read_patch
from tests.support.stops import DIFFERENCES, Stop, assembly_at, plant_of, stop_from_random_state, write_patch

RATES = (1000.0, 500.0, 200.0, 100.0)
CASES: dict[str, tuple[str, ...]] = {
    "none": (),
    **{name: (name,) for name in DIFFERENCES},
    "delay, motor gain, backlash": ("delay", "motor gain", "backlash"),
    "lag, motor gain, sensor gain": ("lag", "motor gain", "sensor gain"),
}


def stops(
    folder: Path, rate: float, names: tuple[str, ...], count: int, random: np.random.Generator
) -> list[Stop]:
    """Several stops, each with its own draw of the differences."""
    assembly = assembly_at(folder, rate)
    found = []
    for k in range(count):
        effects = None
        if names:
            patch = write_patch(folder, assembly.model.joint_names, names, random)
            effects = apply_to_plant(assembly.model, read_patch(patch))
        found.append(stop_from_random_state(assembly, plant_of(assembly, effects, k), random))
    return found


def main() -> None:
    """Prints one row per difference and rate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=25, help="stops per row")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    random = np.random.default_rng(options.seed)
    table = Table(title=f"{options.count} stops per row, seed {options.seed}")
    for name in (
        "plant differs by",
        "rate [Hz]",
        "rise [J]",
        "time to 1 % [s]",
        "left [%]",
        "speed after / before",
    ):
        table.add_column(name)
    with tempfile.TemporaryDirectory() as folder:
        for (name, names), rate in product(CASES.items(), RATES):
            found = stops(Path(folder), rate, names, options.count, random)
            table.add_row(
                name,
                f"{rate:g}",
                f"{max(stop.rise for stop in found):.3f}",
                f"{max(stop.seconds for stop in found):.2f}",
                f"{100 * max(stop.left for stop in found):.2f}",
                f"{max(stop.speed / stop.speed_before for stop in found):.2f}",
            )
    Console(width=118).print(table)


if __name__ == "__main__":
    main()
