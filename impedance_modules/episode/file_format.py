# SPDX-License-Identifier: BSD-3-Clause
"""Episodes as Parquet: the schema, part files of a running recording, and the merge that makes one file of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from impedance_modules.episode.columns import JOINT_KINDS, PHASE, TIME, parse_columns
from impedance_modules.episode.metadata import check_metadata, encode_metadata
from impedance_modules.episode.run_folder import (
    EPISODE,
    part_index,
    part_paths,
    remove_temporaries,
    whole_file,
)
from impedance_modules.episode.sealed_parquet import UNREADABLE, BlockFile, CheckedFile, encode_block
from impedance_modules.errors import BadInput

ROWS_PER_GROUP = 8192
"""Rows that a merge holds in memory at once: 10 MB at 150 columns."""

COLUMNS_AT_ONCE = 16
"""Columns that are made into Arrow's between two pauses: 0.1 ms."""


def episode_schema(columns: Sequence[str], metadata: Mapping[str, Any], place: str) -> pa.Schema:
    """Returns the Parquet schema: float64 columns, and text for ``phase``."""
    fields = [
        pa.field(name, pa.dictionary(pa.int32(), pa.string()) if name == PHASE else pa.float64())
        for name in columns
    ]
    return pa.schema(fields, metadata=encode_metadata(metadata, place))


def is_required(column: str) -> bool:
    """Returns whether every row must have a number: time, and what is known of a joint."""
    return column == TIME or column.partition(".")[0] in JOINT_KINDS


def rows_to_table(
    schema: pa.Schema,
    rows: NDArray[np.float64],
    phase_codes: NDArray[np.int32],
    phases: Sequence[str],
    pause: Callable[[], None] = lambda: None,
) -> pa.Table:
    """Builds a table from rows of numbers.

    Args:
        schema: From `episode_schema`.
        rows: (rows, float columns), in the schema's order without ``phase``. NaN becomes null in columns that
            need not have a value (``tank``, targets ...) and stays NaN, as evidence, in those that must.
        phase_codes: (rows,) index into ``phases``, or negative for no phase.
        phases: Phase names.
        pause: Called every few columns, for a thread that must not work all at once.
    """
    by_column = iter(np.ascontiguousarray(rows.T))
    arrays = []
    for number, name in enumerate(schema.names):
        if number % COLUMNS_AT_ONCE == 0:
            pause()
        if name == PHASE:
            codes = pa.array(phase_codes, mask=phase_codes < 0)
            arrays.append(pa.DictionaryArray.from_arrays(codes, pa.array(phases, pa.string())))
        else:
            arrays.append(pa.array(next(by_column), from_pandas=not is_required(name)))
    pause()
    return pa.Table.from_arrays(arrays, schema=schema)


def write_episode(
    path: Path,
    columns: Mapping[str, NDArray[np.float64] | Sequence[str | None]],
    metadata: Mapping[str, Any],
) -> Path:
    """Writes one Parquet file, whole or not at all.

    Args:
        path: Of the file; its directory exists.
        columns: Name -> (samples,) numbers; ``phase`` -> texts. NaN means no value in a column that need not
            have one.
        metadata: From `episode_metadata`.

    Raises:
        BadInput: Columns or metadata that no episode may have, or columns of different lengths.
    """
    place = str(path)
    names = tuple(columns)
    parse_columns(names, place)
    check_metadata(metadata, place, has_effort=any(name.startswith("effort.") for name in names))
    lengths = {len(values) for values in columns.values()}
    if len(lengths) != 1:
        raise BadInput(f"{place}: columns of {sorted(lengths)} samples (valid: all of one length)")
    schema = episode_schema(names, {"complete": True, **metadata}, place)
    arrays = [_array(name, columns[name]) for name in names]
    write_merged(Path(path), iter([pa.Table.from_arrays(arrays, schema=schema)]), schema)
    return Path(path)


def write_part(path: Path, table: pa.Table) -> None:
    """Writes one part, whole or not at all; quick rather than small."""
    dictionary = [PHASE] if PHASE in table.schema.names else False
    encoded = encode_block(table, compression="none", use_dictionary=dictionary)
    with whole_file(path) as stream:
        stream.write(encoded)


def write_merged(path: Path, tables: Iterator[pa.Table], schema: pa.Schema) -> None:
    """Writes tables as one compressed file, at most `ROWS_PER_GROUP` rows in memory beyond one table."""
    with whole_file(path) as stream, BlockFile(stream, schema, **_encoding(schema)) as file:
        held: list[pa.Table] = []
        for table in tables:
            held.append(table.replace_schema_metadata(schema.metadata))
            if sum(map(len, held)) < ROWS_PER_GROUP:
                continue
            together = pa.concat_tables(held)
            whole = len(together) - len(together) % ROWS_PER_GROUP
            for first in range(0, whole, ROWS_PER_GROUP):
                file.write(together.slice(first, ROWS_PER_GROUP).combine_chunks())
            held = [together.slice(whole)]
        if sum(map(len, held)):
            file.write(pa.concat_tables(held).combine_chunks())


def merge_parts(directory: Path, metadata: Mapping[str, Any] | None) -> Path:
    """Merges a directory's parts into ``episode.parquet`` and removes them.

    Args:
        directory: Of the run; nobody else may be writing it.
        metadata: Replaces the parts' metadata; None keeps it.

    Returns:
        The path of the episode. Parts next to a whole episode are what a kill during their removal left, and
        go; so do files that a kill left unfinished.

    Raises:
        BadInput: A part is damaged, or missing.
        OSError: The directory cannot be written.
    """
    target = directory / EPISODE
    remove_temporaries(directory)
    paths = part_paths(directory)
    if paths and not target.exists():
        _check_sequence(paths)
        schema = _read(paths[0]).schema
        if metadata is not None:
            schema = schema.with_metadata(encode_metadata(metadata, str(directory)))
        write_merged(target, map(_read, paths), schema)
        # A long run's picture comes next: what the merge needed must not count beside what the picture needs.
        pa.default_memory_pool().release_unused()
    for path in paths:
        path.unlink()
    return target


def read_parts(directory: Path) -> pa.Table:
    """Reads the parts of a run that is still being written, or that cannot be merged here."""
    paths = part_paths(directory)
    _check_sequence(paths)
    return pa.concat_tables([_read(path) for path in paths], promote_options="default")


def _check_sequence(paths: Sequence[Path]) -> None:
    for index, path in enumerate(paths):
        if part_index(path) != index:
            raise BadInput(f"{path}: part {index} of the episode, before it, is missing")


def _encoding(schema: pa.Schema) -> dict[str, Any]:
    """Returns writer options: split bytes of floats compress three times better than whole ones."""
    floats = [field.name for field in schema if pa.types.is_floating(field.type)]
    other = [field.name for field in schema if not pa.types.is_floating(field.type)]
    return {
        "compression": "zstd",
        "use_dictionary": other or False,
        "use_byte_stream_split": floats,
    }


def _read(path: Path) -> pa.Table:
    try:
        part = CheckedFile(path)
        groups = range(part.metadata.num_row_groups)
        tables = [table for group in groups for table in part.tables(group, ROWS_PER_GROUP)]
    except UNREADABLE as error:
        raise BadInput(f"{path}: damaged part of an episode: {error}") from error
    return pa.concat_tables(tables) if tables else part.schema.empty_table()


def _array(name: str, values: NDArray[np.float64] | Sequence[str | None]) -> pa.Array:
    if name == PHASE:
        return pa.array(values, pa.string()).dictionary_encode()
    return pa.array(np.asarray(values, dtype=np.float64), from_pandas=not is_required(name))
