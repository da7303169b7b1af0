# SPDX-License-Identifier: BSD-3-Clause
"""Recordings as columns may use them: what carries a reading's noise or a controller's response to it is cleaned.

The residual is made of differentiated positions (M a, I_r a, dq/dt). A column with the same noise would explain some of
it: a lag, a friction, an elasticity, a rotor. So columns are made of accelerations as far as those are above the noise
of their positions (`residuals.band`). A joint is stationary if it does not move over a recording: differences of its
position are all noise, and the controller responds to it. Stationary joints are put at one place, driven by what their
load needs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.joint_motion import regularisation_velocity
from impedance_modules.effects.recorded_signals import Signals

ALONE = 1.5
"""Times a command's noise that motion and model may leave of it, for the rest to count as noise."""

CLEAR = 4.0
"""Times its noise beyond which the sign of a measured effort is the load's."""

STATIONARY = 0.002
"""Rms of a position about its mean below which its joint is stationary [rad or m]."""


def clean_signals(signals: Signals, noise: Array | None = None, flicker: Array | None = None) -> Signals:
    """Replaces the measured effort by its regression on the model's torque and the motion, and cleans the command.

    A column that is computed from the reading carries the reading's noise, and so does the residual: the two
    would agree without any cause. A gain could then explain anything by scaling, an elasticity clean data.

    Args:
        signals: One recording.
        noise: (n,) rms of the commands' noise as repeats show it; without it commands stay as they are.
        flicker: (n,) likewise of the measured effort; without it no law sees the effort's own sign.
    """
    effort = signals.effort
    reading = None
    if effort is not None and flicker is not None:
        reading = np.where(np.abs(effort) > CLEAR * flicker, effort, 0.0)
    if effort is not None:
        effort = np.column_stack(
            [
                _onto(_basis(signals, joint, signals.rigid[:, [joint]]), effort[:, joint])
                for joint in range(signals.n)
            ]
        )
    return replace(
        signals,
        effort=effort,
        reading=reading,
        spring_reading=signals.effort if signals.measures_springs else None,
        clean_drive=_clean_drive(signals, noise),
        aimed=_aimed(signals),
    )


def noise_of_repeats(
    prepared: Sequence[Prepared],
    pairs: Sequence[tuple[int, int]],
    channel: Callable[[Signals], Array | None],
) -> Array | None:
    """Rms (n,) of what differs in a channel of repeats; None without any."""
    found = []
    for i, j in pairs:
        first, second = channel(prepared[i].signals), channel(prepared[j].signals)
        if first is not None and second is not None:
            size = min(len(first), len(second))
            found.append(np.mean((first[:size] - second[:size]) ** 2, axis=0) / 2.0)
    return np.sqrt(np.mean(found, axis=0)) if found else None


def stationary_joints(position: Array) -> NDArray[np.bool_]:
    """Joints that are stationary over a recording's positions (N, n), as a mask (n,)."""
    return np.asarray(position.std(axis=0) < STATIONARY)


def without_noise_of_motion(signals: Signals) -> Signals:
    """The same recording with accelerations above their noise, and stationary joints exactly at rest."""
    still = stationary_joints(signals.position)
    if signals.clean_acceleration is not None:
        signals = replace(signals, acceleration=signals.clean_acceleration)
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
    return replace(calm, drive=_needed_by_load(calm, calm.drive, still), assistance=assistance)


def _aimed(signals: Signals) -> Array | None:
    """The commanded positions (N, n) of a controller that meets nothing unexpected, as far as motion and model tell.

    A controller answers any disturbance with a tracking error that looks like it: the error as recorded would
    explain whatever there is. Only the part that follows from the commanded motion is evidence of wrong gains.
    """
    aim = signals.position_command
    if aim is None:
        return None
    v = signals.rate_of(aim)
    a = signals.rate_of(v)
    weight = signals.weight
    out = np.empty_like(aim)
    for joint in range(signals.n):
        basis = np.column_stack(
            [
                np.ones(len(aim)),
                aim[:, joint],
                v[:, joint],
                a[:, joint],
                np.tanh(v[:, joint] / 0.05),
                weight[:, joint],
                signals.rigid[:, joint] - weight[:, joint],
            ]
        )
        error = aim[:, joint] - signals.position[:, joint]
        out[:, joint] = signals.position[:, joint] + _onto(basis, error)
    return out


def _clean_drive(signals: Signals, noise: Array | None) -> Array | None:
    """The torque asked for, without noise on every joint where motion and model leave no more than noise of it."""
    if signals.drive is None or noise is None:
        return None
    assistance = np.zeros_like(signals.drive) if signals.assistance is None else signals.assistance
    out = signals.drive.copy()
    for joint in range(signals.n):
        asked, weight = signals.drive[:, joint] - assistance[:, joint], signals.weight[:, joint]
        q = signals.position[:, joint]
        own = np.column_stack([signals.rigid[:, joint] - weight, weight, np.cos(q), np.sin(q)])
        smooth = _onto(_basis(signals, joint, own), asked)
        if float(np.std(asked - smooth)) < ALONE * noise[joint]:
            out[:, joint] = smooth + assistance[:, joint]
    return out


def _basis(signals: Signals, joint: int, own: Array) -> Array:
    q, v, a = (x[:, joint] for x in (signals.position, signals.velocity, signals.acceleration))
    # With the regularisation of dry friction itself: a wider one would lend the reading a friction curve of its own.
    regularisation = float(regularisation_velocity(signals.model.sliding)[joint])
    return np.column_stack([own, np.ones_like(q), q, v, a, np.tanh(v / regularisation)])


def _onto(basis: Array, values: Array) -> Array:
    return np.asarray(basis @ np.linalg.lstsq(basis, values, rcond=None)[0])


def _needed_by_load(calm: Signals, drive: Array, still: NDArray[np.bool_]) -> Array:
    """Drives (N, n), those of stationary joints as far as the links' torque and a constant make them."""
    out = drive.copy()
    for joint in np.flatnonzero(still):
        basis = np.column_stack([np.ones(calm.samples), calm.rigid[:, joint]])
        out[:, joint] = basis @ np.linalg.lstsq(basis, drive[:, joint], rcond=None)[0]
    return out
