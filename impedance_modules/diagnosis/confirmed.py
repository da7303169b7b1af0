# SPDX-License-Identifier: BSD-3-Clause
"""Whether a cause helps on the recordings that no step has seen, where no repeats say how strong the noise is.

A weak noise floor lets small false causes in; what does not lower the unseen residual at all is one of them. With
repeats the floor is known, and an unseen motion that a nuisance extrapolates badly shall not veto a cause.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm


def confirmed(bench: ModelFit, refit: Callable[[Sequence[ModelTerm]], ModelFit], heldout: Sequence[int]) -> list[ModelTerm]:
    """Terms of a fitted model without which more is left of the unseen recordings; all of them where repeats exist.

    Args:
        bench: The model.
        refit: Fits a model with fewer terms.
        heldout: The unseen recordings.
    """
    if not bench.design.whitening.weak:
        return list(bench.model)
    with_all = bench.squares(bench.whole.coefficients, heldout)
    kept = []
    for term in bench.model:
        rest = refit([other for other in bench.model if other is not term])
        without = rest.squares(rest.whole.coefficients, heldout)
        groups = list(term.groups)
        if float(with_all[groups].sum()) < float(without[groups].sum()):
            kept.append(term)
    return kept
