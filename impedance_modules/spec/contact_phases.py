# SPDX-License-Identifier: BSD-3-Clause
"""Which phases of a task are spent in contact, as the task itself says."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from impedance_modules.errors import ImpedanceError
from impedance_modules.spec.document import parse_document

Spent = Literal["throughout", "at its end"]


def contact_phases(text: str) -> dict[str, Spent]:
    """Names the phases in which a hand touches its surroundings or holds an object, and says when.

    A phase that waits for contact ends in it; all later ones are in it until one waits for its loss. Hands that
    hold an object do so from the first sample to the last.

    Args:
        text: A task file's whole text, as recordings keep it. Of a text that is no task nothing is known: no phase.
    """
    try:
        data = parse_document(Path("task"), text).data
    except ImpedanceError:
        return {}
    phases = data.get("phases")
    if not isinstance(phases, list):
        return {}
    held = bool(data.get("object"))
    out: dict[str, Spent] = {}
    touching = held
    for phase in phases:
        if not isinstance(phase, dict):
            continue
        awaited = _awaited(phase)
        if touching or awaited:
            out[str(phase.get("name"))] = "throughout" if touching else "at its end"
        touching = held or (touching if awaited is None else awaited)
    return out


def _awaited(phase: Mapping[str, Any]) -> bool | None:
    """True where a phase waits for contact, False where it waits for its loss, None where for neither."""
    until = phase.get("until")
    if not isinstance(until, dict) or "contact" not in until:
        return None
    contact = until["contact"]
    return bool(contact.get("present", True)) if isinstance(contact, dict) else bool(contact)
