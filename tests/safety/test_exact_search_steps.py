# SPDX-License-Identifier: BSD-3-Clause
"""Single steps of the exact search where rounding matters: what random problems reach too seldom."""

from __future__ import annotations

import pytest

from impedance_modules.safety.solvers.exact_search import _push, make_search
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
    assert exact.multiplier[0, 1] == 7.0 and exact.multiplier[1, 1] == pytest.approx(1e-20 + 2e-18, rel=1e-6)
    assert exact.multiplier[0, 2] == 1.25 and exact.multiplier[1, 2] == pytest.approx(1e-20 + 1e-18, rel=1e-6)
