# SPDX-License-Identifier: BSD-3-Clause
"""The commands that record and use the next motion of a diagnosis, for the shell."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

NONE_NEEDED = ("", "none needed")


@dataclass(frozen=True)
class Asked:
    """What a diagnosis was asked with.

    Attributes:
        logs: Recordings, as given.
        robot, urdf: The model, one of them.
        options: Further words that the next diagnosis needs, as --hold and its value.
        json_path: Where the answer is written; None where it is not.
    """

    logs: tuple[Path, ...]
    robot: str | None
    urdf: Path | None
    options: tuple[str, ...]
    json_path: Path | None


def next_commands(asked: Asked, next_motion: Mapping[str, object]) -> tuple[str, ...]:
    """Returns the commands, in order; none where no further motion is needed.

    Args:
        asked: How this diagnosis was made.
        next_motion: Of its answer.
    """
    if str(next_motion.get("purpose", "")) in NONE_NEEDED:
        return ()
    model = ["--robot", str(asked.robot)] if asked.urdf is None else ["--urdf", str(asked.urdf)]
    answer = "answer.json" if asked.json_path is None else str(asked.json_path)
    logs = [str(log) for log in asked.logs]
    commands: list[Sequence[str]] = []
    if asked.json_path is None:
        commands.append(["diagnose", *logs, *model, *asked.options, "--json", answer])
    commands.append(["probe", answer, *model, "--out", "probe"])
    if asked.urdf is None:
        commands.append(["run", "probe/probe.yaml", "--out", "runs/probe"])
        recorded = "runs/probe"
    else:
        recorded = "probe.parquet"
    commands.append(["diagnose", *logs, recorded, *model, *asked.options, "--json", answer])
    return tuple(shlex.join(["impedance", *words]) for words in commands)
