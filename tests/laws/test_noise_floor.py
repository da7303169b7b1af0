# SPDX-License-Identifier: BSD-3-Clause
"""The weak noise floor: what a flexible model leaves of noise is the noise, however many columns it has."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.selection.drafts import Draft
from impedance_modules.diagnosis.selection.floor import noise_by_smoothness
from impedance_modules.diagnosis.selection.nuisance import Nuisance

GROUP = ("link", 0)


@pytest.mark.parametrize("columns", [5, 60, 300])
def test_noise_is_judged_alike_by_few_and_by_many_columns(columns: int) -> None:
    """82 samples of one short run were once explained by 150 columns, and the floor was a third of the noise."""
    random = np.random.default_rng(columns)
    band = SimpleNamespace(cutoff=4.0, step=20, rate=200.0)
    found = []
    for _ in range(20):
        noise = random.normal(scale=0.3, size=82)
        X = random.normal(size=(82, columns))
        nuisance = Nuisance((GROUP,), 0, (np.zeros(0, int),), ((np.zeros((82, 0)),),), {})
        draft = Draft(None, {}, ("generic", "link.0", "random"), [{GROUP: X}])
        floor = noise_by_smoothness([[noise]], [SimpleNamespace(band=band)], nuisance, [draft], [0])
        found.append(float(floor.rms[0, 0]))
    assert np.median(found) == pytest.approx(0.3, rel=0.25)
