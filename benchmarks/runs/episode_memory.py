# SPDX-License-Identifier: BSD-3-Clause
"""Records ten minutes at 1 kHz, as fast as it goes, and prints time, memory and size.

Run: ``python -m benchmarks.runs.episode_memory [minutes]``. The bound is 600 MB for the whole process.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from impedance_modules.episode.columns import (
    JOINT_KINDS,
    joint_columns,
    pose_columns,
    target_columns,
    wrench_columns,
)
from impedance_modules.episode.metadata import episode_metadata
from impedance_modules.episode.writer import EpisodeWriter

BOUND = 600.0


def columns() -> list[str]:
    """Returns about 150 columns, as a two-arm run has."""
    joints = [f"joint{index}" for index in range(14)]
    names = ["time"]
    for kind in JOINT_KINDS:
        names += joint_columns(kind, joints)
    for frame in ("left_hand", "right_hand"):
        names += [*wrench_columns(frame), *pose_columns(frame), *target_columns(frame)]
    for module in ("left", "right"):
        names += [f"module.{module}.{joint}" for joint in joints]
    return [*names, "tank", "phase"]


def any_metadata() -> dict[str, object]:
    """Returns metadata of an episode without a task."""
    return episode_metadata(
        robot="any",
        episode="any",
        effort_source="joint_sensor",
        gravity_compensation="robot",
        repeat_of=None,
        task=None,
    )


def memory() -> float:
    """Returns the largest resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main() -> None:
    """Records, merges, prints."""
    count = round(float(sys.argv[1] if len(sys.argv) > 1 else 10) * 60_000)
    metadata = any_metadata()
    names = columns()
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(1024, len(names) - 1)) * 1e-3
    before, cost = memory(), 0.0
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        writer = EpisodeWriter(Path(folder), names, metadata, wait_for_disk=True)
        row = np.zeros(len(names) - 1)
        for index in range(count):
            row += noise[index & 1023]
            row[0] = index * 1e-3
            begun = time.perf_counter()
            writer.append(row, "slide")
            cost += time.perf_counter() - begun
        recorded, during = time.perf_counter(), memory()
        path = writer.close()
        each = cost / count * 1e6
        print(f"{len(names)} columns, {count} rows: {recorded - start:.1f} s, append {each:.2f} us")
        print(f"close: {time.perf_counter() - recorded:.1f} s, file {path.stat().st_size / 1e6:.0f} MB")
    print(f"memory: {before:.0f} MB before, {during:.0f} MB recording, {memory():.0f} MB after merging")
    if memory() > BOUND:
        raise SystemExit(f"more than {BOUND:.0f} MB")


if __name__ == "__main__":
    main()
