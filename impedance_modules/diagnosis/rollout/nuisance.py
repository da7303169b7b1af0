# SPDX-License-Identifier: BSD-3-Clause
r"""What the fit adjusted within its priors beside the causes: links, compensated weights, and the common delay.

The residuals' columns say what each means: with \delta the fitted change of the bodies' ten parameters,

    links    ID = Y (\pi + \delta_l)        weight that the robot adds = W (\pi - \delta_w)
    delay    the command acts \delta_t later than believed
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.regression.nuisance_columns import (
    INERTIA_PRIOR,
    TIMING_PRIOR,
    WEIGHT_PRIOR,
    inertia_prior,
)
from impedance_modules.diagnosis.data.rigid_tree import Body, RigidTree
from impedance_modules.spec.robot_spec import BodyChange

Array = NDArray[np.float64]

HALVINGS = 6
"""How often a body's change is halved until what results is a physical body."""


@dataclass(frozen=True, eq=False)
class Nuisance:
    """Changes (10 n,) of the links' parameters and of the weights that the robot knows; delay [s]."""

    links: Array
    weights: Array
    delay: float


def no_nuisance(tree: RigidTree) -> Nuisance:
    """The nominal model as it is."""
    zero = np.zeros(10 * len(tree.bodies))
    return Nuisance(zero, zero, 0.0)


def fitted_nuisance(evidence: Evidence) -> Nuisance:
    """Reads the fit of the accepted model."""
    found = evidence.bench.whole.coefficients
    prior = inertia_prior(evidence.prepared[0].tree.inertia)
    size = len(prior)
    rate = evidence.prepared[0].log.rate
    return Nuisance(
        links=found[:size] * prior,
        weights=found[size : 2 * size] * prior * WEIGHT_PRIOR / INERTIA_PRIOR,
        delay=float(found[2 * size] * TIMING_PRIOR / rate),
    )


def body_changes(bodies: Sequence[Body], links: Array) -> tuple[BodyChange, ...]:
    """Turns the links' changes (10 n,) into what a robot wears, as far as every body stays a physical one."""
    out = []
    for body, change in zip(bodies, links.reshape(-1, 10), strict=True):
        for halved in range(HALVINGS):
            part = change * 0.5**halved
            if part.any() and _physical(body.inertia + part):
                out.append(BodyChange(body.link, tuple(float(value) for value in part)))
                break
    return tuple(out)


def _physical(parameters: Array) -> bool:
    """Whether the pseudo-inertia [[tr(I)/2 - I, h], [h^T, m]] is positive definite (Wensing, Kim & Slotine 2018)."""
    xx, xy, yy, xz, yz, zz = parameters[4:]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pseudo = np.empty((4, 4))
    pseudo[:3, :3] = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    pseudo[:3, 3] = pseudo[3, :3] = parameters[1:4]
    pseudo[3, 3] = parameters[0]
    lowest = np.linalg.eigvalsh(pseudo)
    return bool(lowest[0] > 1e-6 * lowest[-1])
