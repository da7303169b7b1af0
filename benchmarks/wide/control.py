# SPDX-License-Identifier: BSD-3-Clause
"""Four controllers of textbooks and of practice, each answering one reading per millisecond."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks.wide.frozen import HELD, policy_target
from benchmarks.wide.plan import PERIOD, Plan

if TYPE_CHECKING:
    from benchmarks.wide.simulation import Engine, RigidModel

Array = NDArray[np.float64]

FILTER = 0.004
"""Time constant of the controllers' own speed of the motors [s]."""


class Controller:
    """Turns readings into commands and keeps what it needs between them.

    impedance        tau = ff + K (q_d - q) + D (v_d - w)
    computed_torque  tau = ID(q, w, a_d + (K / I)(q_d - q) + (D / I)(v_d - w))
    position_loop    tau = K (q_d - q) + D (v_d - w) + K_i int (q_d - q)
    policy           the same without the integral, towards a target that is held and jumps

    w is the motors' measured speed behind a filter; damping the links' speed would drive springs unstable.
    """

    def __init__(self, plan: Plan, model: RigidModel, reference: Array, rate: Array) -> None:
        """Takes the plan, the believed rigid links, and desired (samples, n) position and speed."""
        control, n = plan.control, reference.shape[1]
        self._control, self._model, self._drives = control, model, plan.nominal
        self._reference, self._rate = reference, rate
        self._ahead = np.gradient(rate, PERIOD, axis=0)
        self._w, self._last = np.zeros(n), None
        self._sum, self._seen = np.zeros(n), []
        self._still = np.zeros(n)
        self._rng = np.random.default_rng(0 if plan.seed is None else plan.seed + 1)
        self._feed = self._feed_forward() if control.law == "impedance" else np.zeros_like(reference)
        self.target = reference[0].copy()
        if control.law == "position_loop" and control.weight == "none":
            self._sum[:] = model.torque(reference[0], self._still, self._still)

    def step(self, k: int, seen: Array, engine: Engine, command: Array) -> Array:
        """Fills ``command`` (n,) [N.m] and returns what the robot itself adds for its weight (n,) [N.m]."""
        control, q = self._control, seen[0]
        motor = q + (engine.theta - engine.q)
        if self._last is not None:
            self._w += (1 - np.exp(-PERIOD / FILTER)) * ((motor - self._last) / PERIOD - self._w)
        self._last = motor
        self._aim(k)
        error, speed = self.target - q, self._wanted(k) - self._w
        command[:] = self._law(k, q, error, speed)
        support = self._still
        if control.weight == "command":
            command += self._model.torque(q, self._still, self._still)
        elif control.weight != "none":
            support = self._model.torque(self._remembered(q), self._still, self._still)
        np.clip(command, -control.limit, control.limit, out=command)
        return support

    def _law(self, k: int, q: Array, error: Array, speed: Array) -> Array:
        control = self._control
        springs = control.stiffness * error + control.damping * speed
        if control.law == "computed_torque":
            wanted = self._ahead[k] + springs / control.inertia
            weight = self._model.torque(q, self._still, self._still)
            rotors = self._drives.rotor_inertia * wanted + self._drives.motor_damping * self._w
            return np.asarray(self._model.torque(q, self._w, wanted) - weight + rotors)
        if control.law == "position_loop":
            self._sum += control.integral * error * PERIOD
            return np.asarray(springs + self._sum)
        return np.asarray(springs + self._feed[k])

    def _aim(self, k: int) -> None:
        if self._control.law != "policy":
            self.target = self._reference[k]
        elif k % HELD == 0:
            self.target = policy_target(self._reference[k], self._rate[k], self._rng)

    def _wanted(self, k: int) -> Array:
        return self._still if self._control.law == "policy" else self._rate[k]

    def _remembered(self, q: Array) -> Array:
        if self._control.weight == "robot":
            return q
        self._seen.append(q + self._control.blur * self._rng.standard_normal(q.size))
        age = round(self._control.late / PERIOD)
        return np.asarray(self._seen[max(len(self._seen) - 1 - age, 0)])

    def _feed_forward(self) -> Array:
        few = np.arange(0, self._reference.shape[0], 10)
        torque = [
            self._model.torque(self._reference[k], self._rate[k], self._ahead[k])
            - self._model.torque(self._reference[k], self._still, self._still)
            + self._drives.rotor_inertia * self._ahead[k]
            + self._drives.motor_damping * self._rate[k]
            for k in few
        ]
        every, table = np.arange(self._reference.shape[0]), np.array(torque)
        return np.stack([np.interp(every, few, column) for column in table.T], axis=1)
