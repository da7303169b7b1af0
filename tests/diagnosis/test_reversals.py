# SPDX-License-Identifier: BSD-3-Clause
"""Rows in which a joint with dry friction reverses or rests do not count, if the law leaves clearly more there."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection.reversals import reversal_note, rows_without_reversals
from impedance_modules.effects.catalogue import CATALOGUE

RATE, CUTOFF, SAMPLES = 50.0, 10.0, 1000
TIME = np.arange(SAMPLES) / RATE
ORDER = 4
"""Rows that whitening takes from the beginning."""


def recording(speed: np.ndarray) -> SimpleNamespace:
    """Two joints of which the second moves at a speed (N,)."""
    return SimpleNamespace(
        velocity=np.column_stack([np.ones(SAMPLES), speed]),
        band=SimpleNamespace(rate=4.0 * RATE, step=4, cutoff=CUTOFF),
        signals=SimpleNamespace(model=SimpleNamespace(sliding=np.zeros(2, dtype=bool))),
        tree=SimpleNamespace(joints=("shoulder", "elbow")),
    )


def cause(effect: str, joint: str, group: int) -> SimpleNamespace:
    candidate = SimpleNamespace(effect=CATALOGUE[effect], joints=(joint,))
    return SimpleNamespace(candidate=candidate, groups=(group,))


def masked(speed: np.ndarray, left: np.ndarray, *causes: SimpleNamespace, clear: dict | None = None) -> dict:
    """Masks of one recording; each group leaves the same (N,) whatever the model."""
    fitted = []

    def make(model):
        fitted.append(list(model))
        return SimpleNamespace(
            residuals=lambda coefficients, r: [left[ORDER:]] * 2,
            whole=SimpleNamespace(coefficients=None),
            design=SimpleNamespace(whitening=SimpleNamespace(clear=clear or {})),
        )

    found = dict(rows_without_reversals(causes, make, [recording(speed)]))
    for model in fitted:  # nothing else at the joint may take its reversals away
        assert sum(one.groups == model[-1].groups for one in model) == 1
    return found


SWAY = np.sin(2.0 * np.pi * 0.2 * TIME + 0.3)
AT_REVERSALS = np.where(np.abs(SWAY) < 0.1, 3.0, 1.0)


def test_reversals_that_leave_more_are_masked_with_a_filters_length_about_them() -> None:
    rows = masked(
        SWAY, AT_REVERSALS, cause("coulomb_friction", "elbow", 1), cause("viscous_friction", "elbow", 1)
    )
    (mask,) = rows.values()
    assert list(rows) == [(0, 1)]
    crossings = TIME[1:][SWAY[1:] * SWAY[:-1] <= 0.0]
    distance = np.abs(TIME[:, None] - crossings).min(axis=1)
    assert not mask[distance < 1.0 / CUTOFF].any()
    assert mask[distance > 1.0 / CUTOFF + 2.0 / RATE].all()


def test_a_joint_at_rest_is_masked_throughout_its_rest() -> None:
    speed = np.where((TIME > 5.0) & (TIME < 9.0), 0.001, 0.5)
    (mask,) = masked(speed, np.where(speed < 0.1, 3.0, 1.0), cause("coulomb_friction", "elbow", 1)).values()
    assert not mask[(TIME > 5.0) & (TIME < 9.0)].any() and mask[TIME < 4.8].all() and mask[TIME > 9.2].all()


@pytest.mark.parametrize(
    ("speed", "left", "effect"),
    [
        (SWAY, np.ones(SAMPLES), "coulomb_friction"),  # understood
        (SWAY, AT_REVERSALS, "viscous_friction"),  # no dry friction
        (0.01 * SWAY, AT_REVERSALS, "coulomb_friction"),  # nearly always at rest: nothing would remain
        (np.ones(SAMPLES), AT_REVERSALS, "coulomb_friction"),  # no reversal
    ],
)
def test_other_rows_count(speed: np.ndarray, left: np.ndarray, effect: str) -> None:
    assert not masked(speed, left, cause(effect, "elbow", 1))


def test_rows_that_are_masked_already_say_nothing() -> None:
    known = {(0, 1): np.ones(SAMPLES, dtype=bool)}
    assert not masked(SWAY, AT_REVERSALS, cause("coulomb_friction", "elbow", 1), clear=known)


def test_what_does_not_count_is_said() -> None:
    item = recording(SWAY)
    mask = np.ones(SAMPLES, dtype=bool)
    mask[:100] = False
    (said,) = reversal_note({(0, 1): mask, (1, 1): mask}, [item, item], [("link", 0), ("link", 1)])
    assert "elbow (4 s)" in said and "shoulder" not in said
    assert reversal_note({}, [item], [("link", 0)]) == ()
