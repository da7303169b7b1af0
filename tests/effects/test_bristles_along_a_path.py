# SPDX-License-Identifier: BSD-3-Clause
"""Bristles along a recorded path: reversals alone are followed, and every sample has the bend of the law."""

import numpy as np
import pytest

from impedance_modules.effects.joint_motion import bent, follow


def one_by_one(position: np.ndarray, stretch: float) -> np.ndarray:
    out = np.zeros(position.size)
    for i in range(1, position.size):
        out[i] = bent.python(out[i - 1], position[i] - position[i - 1], stretch)
    return out


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("stretch", [1e-3, 0.1, 3.0])
def test_the_bend_is_that_of_the_law_taken_step_by_step(seed: int, stretch: float) -> None:
    rng = np.random.default_rng(seed)
    rough = np.cumsum(rng.normal(size=200))
    for path in (rough, np.round(rough), np.sin(np.arange(300) / rng.uniform(5, 50)), np.repeat(rough, 3)):
        assert follow(path, stretch) == pytest.approx(one_by_one(path, stretch), abs=1e-12)


def test_nothing_bends_without_motion() -> None:
    assert not follow(np.full(5, 0.3), 0.1).any()
    assert not follow(np.array([0.3]), 0.1).any()
    assert follow(np.array([0.0, 0.0, 1.0]), 0.5).tolist() == pytest.approx([0.0, 0.0, 1.0 - np.exp(-2.0)])
