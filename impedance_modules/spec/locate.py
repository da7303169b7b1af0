# SPDX-License-Identifier: BSD-3-Clause
"""Where tasks, robots and schemas lie: by path, beside a task, in a checkout or in an installed wheel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from impedance_modules.errors import BadInput, nearest

ROBOT_FILE = "robot.yaml"

_PACKAGE = Path(__file__).resolve().parent.parent


def data_folder(kind: str) -> Path:
    """Folder of ``tasks``, ``robots`` or ``schemas`` that travel with the package.

    In a wheel they are package data; in a checkout they lie beside the package, for people.
    """
    packaged = _PACKAGE / "data" / kind
    return packaged if packaged.is_dir() else _PACKAGE.parent / kind


def list_tasks() -> tuple[str, ...]:
    """Names of the shipped tasks, sorted."""
    return tuple(sorted(path.stem for path in data_folder("tasks").rglob("*.yaml")))


def list_robots() -> tuple[str, ...]:
    """Names of the shipped robots, sorted."""
    return _robots_in(data_folder("robots"))


def find_task(name_or_path: str | Path) -> Path:
    """Returns the file of a task; a path wins over a name.

    Raises:
        BadInput: No such file, and no shipped task of that name.
    """
    path = Path(name_or_path)
    if _is_path(name_or_path) or path.suffix in {".yaml", ".yml"} or _is_file(path):
        return path
    for candidate in sorted(data_folder("tasks").rglob("*.yaml")):
        if candidate.stem == str(name_or_path):
            return candidate
    raise BadInput(_unknown("task", str(name_or_path), list_tasks()))


def find_robot(name_or_path: str | Path, beside: Path | None = None) -> Path:
    """Returns the folder of a robot, which holds ``robot.yaml``.

    A path wins over a name: it is taken from the folder of ``beside``, then from the working folder. A
    name is looked up as ``robots/<name>`` in the folder of ``beside`` (of nothing: the working folder) and its
    parents, then among the shipped robots.

    Args:
        name_or_path: As the task file or the command line gives it.
        beside: The task file that names the robot; None when nothing does.

    Raises:
        BadInput: There is no such robot.
    """
    around = _folders_around(beside)
    if _is_path(name_or_path) or (beside is None and _holds_robot(Path(name_or_path))):
        return _robot_by_path(Path(name_or_path), around)
    name = str(name_or_path)
    for folder in [*(place / "robots" for place in around), data_folder("robots")]:
        if _holds_robot(folder / name):
            return folder / name
    known = sorted({robot for place in around for robot in _robots_in(place / "robots")} | set(list_robots()))
    raise BadInput(_unknown("robot", name, known))


def find_schema(name: str) -> Path:
    """Returns the JSON Schema file of ``task``, ``robot``, ``patch`` ...

    Raises:
        BadInput: There is no such schema.
    """
    path = data_folder("schemas") / f"{name}.schema.json"
    if path.is_file():
        return path
    known = sorted(file.name.removesuffix(".schema.json") for file in path.parent.glob("*.schema.json"))
    raise BadInput(_unknown("schema", name, known))


def _is_path(name: str | Path) -> bool:
    return isinstance(name, Path) or "/" in name or "\\" in name or name in {"", ".", ".."}


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _holds_robot(folder: Path) -> bool:
    return _is_file(folder / ROBOT_FILE)


def _folders_around(beside: Path | None) -> list[Path]:
    """Lists the folder of a file and those above it; of no file, the working folder and those above it."""
    folder = Path.cwd() if beside is None else beside.resolve().parent
    return [folder, *folder.parents]


def _robot_by_path(path: Path, around: Sequence[Path]) -> Path:
    folder = path.parent if path.name == ROBOT_FILE else path
    for candidate in [*(place / folder for place in around[:1]), folder]:
        if _holds_robot(candidate):
            return candidate
    raise BadInput(
        f"{path}: no robot folder (no {ROBOT_FILE} in it); shipped robots: {', '.join(list_robots())}"
    )


def _robots_in(folder: Path) -> tuple[str, ...]:
    return tuple(sorted(path.parent.name for path in folder.glob(f"*/{ROBOT_FILE}")))


def _unknown(kind: str, name: str, known: Sequence[str]) -> str:
    valid = ", ".join(known) if known else "none are installed"
    return f"there is no {kind} '{name}'{nearest(name, known)} (valid: {valid})"
