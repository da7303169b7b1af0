# SPDX-License-Identifier: BSD-3-Clause
"""A recording whose torque sensors are noisier than those of the repeats is judged by its own noise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.regression.sensor_noise import SENSOR_NOISE_RATIO, _sensor_noise_ratio


def _recordings(*sizes: float, effort: bool = True) -> list[SimpleNamespace]:
    """Two joints that carry a slow load; noise of some size on the first one's sensor, of size one on the other's."""
    random = np.random.default_rng(7)
    time = np.arange(1500) / 100.0
    out = []
    for size in sizes:
        load = np.column_stack([20.0 * np.sin(time), 5.0 * np.cos(3.0 * time)])
        noise = random.standard_normal(load.shape) * [size, 1.0]
        log = SimpleNamespace(effort=load + noise if effort else None)
        out.append(SimpleNamespace(log=log, signals=SimpleNamespace(n=2)))
    return out


@pytest.mark.parametrize("size", [1.5, 2.0, 3.0])
def test_noisier_sensors_are_known_by_their_noise_beyond_the_motion(size: float) -> None:
    power = _sensor_noise_ratio(_recordings(1.0, 1.0, size), [(1, 0)])
    np.testing.assert_allclose(power[2], [size**2, 1.0], rtol=0.25)
    np.testing.assert_allclose(power[:2], 1.0)


def test_chance_is_no_noisier_sensor_and_the_ratio_has_an_end() -> None:
    power = _sensor_noise_ratio(_recordings(1.0, 1.0, 1.0, 0.5, 50.0), [(1, 0)])
    np.testing.assert_allclose(power[:4], 1.0)
    assert power[4, 0] == SENSOR_NOISE_RATIO[1]


def test_without_a_measured_torque_all_recordings_are_alike() -> None:
    np.testing.assert_allclose(_sensor_noise_ratio(_recordings(1.0, 9.0, effort=False), [(1, 0)]), 1.0)
