# SPDX-License-Identifier: BSD-3-Clause
"""What the robot says it adds by itself, as columns of an episode: gravity, shoulder springs, crosstalk.

``gravity.<joint>`` is the gravity torque that the robot adds, inertial feed-forward included;
``gravity_only.<joint>`` what holds the arm at rest; ``hysteresis.<joint>`` the model of the spring beside the
joint; ``crosstalk.<joint>`` of its neighbours' influence [N.m]. They come slower than the states; a row repeats the
last one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.ros.messages import SEAJointState

Array = NDArray[np.float64]

FIELDS: Mapping[str, str] = {
    "gravity": "gravity_model_effort",
    "gravity_only": "gravity_only",
    "hysteresis": "hysteresis_model_effort",
    "crosstalk": "crosstalk_model_effort",
}
"""Column -> field of the message."""


class SeaColumns:
    """Columns for what a robot has been heard to say; fields that it leaves empty get none.

    Attributes:
        names: Of the columns.
    """

    def __init__(self, newest: Mapping[str, SEAJointState]) -> None:
        """Takes limb -> newest message, which goes on being updated; the columns are fixed now."""
        self._newest = newest
        self._parts = [
            (limb, field, message.name, column)
            for limb, message in newest.items()
            for column, field in FIELDS.items()
            if len(getattr(message, field)) == len(message.name) > 0
        ]
        self.names = tuple(f"{column}.{joint}" for _, _, joints, column in self._parts for joint in joints)
        self._values = np.full(len(self.names), np.nan)
        self._read: dict[str, SEAJointState] = {}

    def values(self) -> Array:
        """Newest value of every column; not a number where a message has shrunk since the beginning."""
        if any(self._read.get(limb) is not message for limb, message in self._newest.items()):
            self._read = dict(self._newest)
            self._update()
        return self._values

    def _update(self) -> None:
        at = 0
        for limb, field, joints, _ in self._parts:
            message = self._read[limb]
            numbers = getattr(message, field)
            complete = message.name == joints and len(numbers) == len(joints)
            self._values[at : at + len(joints)] = numbers if complete else np.nan
            at += len(joints)
