# SPDX-License-Identifier: BSD-3-Clause
"""Reading a YAML file into plain data that remembers where every value stood.

Task, robot and patch files are read here and nowhere else. Refused is also what YAML itself
accepts: duplicate keys, NaN, words that are numbers to one reader and text to another, huge or
binary files, alias bombs. Everything is reported at once, with line and column.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from impedance_modules.errors import BadFile, BadInput, Problem
from impedance_modules.input_files import read_input
from impedance_modules.spec.yaml_tree import Fault, Node, Place, TreeBuilder, TreeError

LARGEST_FILE = 1_000_000
"""Bytes; a file beyond this is refused unread."""

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INDENTATION_WORDS = ("expected '-' indicator", "expected <block end>", "mapping values are not allowed")
_CONTROL = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class Document:
    """One YAML file: its text, its plain data, and the place of every key and value.

    Attributes:
        path: As the user wrote it.
        text: The whole file, for the recording.
        data: dict, list, str, int, float, bool and None only; the top is a dict.
        root: The tree behind ``data``, which knows the places.
        faults: What is wrong with the YAML itself and did not stop the reading. ``read_document`` never
            returns a document that has any.
    """

    path: Path
    text: str
    data: dict[str, Any]
    root: Node = field(repr=False)
    faults: tuple[Fault, ...] = ()

    @property
    def yaml_problems(self) -> tuple[Problem, ...]:
        """The ``faults``, ready to be reported."""
        return tuple(_located(self.path, fault) for fault in self.faults)

    def problem(
        self, path: Sequence[str | int], message: str, valid: Sequence[str] = (), at: str = "value"
    ) -> Problem:
        """Locates a problem.

        Args:
            path: Keys and list positions from the top, e.g. ``("arms", "right", "springs", 0, "frame")``.
            message: What is wrong, in a sentence.
            valid: What would be accepted.
            at: ``value`` or ``key``: which of the two the position points to. Where the path does not
                exist, the position is that of its closest ancestor's key.
        """
        line, column = _find_place(self.root, path, at)
        return Problem(self.path, line, column, print_path(path), message, tuple(valid))


def print_path(path: Sequence[str | int]) -> str:
    """Prints a path the way people write it: ``arms.right.springs[0].frame``."""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def read_document(path: Path) -> Document:
    """Reads one YAML file.

    Raises:
        BadInput: The file is missing, unreadable, too large or no text file.
        BadFile: The text is no plain YAML; all problems at once.
    """
    document = scan_document(path)
    if document.yaml_problems:
        raise BadFile(document.yaml_problems)
    return document


def scan_document(path: Path) -> Document:
    """Like ``read_document``, but returns a document whose ``yaml_problems`` are still to be reported.

    For readers that want to add the problems of schema and meaning before they raise.
    """
    return parse_document(path, _read_text(path))


def parse_document(path: Path, text: str) -> Document:
    """Makes a document of text that is already in memory; ``path`` is only its name."""
    builder = TreeBuilder()
    if found := _CONTROL.search(text):
        raise BadFile([_control_problem(path, text, found)])
    try:
        root = builder.build(yaml.parse(text, Loader=_LOADER))
    except TreeError as error:
        raise BadFile([*_yaml_problems(path, builder), _located(path, error.fault)]) from None
    except yaml.YAMLError as error:
        raise BadFile([*_yaml_problems(path, builder), _syntax_problem(path, text, error)]) from None
    if root is None or root.content is None:
        raise BadFile([*_yaml_problems(path, builder), Problem(path, 1, 1, "", "the file holds nothing")])
    if not isinstance(root.content, dict):
        message = "expected keys with values ('format: 1' and so on) at the top of the file"
        raise BadFile([*_yaml_problems(path, builder), Problem(path, *root.place, "", message)])
    return Document(path, text, root.plain(), root, tuple(builder.faults))


def _yaml_problems(path: Path, builder: TreeBuilder) -> list[Problem]:
    return [_located(path, fault) for fault in builder.faults]


def _located(path: Path, fault: Fault) -> Problem:
    (line, column), inside, message = fault
    return Problem(path, line, column, print_path(inside), message)


def _find_place(root: Node, path: Sequence[str | int], at: str) -> Place:
    """Follows a path as far as it exists."""
    node, key_place = root, root.place
    for step in path:
        child = _child(node, step)
        if child is None:
            return key_place
        key_place = node.keys[step] if isinstance(step, str) else child.place
        node = child
    return key_place if at == "key" else node.place


def _child(node: Node, step: str | int) -> Node | None:
    if isinstance(node.content, dict) and isinstance(step, str):
        return node.content.get(step)
    if isinstance(node.content, list) and isinstance(step, int) and 0 <= step < len(node.content):
        return node.content[step]
    return None


def _read_text(path: Path) -> str:
    """Reads a regular file of bounded size as UTF-8."""
    try:
        near = "" if path.exists() else _near_files(path)
        folder = path.is_dir()
    except OSError:
        near, folder = "", False  # a name that no file can have: reading says why
    if folder:
        raise BadInput(f"{path}: is a directory, not a file{_files_in(path)}")
    return _decode(path, read_input(path, LARGEST_FILE, near=near))


def _decode(path: Path, raw: bytes) -> str:
    if b"\0" in raw:
        raise BadInput(
            f"{path}: holds binary data (a zero byte at {raw.index(0)}); expected YAML as UTF-8 text"
        )
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8-sig", "replace")
        message = f"not UTF-8: the byte 0x{raw[error.start]:02x}; save the file as UTF-8"
        raise BadFile([Problem(path, *_end_of(before), "", message)]) from None


def _end_of(text: str) -> Place:
    """Line and column just after a text."""
    return text.count("\n") + 1, len(text) - (text.rfind("\n") + 1) + 1


def _control_problem(path: Path, text: str, found: re.Match[str]) -> Problem:
    message = f"the control character U+{ord(found.group()):04X} has no place in a text file"
    return Problem(path, *_end_of(text[: found.start()]), "", message)


def _syntax_problem(path: Path, text: str, error: yaml.YAMLError) -> Problem:
    """Turns the parser's error into one sentence at its position."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    if mark is None:
        return Problem(path, 1, 1, "", f"not YAML: {error}")
    lines = text.split("\n")
    line = lines[mark.line] if mark.line < len(lines) else ""
    indent = line[: len(line) - len(line.lstrip())]
    if "\t" in indent:
        message = "a tab is used for indentation; YAML takes spaces only"
        return Problem(path, mark.line + 1, indent.index("\t") + 1, "", message)
    parts = [getattr(error, "context", None), getattr(error, "problem", None)]
    message = "not YAML: " + ", ".join(part for part in parts if part)
    context = getattr(error, "context_mark", None)
    if context is not None and context.line != mark.line:
        message += f" (begun in line {context.line + 1})"
    if any(words in message for words in _INDENTATION_WORDS):
        message += "; is this line indented like its neighbours?"
    return Problem(path, mark.line + 1, mark.column + 1, "", message)


def _near_files(path: Path) -> str:
    folder = path.parent
    if not folder.is_dir():
        return f" (the folder {folder} does not exist)"
    names = sorted(entry.name for entry in folder.iterdir() if entry.is_file())
    near = difflib.get_close_matches(path.name, names, n=1, cutoff=0.5)
    return f"; did you mean '{folder / near[0]}'?" if near else ""


def _files_in(folder: Path) -> str:
    try:
        names = sorted(entry.name for entry in folder.iterdir() if entry.suffix in {".yaml", ".yml"})
    except OSError:
        return ""
    return f" (it holds: {', '.join(names[:8])})" if names else ""
