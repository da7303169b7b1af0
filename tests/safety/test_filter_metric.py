# SPDX-License-Identifier: BSD-3-Clause
"""What a torque change costs, and what breaking a soft row costs."""

import numpy as np
import pytest

from impedance_modules.safety.metric import LOWEST_PENALTY, RANK_FACTOR, metric, penalty, relative_penalty
from impedance_modules.safety.problem import RowKind
from tests.support import filter_problems as fp

SOFT = [kind for kind in RowKind if not kind.hard]


@pytest.mark.parametrize("seed", range(30))
def test_metric_lies_between_eps_and_one_plus_eps_of_the_mobility(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = fp.state(rng)
    eps = float(rng.uniform(0.01, 1.0))
    w = metric(state.inverse_inertia, state.jacobians, eps)
    root = np.linalg.inv(np.linalg.cholesky(state.inverse_inertia))
    seen = np.linalg.eigvalsh(root @ w @ root.T)
    assert eps * (1 - 1e-9) <= seen.min()
    assert seen.max() <= (1 + eps) * (1 + 1e-9)
    assert np.array_equal(w, w.T)


def test_metric_is_gauss_function_of_the_hand_away_from_singularities() -> None:
    rng = np.random.default_rng(3)
    state = fp.state(rng)
    minv = state.inverse_inertia
    w = metric(minv, state.jacobians[:1], eps=1e-9, heaviest=(1e9, 1e9))
    for _ in range(20):
        change = rng.normal(size=fp.N)
        acceleration = state.jacobians[0] @ minv @ change
        weight = np.linalg.pinv(state.jacobians[0] @ minv @ state.jacobians[0].T, rcond=1e-9)
        assert change @ w @ change == pytest.approx(acceleration @ weight @ acceleration, rel=1e-4, abs=1e-6)


def test_metric_refuses_a_weight_that_leaves_the_posture_free() -> None:
    with pytest.raises(ValueError, match="eps > 0"):
        metric(np.eye(2), [], eps=0.0)


def test_penalties_are_ranked_and_independent_of_units() -> None:
    values = [relative_penalty(kind) for kind in SOFT]
    assert values[-1] == LOWEST_PENALTY
    assert np.allclose(np.array(values[:-1]) / values[1:], RANK_FACTOR)
    assert penalty(RowKind.POSITION, np.array([4.0]))[0] == relative_penalty(RowKind.POSITION) / 4.0
    with pytest.raises(ValueError, match="hard"):
        relative_penalty(RowKind.POWER)
