# SPDX-License-Identifier: BSD-3-Clause
"""A LeRobot dataset (v3, and v2 where each episode has a file): features of numbers become columns.

``meta/info.json`` says which features there are and what their entries are called; the rows of all episodes stand in
``data/``. An episode is called DATASET/episode_000003, as if it were a file. What the numbers mean (degrees, radians,
parts of a range) stands nowhere in a dataset: the map states it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from impedance_modules.episode.exact_numbers import exact_doubles
from impedance_modules.episode.imports.table import CHUNK_ROWS, Chunk, Vector, list_names, refuse_nonfinite
from impedance_modules.episode.sealed_parquet import UNREADABLE
from impedance_modules.errors import BadInput
from impedance_modules.input_files import check_file, read_input
from impedance_modules.strict_json import parse_json

INFO = Path("meta") / "info.json"
LARGEST_INFO = 10_000_000
"""Bytes of ``meta/info.json``."""

MOST_EPISODES = 100_000
"""Episodes of a dataset that is read."""

MOST_ENTRIES = 10_000
"""Entries of all features that are read as columns."""

_EPISODE = re.compile(r"episode_([0-9]{6,9})")
_NUMBERS = re.compile(r"(float|int|uint)(8|16|32|64)|bool")
_TEMPLATES = (
    "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
)
"""Where LeRobot writes its rows: v3, and v2."""


def is_dataset(path: Path) -> bool:
    """Says whether a folder is a LeRobot dataset."""
    return (path / INFO).is_file()


def is_episode(path: Path) -> bool:
    """Says whether a path names an episode of a LeRobot dataset, DATASET/episode_000003."""
    return _EPISODE.fullmatch(path.name) is not None and is_dataset(path.parent)


def episode_places(dataset: Path) -> tuple[Path, ...]:
    """Returns the path of each episode of a dataset.

    Raises:
        BadInput: Its description cannot be read, or there is none.
    """
    count = _Description.read(dataset).episodes
    if count == 0:
        raise BadInput(f"{dataset}: a LeRobot dataset without episodes (valid: one or more)")
    return tuple(dataset / f"episode_{index:06d}" for index in range(count))


def feature_columns(dataset: Path) -> tuple[str, ...]:
    """Returns the columns that a dataset's episodes offer.

    Raises:
        BadInput: Its description cannot be read.
    """
    return tuple(_Description.read(dataset).columns)


class LeRobotTable:
    """One episode of a dataset; a column is ``FEATURE.NAME``, or ``FEATURE[2]`` where entries have no names.

    Attributes:
        path, names, scalars, row_word, notes: See `LogTable`.
    """

    def __init__(self, path: Path) -> None:
        """Reads the description.

        Raises:
            BadInput: It cannot be read, or the episode is not there.
        """
        self.path = path
        self.scalars: Mapping[str, float] = {}
        self.row_word = "frame"
        self.notes: list[str] = []
        self._about = _Description.read(path.parent)
        match = _EPISODE.fullmatch(path.name)
        self._episode = -1 if match is None else int(match[1])
        if not 0 <= self._episode < self._about.episodes:
            raise BadInput(
                f"{path}: no such episode (valid: episode_000000 to episode_{self._about.episodes - 1:06d})"
            )
        self.names = tuple(self._about.columns)

    def chunks(self, wanted: Sequence[str]) -> Iterator[Chunk]:
        """Yields the wanted columns; see `LogTable`."""
        features = dict.fromkeys(self._about.columns[name][0] for name in wanted)
        count = 0
        for file in self._files():
            try:
                for batch in _batches(file, ["episode_index", *features]):
                    own = batch.filter(pc.equal(batch["episode_index"], self._episode))
                    if not len(own):
                        continue
                    columns = {name: self._column(own, name) for name in wanted}
                    places = np.arange(count + 1, count + 1 + len(own), dtype=np.int64)
                    count += len(own)
                    yield refuse_nonfinite(self.path, self.row_word, Chunk(columns, places))
            except UNREADABLE as error:
                raise BadInput(f"{file}: damaged, or not what meta/info.json says: {error}") from error
        if count == 0:
            raise BadInput(f"{self.path}: no frame of this episode in data/ (valid: a whole dataset)")

    def _column(self, rows: pa.RecordBatch, name: str) -> Vector:
        feature, entry = self._about.columns[name]
        values = rows.column(rows.schema.get_field_index(feature))
        if (
            pa.types.is_list(values.type)
            or pa.types.is_fixed_size_list(values.type)
            or _is_large(values.type)
        ):
            values = pc.list_element(values, 0 if entry is None else entry)
        elif entry not in (None, 0):
            raise BadInput(f"{self.path}: '{feature}' has one number a frame, not what meta/info.json says")
        found: Vector = exact_doubles(self.path, name, values).to_numpy(zero_copy_only=False)
        return found

    def _files(self) -> tuple[Path, ...]:
        folder = self.path.parent
        if self._about.by_episode:
            chunk = self._episode // self._about.chunk
            return (folder / _TEMPLATES[1].format(episode_chunk=chunk, episode_index=self._episode),)
        place = self._place()
        return (folder / _TEMPLATES[0].format(chunk_index=place[0], file_index=place[1]),)

    def _place(self) -> tuple[int, int]:
        """Chunk and file of the episode, from ``meta/episodes``."""
        keys = ["episode_index", "data/chunk_index", "data/file_index"]
        files = sorted((self.path.parent / "meta" / "episodes").glob("chunk-*/file-*.parquet"))
        for file in files:
            try:
                for batch in _batches(file, keys):
                    rows = batch.filter(pc.equal(batch["episode_index"], self._episode))
                    if len(rows):
                        return int(rows["data/chunk_index"][0].as_py()), int(
                            rows["data/file_index"][0].as_py()
                        )
            except (*UNREADABLE, KeyError, TypeError) as error:
                raise BadInput(f"{file}: damaged, or no list of episodes: {error}") from error
        raise BadInput(
            f"{self.path}: {self.path.parent / 'meta' / 'episodes'} does not say where it is (valid: a whole dataset)"
        )


@dataclass(frozen=True)
class _Description:
    """What ``meta/info.json`` says.

    Attributes:
        episodes: How many.
        columns: Column -> feature and place in it; None for a feature of one number.
        by_episode: Each episode has a file (v2).
        chunk: Episodes in a folder, where each has a file.
    """

    episodes: int
    columns: Mapping[str, tuple[str, int | None]]
    by_episode: bool
    chunk: int

    @classmethod
    def read(cls, dataset: Path) -> _Description:
        """Reads it.

        Raises:
            BadInput: It is missing, damaged, or of a version that is not read.
        """
        path = dataset / INFO
        try:
            info = parse_json(read_input(path, LARGEST_INFO))
            version, template = str(info["codebase_version"]), info["data_path"]
            if not version.startswith(("v2", "v3")) or template not in _TEMPLATES:
                raise BadInput(
                    f"{path}: version {version!r} with its rows in {template!r} (valid: v2 or v3, in {_TEMPLATES[0]})"
                )
            columns = dict(_columns(info["features"]))
            if len(columns) > MOST_ENTRIES:
                raise ValueError(f"{len(columns)} entries (valid: at most {MOST_ENTRIES})")
            size, count = int(info.get("chunks_size", 1000)), int(info["total_episodes"])
            if not 0 <= count <= MOST_EPISODES:
                raise ValueError(f"{count} episodes (valid: at most {MOST_EPISODES})")
            return cls(count, columns, template == _TEMPLATES[1], max(size, 1))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise BadInput(f"{path}: no description of a LeRobot dataset: {error}") from error


def _columns(features: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, int | None]]]:
    """Yields the columns of features that hold a number, or a row of them, in each frame."""
    for feature, about in features.items():
        shape = list(about["shape"])
        if _NUMBERS.fullmatch(str(about["dtype"])) is None or len(shape) > 1:
            continue
        size = int(shape[0]) if shape else 1
        if size > MOST_ENTRIES:
            raise ValueError(f"'{feature}' has {size} entries (valid: at most {MOST_ENTRIES})")
        names = _entry_names(about.get("names"), size)
        if size == 1 and names is None:
            yield feature, (feature, None)
            continue
        for index in range(size):
            yield (
                f"{feature}[{index + 1}]" if names is None else f"{feature}.{names[index]}",
                (feature, index),
            )


def _entry_names(names: Any, size: int) -> list[str] | None:
    """Names of a feature's entries; None where they have none, or not one for each."""
    if isinstance(names, Mapping):
        names = next(iter(names.values()), None)
    if not isinstance(names, list) or len(names) != size or len(set(map(str, names))) != size:
        return None
    return [str(name) for name in names]


def _batches(file: Path, columns: Sequence[str]) -> Iterator[pa.RecordBatch]:
    check_file(file)
    opened = pq.ParquetFile(file)
    missing = [name for name in columns if name not in opened.schema_arrow.names]
    if missing:
        raise BadInput(f"{file}: no column '{missing[0]}' (present: {list_names(opened.schema_arrow.names)})")
    yield from opened.iter_batches(CHUNK_ROWS, columns=list(columns), use_threads=False)


def _is_large(kind: pa.DataType) -> bool:
    return bool(pa.types.is_large_list(kind))
