# SPDX-License-Identifier: BSD-3-Clause
"""XML elements that remember their line, and a list of what is wrong with them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from xml.parsers import expat

from impedance_modules.errors import BadFile, BadInput, Problem

LARGEST_FILE = 10_000_000
"""Bytes; a file beyond this is refused unread."""


class Faults:
    """Collects problems at the lines of their elements."""

    def __init__(self, path: Path, lines: Mapping[ET.Element, int]) -> None:
        self.path, self.lines = path, lines
        self.problems: list[Problem] = []

    def add(self, element: ET.Element, message: str) -> None:
        """Notes a problem at an element."""
        self.problems.append(Problem(self.path, self.lines[element], 1, "", message))

    def number(self, element: ET.Element, key: str) -> float:
        """Reads a finite number; a fault otherwise, and NaN, which no check lets pass."""
        text = element.get(key, "")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            found = f"found {text!r}" if text else "it is missing"
            self.add(element, f"<{element.tag}> needs a finite number '{key}'; {found}")
            return math.nan
        return value


def parse_xml(path: Path) -> tuple[ET.Element, dict[ET.Element, int]]:
    """Parses an XML file into its top element and the line of every element.

    Entity declarations are refused: a robot needs none, and they can be made to fill the memory.

    Raises:
        BadInput: The file is missing, too large or cannot be read.
        BadFile: It is not well-formed.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise BadInput(f"{path}: larger than {LARGEST_FILE} bytes; no robot description is")
        raw = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from None
    builder, lines = ET.TreeBuilder(), dict[ET.Element, int]()
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    def entity(*_: object) -> None:
        raise BadFile([Problem(path, parser.CurrentLineNumber, 1, "", "XML entities are not accepted")])

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(raw, True)
    except expat.ExpatError as error:
        message = f"not XML: {expat.ErrorString(error.code)}"
        raise BadFile([Problem(path, error.lineno, error.offset + 1, "", message)]) from None
    return builder.close(), lines
