# SPDX-License-Identifier: BSD-3-Clause
"""Task files as text: some values replaced (tuned tasks, sweeps), and which phases are spent in contact."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, Literal

import yaml

from impedance_modules.errors import BadInput, ImpedanceError, nearest
from impedance_modules.spec.document import Document, parse_document, print_path, scan_document
from impedance_modules.spec.locate import data_folder, find_robot, find_task
from impedance_modules.spec.path_spec import PATH, episode_path
from impedance_modules.spec.surface_mesh import mesh_path
from impedance_modules.spec.yaml_tree import KeyPath

Spent = Literal["throughout", "at its end"]


def task_document(name_or_path: str | Path) -> Document:
    """Reads a task file as it stands.

    Raises:
        BadInput: There is no such task, or it is no text file.
    """
    return scan_document(find_task(name_or_path))


def find_steps(data: Any, path: str, *, must_exist: bool = True) -> KeyPath:
    """Finds a value by its path: ``arms.right.springs.0.stiffness.x``; entries with a name go by name, too.

    Args:
        data: The task file's data.
        path: Keys and places separated by dots; keys that have dots themselves stay as they are.
        must_exist: Whether the last key must be there already.

    Raises:
        BadInput: A step leads nowhere; says which, and what would be valid.
    """
    here, steps = data, list[str | int]()
    words = path.split(".")
    while words:
        word = _next_word(here, words)
        del words[: word.count(".") + 1]
        last = not words
        if isinstance(here, list):
            step: str | int | None = _place(here, word)
            names = tuple(str(_name(entry, place)) for place, entry in enumerate(here))
        else:
            names = tuple(map(str, here)) if isinstance(here, dict) else ()
            fits = word in names or (last and not must_exist and isinstance(here, dict))
            step = word if fits else None
        if step is None:
            where = print_path(steps) if steps else "the task"
            valid = ", ".join(names) if names else "it is a single value; end the path here"
            raise BadInput(f"'{path}': {where} has no '{word}'{nearest(word, names)} (valid: {valid})")
        steps.append(step)
        here = here[step] if not isinstance(here, dict) else here.get(step)
    return tuple(steps)


def _next_word(here: Any, words: list[str]) -> str:
    """Takes the next key off a path; a key may have dots in it, as targets do (``right.hand``)."""
    if isinstance(here, dict):
        for count in range(1, len(words) + 1):
            if (word := ".".join(words[:count])) in here:
                return word
    return words[0]


def changed(document: Document, changes: Mapping[KeyPath, Any], heading: str = "") -> str:
    """Writes a task file's text with values replaced or added; comments are lost.

    Args:
        document: The original.
        changes: Key path -> new value.
        heading: Comment lines to begin with.
    """
    data: Any = deepcopy(document.data)
    for steps, value in changes.items():
        here = data
        for step in steps[:-1]:
            here = here[step]
        here[steps[-1]] = value
    name_whole_paths(data, document.path)
    robot = data.get("robot")
    if isinstance(robot, str):
        # The changed file may lie elsewhere, where only shipped robots go by their names.
        folder = find_robot(robot, document.path)
        data["robot"] = robot if folder == data_folder("robots") / robot else str(folder.resolve())
    return heading + yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)


def beside_another(text: str, original: Path) -> str:
    """Writes a task's text such that it can be read in another folder: other files are named by their whole paths.

    Args:
        text: As a recording keeps it; one that is no task, or names no file, is returned as it is.
        original: Where the task file was.
    """
    try:
        data: Any = deepcopy(parse_document(original, text).data)
    except ImpedanceError:
        return text
    if not name_whole_paths(data, original):
        return text
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)


def name_whole_paths(data: Any, task: Path) -> int:
    """Replaces the names of meshes and recordings in a task's data by whole paths; returns how many there are."""
    found = [
        surface
        for holder, key in ((data, "environment"), (_mapping(data, "playback"), "taught_on"))
        for surface in _list(holder, key)
        if isinstance(surface, dict) and isinstance(surface.get("file"), str)
    ]
    for surface in found:
        surface["file"] = str(mesh_path(task, surface["file"]))
    paths = [
        path
        for phase in _list(data, "phases")
        for target in (_mapping(phase, "equilibrium") or {})
        if isinstance(path := _mapping(phase["equilibrium"][target], PATH), dict)
        and isinstance(path.get("episode"), str)
    ]
    for path in paths:
        path["episode"] = str(episode_path(task, path["episode"]))
    return len(found) + len(paths)


def _mapping(data: Any, key: str) -> Any:
    return data.get(key) if isinstance(data, dict) else None


def _list(data: Any, key: str) -> list[Any]:
    found = _mapping(data, key)
    return found if isinstance(found, list) else []


def contact_phases(text: str, *, holding: bool = True) -> dict[str, Spent]:
    """Names the phases in which a hand touches its surroundings or holds an object, and says when.

    A phase that waits for contact ends in it; all later ones are in it until one waits for its loss. Hands that
    hold an object do so from the first sample to the last.

    Args:
        text: A task file's whole text, as recordings keep it. Of a text that is no task nothing is known: no phase.
        holding: Whether to hold an object is contact as well; without, only what hands and object touch is.
    """
    try:
        data = parse_document(Path("task"), text).data
    except ImpedanceError:
        return {}
    phases = data.get("phases")
    if not isinstance(phases, list):
        return {}
    held = holding and bool(data.get("object"))
    out: dict[str, Spent] = {}
    touching = held
    for phase in phases:
        if not isinstance(phase, dict):
            continue
        awaited = _awaited(phase)
        if touching or awaited:
            out[str(phase.get("name"))] = "throughout" if touching else "at its end"
        touching = held or (touching if awaited is None else awaited)
    return out


def _place(entries: list[Any], word: str) -> int | None:
    for place, entry in enumerate(entries):
        if word in {str(place), str(_name(entry, place))}:
            return place
    return None


def _name(entry: Any, place: int) -> Any:
    return entry.get("name", place) if isinstance(entry, dict) else place


def _awaited(phase: Mapping[str, Any]) -> bool | None:
    """True where a phase waits for contact, False where it waits for its loss, None where for neither."""
    until = phase.get("until")
    if not isinstance(until, dict) or "contact" not in until:
        return None
    contact = until["contact"]
    return bool(contact.get("present", True)) if isinstance(contact, dict) else bool(contact)
