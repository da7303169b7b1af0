# SPDX-License-Identifier: BSD-3-Clause
"""Metadata of an episode that stands for any other."""

from __future__ import annotations

from typing import Any

from impedance_modules.episode.metadata import episode_metadata


def log_metadata(**changes: Any) -> dict[str, Any]:
    """Of a log without a task, measured at the motors of a planar robot; with ``changes``."""
    plain = {"robot": "planar", "episode": "log", "effort_source": "motor", "gravity_compensation": "none"}
    return episode_metadata(**{**plain, "repeat_of": None, "task": None, **changes})
