# SPDX-License-Identifier: BSD-3-Clause
r"""How large the gap is on the held-out recordings: of the nominal model, and of it with the named causes alone.

What a diagnosis promises is what its patch does. Beside the causes it fits links, weights and stamps within their
priors, which no patch holds; so these count in no ``after``, and what they would add stands beside it as
``refitted``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.gap_result import JointGap
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.gap_location import held_out_series
from impedance_modules.diagnosis.result import Cause, Diagnosis


def with_held_out_gap(found: Diagnosis, evidence: Evidence, model: NominalModel) -> Diagnosis:
    """Measures the gap before and after the named causes, each alone and all together.

    Args:
        found: The conclusion; causes that are small count in no ``after``, as they are in no patch.
        evidence: The accepted model's fit, whose numbers the causes have.
        model: The nominal model.
    """
    named = {(cause.effect, cause.port) for cause in found.causes}
    gaps = _gaps(evidence, model, named)

    def measured(causes: Sequence[Cause]) -> tuple[Cause, ...]:
        return tuple(
            replace(cause, shrink=shrink_alone(evidence, cause)) if _is_term(evidence, cause) else cause
            for cause in causes
        )

    return replace(
        found,
        gaps=gaps,
        shrink=total_shrink(gaps, [gap.after for gap in gaps]),
        refitted_shrink=total_shrink(gaps, [gap.refitted for gap in gaps]),
        causes=measured(found.causes),
        small=measured(found.small),
        series=held_out_series(evidence, model, named),
    )


def total_shrink(gaps: Sequence[JointGap], after: Sequence[float]) -> float | None:
    r"""The gap's shrink over all residuals g, squares summed in units of each noise floor; None without a gap.

        1 - sqrt(sum_g max(0, after_g^2 / floor_g^2 - 1) / sum_g max(0, before_g^2 / floor_g^2 - 1))

    Residuals that were within their noise before count as far as the causes lift them out of it.
    """  # fmt: skip
    start = sum(max(0.0, gap.before**2 / gap.noise_floor**2 - 1.0) for gap in gaps)
    left = sum(max(0.0, rms**2 / gap.noise_floor**2 - 1.0) for rms, gap in zip(after, gaps, strict=True))
    return None if start <= 0.0 else 1.0 - float(np.sqrt(left / start))


def shrink_alone(evidence: Evidence, cause: Cause) -> float | None:
    """Shrink of the nominal model's held-out gap by this cause alone, at the numbers of the fit; None without a gap."""
    before = evidence.excess(evidence.rms(None))
    if before <= 0.0:
        return None
    return 1.0 - float(np.sqrt(evidence.excess(evidence.rms_with({(cause.effect, cause.port)})) / before))


def _is_term(evidence: Evidence, cause: Cause) -> bool:
    """Whether a cause is a term of the fitted model; pushes are none."""
    return any((term.key[0], term.key[2]) == (cause.effect, cause.port) for term in evidence.model_fit.model)


def _gaps(
    evidence: Evidence, model: NominalModel, named: Collection[tuple[str, str]]
) -> tuple[JointGap, ...]:
    first, last = evidence.rms(None), evidence.rms_with(named)
    refitted = evidence.rms(evidence.model_fit)
    units = model.tree.units()
    return tuple(
        JointGap(
            joint=model.joints[joint],
            residual=residual,
            before=float(first[group]),
            after=float(last[group]),
            refitted=float(refitted[group]),
            noise_floor=float(evidence.heldout_noise[group]),
            unit=units[joint] if residual != "velocity" else "rad/s",
        )
        for group, (residual, joint) in enumerate(evidence.design.groups)
    )
