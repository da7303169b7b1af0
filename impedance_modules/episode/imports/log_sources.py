# SPDX-License-Identifier: BSD-3-Clause
"""What the sources of an import are: of which kind each file is, and which files make one recording.

Files are known by their first bytes rather than by their names.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.episode.imports.binary_tables import ArrayTable, ParquetTable
from impedance_modules.episode.imports.import_map import ImportMap, TableMap
from impedance_modules.episode.imports.lerobot_dataset import (
    LeRobotTable,
    episode_places,
    is_dataset,
    is_episode,
)
from impedance_modules.episode.imports.table import LogTable
from impedance_modules.episode.imports.text_table import TextTable
from impedance_modules.episode.run_folder import EPISODE, part_paths
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.extras import need
from impedance_modules.input_files import open_input

EPISODE_MARK = "{episode}"

_MAGIC = (
    (b"#ROSBAG V", "bag", ""),
    (b"\x89MCAP0\r\n", "bag", ".mcap"),
    (b"SQLite format 3\0", "bag", ".db3"),
    (b"PAR1", "parquet", ""),
    (b"PK\x03\x04", "arrays", ".npz"),
    (b"MATLAB 5.0 MAT-file", "arrays", ".mat"),
    (b"MATLAB 7.3 MAT-file", "arrays", ".mat"),
)
"""First bytes, kind, and the suffix that the readers of this kind insist on."""

_SUFFIXES = {
    ".bag": "bag",
    ".mcap": "bag",
    ".db3": "bag",
    ".mat": "arrays",
    ".npz": "arrays",
    ".parquet": "parquet",
}


def kind_of(path: Path) -> str:
    """Returns what a source is.

    Returns:
        ``bag``, ``arrays``, ``parquet``, ``text``, ``run``, ``folder``; of LeRobot ``dataset``, or ``lerobot`` for
        one episode of it.

    Raises:
        BadInput: It is missing, empty, cannot be read, or has another type's suffix.
    """
    if path.is_dir():
        if (path / EPISODE).exists() or part_paths(path):
            return "run"
        if is_dataset(path):
            return "dataset"
        return "bag" if (path / "metadata.yaml").exists() else "folder"
    if is_episode(path):
        return "lerobot"
    try:
        with open_input(path, near="" if path.exists() else _neighbours(path)) as stream:
            start = stream.read(32)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from error
    if not start:
        raise BadInput(f"{path}: the file is empty (valid: a recording)")
    for magic, kind, suffix in _MAGIC:
        if start.startswith(magic):
            if suffix and path.suffix != suffix:
                raise BadInput(
                    f"{path}: this is a {suffix} file under another name (valid: a name in {suffix})"
                )
            return kind
    return _SUFFIXES.get(path.suffix, "text")


def open_table(path: Path, table: TableMap, mapping: ImportMap, scratch: Path) -> LogTable:
    """Opens one table.

    Args:
        path: Of the file, or of a ROS 2 recording's directory.
        table: Its part of the map.
        mapping: The whole map.
        scratch: Directory for what does not fit into memory.

    Raises:
        BadInput: It cannot be read.
        BadFile: The map says too little, or something that has no meaning for this kind of file.
    """
    kind = kind_of(path)
    if kind in ("run", "folder", "dataset"):
        raise BadInput(f"{path}: a directory, and the map describes a file (valid: the file)")
    place = ("tables", table.index)
    if kind == "text" and table.text is None:
        message = f"missing key 'separator': what stands between two values of {path.name}?"
        problem = mapping.document.problem(
            (*place, "separator"), message, ("comma", "semicolon", "tab", "whitespace")
        )
        raise BadFile([problem])
    if kind != "text" and table.text is not None:
        message = f"'separator' is for text files, and {path.name} is none"
        raise BadFile([mapping.document.problem((*place, "separator"), message, at="key")])
    if table.time is not None and (kind == "bag") != (table.time.column is None):
        valid = "'clock: header' or 'clock: received'" if kind == "bag" else "'column' and its 'unit'"
        message = f"{path.name} has {valid}"
        raise BadFile([mapping.document.problem((*place, "time"), message, at="key")])
    return _open(kind, path, table, scratch)


@dataclass(frozen=True)
class RecordingFiles:
    """One recording: its name, and a file (or directory) for each table of the map."""

    name: str
    paths: tuple[Path, ...]


def plain_recordings(sources: Sequence[Path]) -> tuple[RecordingFiles, ...]:
    """Returns one recording for each source, named after its file, and after its folder where names collide."""
    names = [source_name(path) for path in sources]
    found = []
    for path, name in zip(sources, names, strict=True):
        full = f"{path.resolve().parent.name}-{name}" if names.count(name) > 1 else name
        found.append(RecordingFiles(full, (path,)))
    return _distinct(found)


def mapped_recordings(sources: Sequence[Path], mapping: ImportMap) -> tuple[RecordingFiles, ...]:
    """Returns the recordings that sources make under a map.

    Raises:
        BadInput: A source that no table describes, a recording that lacks a table, or one name for two.
    """
    files = [file for source in sources for file in _expand(source, mapping)]
    single = len(mapping.tables) == 1 and mapping.tables[0].file is None
    found = plain_recordings(files) if single else _matched(files, mapping)
    if mapping.episode is None:
        return _distinct(found)
    if len(found) > 1:
        raise BadInput(
            f"{mapping.document.path}: 'episode: {mapping.episode}' names one recording, and the sources make"
            f" {len(found)} (valid: no 'episode' here, or one recording at a time)"
        )
    return (RecordingFiles(mapping.episode, found[0].paths),)


def source_name(path: Path) -> str:
    """Returns what a recording is called: its file without suffix, or its folder."""
    whole = path.resolve()
    if is_episode(whole):
        return f"{whole.parent.name}-{whole.name}"
    if whole.name == EPISODE:
        return whole.parent.name
    return whole.name if whole.is_dir() else whole.stem


def need_bags(path: Path) -> None:
    """Refuses a ROS recording where its readers are not installed."""
    for package in ("rosbags", "apsw", "lz4"):
        need(package, f"{path}: a ROS recording")


def _open(kind: str, path: Path, table: TableMap, scratch: Path) -> LogTable:
    if kind == "bag":
        # The readers of bags are an extra, and take half a second to import: only when a bag is read.
        need_bags(path)
        from impedance_modules.episode.imports.bag_table import BagTable  # noqa: PLC0415

        return BagTable(path, table, scratch)
    if kind == "arrays":
        return ArrayTable(path)
    if kind == "parquet":
        return ParquetTable(path)
    if kind == "lerobot":
        return LeRobotTable(path)
    if table.text is None:
        raise BadInput(f"{path}: a text file needs a 'separator' in the map")
    return TextTable(path, table.text)


def _neighbours(path: Path) -> str:
    if not path.parent.is_dir():
        return f" (the folder {path.parent} does not exist)"
    same = sorted(entry.name for entry in path.parent.glob(f"*{path.suffix}") if entry.is_file())
    return f" (beside it: {', '.join(same[:6])})" if same else ""


def _expand(source: Path, mapping: ImportMap) -> list[Path]:
    """A folder stands for the files in it that the map describes, a dataset for its episodes."""
    if kind_of(source) == "dataset":
        return list(episode_places(source))
    if kind_of(source) != "folder":
        return [source]
    patterns = [_pattern(table.file) for table in mapping.tables if table.file is not None]
    files = sorted(
        path for path in source.iterdir() if any(pattern.fullmatch(path.name) for pattern in patterns)
    )
    if not files:
        held = ", ".join(sorted(path.name for path in source.iterdir())[:8]) or "nothing"
        raise BadInput(
            f"{source}: a folder without any file that the map describes by 'file' (it holds: {held});"
            " valid: the files themselves"
        )
    return files


def _pattern(file: str) -> re.Pattern[str]:
    before, mark, after = file.partition(EPISODE_MARK)
    return re.compile(re.escape(before) + ("(.+)" if mark else "()") + re.escape(after))


def _matched(files: Sequence[Path], mapping: ImportMap) -> tuple[RecordingFiles, ...]:
    groups: dict[str, dict[int, Path]] = {}
    for path in files:
        matches = [
            (table.index, match.group(1))
            for table in mapping.tables
            if table.file is not None and (match := _pattern(table.file).fullmatch(path.name))
        ]
        if len(matches) != 1:
            described = "no table" if not matches else "more than one table"
            patterns = ", ".join(str(table.file) for table in mapping.tables)
            raise BadInput(f"{path}: {described} of {mapping.document.path} describes it (valid: {patterns})")
        (index, name), *_ = matches
        group = groups.setdefault(name, {})
        if index in group:
            raise BadInput(
                f"{path}: and {group[index]} are both '{mapping.tables[index].file}' of one recording"
            )
        group[index] = path
    return tuple(_whole(name, group, mapping) for name, group in groups.items())


def _whole(name: str, group: dict[int, Path], mapping: ImportMap) -> RecordingFiles:
    missing = [str(table.file) for table in mapping.tables if table.index not in group]
    if missing:
        present = ", ".join(str(path) for path in group.values())
        raise BadInput(
            f"{present}: the recording '{name or source_name(next(iter(group.values())))}' lacks"
            f" {', '.join(file.replace(EPISODE_MARK, name) for file in missing)} (valid: all its files as sources)"
        )
    paths = tuple(group[table.index] for table in mapping.tables)
    return RecordingFiles(name or source_name(paths[0]), paths)


def _distinct(found: Sequence[RecordingFiles]) -> tuple[RecordingFiles, ...]:
    names = [recording.name for recording in found]
    for recording in found:
        if names.count(recording.name) > 1:
            raise BadInput(
                f"{recording.paths[0]}: two recordings would be called '{recording.name}'"
                " (valid: different names, or one import for each)"
            )
    return tuple(found)
