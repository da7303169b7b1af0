# SPDX-License-Identifier: BSD-3-Clause
"""Turns one bit of every byte of an episode and says what reading makes of it.

Run: ``python -m benchmarks.runs.flipped_bits [--seed 0]``: a merged file of three blocks, then a folder of parts. Every
reading must either refuse, or give the numbers and the metadata that were written.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.runs.episode_memory import any_metadata
from impedance_modules.episode import file_format
from impedance_modules.episode.damage import survey
from impedance_modules.episode.data import Episode
from impedance_modules.episode.file_format import episode_schema, rows_to_table, write_merged, write_part
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_folder import part_path
from impedance_modules.errors import BadInput

NAMES = ("time", "position.a", "effort.a", "phase")
BLOCK, ROWS = 100, 250


def main() -> None:
    """Damages, reads, prints."""
    options = argparse.ArgumentParser()
    options.add_argument("--seed", type=int, default=0)
    rng = np.random.default_rng(options.parse_args().seed)
    file_format.ROWS_PER_GROUP = BLOCK
    schema = episode_schema(NAMES, any_metadata(), "benchmark")
    rows = np.column_stack([np.arange(ROWS) * 1e-3, rng.normal(size=(ROWS, 2))])
    tables = [
        rows_to_table(schema, part, np.zeros(len(part), np.int32), ["press"])
        for part in np.split(rows, range(50, ROWS, 50))
    ]
    print("what     bits  refused  same numbers  wrong numbers  rows intact: least")
    with tempfile.TemporaryDirectory() as folder:
        merged = Path(folder) / "merged.parquet"
        write_merged(merged, iter(tables), schema)
        print_line("file", rng, merged, merged)
        parts = Path(folder) / "run"
        parts.mkdir()
        for index, table in enumerate(tables):
            write_part(part_path(parts, index), table)
        print_line("part", rng, part_path(parts, 2), parts)


def print_line(what: str, rng: np.random.Generator, damaged: Path, place: Path) -> None:
    """Turns a random bit of every byte of a file and reads the recording at ``place``."""
    content = damaged.read_bytes()
    true = _read_copy(place)
    found, least = Counter[str](), ROWS
    for byte in range(len(content)):
        wrong = bytearray(content)
        wrong[byte] ^= 1 << rng.integers(8)
        damaged.write_bytes(wrong)
        try:
            found["same" if _same(_read_copy(place), true) else "wrong"] += 1
        except BadInput:
            found["refused"] += 1
            least = min(least, survey(place).intact_rows)
    damaged.write_bytes(content)
    print(
        f"{what}  {len(content):7d}  {found['refused']:7d}  {found['same']:12d}  {found['wrong']:13d}"
        f"  {least:8d} of {ROWS}"
    )


def _read_copy(place: Path) -> Episode:
    """Reads a recording, or a copy of a folder: reading merges its parts."""
    if place.is_file():
        return read_episode(place)
    with tempfile.TemporaryDirectory() as folder:
        return read_episode(shutil.copytree(place, Path(folder) / "copy"))


def _same(one: Episode, other: Episode) -> bool:
    return (
        one.metadata == other.metadata
        and np.array_equal(one.time, other.time)
        and np.array_equal(one.matrix("position"), other.matrix("position"))
        and np.array_equal(one.matrix("effort"), other.matrix("effort"))
        and np.array_equal(one.phase, other.phase)
    )


if __name__ == "__main__":
    main()
