# SPDX-License-Identifier: BSD-3-Clause
"""Episodes from columns that a test has made up."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.metadata import episode_metadata


def columns_of(time: np.ndarray, joints: Sequence[str], **kinds: np.ndarray) -> dict[str, np.ndarray]:
    """Names the columns of arrays (N, joints), as ``position`` or ``effort``."""
    named = {f"{kind}.{joint}": x[:, i].copy() for kind, x in kinds.items() for i, joint in enumerate(joints)}
    return {"time": time, **named}


def save(folder: Path, name: str, columns: Mapping[str, np.ndarray], **about: Any) -> Path:
    """Writes ``folder/name.parquet``; ``about`` replaces what is usually said of a recording."""
    usual = {"robot": "pendulum", "effort_source": "joint_sensor", "gravity_compensation": "none"}
    said = {**usual, "repeat_of": None, "task": None, **about}
    return write_episode(folder / f"{name}.parquet", columns, episode_metadata(episode=name, **said))
