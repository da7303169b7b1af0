# SPDX-License-Identifier: BSD-3-Clause
"""Reads an episode from its file, or from the parts that a killed run left, and refuses one that would mislead.

Every message says what is wrong, where, and what would be valid.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from impedance_modules.arrays import Indices
from impedance_modules.episode.columns import (
    FRAME_KINDS,
    HINGE,
    HINGE_COLUMNS,
    JOINT_KINDS,
    PHASE,
    TANK,
    TIME,
    EpisodeColumns,
    parse_columns,
)
from impedance_modules.episode.damage import refusal, survey
from impedance_modules.episode.data import Episode, Matrix, Texts, Vector
from impedance_modules.episode.exact_numbers import exact_doubles, refuse_many_rows
from impedance_modules.episode.file_format import is_required, merge_parts, read_parts
from impedance_modules.episode.metadata import decode_metadata
from impedance_modules.episode.run_folder import EPISODE, RunLock, part_paths, remove_temporaries
from impedance_modules.episode.sealed_parquet import UNREADABLE, CheckedFile
from impedance_modules.errors import BadInput
from impedance_modules.input_files import check_file

KINDS: tuple[str, ...] = (*JOINT_KINDS, *FRAME_KINDS, PHASE, TANK, HINGE, "extra")
ReadColumn = Callable[[str], pa.ChunkedArray]
Read = TypeVar("Read")


def read_episode(
    path: Path | str,
    kinds: Collection[str] | None = None,
    *,
    most_samples: int | None = None,
    rows: Sequence[tuple[int, int]] | None = None,
) -> Episode:
    """Reads one recording.

    Time is taken as it was recorded: whether it jitters or repeats is for the diagnosis to judge.

    Args:
        path: A Parquet file, or a run's directory; the parts of a killed run are merged first.
        kinds: What to read beside time, out of `KINDS`; None reads all. A long recording of many columns is
            read in a fraction of the memory when only its joints matter.
        most_samples: Keeps every n-th sample, n as small as this allows, e.g. for a picture; None keeps all.
            The metadata then say n as ``kept_every``.
        rows: Keeps only these stretches, first row and last + 1 of each; None keeps all.

    Raises:
        BadInput: Missing, empty, truncated or not Parquet; no ``time`` or no ``position.<joint>``; a value
            that is not a finite number; metadata missing or wrong.
    """
    place = str(path)
    unknown = sorted(set(kinds or ()) - set(KINDS))
    if unknown:
        raise BadInput(f"{place}: '{unknown[0]}' is no kind of column (valid: {', '.join(KINDS)})")
    schema, count, read = open_source(Path(path))
    layout = parse_columns(schema.names, place)
    metadata = decode_metadata(schema.metadata, place, has_effort=bool(layout.joints["effort"]))
    if count == 0:
        raise BadInput(f"{place}: the episode has no samples (valid: at least one row)")
    every = 1 if most_samples is None else max(1, -(-count // most_samples))
    if most_samples is not None:
        metadata["kept_every"] = every
    kept = None if rows is None else np.concatenate([np.arange(first, stop) for first, stop in rows])
    pick = slice(None, None, every) if kept is None else kept
    columns = _Columns(schema, read, place, frozenset(KINDS if kinds is None else kinds), pick)
    samples = len(np.arange(count)[pick])
    return Episode(
        time=columns.number(TIME),
        **{kind: columns.joints(kind, layout) for kind in JOINT_KINDS},
        **{kind: columns.frames(kind, layout, samples) for kind in FRAME_KINDS},
        phase=columns.text(PHASE) if columns.has(PHASE) else None,
        tank=columns.number(TANK) if columns.has(TANK) else None,
        extra=columns.extra(layout.extra),
        labels=columns.labels(layout.extra),
        metadata=MappingProxyType(metadata),
        source=Path(path),
    )


def open_source(path: Path) -> tuple[pa.Schema, int, ReadColumn]:
    """Opens an episode file or a run's directory.

    A directory with parts of a run that is over gets them merged first. Parts of a run that is still going,
    or in a directory that cannot be written (a full disk), are read as they are.

    Returns:
        Its schema, its number of rows, and a function that reads one column.

    Raises:
        BadInput: Nothing there, empty, not Parquet, or damaged: then also what of it is intact.
    """
    directory = path if path.is_dir() else path.parent
    if path.is_dir():
        with suppress(OSError):  # a read-only directory: what a kill left stays
            remove_temporaries(directory)
    if path.is_dir() or (path.name == EPISODE and not path.exists()):
        if part_paths(directory) and not _merge_if_over(directory):
            table = _checked(directory, lambda: read_parts(directory))
            return table.schema, len(table), table.column
        path = directory / EPISODE
        if not path.exists():
            raise BadInput(
                f"{directory}: no episode here (valid: a directory with {EPISODE}, or a Parquet file)"
            )
    return _open_file(path)


class _Columns:
    """Reads and checks one file's columns, one at a time."""

    def __init__(
        self, schema: pa.Schema, read: ReadColumn, place: str, kinds: Collection[str], pick: slice | Indices
    ) -> None:
        self._pick = pick
        self._whole = isinstance(pick, slice) and pick.step == 1
        self._schema = schema
        self._read = read
        self._place = place
        self._kinds = kinds

    def has(self, kind: str) -> bool:
        return kind in self._kinds and kind in self._schema.names

    def joints(self, kind: str, layout: EpisodeColumns) -> Mapping[str, Vector]:
        wanted = layout.joints[kind] if kind in self._kinds else {}
        return MappingProxyType({joint: self.number(name) for joint, name in wanted.items()})

    def frames(self, kind: str, layout: EpisodeColumns, rows: int) -> Mapping[str, Matrix]:
        wanted = layout.frames[kind] if kind in self._kinds else {}
        return MappingProxyType({frame: self._frame(names, rows) for frame, names in wanted.items()})

    def extra(self, names: Sequence[str]) -> Mapping[str, Vector]:
        """Reads columns of no other kind; of a hinge alone where only that is asked for."""
        asked = [
            name
            for name in names
            if "extra" in self._kinds or (name in HINGE_COLUMNS and HINGE in self._kinds)
        ]
        wanted = [name for name in asked if not self._is_text(name)]
        return MappingProxyType({name: self.number(name) for name in wanted})

    def labels(self, names: Sequence[str]) -> Mapping[str, Texts]:
        wanted = [name for name in names if "extra" in self._kinds and self._is_text(name)]
        return MappingProxyType({name: self.text(name) for name in wanted})

    def number(self, name: str) -> Vector:
        """Returns a column as read-only float64; NaN where a value is missing and may be."""
        kind = self._schema.field(name).type
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise BadInput(f"{self._place}: column '{name}' holds {kind} (valid: float64 numbers)")
        values: Vector = self._decoded(name, pa.float64()).to_numpy()
        self._check_finite(name, values)
        return _frozen(values if self._whole else values[self._pick].copy())

    def text(self, name: str) -> Texts:
        if not self._is_text(name):
            raise BadInput(
                f"{self._place}: column '{name}' holds {self._schema.field(name).type} (valid: text)"
            )
        encoded = self._decoded(name, pa.string()).dictionary_encode().combine_chunks()
        try:
            texts = encoded.dictionary.to_pylist()
        except UnicodeDecodeError as error:
            raise BadInput(f"{self._place}: column '{name}' is no UTF-8 text: {error}") from error
        # One object per name, and None, reached by code -1, where there is no text.
        names = np.array([*texts, None], dtype=object)
        return _frozen(names[encoded.indices.fill_null(-1).to_numpy()[self._pick]])

    def _decoded(self, name: str, kind: pa.DataType) -> pa.ChunkedArray:
        read = self._read(name)
        try:
            return exact_doubles(self._place, name, read) if kind == pa.float64() else read.cast(kind)
        except pa.ArrowException as error:
            raise BadInput(f"{self._place}: column '{name}' cannot be read: {error}") from error

    def _frame(self, names: Sequence[str | None], rows: int) -> Matrix:
        values = np.full((rows, len(names)), np.nan)
        for index, name in enumerate(names):
            if name is not None:
                values[:, index] = self.number(name)
        return _frozen(values)

    def _is_text(self, name: str) -> bool:
        kind = self._schema.field(name).type
        inner = kind.value_type if pa.types.is_dictionary(kind) else kind
        return bool(pa.types.is_string(inner) or pa.types.is_large_string(inner) or pa.types.is_null(inner))

    def _check_finite(self, name: str, values: Vector) -> None:
        bad = ~np.isfinite(values) if is_required(name) else np.isinf(values)
        if bad.any():
            row = int(np.argmax(bad))
            value = "missing or NaN" if np.isnan(values[row]) else str(values[row])
            raise BadInput(
                f"{self._place}: column '{name}' is {value} in row {row} of {len(values)}"
                " (valid: finite numbers; leave out a column that was not measured)"
            )


