# SPDX-License-Identifier: BSD-3-Clause
"""The weak noise floor: what a flexible model leaves of noise is the noise, however many columns it has."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.regression import noise_floor as judged
from impedance_modules.diagnosis.regression.candidates import CandidateRegressor
from impedance_modules.diagnosis.regression.nuisance_columns import NuisanceColumns
from impedance_modules.diagnosis.regression.sensor_noise import read_noise

GROUP = ("link", 0)
SIZE = 0.3


def floor_of(noise: np.ndarray, X: np.ndarray, made: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> float:
    """Weak floor of one recording's residual beside columns, its positions' noise made up."""
    monkeypatch.setattr(judged, "read_noise", lambda _: None)
    monkeypatch.setattr(judged, "differentiated", lambda *_: SimpleNamespace(of=lambda _: made))
    item = SimpleNamespace(band=SimpleNamespace(cutoff=4.0, step=20, rate=200.0))
    nuisance = NuisanceColumns((GROUP,), 0, (np.zeros(0, int),), ((np.zeros((len(noise), 0)),),), {})
    regressor = CandidateRegressor(None, {}, ("generic", "link.0", "random"), [{GROUP: X}])
    return float(judged.noise_by_smoothness([[noise]], [item], nuisance, [regressor], [0]).rms[0, 0])


@pytest.mark.parametrize("columns", [5, 60, 300])
def test_noise_is_judged_alike_by_few_and_by_many_columns(
    columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """82 samples of one short run were once explained by 150 columns, and the floor was a third of the noise."""
    random = np.random.default_rng(columns)
    found = [
        floor_of(
            random.normal(scale=SIZE, size=82), random.normal(size=(82, columns)), np.zeros(82), monkeypatch
        )
        for _ in range(20)
    ]
    assert np.median(found) == pytest.approx(SIZE, rel=0.25)


def test_a_column_that_holds_the_noise_does_not_hide_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """An acceleration is differentiated noise, and so is the residual: an inertia's column would take it all."""
    random = np.random.default_rng(7)
    noise, other = random.normal(scale=SIZE, size=(2, 400))
    assert floor_of(noise, noise[:, None], 0.0 * noise, monkeypatch) < 0.1 * SIZE
    assert floor_of(noise, noise[:, None], other, monkeypatch) == pytest.approx(SIZE, rel=0.1)


def test_position_noise_is_read_beside_motion() -> None:
    random = np.random.default_rng(8)
    time = np.arange(2000) / 200.0
    motion = 0.5 * np.sin(2.0 * np.pi * np.outer(time, [0.4, 3.0]))
    item = SimpleNamespace(log=SimpleNamespace(position=motion + 1e-5 * random.normal(size=motion.shape)))
    np.testing.assert_allclose(read_noise(item), 1e-5, rtol=0.15)
