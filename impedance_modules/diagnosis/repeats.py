# SPDX-License-Identifier: BSD-3-Clause
"""Finds recordings that repeat each other: the cheapest instrument, a noise floor without a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from impedance_modules.diagnosis.log import Log

LIKENESS = 0.1
"""Two motions repeat each other if they differ by less than this part of their size."""


def group_repeats(logs: Sequence[Log], said: Sequence[str | None]) -> tuple[Log, ...]:
    """Puts recordings of one motion into one group.

    Args:
        logs: Recordings.
        said: What each says it repeats; None where it says nothing.
    """
    groups = {log.name: log.group for log in logs}
    for log, original in zip(logs, said, strict=True):
        if original is not None and original in groups:
            groups[log.name] = groups[original]
        elif original is not None:
            groups[log.name] = original
    for index, log in enumerate(logs):
        for other in logs[:index]:
            if groups[log.name] == log.name and repeats(log, other):
                groups[log.name] = groups[other.name]
    return tuple(replace(log, group=groups[log.name]) for log in logs)


def repeats(log: Log, other: Log) -> bool:
    """Whether two recordings show one motion, sample by sample."""
    samples = min(log.samples, other.samples)
    if abs(log.rate - other.rate) > 0.01 * log.rate or abs(log.samples - other.samples) > 0.02 * samples:
        return False
    a, b = log.position[:samples], other.position[:samples]
    motion = float(np.sqrt(np.mean((a - a.mean(axis=0)) ** 2)))
    return bool(np.sqrt(np.mean((a - b) ** 2)) < LIKENESS * motion)
