# SPDX-License-Identifier: BSD-3-Clause
"""A task on another robot than the one it names: the same text, with another word behind ``robot:``.

So everything that reads the task later, a recording of it too, sees a task of that robot.
"""

from __future__ import annotations

import json
from pathlib import Path

from impedance_modules.errors import BadFile, BadInput, ImpedanceError
from impedance_modules.spec.document import Document, parse_document
from impedance_modules.spec.locate import data_folder, find_robot

HERE = Path("here")
"""A name in the working folder, from which robots are looked for first."""


def on_robot(document: Document, name: str) -> Document:
    """Returns a task's document with another robot.

    Args:
        document: The task.
        name: Name or path of a robot's folder: looked for from the working folder, beside the task, among the shipped.

    Raises:
        BadInput: There is no such robot, or the task names its own in a way that cannot be replaced.
    """
    folder = _find(document, name)
    word = name if folder == data_folder("robots") / name else json.dumps(str(folder.resolve()))
    own = document.data.get("robot")
    start = _offset(document)
    for written in (f"{own}", f'"{own}"', f"'{own}'"):
        if isinstance(own, str) and document.text.startswith(written, start):
            text = f"{document.text[:start]}{word}{document.text[start + len(written) :]}"
            changed = _parsed(document, text)
            if changed is not None and changed.data.get("robot") in (name, str(folder.resolve())):
                return changed
    problem = document.problem(
        ("robot",), "the robot's name cannot be replaced here", ("robot: NAME on a line",)
    )
    raise BadFile([problem])


def _find(document: Document, name: str) -> Path:
    try:
        return find_robot(name, HERE.absolute())
    except BadInput:
        try:
            return find_robot(name, document.path)
        except BadInput as error:
            raise BadInput(f"--robot {name}: {error}") from None


def _offset(document: Document) -> int:
    """Where the robot's name stands in the text."""
    place = document.problem(("robot",), "")
    lines = document.text.split("\n")
    return sum(len(line) + 1 for line in lines[: place.line - 1]) + place.column - 1


def _parsed(document: Document, text: str) -> Document | None:
    try:
        return parse_document(document.path, text)
    except ImpedanceError:
        return None
