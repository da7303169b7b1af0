# SPDX-License-Identifier: BSD-3-Clause
"""From one cycle's numbers to the rows of the quadratic program."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.safety.build import build
from impedance_modules.safety.problem import FilterWorkspace, RowKind
from impedance_modules.safety.solvers import make_solver
from tests.support import filter_problems as fp


def test_layout_names_every_row_once() -> None:
    layout = fp.LAYOUT
    assert len(layout.labels) == len(set(layout.labels)) == len(layout.kinds) == layout.m == 53
    assert layout.labels[0] == "power"
    assert layout.labels[layout.position.start] == "position j0"
    assert layout.labels[layout.distance][3] == "distance pair3"
    for kind, where in ((RowKind.RATE, layout.rate), (RowKind.VELOCITY, layout.velocity)):
        assert set(layout.kinds[where]) == {kind}


def test_build_writes_into_the_workspace_and_overwrites_everything() -> None:
    rng = np.random.default_rng(0)
    workspace = FilterWorkspace(fp.LAYOUT)
    arrays = {name: getattr(workspace.problem, name) for name in ("metric", "matrix", "lower", "penalty")}
    build(workspace, fp.limits(rng), fp.state(rng, 1.5), np.ones(fp.N))
    limits, state, desired = fp.limits(rng), fp.state(rng), rng.normal(size=fp.N)
    again = build(workspace, limits, state, desired)
    fresh = build(FilterWorkspace(fp.LAYOUT), limits, state, desired)
    for name, array in arrays.items():
        assert getattr(again, name) is array
    for name in ("desired", "metric", "effort_max", "matrix", "lower", "upper", "penalty"):
        assert np.array_equal(getattr(again, name), getattr(fresh, name))
    assert (fresh.lower <= fresh.upper).all()


def test_rows_bound_the_acceleration_that_the_torque_causes() -> None:
    rng = np.random.default_rng(1)
    state = fp.state(rng)
    problem = build(FilterWorkspace(fp.LAYOUT), fp.limits(rng), state, np.zeros(fp.N))
    tau = rng.normal(size=fp.N) * 10
    vdot = state.inverse_inertia @ (tau - state.bias)
    where = problem.layout.velocity
    limits = fp.limits(np.random.default_rng(1))
    slack = problem.upper[where] - problem.matrix[where] @ tau
    assert slack == pytest.approx((limits.velocity_max - state.velocity) / limits.horizon - vdot)
    where = problem.layout.distance
    distance_acceleration = state.distance_jacobians @ vdot + state.distance_drift
    allowed = np.minimum((limits.margin - state.distances) / limits.approach_time, limits.separation_speed)
    needed = np.minimum(
        (allowed - state.distance_jacobians @ state.velocity) / limits.horizon, limits.separation_acceleration
    )
    assert problem.matrix[where] @ tau - problem.lower[where] == pytest.approx(distance_acceleration - needed)


def test_snapshot_outlives_the_cycle_and_is_read_only() -> None:
    rng = np.random.default_rng(2)
    workspace = FilterWorkspace(fp.LAYOUT)
    kept = build(workspace, fp.limits(rng), fp.state(rng), np.ones(fp.N)).snapshot()
    before = kept.lower.copy()
    build(workspace, fp.limits(rng), fp.state(rng), np.zeros(fp.N))
    assert np.array_equal(kept.lower, before)
    with pytest.raises(ValueError, match="read-only"):
        kept.desired[0] = 1.0


def test_pair_without_direction_or_with_infinite_distance_makes_no_row() -> None:
    rng = np.random.default_rng(2)
    state = fp.state(rng)
    far = replace(
        state,
        distances=np.full(10, np.inf),
        distance_jacobians=np.zeros((10, fp.N)),
        distance_drift=np.zeros(10),
    )
    problem = build(FilterWorkspace(fp.LAYOUT), fp.limits(rng), far, np.ones(fp.N))
    assert (problem.lower[problem.layout.distance] == -np.inf).all()
    assert np.isfinite(problem.penalty[problem.layout.distance]).all()
    assert make_solver("daqp").solve(problem).solved
