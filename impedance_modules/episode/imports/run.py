# SPDX-License-Identifier: BSD-3-Clause
"""``impedance import``: foreign logs become episodes, all of them or none."""

from __future__ import annotations

import dataclasses
import math
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from impedance_modules.episode.imports.copy_episode import copy_episode
from impedance_modules.episode.imports.map_reader import parse_map, read_map
from impedance_modules.episode.imports.import_map import ImportMap
from impedance_modules.episode.imports.log_sources import kind_of
from impedance_modules.episode.imports.pipeline import Imported, import_recording
from impedance_modules.episode.imports.recordings import Recording, mapped_recordings, plain_recordings
from impedance_modules.episode.imports.own_maps import bag_map, recorder_map
from impedance_modules.errors import BadInput

SUFFIX = ".parquet"


def import_sources(
    sources: Sequence[Path], map_path: Path | None, rate: float | None, out: Path
) -> tuple[Imported, ...]:
    """Turns logs into episodes ``OUT/NAME.parquet``.

    Args:
        sources: Files, directories of ROS 2 recordings or runs, or folders with files that the map describes.
        map_path: What the columns mean; None for bags of a shipped robot, joint recorder files and episodes.
        rate: Stated samples per second [Hz], for logs without time.
        out: Directory; episodes that are there already are never overwritten.

    Returns:
        What became of each recording.

    Raises:
        BadInput: Anything that would make a misleading episode; then nothing is written.
    """
    if rate is not None and not (math.isfinite(rate) and rate > 0.0):
        raise BadInput(f"--rate {rate:g}: no sampling rate (valid: above 0 Hz)")
    _refuse_twice(sources)
    what = read_map(map_path) if map_path is not None else None
    recordings = mapped_recordings(sources, what) if what is not None else plain_recordings(sources)
    _refuse_present(recordings, out)
    with _staging(out) as folder:
        done = [
            _import_one(recording, what, rate, folder / (recording.name + SUFFIX)) for recording in recordings
        ]
        _refuse_present(recordings, out)
        return tuple(_into_place(imported, out) for imported in done)


def _import_one(recording: Recording, what: ImportMap | None, rate: float | None, target: Path) -> Imported:
    if what is not None:
        return import_recording(recording, what, rate, target)
    path = recording.paths[0]
    kind = kind_of(path)
    if kind in ("run", "parquet"):
        if rate is not None:
            raise BadInput(
                f"{path}: it has a time of its own, so --rate {rate:g} has no effect (valid: no --rate)"
            )
        return copy_episode(path, target)
    if kind not in ("bag", "text"):
        what_it_is = "a folder without a recording" if kind == "folder" else "variables that nobody explains"
        raise BadInput(f"{path}: {what_it_is} (valid: --map FILE, see docs/import.md)")
    text, notes = bag_map(path) if kind == "bag" else recorder_map(path)
    own = parse_map(Path(f"{path} (its own map)"), text)
    own = dataclasses.replace(own, notes=(*own.notes, *notes))
    return import_recording(recording, own, rate, target)


def _refuse_twice(sources: Sequence[Path]) -> None:
    places = [source.resolve() for source in sources]
    for source, place in zip(sources, places, strict=True):
        if places.count(place) > 1:
            raise BadInput(f"{source}: given twice (valid: each source once)")


def _refuse_present(recordings: Sequence[Recording], out: Path) -> None:
    existing = _closest_existing(out)
    if not existing.is_dir():
        raise BadInput(
            f"{out}: {existing} is a file, and episodes go into a directory (valid: another --out)"
        )
    for recording in recordings:
        target = out / (recording.name + SUFFIX)
        if target.exists():
            raise BadInput(f"{target}: already there (valid: another --out, or remove it)")


@contextmanager
def _staging(out: Path) -> Iterator[Path]:
    """A hidden directory on the same disk, gone at the end however the import ends."""
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
