# SPDX-License-Identifier: BSD-3-Clause
"""Laws of the limit rows: who obeys them stays inside, who is outside comes back, the middle is free."""

import numpy as np
import pytest

from impedance_modules.safety import rows

CASES = 2000


def parameters(seed: int) -> dict[str, np.ndarray]:
    """Random joints: braking b, period T, horizon h = 1..6 periods, speed limit, range."""
    rng = np.random.default_rng(seed)
    period = 10.0 ** rng.uniform(-3.3, -1.7, CASES)
    horizon = period * rng.integers(1, 7, CASES)
    braking = rng.uniform(2.0, 40.0, CASES)
    speed_max = np.maximum(rng.uniform(0.5, 4.0, CASES), 1.1 * braking * horizon)
    return {
        "period": period,
        "horizon": horizon,
        "deceleration": braking,
        "return_speed": rng.uniform(0.05, 0.5, CASES),
        "speed_max": speed_max,
        "half_range": rng.uniform(0.3, 3.0, CASES) + speed_max**2 / braking,
    }


def step(q: np.ndarray, v: np.ndarray, a: np.ndarray, period: np.ndarray) -> tuple[np.ndarray, ...]:
    """Exact motion under constant acceleration; also the farthest point reached on the way."""
    turning = np.where((v * a < 0) & (np.abs(v) < np.abs(a) * period), -v / np.where(a == 0, 1, a), period)
    peak = q + v * turning + 0.5 * a * turning**2
    return q + v * period + 0.5 * a * period**2, v + a * period, peak


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("greedy", [True, False])
def test_obeying_joint_never_leaves_its_range_nor_its_speed(seed: int, greedy: bool) -> None:
    p = parameters(seed)
    rng = np.random.default_rng(seed + 10)
    top = p["half_range"]
    q = rng.uniform(-1.0, 1.0, CASES) * top
    room = top - np.abs(q)
    v = np.sign(q) * np.minimum(p["speed_max"], np.sqrt(2 * p["deceleration"] * room)) * rng.random(CASES)
    push = rng.choice([-1.0, 1.0], CASES) * 1e4
    for _ in range(300):
        if not greedy:
            push = rng.normal(size=CASES) * 100.0
        low, high = rows.position_interval(
            q, v, -top, top,
            deceleration=p["deceleration"], return_speed=p["return_speed"], horizon=p["horizon"],
        )  # fmt: skip
        low_v, high_v = rows.velocity_interval(v, p["speed_max"], p["deceleration"], p["horizon"])
        low, high = np.maximum(low, low_v), np.minimum(high, high_v)
        assert (low <= high + 1e-9 * p["deceleration"]).all()
        assert (np.maximum(low, -high) <= p["deceleration"] * (1 + 1e-12)).all()
        q, v, peak = step(q, v, np.clip(push, low, high), p["period"])
        assert (np.abs(q) <= top + 1e-9).all()
        assert (np.abs(peak) <= top + 1e-9).all()
        assert (np.abs(v) <= p["speed_max"] * (1 + 1e-9)).all()


@pytest.mark.parametrize("seed", range(3))
def test_bound_is_the_largest_acceleration_that_still_stops(seed: int) -> None:
    """Slightly more than the bound, held for a horizon, and braking then is too late."""
    p = parameters(seed)
    rng = np.random.default_rng(seed + 20)
    b, h = p["deceleration"], p["horizon"]
    room = 10.0 ** rng.uniform(-5, 0.5, CASES)
    v = np.sqrt(2 * b * room) * rng.uniform(-1.0, 1.0, CASES)
    bound = rows.braking_acceleration(room, v, b, p["return_speed"], h)
    assert (bound >= -b * (1 + 1e-9)).all()
    for factor, fits in ((-1e-6, True), (1e-6, False)):
        a = bound + factor * b
        _, after, _ = step(np.zeros(CASES), v, a, h)
        end = v * h + 0.5 * a * h**2
        stop = np.where(after > 0, end + after**2 / (2 * b), 0.0)
        turn = np.where((v > 0) & (after <= 0), v**2 / np.where(a < 0, -2 * a, 1.0), 0.0)
        reached = np.maximum(np.maximum(stop, turn), end)
        saturated = (bound <= -b * (1 - 1e-9)) & ~(reached > room)
        assert ((reached <= room * (1 + 1e-9) + 1e-12) | (not fits)).all()
        if not fits:
            assert ((reached >= room * (1 - 1e-9) - 1e-12) | saturated).all()


@pytest.mark.parametrize("seed", range(3))
def test_joint_outside_comes_back_at_a_bounded_speed(seed: int) -> None:
    p = parameters(seed)
    rng = np.random.default_rng(seed + 30)
    top, b, h = p["half_range"], p["deceleration"], p["horizon"]
    q = (top + 10.0 ** rng.uniform(-3, -1, CASES)) * rng.choice([-1.0, 1.0], CASES)
    v = rng.uniform(-1.0, 1.0, CASES) * 0.3
    start = np.abs(v)
    back = p["return_speed"]
    bound = np.maximum(np.maximum(start, back), b * p["period"])
    steps = 0
    while (np.abs(q) > top + 1e-4).any():
        low, high = rows.position_interval(
            q, v, -top, top, deceleration=b, return_speed=back, horizon=h
        )  # fmt: skip
        a = np.clip(0.0, low, high)
        assert (np.abs(a) <= b * (1 + 1e-12)).all()
        q, v, _ = step(q, v, a, p["period"])
        assert (np.abs(v) <= bound + 1e-9).all()
        steps += 1
        assert steps < 60_000
    assert (np.abs(q) <= top + 1e-4).all()


