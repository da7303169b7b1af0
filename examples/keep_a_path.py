# SPDX-License-Identifier: BSD-3-Clause
"""Keeps the path of a hand of a run in a small file, for tasks that retrace it: tasks/figure-of-eight.parquet is one.

Run: ``python examples/keep_a_path.py [DIRECTORY]``. A task beside the file then says
``equilibrium: {right.hand: {path: {episode: figure-of-eight.parquet}}}``; a whole run's folder would do as well.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pyarrow.parquet as pq

import impedance_modules as im

METADATA = b"impedance_modules"
EVERY = 20
"""Samples of a run at 1 kHz of which one is kept: 50 Hz."""


def keep_path(run: Path, frame: str, kept: Path) -> int:
    """Writes some samples of a run's time, joint positions and one frame's pose; returns how many."""
    table = pq.read_table(run / "episode.parquet")
    said = json.loads(table.schema.metadata[METADATA])
    wanted = ("time", "position.", f"pose.{frame}.")
    columns = [name for name in table.column_names if name.startswith(wanted)]
    thin = table.select(columns).take(list(range(0, len(table), EVERY)))
    about = {key: said[key] for key in ("format", "robot", "gravity_compensation")}
    about |= {"episode": kept.stem, "effort_source": None, "repeat_of": None, "task": None}
    pq.write_table(thin.replace_schema_metadata({METADATA: json.dumps(about)}), kept, compression="zstd")
    return len(thin)


def main(out: Path) -> None:
    """Runs a task on the built-in plant and keeps the path of its right hand."""
    result = im.run(im.load_task("draw-eight"), out)
    kept = out / "figure-of-eight.parquet"
    samples = keep_path(result.directory, "right_hand", kept)
    print(f"kept {samples} samples of right_hand in {kept}, {kept.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/keep-a-path"))
