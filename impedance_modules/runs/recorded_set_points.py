# SPDX-License-Identifier: BSD-3-Clause
"""The set-points of a recording, sample by sample: what a replay follows."""

from __future__ import annotations

import numpy as np

from impedance_modules.control.equilibrium_following import Following
from impedance_modules.control.set_point_source import RunReport
from impedance_modules.episode.columns import set_point_columns
from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.set_point_limits import SetPointLimits


class RecordedSetPoints:
    """Gives each cycle the set-points that were in force when it was recorded; a ``SetPointSource``."""

    def __init__(self, episode: Episode, limits: SetPointLimits) -> None:
        """Takes a recording of a task with these limits.

        Raises:
            BadInput: A target's set-points were not recorded.
        """
        tables = []
        for target in limits.targets:
            names = set_point_columns(target)
            missing = [name for name in names if name not in episode.extra]
            if missing:
                raise BadInput(
                    f"{episode.source}: no column '{missing[0]}' (valid: a recording of this task)"
                )
            tables.append(np.column_stack([episode.extra[name] for name in names]))
        self._time = episode.time
        self._values = np.stack(tables, axis=1)

    def begin(self, phase: str, following: Following) -> None:
        """Does nothing: the recording knows what each phase was told."""

    def write(self, following: Following, state: RobotState) -> None:
        """Writes what was recorded at the state's time."""
        row = min(int(np.searchsorted(self._time, state.time)), len(self._time) - 1)
        values = self._values[row]
        for k in range(following.fresh.size):
            following.fresh[k] = values[k, 0] > 0.0
            if following.fresh[k]:
                following.goal[k] = values[k, 1:8]
                following.stiffness[k] = values[k, 8:14]
                following.force[k] = values[k, 14:20]

    def look(self, report: RunReport) -> list[str]:  # noqa: ARG002 - a recording takes no notice
        """Has nothing to tell."""
        return []


def recorded_set_points(episode: Episode, limits: SetPointLimits | None) -> RecordedSetPoints | None:
    """Opens the set-points of a recording; None where the task listens to nothing.

    Raises:
        BadInput: They were not recorded.
    """
    return None if limits is None else RecordedSetPoints(episode, limits)
