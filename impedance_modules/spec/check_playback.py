# SPDX-License-Identifier: BSD-3-Clause
"""What a task must fulfil that the robot itself plays back."""

from __future__ import annotations

from collections.abc import Iterator

from impedance_modules.errors import Problem
from impedance_modules.spec.task_draft import Draft


def playback_problems(draft: Draft) -> Iterator[Problem]:
    """Checks that the robot plays anything back, and that nothing is asked that a playback does not do."""
    if not draft.has("playback"):
        return
    if draft.robot is not None and draft.robot.playback is None:
        message = f"robot '{draft.robot.name}' plays nothing back: its robot.yaml has no 'playback'"
        yield draft.problem(("playback",), message)
    for key, what in (("object", "holds no object"), ("pushes", "is not pushed")):
        if draft.has(key):
            message = f"a robot that plays a path back {what} here; leave out 'playback' or '{key}'"
            yield draft.problem((key,), message)
