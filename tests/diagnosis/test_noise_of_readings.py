# SPDX-License-Identifier: BSD-3-Clause
"""A reading's own noise bends no spring: with slow noise and no repeat, no elastic joint is named."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.diagnosis.test_diagnosis import JOINTS, RATE, answer, motion, torque
from tests.support.recordings import columns_of, save

SETTLED = 200


def slow_noise(dice: np.random.Generator, samples: int, constant: float) -> np.ndarray:
    """(N, 2) of unit power that forgets itself within a time constant [s]."""
    keep = np.exp(-1.0 / (RATE * constant))
    white = dice.normal(size=(samples + SETTLED, len(JOINTS)))
    return lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0)[SETTLED:]


def recorded(folder: Path, kind: int, constant: float) -> Path:
    """A rigid arm whose torque sensors have such noise of 0.2 N.m."""
    dice = np.random.default_rng(kind)
    t, q, v, a = motion(kind, 20.0)
    effort = torque(q, v, a, mass=1.0) + 0.2 * slow_noise(dice, len(t), constant)
    return save(
        folder,
        f"run{kind}",
        columns_of(t, JOINTS, position=q + dice.normal(scale=1e-5, size=q.shape), effort=effort),
    )


@pytest.mark.parametrize("constant", [0.02, 0.05, 0.1])
def test_slow_noise_of_a_torque_sensor_is_no_spring(tmp_path: Path, constant: float) -> None:
    _, said = answer(tmp_path, [recorded(tmp_path, kind, constant) for kind in range(4)])
    assert said["verdict"] == "no_gap" and not said["causes"]
