# SPDX-License-Identifier: BSD-3-Clause
r"""Path of all joints from the torque asked for to the motor's: delayed, clipped, scaled, mixed, lagged.

u_1(t) = u(t - T_delay)      of the command; what the robot adds by itself is not delayed
u_2 = min(max(u_1 + assist, -limit), limit)
u_3 = s u_2 + C u_2
T_lag \dot\tau_m = u_3 - \tau_m
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.effects.joint_motion import CompiledTorque, JointMotion
from impedance_modules.records import Flag, Indices, Integer, Matrix, Record, Vector


class DriveState(Record):
    """All drives, (n,) each unless said otherwise.

    Attributes:
        limit: Symmetric [N.m]; infinite for none.
        gain: Torque given per torque asked for.
        crosstalk: (n, n) C, share of what is asked of column j that row i's motor gives.
        mixes: Whether C has any number.
        lagging: 1 where the drive lags.
        share: Of a change of u_3 that the motor follows in one step.
        age: Steps by which each command is late.
        past: (rows, n) commands of the last steps [N.m], a ring.
        next: Row of the oldest of them.
        slow: Motor torque of lagging drives at the step's start [N.m].
        clipped, asked: u_2 and u_3 [N.m].
    """

    limit: Vector
    gain: Vector
    crosstalk: Matrix
    mixes: Flag
    lagging: Indices
    share: Vector
    age: Indices
    past: Matrix
    next: Integer
    slow: Vector
    clipped: Vector
    asked: Vector


@compiled
def ask_motors(drives: DriveState, motion: JointMotion) -> None:
    """Writes u_3, what each motor's own bandwidth then follows."""
    clipped, asked, rows = drives.clipped, drives.asked, drives.past.shape[0]
    for i in range(asked.size):
        late = drives.age[i] > 0
        command = drives.past[(drives.next - drives.age[i]) % rows, i] if late else motion.command[i]
        total = command + (motion.drive[i] - motion.command[i])
        clipped[i] = min(max(total, -drives.limit[i]), drives.limit[i])
        asked[i] = drives.gain[i] * clipped[i]
    if drives.mixes:
        for i in range(asked.size):
            for j in range(asked.size):
                asked[i] += drives.crosstalk[i, j] * clipped[j]


@compiled
def add_drive_error(drives: DriveState, motion: JointMotion, torque: Vector) -> None:
    """Adds motor torque minus torque asked for [N.m].

    Over a step, a lag moves by its share: half-way is what the step sees on average.
    """
    ask_motors(drives, motion)
    for i in range(torque.size):
        given = drives.asked[i]
        if drives.lagging[i]:
            given = drives.slow[i] + 0.5 * drives.share[i] * (given - drives.slow[i])
        torque[i] += given - motion.drive[i]


@compiled
def end_drive_step(drives: DriveState, motion: JointMotion) -> None:
    """Lets lagging motors follow by one step, and keeps the command."""
    ask_motors(drives, motion)
    for i in range(drives.slow.size):
        drives.slow[i] += drives.share[i] * (drives.asked[i] - drives.slow[i])
        drives.past[drives.next, i] = motion.command[i]
    drives.next = (drives.next + 1) % drives.past.shape[0]


class DrivePath(CompiledTorque):
    """The drives of all joints. The delay is rounded to the plant's integration step."""

    port: Literal["motor", "link"] = "motor"
    law, ending = add_drive_error, end_drive_step

    def __init__(self, delay: Array, limit: Array, gain: Array, crosstalk: Array, lag: Array) -> None:
        """Takes (n,) each: delay [s], symmetric limit [N.m] (inf: none), gain, time constant [s]; C (n, n)."""
        self._delay, self._lag = np.array(delay), np.array(lag)
        self._numbers = {"limit": np.array(limit), "gain": np.array(gain), "crosstalk": np.array(crosstalk)}
        self.state: DriveState = self._at_rest(0.0)

    @property
    def does_anything(self) -> bool:
        """Says whether any joint's motor torque differs from the torque asked for."""
        return bool(
            self._delay.any()
            or self._lag.any()
            or self._numbers["crosstalk"].any()
            or np.any(self._numbers["gain"] != 1.0)
            or np.isfinite(self._numbers["limit"]).any()
        )

    def start(self, motion: JointMotion, step: float) -> None:
        """Starts as if the present command had acted for ever."""
        self.state = self._at_rest(step)
        self.state.past[:] = motion.command
        ask_motors(self.state, motion)
        self.state.slow[:] = self.state.asked

    def _at_rest(self, step: float) -> DriveState:
        """Makes the drives of a step [s], nothing asked of them; 0 for a step that nobody knows yet."""
        n, late = self._delay.size, np.zeros(self._delay.size, dtype=np.int64)
        if step > 0.0:
            late = np.rint(self._delay / step).astype(np.int64)
        return DriveState(
            **self._numbers,
            mixes=bool(self._numbers["crosstalk"].any()),
            lagging=(self._lag > 0.0).astype(np.int64),
            share=np.where(self._lag > 0.0, -np.expm1(-step / np.maximum(self._lag, 1e-12)), 1.0),
            age=late,
            past=np.zeros((int(late.max(initial=0)) + 1, n)),
            next=0,
            slow=np.zeros(n),
            clipped=np.zeros(n),
            asked=np.zeros(n),
        )
