# SPDX-License-Identifier: BSD-3-Clause
r"""Joints that stand still, as every column may see them: at one place, and driven by what their load asks for.

Where nothing moves, differences of a position are its noise. The residual is made of them too (M a, I_r a, dq/dt),
and a column that contains the same noise would explain some of it: a lag, a friction, an elasticity of a joint at
rest. A controller answers that noise, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]

STILL = 0.002
"""Rms of a position about its mean below which its joint stands still [rad or m]."""


def at_rest(position: Array) -> NDArray[np.bool_]:
    """Joints that stand still over a recording's positions (N, n), as a mask (n,)."""
    return np.asarray(position.std(axis=0) < STILL)


def quieted(signals: Signals) -> Signals:
    """The same recording with still joints standing still."""
    still = at_rest(signals.position)
    if not still.any():
        return signals
    position, velocity, acceleration = (
        x.copy() for x in (signals.position, signals.velocity, signals.acceleration)
    )
    position[:, still] = position[:, still].mean(axis=0)
    velocity[:, still] = acceleration[:, still] = 0.0
    calm = replace(signals, position=position, velocity=velocity, acceleration=acceleration)
    if calm.drive is None:
        return calm
    assistance = calm.assistance
    if assistance is not None:
        assistance = np.where(still, calm.weight, assistance)
    return replace(calm, drive=_asked_by_load(calm, calm.drive, still), assistance=assistance)


def _asked_by_load(calm: Signals, drive: Array, still: NDArray[np.bool_]) -> Array:
    """Drives (N, n), those of still joints as far as the links' torque and a constant make them."""
    out = drive.copy()
    for joint in np.flatnonzero(still):
        basis = np.column_stack([np.ones(calm.samples), calm.rigid[:, joint]])
        out[:, joint] = basis @ np.linalg.lstsq(basis, drive[:, joint], rcond=None)[0]
    return out
