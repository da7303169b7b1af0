# SPDX-License-Identifier: BSD-3-Clause
"""``impedance import``: each recording from its tables to its Parquet file; all recordings are written, or none."""

from __future__ import annotations

import dataclasses
import math
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from impedance_modules.episode.columns import JOINT_KINDS, TIME, parse_columns
from impedance_modules.episode.damage import save_intact, survey
from impedance_modules.episode.file_format import episode_schema, is_required, write_merged
from impedance_modules.episode.imports.binary_tables import ParquetTable
from impedance_modules.episode.imports.convert import MappedTable, blocks, column_order, decimated, map_table
from impedance_modules.episode.imports.generated_maps import map_for
from impedance_modules.episode.imports.import_map import ImportMap
from impedance_modules.episode.imports.log_checks import Clock, PlausibilityCheck, SpeedMatch
from impedance_modules.episode.imports.log_sources import (
    RecordingFiles,
    kind_of,
    mapped_recordings,
    open_table,
    plain_recordings,
)
from impedance_modules.episode.imports.map_reader import parse_map, read_map
from impedance_modules.episode.imports.table import Block
from impedance_modules.episode.metadata import decode_metadata, episode_metadata
from impedance_modules.episode.reader import open_source
from impedance_modules.episode.run_folder import EPISODE
from impedance_modules.errors import BadInput

SUFFIX = ".parquet"


def import_sources(
    sources: Sequence[Path],
    map_path: Path | None,
    rate: float | None,
    out: Path,
    urdf: Path | None = None,
) -> tuple[Imported, ...]:
    """Turns logs into episodes ``OUT/NAME.parquet``.

    Args:
        sources: Files, directories of ROS 2 recordings or runs, or folders with files that the map describes.
        map_path: What the columns mean; None for bags of a shipped robot, joint recorder files and episodes.
        rate: Stated samples per second [Hz], for logs without time.
        out: Directory; episodes that are there already are never overwritten.
        urdf: Without a map: a description that names the joints of a log which only numbers them.

    Returns:
        What became of each recording.

    Raises:
        BadInput: Anything that would make a misleading episode; then nothing is written.
    """
    if rate is not None and not (math.isfinite(rate) and rate > 0.0):
        raise BadInput(f"--rate {rate:g}: no sampling rate (valid: above 0 Hz)")
    if urdf is not None and map_path is not None:
        raise BadInput(f"--urdf {urdf}: the map says which description counts (valid: 'urdf' in {map_path})")
    _refuse_twice(sources)
    mapping = read_map(map_path) if map_path is not None else None
    recordings = mapped_recordings(sources, mapping) if mapping is not None else plain_recordings(sources)
    _refuse_present([recording.name for recording in recordings], out)
    with _staging(out) as folder:
        done = [
            imported
            for recording in recordings
            for imported in _import_one(recording, mapping, rate, folder / (recording.name + SUFFIX), urdf)
        ]
        _refuse_present([imported.path.stem for imported in done], out)
        return tuple(_into_place(imported, out) for imported in done)


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


def import_recording(
    recording: RecordingFiles, mapping: ImportMap, rate: float | None, target: Path
) -> Imported:
    """Writes one recording as an episode.

    Args:
        recording: Its sources, one for each table of the map.
        mapping: The import map.
        rate: Stated on the command line [Hz], or None.
        target: Of the episode, in a directory for unfinished work.

    Raises:
        BadInput: Anything that would make a misleading episode.
    """
    parts = [
        map_table(open_table(path, table, mapping, target.parent), table, mapping)
        for path, table in zip(recording.paths, mapping.tables, strict=True)
    ]
    path, row_word = recording.paths[0], parts[0].table.row_word
    stated = _stated_rate(parts, mapping, rate)
    watch = _CheckedStream(
        Clock(path, row_word), PlausibilityCheck(mapping, path, rate_stated=stated is not None)
    )
    stream = decimated(watch.passing(blocks(parts, mapping, stated)), mapping)
    names = (TIME, *column_order(mapping))
    place = str(path)
    parse_columns(names, place)
    first = next(stream, None)
    if first is None:
        raise BadInput(f"{path}: no samples (valid: two or more)")
    schema = episode_schema(names, {"complete": True, **_metadata(recording, parts, mapping, stated)}, place)
    written = _ArrowTables(schema)
    write_merged(target, written.of(first, stream), schema)
    notes = [
        *mapping.notes,
        *(note for part in parts for note in part.table.notes),
        *watch.plausibility.notes,
    ]
    every = mapping.decimation.keep_every if mapping.decimation else 1
    return Imported(
        path=target,
        samples=written.rows,
        duration=watch.clock.duration,
        rate=watch.clock.rate / every,
        rate_stated=stated is not None,
        joints=len(mapping.joints),
        kinds=mapping.kinds,
        notes=tuple(dict.fromkeys(notes)),
    )


