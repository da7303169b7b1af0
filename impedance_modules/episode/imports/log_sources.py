# SPDX-License-Identifier: BSD-3-Clause
"""Opens a log of any kind as a table, by what it is rather than by what it is called."""

from __future__ import annotations

from pathlib import Path

from impedance_modules.episode.run_folder import EPISODE, part_paths
from impedance_modules.episode.imports.binary_tables import ArrayTable
from impedance_modules.episode.imports.import_map import ImportMap, TableMap
from impedance_modules.episode.imports.parquet_table import ParquetTable
from impedance_modules.episode.imports.table import Table
from impedance_modules.episode.imports.text_table import TextTable
from impedance_modules.errors import BadFile, BadInput

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
    """Returns what a source is: ``bag``, ``arrays``, ``parquet``, ``text``, ``run`` or ``folder``.

    Raises:
        BadInput: It is missing, empty, cannot be read, or its name hides what it is.
    """
    if path.is_dir():
        if (path / EPISODE).exists() or part_paths(path):
            return "run"
        return "bag" if (path / "metadata.yaml").exists() else "folder"
    try:
        with path.open("rb") as stream:
            start = stream.read(32)
    except FileNotFoundError:
        raise BadInput(f"{path}: no such file{_neighbours(path)}") from None
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


def open_table(path: Path, table: TableMap, what: ImportMap, scratch: Path) -> Table:
    """Opens one table.

    Args:
        path: Of the file, or of a ROS 2 recording's directory.
        table: Its part of the map.
        what: The whole map.
        scratch: Directory for what does not fit into memory.

    Raises:
        BadInput: It cannot be read.
        BadFile: The map says too little, or something that has no meaning for this kind of file.
    """
    kind = kind_of(path)
    if kind in ("run", "folder"):
        raise BadInput(f"{path}: a directory, and the map describes a file (valid: the file)")
    place = ("tables", table.index)
    if kind == "text" and table.text is None:
        message = f"missing key 'separator': what stands between two values of {path.name}?"
        problem = what.document.problem(
            (*place, "separator"), message, ("comma", "semicolon", "tab", "whitespace")
        )
        raise BadFile([problem])
    if kind != "text" and table.text is not None:
        message = f"'separator' is for text files, and {path.name} is none"
        raise BadFile([what.document.problem((*place, "separator"), message, at="key")])
    if table.time is not None and (kind == "bag") != (table.time.column is None):
        valid = "'clock: header' or 'clock: received'" if kind == "bag" else "'column' and its 'unit'"
        message = f"{path.name} has {valid}"
        raise BadFile([what.document.problem((*place, "time"), message, at="key")])
    return _open(kind, path, table, scratch)


def _open(kind: str, path: Path, table: TableMap, scratch: Path) -> Table:
    if kind == "bag":
        # The readers of bags take half a second to import, which only those who read bags should pay.
        from impedance_modules.episode.imports.bag_table import BagTable  # noqa: PLC0415

        return BagTable(path, table, scratch)
    if kind == "arrays":
        return ArrayTable(path)
    if kind == "parquet":
        return ParquetTable(path)
    if table.text is None:
        raise BadInput(f"{path}: a text file needs a 'separator' in the map")
    return TextTable(path, table.text)


def _neighbours(path: Path) -> str:
    if not path.parent.is_dir():
        return f" (the folder {path.parent} does not exist)"
    same = sorted(entry.name for entry in path.parent.glob(f"*{path.suffix}") if entry.is_file())
    return f" (beside it: {', '.join(same[:6])})" if same else ""
