# SPDX-License-Identifier: BSD-3-Clause
"""Writes ``summary.json``: how a run ended, in numbers a program can read."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.episode.run_folder import SUMMARY, whole_file


def write_summary(directory: Path, summary: Mapping[str, Any]) -> Path:
    """Writes the summary of a run, whole or not at all.

    Args:
        directory: Of the run.
        summary: Numbers, texts, arrays, nested; a number that is not finite becomes null.

    Raises:
        TypeError: A value that is none of these.
    """
    path = Path(directory) / SUMMARY
    text = json.dumps(_plain(summary), indent=2, allow_nan=False, ensure_ascii=False)
    with whole_file(path) as stream:
        stream.write(text.encode() + b"\n")
    return path


def _plain(value: Any) -> Any:
    """Returns the value in JSON's own types."""
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
