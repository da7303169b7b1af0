# SPDX-License-Identifier: BSD-3-Clause
"""How large an effect is: by the torques and speeds of the motion that is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.stranger.engine import Arm
from benchmarks.stranger.motions import REST, TICK, Motion

Array = NDArray[np.float64]


def rms(x: Array) -> Array:
    """Root mean square over rows."""
    value: Array = np.sqrt(np.mean(np.square(x), axis=0))
    return value


@dataclass(frozen=True)
class Pilot:
    """All recordings' set-points at 50 Hz, with the torques that the drawing says they need."""

    q: Array
    v: Array
    a: Array
    tau: Array
    rates: Array  # dtau/dt [N.m/s]
    span: Array  # of torque, joint by joint [N.m]
    lightest: Array  # inertia of each joint with all others free [kg.m^2], least over the rows

    def per_radian(self, model: Arm, j: int) -> Array:
        """How joint torques at rest change with joint j's angle [N.m/rad], in every tenth row."""
        q = self.q[::10]
        step = np.zeros(q.shape[1])
        step[j] = 1e-3
        return np.array([(model.weight(x + step) - model.weight(x - step)) / 2e-3 for x in q])


def pilot(model: Arm, motions: list[Motion]) -> Pilot:
    """Inverse dynamics of the set-points."""
    first, every = round(REST / TICK), 20
    parts = [(m.q[first::every], m.v[first::every], m.a[first::every]) for m in motions]
    taus = [model.torque(*part) for part in parts]
    tau = np.concatenate(taus)
    rates = np.concatenate([np.gradient(x, every * TICK, axis=0) for x in taus])
    q, v, a = (np.concatenate([p[i] for p in parts]) for i in range(3))
    least = np.full(q.shape[1], np.inf)
    for row in q[::50]:
        model.at(row, np.zeros_like(row))
        least = np.minimum(least, 1.0 / np.diag(np.linalg.inv(model.mass_and_bias()[0])))
    return Pilot(q, v, a, tau, rates, np.ptp(tau, axis=0), least)
