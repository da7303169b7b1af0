# SPDX-License-Identifier: BSD-3-Clause
r"""Whether what a candidate rests on comes back when the motion does: if not, it is noise, and the arm's answer to it.

    \rho = \sum_{pairs} x_i \cdot x_j / \sum_{pairs} |x_i| |x_j|,      x what the candidate explains, whitened

On a slow creep accelerations are noise of the velocity's reading that went through the controller's damping; an
inertia or a lag fitted to them follows the very noise that the residual holds. Repeats tell: noise differs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.model_selection.candidate_trial import Trial

Array = NDArray[np.float64]

REPEATED_MIN = 0.5
"""Least correlation: from there on more than half of a candidate's power belongs to the motion."""


MADE_OF_COMMAND = ("command_delay", "actuator_lag", "torque_gain", "controller_gain")
"""Effects made of what was asked for: it is known as it was sent, so that its noise is as good as any command."""


def repeats(trial: Trial, pairs: Sequence[tuple[int, int]]) -> bool:
    """Whether a candidate's torque comes back in recordings of one motion, or need not.

    It need not where none was repeated, or where the command makes it.

    Args:
        trial: The candidate.
        pairs: Recordings that repeat each other.
    """
    effect, _, port = trial.term.key
    if effect in MADE_OF_COMMAND and port != "sensor":
        return True
    shared, whole = 0.0, 0.0
    for i, j in pairs:
        one, other = _torque(trial, i), _torque(trial, j)
        for group in one.keys() & other.keys():
            size = min(len(one[group]), len(other[group]))
            first, second = one[group][:size], other[group][:size]
            shared += float(first @ second)
            whole += float(np.linalg.norm(first) * np.linalg.norm(second))
    return whole <= 0.0 or shared >= REPEATED_MIN * whole


def _torque(trial: Trial, recording: int) -> dict[int, Array]:
    """Group -> (M,) what a candidate explains of a recording, whitened."""
    term, own = trial.term, trial.seen.own
    fixed = term.fixed[recording]
    return {
        group: np.asarray(block @ own + fixed[group] if group in fixed else block @ own)
        for group, block in term.columns[recording].items()
    }
