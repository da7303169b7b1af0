# SPDX-License-Identifier: BSD-3-Clause
"""Sorts the sources of an import into recordings: which files belong together, and what each is called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.episode.run_folder import EPISODE
from impedance_modules.episode.imports.import_map import ImportMap
from impedance_modules.episode.imports.log_sources import kind_of
from impedance_modules.errors import BadInput

EPISODE_MARK = "{episode}"


@dataclass(frozen=True)
class Recording:
    """One recording: its name, and a source for each table of the map."""

    name: str
    paths: tuple[Path, ...]


def plain_recordings(sources: Sequence[Path]) -> tuple[Recording, ...]:
    """Returns one recording for each source, named after its file, and after its folder where names collide."""
    names = [source_name(path) for path in sources]
    found = []
    for path, name in zip(sources, names, strict=True):
        full = f"{path.resolve().parent.name}-{name}" if names.count(name) > 1 else name
        found.append(Recording(full, (path,)))
    return _distinct(found)


def mapped_recordings(sources: Sequence[Path], what: ImportMap) -> tuple[Recording, ...]:
    """Returns the recordings that sources make under a map.

    Raises:
        BadInput: A source that no table describes, a recording that lacks a table, or one name for two.
    """
    files = [file for source in sources for file in _expand(source, what)]
    single = len(what.tables) == 1 and what.tables[0].file is None
    found = plain_recordings(files) if single else _matched(files, what)
    if what.episode is None:
        return _distinct(found)
    if len(found) > 1:
        raise BadInput(
            f"{what.document.path}: 'episode: {what.episode}' names one recording, and the sources make {len(found)}"
            " (valid: no 'episode' here, or one recording at a time)"
        )
    return (Recording(what.episode, found[0].paths),)


def source_name(path: Path) -> str:
    """Returns what a recording is called: its file without suffix, or its folder."""
    whole = path.resolve()
    if whole.name == EPISODE:
        return whole.parent.name
    return whole.name if whole.is_dir() else whole.stem


def _expand(source: Path, what: ImportMap) -> list[Path]:
    """A folder stands for the files in it that the map describes."""
    if kind_of(source) != "folder":
        return [source]
    patterns = [_pattern(table.file) for table in what.tables if table.file is not None]
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


def _matched(files: Sequence[Path], what: ImportMap) -> tuple[Recording, ...]:
    groups: dict[str, dict[int, Path]] = {}
    for path in files:
        matches = [
            (table.index, match.group(1))
            for table in what.tables
            if table.file is not None and (match := _pattern(table.file).fullmatch(path.name))
        ]
        if len(matches) != 1:
            described = "no table" if not matches else "more than one table"
            patterns = ", ".join(str(table.file) for table in what.tables)
            raise BadInput(f"{path}: {described} of {what.document.path} describes it (valid: {patterns})")
        (index, name), *_ = matches
        group = groups.setdefault(name, {})
        if index in group:
            raise BadInput(
                f"{path}: and {group[index]} are both '{what.tables[index].file}' of one recording"
            )
        group[index] = path
    return tuple(_whole(name, group, what) for name, group in groups.items())


def _whole(name: str, group: dict[int, Path], what: ImportMap) -> Recording:
    missing = [str(table.file) for table in what.tables if table.index not in group]
    if missing:
        present = ", ".join(str(path) for path in group.values())
        raise BadInput(
            f"{present}: the recording '{name or source_name(next(iter(group.values())))}' lacks"
            f" {', '.join(file.replace(EPISODE_MARK, name) for file in missing)} (valid: all its files as sources)"
        )
    paths = tuple(group[table.index] for table in what.tables)
    return Recording(name or source_name(paths[0]), paths)


def _distinct(found: Sequence[Recording]) -> tuple[Recording, ...]:
    names = [recording.name for recording in found]
    for recording in found:
        if names.count(recording.name) > 1:
            raise BadInput(
                f"{recording.paths[0]}: two recordings would be called '{recording.name}'"
                " (valid: different names, or one import for each)"
            )
    return tuple(found)
