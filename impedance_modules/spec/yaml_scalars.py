# SPDX-License-Identifier: BSD-3-Clause
"""What an unquoted word in a YAML file means, and the words that mean something else than they look.

YAML 1.1 readers and YAML 1.2 readers disagree on ``1e3``, ``010``, ``1:30``, ``on``. A number that one
reader takes as text and another as 1000 has no place in a file that moves a robot, so all of these are
refused, with the spelling that every reader agrees on.
"""

from __future__ import annotations

import re

Scalar = str | int | float | bool | None

LONGEST_INTEGER = 15
"""Digits that a float64 holds exactly."""

_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+][0-9]+)?")
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
        re.compile(r"[-+]?[0-9][0-9_]*_[0-9_]*(?:\.[0-9_]*)?"),
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
