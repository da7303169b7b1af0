# SPDX-License-Identifier: BSD-3-Clause
r"""How large the gap is on the held-out recordings: of the nominal model, and of it with the named causes alone.

What a diagnosis promises is what its patch does. Beside the causes it fits links, weights and stamps within their
priors, which no patch holds; so these count in no ``after``, and what they would add stands beside it as
``refitted``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.gap_result import JointGap, total_shrink
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
    before, refitted = evidence.rms(None), evidence.rms(evidence.model_fit)

    def shrink(after: Array) -> float | None:
        return total_shrink(before, after, evidence.heldout_noise)

    def measured(causes: Sequence[Cause]) -> tuple[Cause, ...]:
        return tuple(
            replace(cause, shrink=shrink(evidence.rms_with({(cause.effect, cause.port)})))
            if _is_term(evidence, cause)
            else cause
            for cause in causes
        )

    named = {(cause.effect, cause.port) for cause in found.causes}
    after = evidence.rms_with(named)
    return replace(
        found,
        gaps=_gaps(evidence, model, before, after, refitted),
        shrink=shrink(after),
        refitted_shrink=shrink(refitted),
        causes=measured(found.causes),
        small=measured(found.small),
        series=held_out_series(evidence, model, named),
    )


def _is_term(evidence: Evidence, cause: Cause) -> bool:
    """Whether a cause is a term of the fitted model; pushes are none."""
    return any((term.key[0], term.key[2]) == (cause.effect, cause.port) for term in evidence.model_fit.model)


def _gaps(
    evidence: Evidence, model: NominalModel, before: Array, after: Array, refitted: Array
) -> tuple[JointGap, ...]:
    units = model.tree.units()
    return tuple(
        JointGap(
            before=float(before[group]),
            after=float(after[group]),
            refitted=float(refitted[group]),
            noise_floor=float(evidence.heldout_noise[group]),
            unit=units[joint] if residual != "velocity" else "rad/s",
            joint=model.joints[joint],
            residual=residual,
        )
        for group, (residual, joint) in enumerate(evidence.design.groups)
    )
