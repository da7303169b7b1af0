# SPDX-License-Identifier: BSD-3-Clause
"""Which row changed the torque, and at which module's cost."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.safety.attribute import attribute
from impedance_modules.safety.filter_problem import FilterLayout, make_problem
from impedance_modules.safety.solvers import make_solver
from tests.support import filter_problems as fp

pytestmark = pytest.mark.usefixtures("machine_code")

ONE = FilterLayout(("j",), ())


def test_attribution_sums_to_the_change_over_rows_and_modules() -> None:
    rng = np.random.default_rng(12)
    solver = make_solver("daqp")
    counted = exact = 0
    for _ in range(150):
        p = fp.problem(rng, float(rng.choice([0.4, 0.9, 1.1])), float(rng.choice([0.2, 1.0])))
        parts = rng.normal(size=(3, fp.N)) * 20
        parts[2] += p.desired - parts.sum(axis=0)
        s = solver.solve(p)
        found = attribute(p, fp.LAYOUT, s, ("a", "b", "c"), parts)
        total = sum((r.change for r in found), np.zeros(fp.N))
        # Parts of rows that contradict each other are large and cancel; rounding follows their size.
        size = sum(r.amount for r in found)
        assert np.abs(total - (s.effort - p.desired)).max() < 1e-9 + 1e-15 * size
        exact += size < 1e6
        labels = np.array(fp.LAYOUT.labels)[s.active]
        assert set(labels) <= {r.row for r in found}
        assert [r.amount for r in found] == sorted((r.amount for r in found), reverse=True)
        counted += len(found)
    assert counted > 500
    assert exact > 50


def test_each_row_bears_its_own_optimality_term_and_splits_by_push() -> None:
    p = fp.single(desired=np.array([9.0]), effort_max=np.array([5.0]))
    s = make_solver("daqp").solve(p)
    found = attribute(p, ONE, s, ("up", "more", "down"), np.array([[8.0], [4.0], [-3.0]]))
    assert {(r.row, r.module) for r in found} == {("torque j", "up"), ("torque j", "more")}
    by_module = {r.module: r.change[0] for r in found}
    assert by_module["up"] == pytest.approx(-4.0 * 8 / 12)
    assert by_module["more"] == pytest.approx(-4.0 * 4 / 12)


def test_at_a_lower_limit_the_module_that_pushes_down_bears_the_change() -> None:
    p = fp.single(desired=np.array([-9.0]), effort_max=np.array([5.0]))
    s = make_solver("daqp").solve(p)
    found = attribute(p, ONE, s, ("down", "up"), np.array([[-12.0], [3.0]]))
    assert [(r.row, r.module) for r in found] == [("torque j", "down")]
    assert found[0].change[0] == pytest.approx(4.0)


def test_power_row_is_attributed_to_who_drives_the_motion() -> None:
    layout = FilterLayout(("a", "b"), ())
    p = make_problem(layout, np.full(layout.n, np.inf))
    p.effort_max[:] = 50.0
    p.matrix[0], p.upper[0] = np.array([0.6, 0.8]), 1.0
    p.desired[:] = [3.0, 4.0]
    s = make_solver("daqp").solve(p)
    found = attribute(p, layout, s, ("push", "brake"), np.array([[6.0, 8.0], [-3.0, -4.0]]))
    assert [(r.row, r.module) for r in found] == [("power", "push")]
    assert found[0].change == pytest.approx(np.array([-2.4, -3.2]))


def test_state_is_blamed_where_no_module_pushes() -> None:
    """Outside its range a joint is moved back although every module rests."""
    layout = FilterLayout(("j",), ())
    p = make_problem(layout, np.full(layout.n, np.inf))
    p.effort_max[:] = 50.0
    row = layout.position.start
    p.matrix[row], p.lower[row], p.penalty[row] = 1.0, 2.0, 1e9
    found = attribute(p, layout, make_solver("daqp").solve(p), ("rest",), np.zeros((1, 1)))
    assert [(r.row, r.module) for r in found] == [("position j", None)]


def test_attribution_refuses_what_it_cannot_split() -> None:
    rng = np.random.default_rng(13)
    p = fp.problem(rng, 0.9, 1.0)
    s = make_solver("daqp").solve(p)
    with pytest.raises(ValueError, match="miss the desired torque"):
        attribute(p, fp.LAYOUT, s, ("a",), p.desired[None] * 0.5)
    failed = make_solver("daqp").solve(fp.changed(p, metric=-p.metric))
    with pytest.raises(ValueError, match="did not solve"):
        attribute(p, fp.LAYOUT, failed, ("a",), p.desired[None])
    free = replace(s, row_duals=np.zeros(fp.LAYOUT.m), box_duals=np.zeros(14))
    assert attribute(p, fp.LAYOUT, free, ("a",), p.desired[None]) == []
