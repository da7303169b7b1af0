# SPDX-License-Identifier: BSD-3-Clause
"""An episode as a source: checked like any other log, and copied as it is."""

from __future__ import annotations

import shutil
from pathlib import Path

from impedance_modules.episode.columns import JOINT_KINDS, TIME, parse_columns
from impedance_modules.episode.run_folder import EPISODE
from impedance_modules.episode.imports.blocks import Block
from impedance_modules.episode.imports.clock import Clock
from impedance_modules.episode.imports.parquet_table import ParquetTable
from impedance_modules.episode.imports.pipeline import Imported
from impedance_modules.episode.metadata import decode_metadata
from impedance_modules.episode.file_format import is_required
from impedance_modules.episode.source import open_source


def copy_episode(path: Path, target: Path) -> Imported:
    """Checks an episode, or a run's directory, and copies it.

    Raises:
        BadInput: It is no episode, or one that would mislead.
    """
    if path.is_dir():
        open_source(path)  # merges the parts of a killed run
        path = path / EPISODE
    table = ParquetTable(path)
    layout = parse_columns(table.names, str(path))
    decode_metadata(table.metadata, str(path), has_effort=bool(layout.joints["effort"]))
    clock = Clock(path, table.row_word)
    for chunk in table.chunks([name for name in table.names if is_required(name)]):
        clock.take(Block(chunk.columns[TIME], chunk.columns, chunk.places))
    clock.finish()
    shutil.copyfile(path, target)
    return Imported(
        path=target,
        samples=clock.samples,
        duration=clock.duration,
        rate=clock.rate,
        rate_stated=False,
        joints=len(layout.joints["position"]),
        kinds=tuple(kind for kind in JOINT_KINDS if layout.joints[kind]),
        notes=("an episode already: checked and copied",),
    )
