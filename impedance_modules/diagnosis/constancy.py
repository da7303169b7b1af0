# SPDX-License-Identifier: BSD-3-Clause
r"""Whether a cause is as strong everywhere along its joint's way, as its law says.

    r = \tau(t) (1 + a \sin N q + b \cos N q),      \tau the torque of an accepted cause at its joint

A law of the catalogue has one size; a friction that comes and goes along the stroke is another law, even where the
catalogue's nearest explains most of it. The orders N go from one bend over the travel to what sampling can follow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.regression.model_fit import ModelTerm

Array = NDArray[np.float64]

ORDERS = 30
"""Orders tried at most."""

SPACING = 2.5
"""Phase over the travel between two orders [rad]."""

FOLLOWED = 1.0
"""Phase from one sample to the next that still can be followed [rad]."""

GAIN, PART = 12.0, 0.05
"""Log-likelihood beyond its price, and part of the residual, that no constant law leaves to its own variation."""


def uneven(evidence: Evidence) -> tuple[float, str] | None:
    """Finds the cause whose size changes most along its joint's way.

    Returns:
        Part of the residual that the change takes, and a sentence; None where all are constant.
    """
    found = []
    for index, term in enumerate(evidence.bench.model):
        if len(term.candidate.joints) == 1 and len(term.groups) == 1:
            part = _varies(evidence, index, term)
            if part is not None:
                name = f"{term.key[0]} on {term.candidate.joints[0]}"
                said = f"the size of {name} changes along its way, by which {100 * part:.0f} % more is taken"
                found.append((part, said))
    return max(found, default=None)


def _varies(evidence: Evidence, index: int, term: ModelTerm) -> float | None:
    """Part of the residual that the best order takes beyond the model, confirmed on unseen recordings; None if none."""
    bench, (g,) = evidence.bench, term.groups
    joint = evidence.prepared[0].tree.joints.index(term.candidate.joints[0])
    positions = [item.position[:, joint] for item in evidence.prepared]
    orders = _orders(positions)
    samples = float(bench.counts[g])
    best: tuple[float, float] | None = None
    for order in orders:
        blocks = [_modulated(evidence, index, (r, g), order * q) for r, q in enumerate(positions)]
        gain, coefficients, carried = _fit(evidence, blocks, g)
        # The pair's own price, and that of the orders tried.
        gain -= float(np.log(samples)) + float(np.log(len(orders)))
        if (
            gain > GAIN
            and (best is None or gain > best[0])
            and _confirmed(evidence, blocks, g, coefficients, carried)
        ):
            best = (gain, 1.0 - float(np.exp(-2.0 * gain / samples)))
    return best[1] if best is not None and best[1] > PART else None


def _orders(positions: Sequence[Array]) -> Array:
    travel = float(np.ptp(np.concatenate(positions)))
    jump = float(np.quantile(np.concatenate([np.abs(np.diff(q)) for q in positions]), 0.95))
    if travel < 1e-3 or jump == 0.0:
        return np.zeros(0)
    return np.arange(SPACING, FOLLOWED * travel / jump, SPACING)[:ORDERS] / travel


def _modulated(evidence: Evidence, index: int, place: tuple[int, int], phase: Array) -> Array:
    """Whitened columns (M, 2) of a cause's torque times sine and cosine of a phase (M,)."""
    r, g = place
    torque = evidence.plain.torque(evidence.bench, index, r)[g]
    block = torque[:, None] * np.column_stack([np.sin(phase), np.cos(phase)])
    return np.asarray(evidence.design.whitening.apply(block, r, g))


def _fit(evidence: Evidence, blocks: Sequence[Array], g: int) -> tuple[float, Array, Array]:
    """Gain [nats] of columns beside the whole fit, their coefficients, and what they pull the model's along by."""
    bench = evidence.bench
    ids, weight = bench.ids[g], bench.weights[g]
    cross, own, right = np.zeros((len(ids), 2)), np.zeros((2, 2)), np.zeros(2)
    for r in bench.fitted:
        left = bench.residuals(bench.whole.coefficients, r)[g]
        cross += weight * (bench.rows[r][g].T @ blocks[r])
        own += weight * (blocks[r].T @ blocks[r])
        right += weight * (blocks[r].T @ left)
    carried = bench.whole.inverse[np.ix_(ids, ids)] @ cross
    free = own - cross.T @ carried
    coefficients = np.linalg.pinv(free, rcond=1e-6, hermitian=True) @ right
    samples = float(bench.counts[g])
    explained = float(right @ coefficients) / samples
    return -0.5 * samples * float(np.log(max(1.0 - explained, 1e-6))), np.asarray(coefficients), carried


def _confirmed(
    evidence: Evidence, blocks: Sequence[Array], g: int, coefficients: Array, carried: Array
) -> bool:
    """Whether the same numbers help on the recordings that no fit has seen."""
    bench = evidence.bench
    gained = 0.0
    for r in evidence.heldout:
        left = bench.residuals(bench.whole.coefficients, r)[g]
        after = left - (blocks[r] - bench.rows[r][g] @ carried) @ coefficients
        gained += float(left @ left - after @ after)
    return gained > 0.0
