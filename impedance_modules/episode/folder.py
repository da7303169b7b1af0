# SPDX-License-Identifier: BSD-3-Clause
"""Which episodes a path stands for: a file, a run's directory, or a folder that ``import`` filled."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from impedance_modules.episode.run_folder import EPISODE, part_paths
from impedance_modules.errors import BadInput


def episode_paths(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Replaces every folder of imported episodes by its episodes, in the order of their names.

    Files and runs' directories stay as they are, and so does a path that leads nowhere: whoever reads it says so.

    Raises:
        BadInput: A folder without any episode.
    """
    return tuple(found for path in paths for found in _episodes_at(path))


def the_episode(path: Path) -> Path:
    """Returns the one episode that a path stands for.

    Raises:
        BadInput: A folder with several episodes, or with none.
    """
    found = episode_paths([path])
    if len(found) > 1:
        names = ", ".join(str(episode) for episode in found[:5]) + (", ..." if len(found) > 5 else "")
        raise BadInput(f"{path}: holds {len(found)} episodes (valid: one of them: {names})")
    return found[0]


def _episodes_at(path: Path) -> Sequence[Path]:
    if not path.is_dir() or (path / EPISODE).exists() or part_paths(path):
        return [path]
    found = sorted(file for file in path.glob("*.parquet") if not file.name.startswith("."))
    if not found:
        raise BadInput(
            f"{path}: no episode here (valid: a run's directory with {EPISODE}, or a folder of episodes,"
            " NAME.parquet each)"
        )
    return found
