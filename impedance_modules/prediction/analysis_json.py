# SPDX-License-Identifier: BSD-3-Clause
"""The analysis as ``analyze --json`` writes it (design 3.1): plain numbers, null for what does not exist."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.prediction.analysis import Analysis, Felt

MATRICES = (
    "inertia",
    "inertia_without_reflected",
    "mobility",
    "damping",
    "stiffness",
    "compliance",
    "stiffness_without_preload",
)


def analysis_json(analysis: Analysis) -> dict[str, Any]:
    """Gives ``{"format": 1, "arms": {SIDE: X}, "object": X or null}``."""
    felt = analysis.object
    return {
        "format": 1,
        "arms": {limb: _frame(found, analysis.phase) for limb, found in analysis.arms.items()},
        "object": None if felt is None else _frame(felt, analysis.phase),
    }


def write_analysis(analysis: Analysis, path: Path) -> None:
    """Writes the JSON file.

    Raises:
        BadInput: The file cannot be written.
    """
    text = json.dumps(analysis_json(analysis), indent=1, allow_nan=False)
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--json {path}: cannot be written: {error.strerror}") from None


def _frame(felt: Felt, phase: str | None) -> dict[str, Any]:
    found: dict[str, Any] = {"frame": felt.frame, "position": felt.position.tolist(), "q": dict(felt.q)}
    found.update({name: _numbers(getattr(felt, name)) for name in MATRICES})
    found.update({"preload": felt.preload.tolist(), "folds": felt.folds, "phase": phase})
    return found


def _numbers(matrix: NDArray[np.float64] | None) -> list[list[float]] | None:
    return None if matrix is None else [[float(value) for value in row] for row in matrix]
