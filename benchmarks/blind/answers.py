# SPDX-License-Identifier: BSD-3-Clause
"""A tool's answer to one case, and its comparison with the truth."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

VERDICTS = ("no_gap", "explained", "partly_explained", "unexplained", "ambiguous", "insufficient_data")
NO_ANSWER = "no answer"


@dataclass(frozen=True)
class Answer:
    """A tool's answer to one case.

    Attributes:
        verdict: One of `VERDICTS`, or "no answer".
        causes: As in design 3.3, without those that only name known surroundings.
        shrink: Held-out share of the gap that was closed, or None.
        seconds: Wall time.
        processor_seconds: Of all its threads.
        memory: Peak [MB].
        errors: End of what was printed there.
    """

    verdict: str
    causes: tuple[Mapping[str, Any], ...]
    shrink: float | None
    seconds: float
    processor_seconds: float
    memory: float
    errors: str = ""

    @property
    def first(self) -> str:
        """Id of the first cause, or the verdict where there is none."""
        return str(self.causes[0]["effect"]) if self.causes else self.verdict

    @property
    def named(self) -> bool:
        """Whether it claims to have explained the gap by a cause."""
        return self.verdict == "explained" and bool(self.causes)

    @property
    def reported(self) -> set[str]:
        """Every effect id among causes and equivalents."""
        same = {str(other["effect"]) for cause in self.causes for other in cause.get("equivalent", [])}
        return same | {str(cause["effect"]) for cause in self.causes}


def read_answer(folder: Path, name: str, surroundings: Sequence[str]) -> Answer | None:
    """Reads a tool's answer to a case; None where there is none."""
    record = folder / f"{name}.run.json"
    if not record.exists():
        return None
    run = json.loads(record.read_text())
    costs = (run["seconds"], run["processor_seconds"], run["memory_mb"])
    path = folder / f"{name}.json"
    if not path.exists():
        return Answer(NO_ANSWER, (), None, *costs, run["errors"])
    said = json.loads(path.read_text())
    causes = tuple(cause for cause in said.get("causes", []) if cause["effect"] not in surroundings)
    verdict = said["verdict"] if said["verdict"] in VERDICTS else NO_ANSWER
    shrink = (said.get("gap") or {}).get("shrink")
    return Answer(verdict, causes, shrink, *costs)


def is_cause(causes: Sequence[Mapping[str, Any]], at: int, truth: Mapping[str, Any]) -> bool:
    """Tells whether one of the causes is a true effect, at its joints or body.

    What sits on one or two joints must be named on one of them and on no other. What sits on the whole arm must be
    named without joints, or on more than half of them, by this cause and others of the same effect together.
    """
    cause = causes[at]
    if cause["effect"] not in (truth["effect"], *truth["also"]):
        return False
    if truth["effect"] == "link_inertia":
        return bool(set(cause.get("parameters", {})) & set(truth["parameters"]))
    if truth["effect"] == "payload" or not truth["joints"]:
        return True
    right = set(truth["joints"])
    if len(right) <= 2:
        joints = set(cause.get("joints", []))
        return bool(joints) and joints <= right
    alike = [set(one.get("joints", [])) for one in causes if one["effect"] == cause["effect"]]
    return not all(alike) or (set().union(*alike) <= right and 2 * len(set().union(*alike)) > len(right))
