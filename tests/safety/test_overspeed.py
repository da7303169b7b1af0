# SPDX-License-Identifier: BSD-3-Clause
"""A joint within its speed is never accused; one beyond it is found within the longest window, sooner if faster."""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.safety.overspeed import forget_travel, longest_window, too_fast_joint, travel_watch
from tests.support.both_ways import ways  # noqa: F401

pytestmark = pytest.mark.usefixtures("ways")

BOUND = np.array([1.5, 4.0])
ERROR = np.array([8e-4, 1.1e-3])
COMPLIANCE = np.array([1.0 / 843.0, 0.0])


def cycles_until_found(
    period: float, motors: list[np.ndarray], links: list[np.ndarray], random: np.random.Generator
) -> tuple[int, int]:
    """Cycles, and the joint, until one at these speeds is found too fast; -1 if none ever is. Joint 1 is rigid."""
    watch, theta, q = travel_watch(period, BOUND, COMPLIANCE, ERROR), np.zeros(2), np.zeros(2)
    for cycle, (motor, link) in enumerate(zip(motors, links, strict=True)):
        theta, q = theta + period * motor, q + period * np.array([link[0], motor[1]])
        effort = np.array([(theta[0] - q[0]) / COMPLIANCE[0], 3.0])
        found = too_fast_joint(watch, q + random.uniform(-1.0, 1.0, 2) * ERROR, effort)
        if found < 2:
            return cycle, found
    return -1, 2


@pytest.mark.parametrize("period", [1e-3, 3e-3, 1e-2])
def test_who_keeps_the_speed_is_never_accused(period: float, ways: str) -> None:  # noqa: F811
    random = np.random.default_rng(0)
    for _ in range(30 if ways == "machine code" else 3):
        motors, links = np.clip(np.cumsum(random.normal(size=(2, 300, 2)) * 0.3, axis=1), -1.0, 1.0) * BOUND
        assert cycles_until_found(period, list(motors), list(links), random) == (-1, 2)


@pytest.mark.parametrize("period", [1e-3, 3e-3, 1e-2])
@pytest.mark.parametrize("joint", [0, 1])
def test_an_excess_is_found_within_the_longest_window(period: float, joint: int) -> None:
    random = np.random.default_rng(1)
    longest, last = longest_window(period, BOUND, ERROR), None
    for excess in (1.045, 1.2, 2.0, 5.0):
        waits = []
        for sign in (1.0, -1.0):
            slow, fast = np.array([0.3, -0.3]), np.array([0.1, 0.1])
            fast[joint] = sign * excess * BOUND[joint]
            motors = [slow] * 50 + [fast] * (longest + 1)
            found, which = cycles_until_found(period, motors, [slow] * len(motors), random)
            assert which == joint
            waits.append(found - 49)
        assert 1 <= max(waits) <= longest + 1
        assert last is None or max(waits) <= last
        last = max(waits)


def test_a_link_that_swings_too_fast_while_its_motor_stands_is_found() -> None:
    fast, still = [np.array([1.3 * BOUND[0], 0.0])] * 70, [np.zeros(2)] * 70
    cycle, joint = cycles_until_found(1e-3, still, fast, np.random.default_rng(2))
    assert joint == 0
    assert 0 < cycle < 30


def test_the_longest_window_finds_a_measured_excess_of_two_percent() -> None:
    for period in (1e-3, 2.5e-3, 1e-2):
        window = longest_window(period, BOUND, ERROR)
        allowed = BOUND * window * period + 2.0 * ERROR
        assert (allowed <= 1.02 * BOUND * window * period * (1 + 1e-12)).all()
        assert window == 1 or (0.5 * window * period * 0.02 * BOUND < 2.0 * ERROR).any()


def test_windows_of_baxter_are_as_short_as_the_docs_say() -> None:
    for rate, expected in ((1000.0, 64), (100.0, 8)):
        tank = assemble("soft-hold", effects=None, rate=rate, scale=1.0, arm=None).tank
        assert longest_window(tank.period, tank.speed_bound, tank.sensing_error) == expected


def test_after_a_gap_travel_counts_anew() -> None:
    watch = travel_watch(1e-3, BOUND, COMPLIANCE, ERROR)
    assert too_fast_joint(watch, np.zeros(2), np.zeros(2)) == 2
    assert too_fast_joint(watch, np.ones(2), np.zeros(2)) == 0
    forget_travel(watch)
    assert too_fast_joint(watch, np.zeros(2), np.zeros(2)) == 2