def copy_or_save(path: Path, target: Path) -> tuple[Imported, ...]:
    """Checks an episode, or a run's directory, and copies it; of a damaged or unfinished one, saves what is intact.

    Raises:
        BadInput: It is no episode, or one that would mislead, or nothing of it is intact.
    """
    if path.is_dir():
        with suppress(BadInput):  # damaged: what is intact comes next
            open_source(path)  # merges the parts of a killed run
    found = survey(path)
    file = path / EPISODE if path.is_dir() else path
    if file.exists() and not found.problems:
        return (copy_episode(file, target),)
    saved = save_intact(found, target.parent, target.stem)
    return tuple(
        dataclasses.replace(check_episode(file), notes=(note, *found.problems)) for file, note in saved
    )


def copy_episode(path: Path, target: Path) -> Imported:
    """Checks an episode's file and copies it.

    Raises:
        BadInput: It is no episode, or one that would mislead.
    """
    checked = check_episode(path)
    shutil.copyfile(path, target)
    return dataclasses.replace(checked, path=target, notes=("an episode already: checked and copied",))


def check_episode(path: Path) -> Imported:
    """Checks an episode's file.

    Raises:
        BadInput: It is no episode, or one that would mislead.
    """
    table = ParquetTable(path)
    layout = parse_columns(table.names, str(path))
    decode_metadata(table.metadata, str(path), has_effort=bool(layout.joints["effort"]))
    clock = Clock(path, table.row_word)
    for chunk in table.chunks([name for name in table.names if is_required(name)]):
        clock.take(Block(chunk.columns[TIME], chunk.columns, chunk.places))
    clock.finish()
    return Imported(
        path=path,
        samples=clock.samples,
        duration=clock.duration,
        rate=clock.rate,
        rate_stated=False,
        joints=len(layout.joints["position"]),
        kinds=tuple(kind for kind in JOINT_KINDS if layout.joints[kind]),
        notes=(),
    )


class _CheckedStream:
    """Hands blocks on and shows each to the checks, which finish after the last one."""

    def __init__(self, clock: Clock, plausibility: PlausibilityCheck) -> None:
        self.clock = clock
        self.plausibility = plausibility

    def passing(self, stream: Iterator[Block]) -> Iterator[Block]:
        for block in stream:
            self.clock.take(block)
            self.plausibility.take(block)
            yield block
        self.clock.finish()
        self.plausibility.finish()


class _ArrowTables:
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


def _stated_rate(parts: Sequence[MappedTable], mapping: ImportMap, rate: float | None) -> float | None:
    """Returns the rate to count time with; None where a table brings its own time."""
    place = parts[0].table.path
    if any(part.time is not None for part in parts):
        if rate is not None:
            raise BadInput(
                f"{place}: it has a time of its own, so --rate {rate:g} has no effect (valid: no --rate)"
            )
        return None
    if rate is not None and mapping.rate is not None and rate != mapping.rate:
        raise BadInput(
            f"--rate {rate:g}: {mapping.document.path} says 'rate: {mapping.rate:g}' (valid: one of the two,"
            " or the same)"
        )
    stated = rate if rate is not None else mapping.rate
    if stated is None:
        raise BadInput(
            f"{place}: no time base: the map names no time column, and no rate is stated{_rate_hint(parts, mapping)}"
            " (valid: 'rate: HZ' in the map, or --rate HZ, from whoever recorded it; or 'time' for the table)"
        )
    return stated


