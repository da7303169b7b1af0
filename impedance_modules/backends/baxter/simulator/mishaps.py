# SPDX-License-Identifier: BSD-3-Clause
"""What faults do to messages on their way out: lost, late, repeated, incomplete, not a number."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from impedance_modules.backends.baxter.ros.messages import JointState, Message

Send = Callable[[], None]


@dataclass
class Mishaps:
    """Faults in force.

    Attributes:
        silence, freeze, partial, nan: See ``faults``.
        drop: Share of messages lost.
        delay: Of the others [s].
        clock_step: Of the robot's clock [s].
        joint: Which joint ``partial`` leaves out.
    """

    joint: str
    seed: int
    silence: bool = False
    freeze: bool = False
    partial: bool = False
    nan: bool = False
    drop: float = 0.0
    delay: float = 0.0
    clock_step: float = 0.0
    _line: deque[tuple[float, Send]] = field(default_factory=deque)
    _frozen: dict[tuple[str, str], Message] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)

    def pass_on(
        self, place: tuple[str, str], message: Message, now: float, send: Callable[[Message], None]
    ) -> None:
        """Sends a message of one node's topic, as far as the faults let it through."""
        message = self._bent(place, message)
        if self.silence or (self.drop > 0.0 and self._random.random() < self.drop):
            return
        if self.delay > 0.0 or self._line:
            self._line.append((now + self.delay, lambda: send(message)))
        else:
            send(message)

    def release(self, now: float) -> None:
        """Sends what has been delayed long enough."""
        while self._line and self._line[0][0] <= now:
            self._line.popleft()[1]()

    def _bent(self, place: tuple[str, str], message: Message) -> Message:
        if self.freeze:
            return self._frozen.setdefault(place, message)
        self._frozen.clear()
        if isinstance(message, JointState) and self.partial:
            message = _without(message, self.joint)
        if isinstance(message, JointState) and self.nan:
            message = replace(message, effort=(math.nan,) * len(message.effort))
        return message


def _without(message: JointState, joint: str) -> JointState:
    """Leaves one joint out."""
    kept = [i for i, name in enumerate(message.name) if name != joint]
    return replace(
        message,
        name=tuple(message.name[i] for i in kept),
        position=tuple(message.position[i] for i in kept),
        velocity=tuple(message.velocity[i] for i in kept),
        effort=tuple(message.effort[i] for i in kept),
    )
