# SPDX-License-Identifier: BSD-3-Clause
"""What a torque change costs: the hands' acceleration before the posture's."""

import numpy as np
import pytest

from impedance_modules.safety.filter_problem import FilterState
from impedance_modules.safety.metric import HEAVIEST_HAND, POSTURE_WEIGHT, weigh_changes, write_metric
from tests.support import filter_problems as fp

pytestmark = pytest.mark.usefixtures("ways")


def metric(state: FilterState, eps: float, heaviest: float, bulkiest: float) -> np.ndarray:
    problem = fp.blank()
    weigh_changes(problem, state, eps, heaviest, bulkiest)
    return problem.metric


def test_metric_is_gauss_function_of_the_hand_away_from_singularities() -> None:
    rng = np.random.default_rng(3)
    state = fp.state(rng)
    state.jacobian[1] = 0.0
    minv, hand = state.inverse_inertia, state.jacobian[0]
    w = metric(state, 1e-9, 1e9, 1e9)
    for _ in range(20):
        change = rng.normal(size=fp.N)
        acceleration = hand @ minv @ change
        weight = np.linalg.pinv(hand @ minv @ hand.T, rcond=1e-9)
        assert change @ w @ change == pytest.approx(acceleration @ weight @ acceleration, rel=1e-4, abs=1e-6)


def by_matrix_algebra(state: FilterState, eps: float, mass: float, inertia: float) -> np.ndarray:
    expected = eps * state.inverse_inertia
    for hand in state.jacobian:
        seen = hand @ state.inverse_inertia
        mobility = seen @ hand.T + np.diag([1 / mass] * 3 + [1 / inertia] * 3)
        expected = expected + seen.T @ np.linalg.inv(mobility) @ seen
    return expected


def test_metric_is_the_sum_over_hands_by_plain_matrix_algebra() -> None:
    rng = np.random.default_rng(4)
    for _ in range(10):
        state, problem = fp.state(rng), fp.blank()
        write_metric(problem, state)
        expected = by_matrix_algebra(state, POSTURE_WEIGHT, *HEAVIEST_HAND)
        assert problem.metric == pytest.approx(expected, rel=1e-9, abs=1e-11)
        numbers = rng.uniform(0.01, 1.0), *rng.uniform(0.1, 2.0, 2) * HEAVIEST_HAND
        assert metric(state, *numbers) == pytest.approx(
            by_matrix_algebra(state, *numbers), rel=1e-9, abs=1e-11
        )
