# SPDX-License-Identifier: BSD-3-Clause
r"""What is seen but does not matter: gaps within a stated share of each joint's torque and of its simulated motion.

With good sensors and long recordings, torques of a thousandth of a joint's range are certain. Nobody is warned of them:

    \tau_{rms} \le s (\tau_{max} - \tau_{min})      for every joint and residual,

the range over all recordings (of reported velocities, the range of speeds), s the tolerance. And the nominal model must
simulate the motion as well: each joint's error is at most s times the range of its positions, or what noise makes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import Cause, Diagnosis, Rollout

DEFAULT_TOLERANCE = 0.01
"""Share of a joint's ranges of torque and motion."""

DRIFT = 1.5
"""Simulated error over its noise that is still noise."""


def set_small_aside(found: Diagnosis, evidence: Evidence, tolerance: float) -> Diagnosis:
    """Calls a gap none if nothing of it matters: its causes are listed as small, and what remains passes.

    Args:
        found: With its rollouts.
        evidence: The fit.
        tolerance: s; 0 leaves everything as it is.
    """
    found = replace(found, tolerance=tolerance)
    if tolerance == 0.0 or found.verdict == "no_gap":
        return found
    limits = tolerance * ranges(evidence.prepared, evidence.design.groups)
    left = evidence.rms(evidence.model_fit, range(len(evidence.prepared)))
    small = all(is_small(cause, evidence, limits) for cause in found.causes)
    if not small or not (found.remainder.explained or np.all(left <= limits)):
        return found
    if not stays_near(found.rollout, evidence.prepared, tolerance):
        return found
    words = (
        f"; the gap is within the tolerance of {100.0 * tolerance:.3g} % of each joint's torque and motion"
    )
    remainder = replace(found.remainder, explained=True, structure=found.remainder.structure + words)
    return replace(found, verdict="no_gap", causes=(), small=found.causes, remainder=remainder)


def is_small(cause: Cause, evidence: Evidence, limits: Array) -> bool:
    """Whether a cause's torque is within the limits (groups,) at each joint."""
    model_fit, recordings = evidence.model_fit, range(len(evidence.prepared))
    terms = [
        i
        for i, term in enumerate(model_fit.model)
        if (term.key[0], term.key[2]) == (cause.effect, cause.port)
    ]
    for index in terms:
        torques = [evidence.plain.torque(model_fit, index, r) for r in recordings]
        for group in model_fit.model[index].groups:
            power = np.mean(np.concatenate([torque[group] for torque in torques]) ** 2)
            if not np.sqrt(power) <= limits[group]:
                return False
    # A push is no term of the fit: it is never small.
    return bool(terms)


def stays_near(rollout: Rollout, prepared: Sequence[Prepared], tolerance: float) -> bool:
    """Whether the nominal model simulates each joint's motion within the tolerance, or as well as noise allows."""
    travel = np.ptp(np.concatenate([item.position for item in prepared]), axis=0)
    allowed = dict(zip(prepared[0].tree.joints, tolerance * travel, strict=True))
    return all(
        drift.before <= max(allowed[joint], DRIFT * drift.noise_floor)
        for joint, drift in rollout.position.items()
    )


def ranges(prepared: Sequence[Prepared], groups: Sequence[Group]) -> Array:
    """(groups,) range of each joint's torque over all recordings [N.m], or of its speed for reported velocities."""
    torque, speed = (
        np.ptp(np.concatenate(values), axis=0)
        for values in ([item.load for item in prepared], [item.velocity for item in prepared])
    )
    return np.array([speed[joint] if residual == "velocity" else torque[joint] for residual, joint in groups])
