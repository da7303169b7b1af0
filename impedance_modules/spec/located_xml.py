# SPDX-License-Identifier: BSD-3-Clause
"""XML whose elements know their line, so that a fault in a URDF is reported at its own place.

Only UTF-8 is read: the library that computes dynamics knows no other encoding. Entity declarations are refused: a
robot needs none, and they can be made to fill the memory.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from impedance_modules.errors import BadFile, Problem
from impedance_modules.input_files import read_input

LARGEST_FILE = 10_000_000
"""Bytes; a file beyond this is refused unread."""

LARGEST_NUMBER = 1e18
"""No length, mass, inertia or limit of a robot is beyond; products of some of them are still finite numbers."""

ENCODINGS = ("utf-8", "us-ascii", "ascii")
"""Declarations of the one encoding that is read, and of a part of it."""

_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


class Faults:
    """Collects problems at the lines of their elements."""

    def __init__(self, path: Path, lines: Mapping[ET.Element, int]) -> None:
        self.path, self.lines = path, lines
        self.problems: list[Problem] = []

    def add(self, element: ET.Element, message: str) -> None:
        """Notes a problem at an element."""
        self.problems.append(Problem(self.path, self.lines[element], 1, "", message))

    def number(self, element: ET.Element, key: str, *, least: float = -math.inf) -> float:
        """Reads a finite number of at least ``least``; a fault otherwise, and NaN, which no check lets pass."""
        text = element.get(key, "")
        value = read_number(text)
        if value is None:
            found = f"found {text[:60]!r}" if text else "it is missing"
            self.add(element, f"<{element.tag}> needs a finite number '{key}'; {found}")
        elif abs(value) > LARGEST_NUMBER:
            self.add(
                element,
                f"<{element.tag}> has '{key}' {text[:60]!r} (valid: at most {LARGEST_NUMBER:g} in size)",
            )
        elif value < least:
            self.add(element, f"<{element.tag}> has '{key}' {text[:60]!r} (valid: at least {least:g})")
        else:
            return value
        return math.nan

    def vector(self, element: ET.Element, key: str) -> tuple[float, ...]:
        """Reads three finite numbers; a fault otherwise, and an empty tuple."""
        text = element.get(key, "")
        values = [read_number(word) for word in text.split()]
        found = tuple(value for value in values if value is not None and abs(value) <= LARGEST_NUMBER)
        if len(values) == len(found) == 3:
            return found
        self.add(
            element,
            f"<{element.tag}> has '{key}' {text[:60]!r} (valid: three finite numbers, at most"
            f' {LARGEST_NUMBER:g} in size, as in "0 0 1")',
        )
        return ()


def read_number(text: str) -> float | None:
    """Returns a decimal number, infinite where it is too large; None where a text is none."""
    return float(text) if _NUMBER.fullmatch(text.strip()) else None


@dataclass(frozen=True)
class XmlDocument:
    """An XML file: its bytes, its elements, and where each of them stands.

    Attributes:
        path: As the user wrote it.
        raw: The whole file.
        root: The top element.
        lines: Element -> line on which it begins, from 1.
        starts: Element -> place of its start tag in ``raw`` [bytes].
        ends: Element -> place of its end tag [bytes]; where it ends itself, ``<a/>``, the place behind that.
    """

    path: Path
    raw: bytes
    root: ET.Element
    lines: Mapping[ET.Element, int]
    starts: Mapping[ET.Element, int]
    ends: Mapping[ET.Element, int]


def parse_xml(path: Path) -> tuple[ET.Element, Mapping[ET.Element, int]]:
    """Parses an XML file into its top element and the line of every element; errors as in ``read_xml``."""
    document = read_xml(path)
    return document.root, document.lines


def read_xml(path: Path) -> XmlDocument:
    """Reads an XML file.

    Raises:
        BadInput: The file is missing, no regular file, too large or cannot be read.
        BadFile: It is not UTF-8, or not well-formed.
    """
    raw = read_input(path, LARGEST_FILE)
    _check_utf8(path, raw)
    builder = ET.TreeBuilder()
    lines, starts, ends = dict[ET.Element, int](), dict[ET.Element, int](), dict[ET.Element, int]()
    parser = expat.ParserCreate("utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = builder.start(tag, attributes)
        lines[element], starts[element] = parser.CurrentLineNumber, parser.CurrentByteIndex

    def end(tag: str) -> None:
        ends[builder.end(tag)] = parser.CurrentByteIndex

    def here(message: str, valid: tuple[str, ...] = ()) -> BadFile:
        place = (parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)
        return BadFile([Problem(path, *place, "", message, valid)])

    def entity(*_: object) -> None:
        raise here("XML entities are not accepted")

    def declaration(_version: str, encoding: str | None, _standalone: int) -> None:
        if encoding is not None and encoding.lower() not in ENCODINGS:
            raise here(f"the encoding {encoding[:60]!r} is declared, and only UTF-8 is read", ("UTF-8",))

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.EntityDeclHandler = entity
    parser.XmlDeclHandler = declaration
    try:
        parser.Parse(raw, True)
    except expat.ExpatError as error:
        message = f"not XML: {expat.ErrorString(error.code)}"
        raise BadFile([Problem(path, error.lineno, error.offset + 1, "", message)]) from None
    return XmlDocument(path, raw, builder.close(), lines, starts, ends)


def _check_utf8(path: Path, raw: bytes) -> None:
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8", "replace")
        message = f"not UTF-8: the byte 0x{raw[error.start]:02x}; save the file as UTF-8"
        place = before.count("\n") + 1, len(before) - before.rfind("\n")
        raise BadFile([Problem(path, *place, "", message, ("UTF-8",))]) from None