def _frozen(values: NDArray[Any]) -> NDArray[Any]:
    """Returns the array, read-only."""
    values.setflags(write=False)
    return values


def _merge_if_over(directory: Path) -> bool:
    """Makes an episode of a finished run's parts; returns False if they must stay parts."""
    try:
        lock = RunLock.try_acquire(directory)
    except OSError:
        return False  # a read-only directory: nobody can be writing it, and neither can we
    if lock is None:
        return False
    try:
        _checked(directory, lambda: merge_parts(directory, None))
    except OSError:
        return False  # a full disk
    finally:
        lock.release()
    return True


def _open_file(path: Path) -> tuple[pa.Schema, int, ReadColumn]:
    if check_file(path, near=" (valid: an episode's Parquet file or a run's directory)") == 0:
        raise BadInput(f"{path}: the file is empty (valid: an episode as Parquet)")
    file = _checked(path, lambda: CheckedFile(path))
    refuse_many_rows(path, file.metadata.num_rows)

    def read(name: str) -> pa.ChunkedArray:
        return _checked(path, lambda: file.column(name))

    return file.schema, file.metadata.num_rows, read


def _checked(path: Path, read: Callable[[], Read]) -> Read:
    """Reads; where that shows damage, all of the recording is looked at for what is intact."""
    try:
        return read()
    except (BadInput, *UNREADABLE) as error:
        found = survey(path)
        if found.problems:
            raise refusal(path, found) from error
        raise
