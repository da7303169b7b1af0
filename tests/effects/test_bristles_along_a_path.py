# SPDX-License-Identifier: BSD-3-Clause
"""Bristles along a recorded path: reversals alone are followed, and every sample has the bend of the law."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.hysteresis import COUNTS, EXPONENT, PRESLIDING_MAX, STRETCH
from impedance_modules.effects.joint_motion import bent, follow


def one_by_one(position: np.ndarray, stretch: float, exponent: float) -> np.ndarray:
    out = np.zeros(position.size)
    for i in range(1, position.size):
        out[i] = bent.python(out[i - 1], position[i] - position[i - 1], stretch, exponent)
    return out


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("exponent", [1.0, 1.3, 2.0])
@pytest.mark.parametrize("stretch", [1e-3, 0.1, 3.0])
def test_the_bend_is_that_of_the_law_taken_step_by_step(seed: int, stretch: float, exponent: float) -> None:
    rng = np.random.default_rng(seed)
    rough = np.cumsum(rng.normal(size=200))
    for path in (rough, np.round(rough), np.sin(np.arange(300) / rng.uniform(5, 50)), np.repeat(rough, 3)):
        assert follow(path, stretch, exponent) == pytest.approx(one_by_one(path, stretch, exponent), abs=1e-9)


def test_nothing_bends_without_motion() -> None:
    assert not follow(np.full(5, 0.3), 0.1).any()
    assert not follow(np.array([0.3]), 0.1).any()
    assert follow(np.array([0.0, 0.0, 1.0]), 0.5).tolist() == pytest.approx([0.0, 0.0, 1.0 - np.exp(-2.0)])


@pytest.mark.parametrize("exponent", [1.0, 1.0 + 1e-5, 1.5, 2.0])
@pytest.mark.parametrize("begin", [-1.0, -0.4, 0.0, 0.9])
def test_a_bend_solves_dahls_equation(begin: float, exponent: float) -> None:
    """d zeta / dq = (1 - zeta)^i / stretch, integrated by small steps; it slips at the end and never beyond."""
    stretch, way = 0.02, 0.05
    small = solve_ivp(
        lambda _, zeta: (1.0 - zeta) ** exponent / stretch, (0.0, way), [begin], rtol=1e-10, atol=1e-12
    )
    assert bent.python(begin, way, stretch, exponent) == pytest.approx(small.y[0, -1], abs=1e-5)
    assert bent.python(begin, -way, stretch, exponent) == pytest.approx(
        -bent.python(-begin, way, stretch, exponent), abs=1e-12
    )
    assert bent.python(1.0, 1e3, stretch, exponent) == 1.0


@given(st.floats(1e-7, 1.0), st.floats(0.0, 1e-2))
def test_bristles_are_a_law_of_their_own_only_beyond_a_milliradian_and_what_the_encoder_sees(
    stretch: float, resolution: float
) -> None:
    """Every dry friction bends a little before it slides."""
    reason = CATALOGUE["hysteresis"].unresolved({STRETCH: stretch, EXPONENT: 1.0}, resolution)
    assert (reason is None) == (stretch >= max(PRESLIDING_MAX, COUNTS * resolution))
