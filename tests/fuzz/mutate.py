# SPDX-License-Identifier: BSD-3-Clause
"""Changes to an input, drawn from a seed: words, lines, numbers and pieces of text; bytes of everything else."""

from __future__ import annotations

import random
import re

TOKEN = re.compile(r"[A-Za-z_][\w.-]*|[-+]?[0-9][\w.+-]*|[^\s\w]|\n *")
WORDS = (
    "on", "1e3", ".nan", ".inf", "nan", "inf", "-inf", "1e308", "-1e308", "1e999", "1e-320", "0", "-1", "-0.0",
    "0x1", "010", "1:30", "~", "", "null", "true", "[]", "{}", "9" * 20, "9" * 400, "1e18", "9007199254740993",
    "4294967296", "*a", "&a x", "<<: ", "!!python/object:os.system ", "{", "}", "[", "]", ":", ": ", "- ", ",", "#",
    "\t", "\n", "'", '"', "|", ">", "%", "@", "? ", "\x00", "\x07", "\x1b[2J", "\ufeff", "\u00e9", "\u2028", "\u202e",
    "\r", "&#0;", "\\u0000", "\\ud800", "<script>", "../../..", "/dev/zero", "a" * 300, "n" * 5000, "[" * 60,
    '{"a":' * 60, "<!ENTITY ", 'encoding="hex"', "CDATA[", "&lt;", "$\\frac$", "[/bold]", "{joint}", "{index}",
    "{episode}", "right", "world",
)  # fmt: skip
EDGES = (
    0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x7FFFFFFFFFFFFFFF, 0xFFFFFFFFFFFFFFFF,
)  # fmt: skip
MOST = 5
"""Changes at once."""

LONGEST = 200_000
"""Bytes of an input."""


def mutated(data: bytes, others: list[bytes], draw: random.Random, *, text: bool) -> bytes:
    """Returns an input with one to five changes.

    Args:
        data: The input.
        others: From which pieces are taken.
        draw: Where all chance comes from.
        text: Whether it is text; one in eight is changed as bytes nevertheless.
    """
    changes = 1 + min(draw.randrange(MOST), draw.randrange(MOST))
    if not text or draw.randrange(8) == 0:
        for _ in range(changes):
            data = _bytes(data, others, draw)
        return data[:LONGEST]
    words = data.decode("utf-8", "replace")
    source = draw.choice(others).decode("utf-8", "replace")
    for _ in range(changes):
        words = _text(words, source, draw)
    return words[:LONGEST].encode("utf-8", "replace")


def _text(text: str, source: str, draw: random.Random) -> str:
    places = [found.span() for found in TOKEN.finditer(text)]
    if not places:
        return draw.choice(WORDS)
    start, end = draw.choice(places)
    kind = draw.randrange(9)
    if kind <= 1:
        return text[:start] + draw.choice(WORDS) + text[end:]
    if kind == 2:
        return text[:start] + text[end:]
    if kind == 3:
        return text[:end] + draw.choice(WORDS) + text[end:]
    if kind == 4:
        found = draw.choice([piece.group() for piece in TOKEN.finditer(source)] or [""])
        return text[:start] + found + text[end:]
    if kind == 5:
        return text[:start] + _number(text[start:end], draw) + text[end:]
    if kind == 6:
        lines = text.split("\n")
        at = draw.randrange(len(lines))
        lines[at : at + 1] = [lines[at]] * draw.randrange(4)
        return "\n".join(lines)
    if kind == 7:
        lines, more = text.split("\n"), source.split("\n")
        lines.insert(draw.randrange(len(lines) + 1), draw.choice(more))
        return "\n".join(lines)
    return text[:start] + chr(draw.randrange(0x3000)) + text[start + 1 :]


def _number(word: str, draw: random.Random) -> str:
    """The same number times something, or with another sign."""
    try:
        value = float(word)
    except ValueError:
        return repr(draw.uniform(-10.0, 10.0))
    return repr(value * draw.choice((-1.0, 0.0, 1e-9, 1e3, 1e9, 1e300, draw.uniform(0.5, 2.0))))


def _bytes(data: bytes, others: list[bytes], draw: random.Random) -> bytes:
    if not data:
        return draw.randbytes(4)
    at, kind = draw.randrange(len(data)), draw.randrange(8)
    if kind == 0:
        return data[:at] + bytes([data[at] ^ (1 << draw.randrange(8))]) + data[at + 1 :]
    if kind == 1:
        return data[:at] + draw.randbytes(1) + data[at + 1 :]
    if kind == 2:
        return data[:at] + data[at + draw.randrange(1, 64) :]
    if kind == 3:
        return data[:at] + draw.randbytes(draw.randrange(1, 16)) + data[at:]
    if kind == 4:
        size = draw.choice((1, 2, 4, 8))
        edge = draw.choice(EDGES) & ((1 << 8 * size) - 1)
        return data[:at] + edge.to_bytes(size, draw.choice(("little", "big"))) + data[at + size :]
    if kind == 5:
        return data[:at]
    if kind == 6:
        other = draw.choice(others) or b"\0"
        first = draw.randrange(len(other))
        piece = other[first : first + draw.randrange(1, 200)]
        return data[:at] + piece + data[at + len(piece) * draw.randrange(2) :]
    size = draw.randrange(1, 32)
    other_at = draw.randrange(len(data))
    return data[:at] + data[other_at : other_at + size] + data[at + size :]
