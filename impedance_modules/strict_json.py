# SPDX-License-Identifier: BSD-3-Clause
"""JSON that somebody else wrote: what Python accepts beyond the standard, or cannot hold, is refused.

Refused are NaN and infinities, numbers that become infinite, whole numbers beyond 64 bits, and nesting so deep that
whoever walks through the value would run out of stack.
"""

from __future__ import annotations

import json
import math
from typing import Any

DEEPEST = 40
"""Lists and objects within each other."""

LARGEST_WHOLE = 1 << 64


def parse_json(text: bytes | str) -> Any:
    """Reads JSON.

    Raises:
        ValueError: It is none; ``json.JSONDecodeError`` where a line and a column are known.
    """
    try:
        value = json.loads(text, parse_constant=_refused, parse_float=_finite, parse_int=_whole)
    except RecursionError:
        raise ValueError(f"nested more than {DEEPEST} levels deep") from None
    _check_depth(value)
    return value


def _refused(word: str) -> float:
    raise ValueError(f"the number {word} is not finite (valid: finite numbers)")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:40]} is too large for a double")
    return value


def _whole(text: str) -> int:
    # Python refuses to convert some thousand digits; so many are never needed.
    value = int(text) if len(text) <= 40 else LARGEST_WHOLE
    if abs(value) >= LARGEST_WHOLE:
        raise ValueError(f"the whole number {text[:40]} has more than 64 bits")
    return value


def _check_depth(value: Any) -> None:
    waiting = [(value, 1)]
    while waiting:
        item, depth = waiting.pop()
        inner = item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
        if depth > DEEPEST:
            raise ValueError(f"nested more than {DEEPEST} levels deep")
        waiting += [(one, depth + 1) for one in inner if isinstance(one, dict | list)]
