# SPDX-License-Identifier: BSD-3-Clause
"""Changes attributes and adds elements in an XML file; every other byte of it stays as it is.

The tree is changed first, by whoever knows what it means. What differs from the file is then written into the file's
own bytes: comments, order, quotes, line ends and spaces between attributes are those of its author.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.sax.saxutils import escape

from impedance_modules.spec.located_xml import XmlDocument

_ATTRIBUTE = re.compile(rb"""(\s+)([^\s=/>]+)(\s*=\s*)("[^"]*"|'[^']*')""")
_START = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=/>]+\s*=\s*(?:"[^"]*"|'[^']*'))*""")
_ENDS_ITSELF = re.compile(rb"\s*/>")

DEEPER = b"  "
"""What an added element is indented by beyond its parent."""

Splice = tuple[int, int, bytes]
"""Bytes from a place to another are replaced."""


@dataclass(frozen=True)
class Change:
    """One attribute that is written, or one element that is added.

    Attributes:
        line: Of the element in the file that was read; of its parent if it is new.
        place: The element, with the name of the closest one that has a name.
        key: Attribute.
        before, after: Its text; None where there is none.
    """

    line: int
    place: str
    key: str
    before: str | None
    after: str | None


class EditedXml:
    """An XML file whose tree may be changed.

    Attributes:
        document: The file as it was read; its tree is the one to change.
        parents: Element -> the one that it stands in.
    """

    def __init__(self, document: XmlDocument) -> None:
        self.document = document
        self._before = {element: dict(element.attrib) for element in document.lines}
        self.parents = {child: parent for parent in document.lines for child in parent}

    def child(self, parent: ET.Element, tag: str) -> ET.Element:
        """Returns the first child of a kind, which is added where there is none."""
        found = parent.find(tag)
        return self.add(parent, tag) if found is None else found

    def add(self, parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
        """Adds an element behind all others of its parent."""
        added = ET.SubElement(parent, tag, attributes)
        self.parents[added] = parent
        return added

    def changes(self) -> Iterator[Change]:
        """Yields all that differs from the file, in the file's order."""
        for element in self.document.root.iter():
            before, after = self._before.get(element, {}), element.attrib
            for key in dict.fromkeys((*before, *after)):
                if before.get(key) != after.get(key):
                    yield Change(
                        self._line(element), self._words(element), key, before.get(key), after.get(key)
                    )

    def written(self) -> bytes:
        """Returns the file with the changes in it."""
        splices = [splice for element in self._before for splice in self._splices(element)]
        out = self.document.raw
        for start, end, text in sorted(splices, reverse=True):
            out = out[:start] + text + out[end:]
        return out

    def _line(self, element: ET.Element) -> int:
        while element not in self.document.lines:
            element = self.parents[element]
        return self.document.lines[element]

    def _words(self, element: ET.Element) -> str:
        named = element
        while "name" not in named.attrib and named in self.parents:
            named = self.parents[named]
        if named is element or "name" not in named.attrib:
            return f"<{element.tag}>" + (f" '{element.get('name')}'" if "name" in element.attrib else "")
        return f"<{element.tag}> of <{named.tag}> '{named.get('name')}'"

    def _splices(self, element: ET.Element) -> Iterator[Splice]:
        """What becomes of an element's start tag, and what is added before its end."""
        raw, start = self.document.raw, self.document.starts[element]
        head = _START.match(raw, start)
        end_of_head = start if head is None else head.end()
        if element.attrib != self._before[element]:
            yield start, end_of_head, self._start_tag(element, raw[start:end_of_head])
        added = [child for child in element if child not in self._before]
        if not added:
            return
        if itself := _ENDS_ITSELF.match(raw, end_of_head):  # <a/> becomes <a>...</a>
            inside = b"".join(_as_text(child) for child in added)
            yield itself.start(), itself.end(), b">" + inside + f"</{element.tag}>".encode()
        else:
            yield self._before_end(element, added)

    def _before_end(self, element: ET.Element, added: list[ET.Element]) -> Splice:
        """Puts elements on lines of their own where the end tag has one, else directly before it."""
        raw, end = self.document.raw, self.document.ends[element]
        line = raw.rfind(b"\n", 0, end) + 1
        if raw[line:end].strip(b" \t"):
            return end, end, b"".join(_as_text(child) for child in added)
        break_ = b"\r\n" if raw[line - 2 : line] == b"\r\n" else b"\n"
        indent = raw[line:end] + DEEPER
        return line, line, b"".join(indent + _as_text(child) + break_ for child in added)

    def _start_tag(self, element: ET.Element, text: bytes) -> bytes:
        """Rewrites the values that changed, drops attributes that are gone, adds new ones behind the others."""
        before, after = self._before[element], element.attrib

        def rewritten(found: re.Match[bytes]) -> bytes:
            key = found[2].decode()
            if before[key] == after.get(key):
                return found[0]
            if key not in after:
                return b""
            quote = found[4][:1]
            return found[1] + found[2] + found[3] + quote + _escaped(after[key]) + quote

        new = (key for key in after if key not in before)
        return _ATTRIBUTE.sub(rewritten, text) + b"".join(
            f' {key}="'.encode() + _escaped(after[key]) + b'"' for key in new
        )


def _as_text(element: ET.Element) -> bytes:
    text = ET.tostring(element, encoding="unicode", short_empty_elements=True)
    return text.replace(" />", "/>").encode()


def _escaped(value: str) -> bytes:
    return escape(value, {'"': "&quot;", "'": "&apos;"}).encode()


def number(value: float) -> str:
    """Writes a number with fifteen digits at most: 0.1 + 0.2 is 0.3 again."""
    return f"{value + 0.0:.15g}"


def numbers(values: Iterable[float]) -> str:
    """Writes several numbers."""
    return " ".join(number(float(value)) for value in values)
