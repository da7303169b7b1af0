# SPDX-License-Identifier: BSD-3-Clause
"""Safety functions of a limb that a user may keep switched off, by asking again and again."""

from __future__ import annotations

import math

from impedance_modules.backends.baxter.simulator.parameters import SUPPRESSION_LAPSE

SUPPRESSIBLE = (
    "suppress_collision_avoidance",
    "suppress_contact_safety",
    "suppress_cuff_interaction",
    "suppress_gravity_compensation",
    "suppress_hand_overwrench_safety",
)
"""Topics below /robot/limb/SIDE/ that the real robot listens to; nobody there listens to suppress_body_avoidance."""


class Suppressions:
    """When each suppression of one limb was asked for last."""

    def __init__(self) -> None:
        self._asked = dict.fromkeys(SUPPRESSIBLE, -math.inf)

    def ask(self, name: str, now: float) -> None:
        """Notes a request at a time [s]."""
        self._asked[name] = now

    def active(self, name: str, now: float) -> bool:
        """Says whether it still holds."""
        return now - self._asked[name] < SUPPRESSION_LAPSE