def _rate_hint(parts: Sequence[MappedTable], mapping: ImportMap) -> str:
    """The rate at which positions and velocities would agree, where the log has both."""
    first = next(blocks(parts, mapping, 1.0), None)
    if first is None:
        return ""
    match = SpeedMatch(mapping, parts[0].table.path, rate_stated=True)
    match.take(first)
    ratios = sorted(match.ratios().values())
    if not ratios or ratios[0] <= 0.0:
        return ""
    return f"; its velocities agree with its positions at about {ratios[len(ratios) // 2]:.3g} Hz"


def _metadata(
    recording: RecordingFiles, parts: Sequence[MappedTable], mapping: ImportMap, stated: float | None
) -> dict[str, Any]:
    imported: dict[str, Any] = {
        "sources": [path.name for path in recording.paths],
        "map": mapping.document.text,
        "time": "recorded" if stated is None else "stated",
    }
    if stated is not None:
        imported["rate"] = stated
    if mapping.decimation is not None:
        imported["decimate"] = {
            "keep_every": mapping.decimation.keep_every,
            "low_pass": mapping.decimation.low_pass,
        }
    starts = [start for part in parts if (start := getattr(part.table, "start", None)) is not None]
    if starts:
        imported["start_ns"] = starts[0]
    return episode_metadata(
        robot=mapping.robot,
        episode=recording.name,
        effort_source=mapping.effort_source,
        gravity_compensation=mapping.gravity_compensation,
        repeat_of=mapping.repeat_of(recording.name),
        task=None,
        imported=imported,
    )


def _import_one(
    recording: RecordingFiles, mapping: ImportMap | None, rate: float | None, target: Path, urdf: Path | None
) -> tuple[Imported, ...]:
    if mapping is not None:
        return (import_recording(recording, mapping, rate, target),)
    path = recording.paths[0]
    if kind_of(path) in ("run", "parquet"):
        if rate is not None:
            raise BadInput(
                f"{path}: it has a time of its own, so --rate {rate:g} has no effect (valid: no --rate)"
            )
        return copy_or_save(path, target)
    found = map_for(path, urdf)
    if found.missing:
        raise BadInput(
            f"{path}: it does not say the {'; nor the '.join(found.missing)} (valid: a map that does; the same command"
            " with --write-map FILE writes one in which only that is to be stated, for --map FILE)"
        )
    own = parse_map(Path(f"{path} (its own map)"), found.text)
    own = dataclasses.replace(own, notes=(*own.notes, *found.notes))
    return (import_recording(recording, own, rate, target),)


def _refuse_twice(sources: Sequence[Path]) -> None:
    places = [source.resolve() for source in sources]
    for source, place in zip(sources, places, strict=True):
        if places.count(place) > 1:
            raise BadInput(f"{source}: given twice (valid: each source once)")


def _refuse_present(names: Sequence[str], out: Path) -> None:
    existing = _closest_existing(out)
    if not existing.is_dir():
        raise BadInput(
            f"{out}: {existing} is a file, and episodes go into a directory (valid: another --out)"
        )
    for name in names:
        target = out / (name + SUFFIX)
        if target.exists():
            raise BadInput(f"{target}: already there (valid: another --out, or remove it)")


@contextmanager
def _staging(out: Path) -> Iterator[Path]:
    """A hidden directory on the same disk, removed however the import ends."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=".impedance-import-", dir=_closest_existing(out)))
    except OSError as error:
        raise BadInput(f"{out}: cannot be written: {error.strerror} (valid: another --out)") from error
    try:
        yield folder
    except OSError as error:
        raise BadInput(f"{out}: the import could not be written: {error}") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _closest_existing(out: Path) -> Path:
    """The path itself, or the closest of its parents that exists."""
    return next(path for path in (out, *out.absolute().parents) if path.exists())


def _into_place(imported: Imported, out: Path) -> Imported:
    out.mkdir(parents=True, exist_ok=True)
    target = out / imported.path.name
    imported.path.rename(target)
    return dataclasses.replace(imported, path=target)
