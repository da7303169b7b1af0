# SPDX-License-Identifier: BSD-3-Clause
"""What noise reaches in its largest moment: rarely more, whatever its colour, and a moment that is louder is seen."""

import numpy as np
import pytest
from scipy.signal import lfilter

from impedance_modules.diagnosis.model_selection.tolerance import largest_moment

CHANCE = 0.05
RUNS = 200


def noise(rng: np.random.Generator, pole: float, samples: int) -> np.ndarray:
    return np.asarray(lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.normal(size=samples + 500)))[500:]


def worst(series: np.ndarray, size: int) -> float:
    power = np.convolve(series**2, np.ones(size) / size, mode="valid")
    return float(power.max() / np.mean(series**2))


@pytest.mark.parametrize("size", [3, 10, 50])
@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9])
def test_noise_of_any_colour_rarely_exceeds_its_largest_moment(pole: float, size: int) -> None:
    """With a chance of 5 % about ten of 200 do: quantiles of correlated samples are approximate, so up to thirty."""
    rng = np.random.default_rng(1)
    drawn = [noise(rng, pole, 2000) for _ in range(RUNS)]
    beyond = sum(worst(series, size) > largest_moment([series], size, CHANCE) for series in drawn)
    assert beyond <= 0.15 * RUNS


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_a_moment_three_times_as_loud_exceeds_it(pole: float) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        series = noise(rng, pole, 2000)
        allowed = largest_moment([series], 50, CHANCE)
        series[1000:1050] *= 3.0 * np.sqrt(allowed)
        assert worst(series, 50) * np.mean(series**2) > allowed
