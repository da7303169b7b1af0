# SPDX-License-Identifier: BSD-3-Clause
"""Single steps of the exact search that random problems reach too seldom, or whose mistakes its proof makes good."""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.safety.solvers.acting_set import append, extend, make_search, project, write_change
from impedance_modules.safety.solvers.daqp_solver import PlainProblem, write_plain
from impedance_modules.safety.solvers.exact_form import make_form
from impedance_modules.safety.solvers.exact_search import _push
from impedance_modules.safety.solvers.optimality import _carried
from tests.support.both_ways import ways  # noqa: F401


@pytest.mark.usefixtures("ways")
def test_a_multiplier_that_rounding_would_make_negative_becomes_zero() -> None:
    """Of three constraints the last one pushes by 1; the first loses all it has and a rounding error more."""
    exact = make_search(3, 2)
    exact.count = 3
    exact.multiplier[0, :3], exact.multiplier[1, :3] = (1.0, 5.0, 0.25), (0.0, 1e-20, 1e-20)
    exact.answer[0, :2], exact.answer[1, :2] = (1.0 + 2e-16, -2.0), (1e-20, 0.0)
    _push(exact, (1.0, 1e-18))
    assert (exact.multiplier[0, 0], exact.multiplier[1, 0]) == (0.0, 0.0)
    assert exact.multiplier[0, 1] == 7.0 and exact.multiplier[1, 1] == pytest.approx(
        1e-20 + 2e-18, rel=1e-6, abs=0.0
    )
    assert exact.multiplier[0, 2] == 1.25 and exact.multiplier[1, 2] == pytest.approx(
        1e-20 + 1e-18, rel=1e-6, abs=0.0
    )


@pytest.mark.usefixtures("ways")
@pytest.mark.parametrize("size", [1.0, 8.0])
def test_the_guessing_solver_is_given_the_problem_itself(size: float) -> None:
    """In parts of ``size``; a torque limit in the joint's own units, because DAQP takes limits without a row."""
    random, n, m = np.random.default_rng(1), 3, 2
    form = make_form(n, m)
    form.metric[:] = random.standard_normal((n, n))
    form.rows[:n] = np.diag([2.0, 0.5, 4.0])
    form.rows[n:] = random.standard_normal((m, n))
    form.low[0], form.high[0] = -random.random(n + m), random.random(n + m)
    form.low[0, 1], form.high[0, 4] = -np.inf, np.inf
    form.give[0] = random.random(n + m)
    plain = PlainProblem(
        metric=np.zeros((n, n)), matrix=np.zeros((m, n)), lower=np.zeros(n + m), upper=np.zeros(n + m),
        softness=np.zeros(n + m),
    )  # fmt: skip
    write_plain(form, size, plain)
    unit = size * np.array([2.0, 0.5, 4.0, 1.0, 1.0])
    assert np.array_equal(plain.metric, form.metric) and np.array_equal(plain.matrix, form.rows[n:])
    assert plain.lower == pytest.approx(np.maximum(form.low[0] / unit, -1e30))
    assert plain.upper == pytest.approx(np.minimum(form.high[0] / unit, 1e30))
    assert plain.softness == pytest.approx(form.give[0] ** 2)


@pytest.mark.usefixtures("ways")
@pytest.mark.parametrize(("off", "carried"), [(0.0, True), (1e-14, True), (1e-11, False), (-1e-3, False)])
def test_the_multipliers_must_carry_the_whole_change(off: float, carried: bool) -> None:
    """y = -sum lambda g, each coordinate to a millionth of a millionth of its terms."""
    random, exact = np.random.default_rng(3), make_search(3, 2)
    exact.count = 2
    exact.rows[0, :2] = random.standard_normal((2, 3))
    exact.multiplier[0, :2] = random.uniform(0.5, 2.0, 2)
    exact.point[0] = -exact.multiplier[0, :2] @ exact.rows[0, :2]
    assert _carried(exact)
    exact.point[0, 2] += off * np.abs(exact.multiplier[0, :2] * exact.rows[0, :2, 2]).sum()
    assert _carried(exact) is carried


@pytest.mark.usefixtures("ways")
@pytest.mark.parametrize(("give", "drowned"), [(1e3, False), (1e9, True)])
def test_a_slack_that_drowns_the_point_is_left_to_the_rows_themselves(give: float, drowned: bool) -> None:
    """One soft row whose bound is -1: y = -1 / (1 + give^2) beside a load of -1 / give, known to 28 of its digits."""
    exact = make_search(1, 1)
    exact.form.factor[0, 0, 0] = 1.0
    exact.form.rows[1, 0], exact.form.high[0, 1], exact.form.give[0, 1] = 1.0, -1.0, give
    append(exact, 1, 1)
    assert extend(exact, project(exact))
    write_change(exact)
    size = 1.0 / (1.0 + give**2)
    assert exact.point[0, 0] == pytest.approx(-size, rel=1e-12, abs=0.0)
    assert exact.noise == pytest.approx(
        1e-20 * size if drowned else 1e-28 / np.hypot(1.0, give), rel=1e-9, abs=0.0
    )
