# SPDX-License-Identifier: BSD-3-Clause
r"""From the torque asked for to the torque of the motor: late, clipped, scaled, and slow, in this order.

u_1(t) = u(t - T_delay)      of the command; what the robot adds by itself is not late
u_2 = min(max(u_1 + assist, -limit), limit)
u_3 = s u_2
T_lag \dot\tau_m = u_3 - \tau_m
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.motion import JointMotion

Array = NDArray[np.float64]


class DrivePath:
    """Command path of all joints; gives the difference between motor torque and torque asked for.

    The delay is rounded to the plant's integration step.
    """

    def __init__(self, delay: Array, limit: Array, gain: Array, lag: Array) -> None:
        """Takes (n,) each: delay [s], symmetric limit [N.m] (inf: none), gain, time constant [s]."""
        self._delay, self._limit, self._gain, self._lag = delay, limit, gain, lag
        self._age = np.zeros(delay.size, dtype=np.intp)
        self._share = np.ones(delay.size)
        self._past = np.zeros((1, delay.size))
        self._next = 0
        self._slow = np.zeros(delay.size)

    @property
    def port(self) -> Literal["motor", "link"]:
        """The motor's."""
        return "motor"

    @property
    def does_anything(self) -> bool:
        """Says whether any joint's motor torque differs from the torque asked for."""
        return bool(
            self._delay.any()
            or self._lag.any()
            or np.any(self._gain != 1.0)
            or np.isfinite(self._limit).any()
        )

    def start(self, motion: JointMotion, step: float) -> None:
        """Starts as if the present command had acted for ever."""
        self._age = np.rint(self._delay / step).astype(np.intp)
        self._share = np.where(self._lag > 0.0, -np.expm1(-step / np.maximum(self._lag, 1e-12)), 1.0)
        self._past = np.tile(motion.command, (int(self._age.max()) + 1, 1))
        self._next = 0
        self._slow = self._asked(motion)

    def torque(self, motion: JointMotion) -> Array:
        """Gives motor torque minus torque asked for (n,) [N.m]."""
        asked = self._asked(motion)
        # Over a step, a lag moves by its share: half-way is what the step sees on average.
        now = np.where(self._lag > 0.0, self._slow + 0.5 * self._share * (asked - self._slow), asked)
        return np.asarray(now - motion.drive)

    def settle(self, motion: JointMotion) -> None:
        """Moves on by one step."""
        self._slow = self._slow + self._share * (self._asked(motion) - self._slow)
        self._past[self._next] = motion.command
        self._next = (self._next + 1) % self._past.shape[0]

    def _asked(self, motion: JointMotion) -> Array:
        """Computes u_3, what the motor's own bandwidth then follows."""
        n = self._delay.size
        late = self._past[(self._next - self._age) % self._past.shape[0], np.arange(n)]
        command = np.where(self._age > 0, late, motion.command)
        total = command + (motion.drive - motion.command)
        return np.asarray(self._gain * np.clip(total, -self._limit, self._limit))
