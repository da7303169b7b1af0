# SPDX-License-Identifier: BSD-3-Clause
"""From YAML events to a tree of values that all know their line and column.

The tree is built from the parser's flat stream of events, not by a composing loader: depth, number of values
and aliases are bounded before anything is expanded, and duplicate keys are still visible.

YAML 1.1 readers and YAML 1.2 readers disagree on ``1e3``, ``010``, ``1:30``, ``on``. A number that one reader takes
as text and another as 1000 has no place in a file that moves a robot, so all of these are refused, with the spelling
that every reader agrees on.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import yaml

DEEPEST = 40
"""Nesting that no sensible file reaches."""

MOST_VALUES = 20_000
"""Values of one file, aliases counted as often as they are used."""

Place = tuple[int, int]
KeyPath = tuple[str | int, ...]

Fault = tuple[Place, KeyPath, str]
"""A place, a path inside the document, and what is wrong there."""

Scalar = str | int | float | bool | None

LONGEST_INTEGER = 15
"""Digits that a float64 holds exactly."""

_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_FLOAT = re.compile(r"(?:[-+]?[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+][0-9]+)?")
_SIGNED_POINT = re.compile(r"[-+]\.[0-9]+(?:[eE][-+]?[0-9]+)?")
_SHORT_EXPONENT = re.compile(r"([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))[eE]([-+]?)([0-9]+)")

_LOOKALIKES = (
    (
        re.compile(r"[-+]?\.?(?:inf|infinity|nan)", re.IGNORECASE),
        "is not a finite number; every number must be finite",
    ),
    (
        re.compile(r"[-+]?0[0-9_]+"),
        "may be read as octal or as text; write it without leading zeros",
    ),
    (
        re.compile(r"[-+]?0[xXbBoO][0-9a-fA-F_]+"),
        "is not a decimal number; write it in decimal",
    ),
    (
        re.compile(r"[-+]?[0-9][0-9_]*(?::[0-5]?[0-9])+(?:\.[0-9_]*)?"),
        "may be read as a number to base 60; write a decimal number, or quotes for text",
    ),
    (
        re.compile(r"(?=.*_)[-+]?\.?[0-9][0-9_]*\.?[0-9_]*(?:[eE][-+]?[0-9_]+)?"),
        "may be read as text; write the number without underscores",
    ),
    (
        re.compile(r"[-+]?[0-9]+,[0-9]+"),
        "is text; write the number with a decimal point",
    ),
)
"""Words that look like numbers but are text, or another number, to some YAML readers."""

_WORDS: dict[str, Scalar] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_SWITCH = {"on": True, "yes": True, "off": False, "no": False}


@dataclass(slots=True)
class Node:
    """One value with its place.

    Attributes:
        place: (line, column) of the value, from 1.
        content: A scalar, a mapping or a list of nodes.
        keys: Place of each key of a mapping.
        size: Values inside, itself included, aliases expanded.
    """

    place: Place
    content: Scalar | dict[str, Node] | list[Node]
    keys: dict[str, Place] = field(default_factory=dict)
    size: int = 1

    def plain(self) -> Any:
        """The value as plain Python: dict, list, str, int, float, bool or None."""
        if isinstance(self.content, dict):
            return {key: node.plain() for key, node in self.content.items()}
        if isinstance(self.content, list):
            return [node.plain() for node in self.content]
        return self.content


class TreeError(Exception):
    """The document cannot be followed any further; carries one fault."""

    def __init__(self, fault: Fault) -> None:
        self.fault = fault
        super().__init__(fault[2])


@dataclass(slots=True)
class _Open:
    """A mapping or list that is being read.

    Attributes:
        key: The mapping's key whose value comes next.
        waiting: A key has been read and its value has not.
        discard: The value will be dropped, for its key is at fault.
        key_is_collection: A list or mapping is being read where a key should stand.
    """

    node: Node
    anchor: str | None
    key: str | None = None
    waiting: bool = False
    discard: bool = False
    key_is_collection: bool = False


class TreeBuilder:
    """Builds one tree from one stream of events.

    Attributes:
        root: The document's value; None while there is none.
        faults: Everything wrong that does not stop the reading.
    """

    def __init__(self) -> None:
        self.root: Node | None = None
        self.faults: list[Fault] = []
        self._open: list[_Open] = []
        self._anchors: dict[str, Node] = {}
        self._documents = 0
        self._count = 0

    def build(self, events: Iterable[yaml.Event]) -> Node | None:
        """Reads all events; raises TreeError where the rest cannot be read."""
        for event in events:
            self._take(event)
        return self.root

    def _take(self, event: yaml.Event) -> None:
        mark: Any = event.start_mark
        place = (mark.line + 1, mark.column + 1)
        if isinstance(event, yaml.ScalarEvent):
            self._scalar(event, place)
        elif isinstance(event, yaml.MappingStartEvent):
            self._begin(Node(place, {}), event)
        elif isinstance(event, yaml.SequenceStartEvent):
            self._begin(Node(place, []), event)
        elif isinstance(event, (yaml.MappingEndEvent, yaml.SequenceEndEvent)):
            self._end()
        elif isinstance(event, yaml.AliasEvent):
            self._alias(str(event.anchor), place)
        elif isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                raise TreeError((place, (), "a second document ('---') starts here; one file holds one"))

    def _here(self) -> KeyPath:
        """Path of the value that is read next."""
        steps: list[str | int] = []
        for frame in self._open:
            if isinstance(frame.node.content, list):
                steps.append(len(frame.node.content))
            elif frame.key is not None:
                steps.append(frame.key)
        return tuple(steps)

    def _fault(self, place: Place, message: str) -> None:
        self.faults.append((place, self._here(), message))

    def _scalar(self, event: yaml.ScalarEvent, place: Place) -> None:
        if self._expects_key():
            self._key(event, place)
            return
        self._refuse_tag(event.tag, place)
        if event.style:
            value: Scalar = event.value
        else:
            value, trap = read_plain(event.value)
            if trap:
                self._fault(place, trap)
        self._finish(Node(place, value), event.anchor)

    def _expects_key(self) -> bool:
        return (
            bool(self._open) and isinstance(self._open[-1].node.content, dict) and not self._open[-1].waiting
        )

    def _key(self, event: yaml.ScalarEvent, place: Place) -> None:
        frame = self._open[-1]
        frame.key, frame.waiting, frame.discard = event.value, True, False
        if event.anchor:
            self._anchors[event.anchor] = Node(place, event.value)
        if not event.style and event.value == "<<":
            frame.discard = True
            self._fault(place, "merge keys are not used here; write the keys out, or alias a whole value")
        elif not event.style and not isinstance(read_plain(event.value)[0], str):
            self._fault(place, f"the key '{event.value}' is not read as text; put it in quotes")
        if event.value in frame.node.keys:
            frame.discard = True
            line = frame.node.keys[event.value][0]
            self._fault(place, f"the key '{event.value}' is given twice; the first is in line {line}")
        if not frame.discard:
            frame.node.keys[event.value] = place

    def _refuse_tag(self, tag: str | None, place: Place) -> None:
        if tag is not None:
            self._fault(place, f"the tag '{tag}' is not used here; plain YAML only, quotes for text")

    def _begin(self, node: Node, event: yaml.CollectionStartEvent) -> None:
        self._refuse_tag(event.tag, node.place)
        if len(self._open) >= DEEPEST:
            raise TreeError((node.place, (), f"nested more than {DEEPEST} levels deep"))
        if self._expects_key():
            self._fault(node.place, "a key must be one word of text, not a list or mapping")
            self._open[-1].key_is_collection = True
        self._open.append(_Open(node, event.anchor))

    def _end(self) -> None:
        frame = self._open.pop()
        self._finish(frame.node, frame.anchor)

    def _alias(self, name: str, place: Place) -> None:
        if self._expects_key():
            self._fault(place, "a key must be one word of text, not an alias")
            self._open[-1].waiting = self._open[-1].discard = True
            return
        if any(frame.anchor == name for frame in self._open):
            raise TreeError((place, self._here(), f"the alias '*{name}' contains itself"))
        if name not in self._anchors:
            self._fault(place, f"there is no anchor '&{name}' above this alias")
            self._finish(Node(place, None), None)
            return
        target = self._anchors[name]
        self._count += target.size - 1
        self._finish(Node(place, target.content, target.keys, target.size), None)

    def _finish(self, node: Node, anchor: str | None) -> None:
        """Hands a complete value to the mapping or list that waits for it."""
        self._count += 1
        if self._count > MOST_VALUES:
            raise TreeError((node.place, (), f"more than {MOST_VALUES} values, aliases expanded"))
        if anchor:
            self._anchors[anchor] = node
        if not self._open:
            self.root = node
            return
        self._give(self._open[-1], node)

    def _give(self, frame: _Open, node: Node) -> None:
        content = frame.node.content
        if isinstance(content, list):
            content.append(node)
        elif isinstance(content, dict):
            self._give_to_mapping(frame, content, node)
        frame.node.size += node.size

    def _give_to_mapping(self, frame: _Open, content: dict[str, Node], node: Node) -> None:
        if frame.key_is_collection:
            frame.key_is_collection, frame.waiting, frame.discard = False, True, True
            return
        if not frame.discard and frame.key is not None:
            content[frame.key] = node
        frame.key, frame.waiting, frame.discard = None, False, False


def read_plain(word: str) -> tuple[Scalar, str | None]:
    """Returns the value of an unquoted word and, where it is a trap, a sentence that says so.

    The value beside a trap is what the author most likely meant, so that the rest of the file can still
    be checked; a file with a trap is never accepted.
    """
    if word in _WORDS:
        return _WORDS[word], None
    if word.lower() in _SWITCH:
        meant = _SWITCH[word.lower()]
        return meant, f"'{word}' is read as {str(meant).lower()}; write true or false, or '{word}' in quotes"
    if word[0] not in "-+.0123456789niNI":
        return word, None
    return _read_number(word)


def _read_number(word: str) -> tuple[Scalar, str | None]:
    if _INTEGER.fullmatch(word):
        return _integer(word)
    if _FLOAT.fullmatch(word):
        return _finite(word)
    if _SIGNED_POINT.fullmatch(word):
        longhand = f"{word[0]}0{word[1:]}"
        return float(word), f"'{word}' is read as text by some YAML readers; write {longhand}"
    if match := _SHORT_EXPONENT.fullmatch(word):
        return _short_exponent(word, *match.groups())
    for pattern, explain in _LOOKALIKES:
        if pattern.fullmatch(word):
            return 0.0, f"'{word}' {explain}"
    return word, None


def _integer(word: str) -> tuple[Scalar, str | None]:
    if len(word.lstrip("+-")) > LONGEST_INTEGER:
        return 0, f"a whole number of {len(word)} digits is more than a double holds exactly"
    return int(word), None


def _finite(word: str) -> tuple[Scalar, str | None]:
    value = float(word)
    if value in (float("inf"), float("-inf")):
        return 0.0, f"'{word}' is too large for a double"
    return value, None


def _short_exponent(word: str, mantissa: str, sign: str, exponent: str) -> tuple[Scalar, str | None]:
    pointed = mantissa if "." in mantissa else f"{mantissa}.0"
    longhand = f"{pointed}e{sign or '+'}{exponent}"
    value, overflow = _finite(longhand)
    return value, overflow or f"'{word}' is read as text by some YAML readers; write {longhand}"
