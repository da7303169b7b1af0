# SPDX-License-Identifier: BSD-3-Clause
"""Logs of other programs that ``diagnose`` takes as they are: imported first, by the map of their header."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

SUFFIXES = {".csv", ".txt"}
"""Of text logs."""

SOURCES, GRAVITIES = ("joint_sensor", "motor"), ("none", "robot", "command")
"""Where effort may have been measured; what may hold the arm's weight. The first of each is taken unless stated."""


@dataclass(frozen=True)
class Stated:
    """What a table cannot say of itself: where effort was measured, and what holds the weight; None if not stated."""

    effort_source: str | None = None
    gravity_compensation: str | None = None


def as_episodes(
    logs: Sequence[Path],
    description: Callable[[], Path],
    stated: Stated,
    folder: Path,
    note: Callable[[str], None],
) -> tuple[Path, ...]:
    """Replaces every text log by the episode that it is imported as; all other logs stay.

    Args:
        logs: As the user gave them.
        description: Finds the description that names the joints; called only if there is a text log.
        stated: Of logs whose header does not say it.
        folder: For the episodes.
        note: Told what was taken because nobody said it, and which columns were left out.

    Raises:
        BadInput: A text log whose columns are not known, or one that cannot be imported.
    """
    texts = [log for log in logs if log.suffix in SUFFIXES and log.is_file()]
    if not texts:
        return tuple(logs)
    urdf, taken = description(), dict[str, str]()
    found = tuple(_episode(log, urdf, stated, taken, folder, note) if log in texts else log for log in logs)
    for key, usual in taken.items():
        more = f" and {len(texts) - 1} more" if len(texts) > 1 else ""
        option = f"--{key.replace('_', '-')}"
        note(f"{texts[0]}{more}: no {key} is said; '{usual}' is taken ({option} states it)")
    return found


def _episode(
    log: Path,
    urdf: Path,
    stated: Stated,
    taken: dict[str, str],
    folder: Path,
    note: Callable[[str], None],
) -> Path:
    """Imports one text log; writes into ``taken`` what nobody said, and notes which columns are not used."""
    # Imported only here: the command line needs the choices above at once.
    from impedance_modules.episode.imports.generated_maps import map_for  # noqa: PLC0415
    from impedance_modules.episode.imports.maker_maps import STATE  # noqa: PLC0415
    from impedance_modules.episode.imports.pipeline import import_sources  # noqa: PLC0415

    made = map_for(log, urdf)
    text = made.text
    for said in made.notes:
        note(f"{log}: {said}")
    answers = {"effort_source": stated.effort_source, "gravity_compensation": stated.gravity_compensation}
    for (key, answer), usual in zip(answers.items(), (SOURCES[0], GRAVITIES[0]), strict=True):
        asked = re.compile(rf"^{key}: {STATE}$", re.MULTILINE)
        if asked.search(text):
            text = asked.sub(f"{key}: {answer or usual}", text)
            if answer is None:
                taken[key] = usual
    target = folder / f"{len(list(folder.iterdir()))}"
    target.mkdir()
    (target / "map.yaml").write_text(text, encoding="utf-8")
    return import_sources([log], target / "map.yaml", None, target)[0].path