def test_bound_is_continuous_where_a_returning_joint_enters_its_range() -> None:
    v = np.linspace(-1.0, 0.0, 101)
    just_in, just_out = (
        rows.braking_acceleration(np.full(101, d), v, np.full(101, 1e3), np.full(101, 0.2), 0.01)
        for d in (1e-14, -1e-14)
    )
    assert just_out == pytest.approx(-v / 0.01, abs=1e-6)
    assert (just_in >= just_out - 1e-6).all()
    assert just_in[-1] == pytest.approx(just_out[-1], abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_middle_of_the_range_is_free(seed: int) -> None:
    """Any acceleration after which the joint can still stop is allowed."""
    p = parameters(seed)
    rng = np.random.default_rng(seed + 40)
    b, h, top = p["deceleration"], p["horizon"], p["half_range"]
    v = rng.uniform(-0.9, 0.9, CASES) * p["speed_max"]
    a = rng.uniform(-3, 3, CASES) * b
    after = v + a * h
    need = np.abs(v) * h + 0.5 * np.abs(a) * h**2 + np.maximum(v**2, after**2) / (2 * b)
    q = rng.uniform(-1, 1, CASES) * (top - need)
    free = (need < top) & (np.abs(after) < p["speed_max"])
    assert free.sum() > CASES / 10
    low, high = rows.position_interval(
        q, v, -top, top, deceleration=b, return_speed=p["return_speed"], horizon=h
    )  # fmt: skip
    low_v, high_v = rows.velocity_interval(v, p["speed_max"], b, h)
    allowed = (np.maximum(low, low_v) <= a + 1e-9) & (a <= np.minimum(high, high_v) + 1e-9)
    assert allowed[free].all()


def test_range_too_short_to_stop_in_still_gives_an_interval() -> None:
    low, high = rows.position_interval(
        np.zeros(2), np.array([3.0, -3.0]), np.full(2, -1e-3), np.full(2, 1e-3),
        deceleration=np.full(2, 1e3), return_speed=np.full(2, 0.1), horizon=0.05,
    )  # fmt: skip
    assert (low <= high).all()


def test_too_fast_joint_slows_down_with_bounded_braking() -> None:
    v, limit, b, h, period = np.array([5.0, -5.0]), 2.0, 20.0, 0.02, 0.005
    for _ in range(200):
        low, high = rows.velocity_interval(v, limit, b, h)
        assert (low <= high).all()
        a = np.clip(0.0, low, high)
        assert (np.abs(a) <= b).all()
        assert (np.abs(v + a * period) <= np.abs(v)).all()
        v = v + a * period
    assert (np.abs(v) <= limit * (1 + 1e-3)).all()


@pytest.mark.parametrize("seed", range(3))
def test_pair_never_enters_its_margin_and_leaves_it_from_inside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    period = 10.0 ** rng.uniform(-3.3, -2, CASES)
    horizon = period * rng.integers(1, 6, CASES)
    approach = horizon * rng.uniform(4.0, 9.0, CASES)
    margin, back, limit = 0.02, 0.1, 1e9
    distance = margin + 10.0 ** rng.uniform(-4, -0.5, CASES)
    rate = -(distance - margin) / approach * rng.uniform(-1, 1, CASES)
    distance[: CASES // 2] = margin - rng.uniform(0, 0.03, CASES // 2)
    rate[: CASES // 2] = 0.0
    start = distance.copy()
    for _ in range(3000):
        low = rows.separation_acceleration(
            distance, rate, margin=margin, approach_time=approach, separation_speed=back,
            limit=limit, horizon=horizon,
        )  # fmt: skip
        push = rng.normal(size=CASES) * 10.0 - 5.0
        push[: CASES // 2] = -1e9
        distance, rate, peak = step(distance, rate, np.maximum(push, low), period)
        assert (np.minimum(distance, peak)[CASES // 2 :] >= margin - 1e-12).all()
        assert (rate[: CASES // 2] <= back + 1e-12).all()
        assert (distance[: CASES // 2] >= start[: CASES // 2] - 1e-12).all()
    closer = np.abs(margin - distance[: CASES // 2]) / np.maximum(margin - start[: CASES // 2], 1e-6)
    settled = 3000 * period[: CASES // 2] > 5 * approach[: CASES // 2] + 0.5
    assert settled.sum() > 50
    assert (closer[settled] < 0.1).all()


def test_power_row_states_the_energy_drawn_in_a_horizon() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        motion, tau = rng.normal(size=(2, 7)) * 10.0 ** rng.uniform(-3, 1)
        available, horizon = float(rng.choice([0.0, rng.random()])), 10.0 ** rng.uniform(-3, -1)
        row, upper = rows.power_row(motion, available, horizon)
        drawn = motion @ tau * horizon
        assert (row @ tau <= upper) == (drawn <= available)
        assert np.linalg.norm(row) == pytest.approx(1.0)
        assert upper >= 0.0


def test_power_row_at_rest_is_absent_and_a_negative_tank_is_refused() -> None:
    row, upper = rows.power_row(np.zeros(7), 0.0, 0.01)
    assert not row.any()
    assert upper == np.inf
    for available in (-1e-9, np.nan):
        with pytest.raises(ValueError, match="available energy"):
            rows.power_row(np.ones(7), available, 0.01)


def test_rate_interval_reaches_back_into_the_torque_limits() -> None:
    low, high = rows.rate_interval(np.array([80.0, -80.0, 3.0]), 100.0, np.full(3, 50.0), 0.01)
    assert np.allclose(low, [49.0, -51.0, 2.0])
    assert np.allclose(high, [51.0, -49.0, 4.0])
