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
from tests.support.stops import (
    EARTH,
    WEIGHTLESS,
    Stop,
    assembly_at,
    plant_of,
    stop_from_random_state,
    write_patch,
)

RATES = (1000.0, 500.0, 200.0, 100.0)
CARRIED: dict[str, tuple[str, ...]] = {
    "nothing": (),
    **{
        name: (name,) for name in ("delay", "lag", "backlash", "motor gain", "sensor gain", "lag of velocity")
    },
    "delay, motor gain, backlash": ("delay", "motor gain", "backlash"),
    "lag, motor gain, sensor gain": ("lag", "motor gain", "sensor gain"),
}
"""Differences under which the robot still carries its arms' weight."""

FALLING = {name: (name,) for name in ("motor gain", "payload", "tilt", "torque offset")}
"""Differences under which an arm at zero torque falls, or is lifted."""


def stops(
    folder: Path,
    rate: float,
    names: tuple[str, ...],
    count: int,
    random: np.random.Generator,
    gravity: tuple[float, float, float],
) -> list[Stop]:
    """Several stops, each with its own draw of the differences."""
    assembly = assembly_at(folder, rate)
    found = []
    for k in range(count):
        effects = None
        if names:
            patch = write_patch(folder, assembly.model.joint_names, names, random)
            effects = apply_to_plant(assembly.model, read_patch(patch))
        found.append(stop_from_random_state(assembly, plant_of(assembly, effects, k, gravity), random))
    return found


def carried_table(folder: Path, count: int, random: np.random.Generator) -> Table:
    """Weight carried exactly: energy must fall."""
    heads = ("rate [Hz]", "rise [J]", "time to 1 % [s]", "left [%]", "speed after / before", "travel [rad]")
    table = Table("plant differs by", *heads, title="weight carried exactly")
    for (name, names), rate in product(CARRIED.items(), RATES):
        found = stops(folder, rate, names, count, random, WEIGHTLESS)
        table.add_row(
            name,
            f"{rate:g}",
            f"{max(stop.rise for stop in found):.3f}",
            f"{max(stop.seconds for stop in found):.2f}",
            f"{100 * max(stop.left for stop in found):.2f}",
            f"{max(stop.speed / stop.speed_before for stop in found):.2f}",
            f"{max(stop.travel for stop in found):.2f}",
        )
    return table


def falling_table(folder: Path, count: int, random: np.random.Generator) -> Table:
    """Weight that nobody carries moves the arms until the hold has them."""
    heads = ("rate [Hz]", "speed / declared", "travel [rad]")
    table = Table("plant differs by", *heads, title="weight not carried")
    for (name, names), rate in product(FALLING.items(), RATES):
        found = stops(folder, rate, names, count, random, EARTH)
        speed, travel = max(stop.speed for stop in found), max(stop.travel for stop in found)
        table.add_row(name, f"{rate:g}", f"{speed:.2f}", f"{travel:.2f}")
    return table


def main() -> None:
    """Prints one row per difference and rate: the worst of its stops."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=25, help="stops per row")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    random = np.random.default_rng(options.seed)
    console = Console(width=118)
    console.print(f"the worst of {options.count} stops per row, seed {options.seed}")
    with tempfile.TemporaryDirectory() as folder:
        console.print(carried_table(Path(folder), options.count, random))
        console.print(falling_table(Path(folder), options.count, random))


if __name__ == "__main__":
    main()
