# SPDX-License-Identifier: BSD-3-Clause
"""One recording from its tables to its Parquet file, watched all the way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from impedance_modules.episode.columns import TIME, parse_columns
from impedance_modules.episode.imports.blocks import Block
from impedance_modules.episode.imports.clock import Clock
from impedance_modules.episode.imports.convert import Part, blocks, column_order, make_part
from impedance_modules.episode.imports.decimate import decimated
from impedance_modules.episode.imports.import_map import ImportMap
from impedance_modules.episode.imports.log_sources import open_table
from impedance_modules.episode.imports.log_checks import Plausibility
from impedance_modules.episode.imports.recordings import Recording
from impedance_modules.episode.imports.speed_match import SpeedMatch
from impedance_modules.episode.metadata import episode_metadata
from impedance_modules.episode.file_format import episode_schema, is_required, write_merged
from impedance_modules.errors import BadInput


@dataclass(frozen=True)
class Imported:
    """What became of one recording.

    Attributes:
        path: Its episode.
        samples: Rows of the episode.
        duration: From the first sample to the last [s].
        rate: Samples per second of the episode [Hz].
        rate_stated: The log had no time of its own.
        joints: How many.
        kinds: Joint quantities.
        notes: What the reader should know, in sentences.
    """

    path: Path
    samples: int
    duration: float
    rate: float
    rate_stated: bool
    joints: int
    kinds: tuple[str, ...]
    notes: tuple[str, ...]


def import_recording(recording: Recording, what: ImportMap, rate: float | None, target: Path) -> Imported:
    """Writes one recording as an episode.

    Args:
        recording: Its sources, one for each table of the map.
        what: The map.
        rate: Stated on the command line [Hz], or None.
        target: Of the episode, in a directory for unfinished work.

    Raises:
        BadInput: Anything that would make a misleading episode.
    """
    parts = [
        make_part(open_table(path, table, what, target.parent), table, what)
        for path, table in zip(recording.paths, what.tables, strict=True)
    ]
    path, row_word = recording.paths[0], parts[0].table.row_word
    stated = _stated_rate(parts, what, rate)
    watch = _Watch(Clock(path, row_word), Plausibility(what, path, rate_stated=stated is not None))
    stream = decimated(watch.passing(blocks(parts, what, stated)), what)
    names = (TIME, *column_order(what))
    place = str(path)
    parse_columns(names, place)
    first = next(stream, None)
    if first is None:
        raise BadInput(f"{path}: no samples (valid: two or more)")
    schema = episode_schema(names, {"complete": True, **_metadata(recording, parts, what, stated)}, place)
    written = _Tables(schema)
    write_merged(target, written.of(first, stream), schema)
    notes = [*what.notes, *(note for part in parts for note in part.table.notes), *watch.plausibility.notes]
    every = what.decimation.keep_every if what.decimation else 1
    return Imported(
        path=target,
        samples=written.rows,
        duration=watch.clock.duration,
        rate=watch.clock.rate / every,
        rate_stated=stated is not None,
        joints=len(what.joints),
        kinds=what.kinds,
        notes=tuple(dict.fromkeys(notes)),
    )


class _Watch:
    """Lets blocks pass while clock and plausibility look at them; they judge when the last has passed."""

    def __init__(self, clock: Clock, plausibility: Plausibility) -> None:
        self.clock = clock
        self.plausibility = plausibility

    def passing(self, stream: Iterator[Block]) -> Iterator[Block]:
        for block in stream:
            self.clock.take(block)
            self.plausibility.take(block)
            yield block
        self.clock.finish()
        self.plausibility.finish()


class _Tables:
    """Turns blocks into Arrow tables and counts their rows."""

    def __init__(self, schema: pa.Schema) -> None:
        self.rows = 0
        self._schema = schema

    def of(self, first: Block, rest: Iterator[Block]) -> Iterator[pa.Table]:
        yield self._table(first)
        for block in rest:
            yield self._table(block)

    def _table(self, block: Block) -> pa.Table:
        self.rows += len(block.time)
        values = {TIME: block.time, **block.columns}
        arrays = [
            pa.array(np.ascontiguousarray(values[name]), from_pandas=not is_required(name))
            for name in self._schema.names
        ]
        return pa.Table.from_arrays(arrays, schema=self._schema)


def _stated_rate(parts: Sequence[Part], what: ImportMap, rate: float | None) -> float | None:
    """Returns the rate to count time with; None where a table brings its own time."""
    place = parts[0].table.path
    if any(part.time is not None for part in parts):
        if rate is not None:
            raise BadInput(
                f"{place}: it has a time of its own, so --rate {rate:g} has no effect (valid: no --rate)"
            )
        return None
    if rate is not None and what.rate is not None and rate != what.rate:
        raise BadInput(
            f"--rate {rate:g}: {what.document.path} says 'rate: {what.rate:g}' (valid: one of the two, or the same)"
        )
    stated = rate if rate is not None else what.rate
    if stated is None:
        raise BadInput(
            f"{place}: no time base: the map names no time column, and no rate is stated{_rate_hint(parts, what)}"
            " (valid: 'rate: HZ' in the map, or --rate HZ, from whoever recorded it; or 'time' for the table)"
        )
    return stated


def _rate_hint(parts: Sequence[Part], what: ImportMap) -> str:
    """The rate at which positions and velocities would agree, where the log has both."""
    first = next(blocks(parts, what, 1.0), None)
    if first is None:
        return ""
    match = SpeedMatch(what, parts[0].table.path, rate_stated=True)
    match.take(first)
    ratios = sorted(match.ratios().values())
    if not ratios or ratios[0] <= 0.0:
        return ""
    return f"; its velocities agree with its positions at about {ratios[len(ratios) // 2]:.3g} Hz"


def _metadata(
    recording: Recording, parts: Sequence[Part], what: ImportMap, stated: float | None
) -> dict[str, Any]:
    imported: dict[str, Any] = {
        "sources": [path.name for path in recording.paths],
        "map": what.document.text,
        "time": "recorded" if stated is None else "stated",
    }
    if stated is not None:
        imported["rate"] = stated
    if what.decimation is not None:
        imported["decimate"] = {
            "keep_every": what.decimation.keep_every,
            "low_pass": what.decimation.low_pass,
        }
    starts = [start for part in parts if (start := getattr(part.table, "start", None)) is not None]
    if starts:
        imported["start_ns"] = starts[0]
    return episode_metadata(
        robot=what.robot,
        episode=recording.name,
        effort_source=what.effort_source,
        gravity_compensation=what.gravity_compensation,
        repeat_of=what.repeat_of(recording.name),
        task=None,
        imported=imported,
    )
