# SPDX-License-Identifier: BSD-3-Clause
"""A shipped task or patch with some numbers replaced, written beside an experiment's recordings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from impedance_modules.spec.task_text import changed, find_steps, task_document
from impedance_modules.spec.document import Document, scan_document


def task_with(name: str, values: Mapping[str, Any], folder: Path, mark: str) -> Path:
    """Writes a task with values replaced, by their paths as in ``sweep --vary``; returns its file."""
    return _written(task_document(name), values, folder / f"{name}-{mark}.yaml")


def patch_with(patch: Path, values: Mapping[str, Any], folder: Path, mark: str) -> Path:
    """Does the same with a patch file."""
    return _written(scan_document(patch), values, folder / f"{patch.stem}-{mark}.yaml")


def _written(document: Document, values: Mapping[str, Any], path: Path) -> Path:
    changes = {find_steps(document.data, steps): value for steps, value in values.items()}
    path.write_text(changed(document, changes))
    return path
