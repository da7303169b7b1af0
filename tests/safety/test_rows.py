# SPDX-License-Identifier: BSD-3-Clause
"""Laws of the limit rows: who obeys them stays inside, who is outside comes back, the middle is free."""

import numpy as np
import pytest

from impedance_modules.safety.filter_problem import FilterLayout, make_problem
from impedance_modules.safety.limits import FilterLimits
from impedance_modules.safety.rows import (
    braking_acceleration,
    least_with_push,
    motor_interval,
    narrow,
    position_interval,
    separation_acceleration,
    velocity_interval,
)

pytestmark = pytest.mark.usefixtures("ways")

CASES = 80
Array = np.ndarray


def random_limits(seed: int) -> FilterLimits:
    """Random joints: braking b, range, speed limit; one period T and a horizon h of 1..6 periods."""
    rng = np.random.default_rng(seed)
    period = 10.0 ** rng.uniform(-3.3, -1.7)
    horizon = period * rng.integers(1, 7)
    braking = rng.uniform(2.0, 40.0, CASES)
    speed_max = np.maximum(rng.uniform(0.5, 4.0, CASES), 1.1 * braking * horizon)
    half_range = rng.uniform(0.3, 3.0, CASES) + speed_max**2 / braking
    middle = rng.uniform(-1.0, 1.0, CASES)
    return FilterLimits(
        effort_max=np.full(CASES, 50.0),
        effort_rate_max=np.full(CASES, 100.0),
        position_min=middle - half_range,
        position_max=middle + half_range,
        velocity_max=speed_max,
        deceleration=braking,
        return_speed=rng.uniform(0.1, 0.5, CASES),
        margin=0.02,
        approach_time=horizon * rng.uniform(4.0, 9.0),
        separation_speed=0.1,
        separation_acceleration=1e9,
        period=period,
        delay=0.0,
        horizon=horizon,
        pair_horizon=horizon,
        reflected_inertia=rng.uniform(0.03, 0.6, CASES),
        compliance=1.0 / rng.uniform(250.0, 900.0, CASES),
    )


def middle_and_half(limits: FilterLimits) -> tuple[Array, Array]:
    low, high = limits.position_min, limits.position_max
    return 0.5 * (low + high), 0.5 * (high - low)


def position_intervals(limits: FilterLimits, q: Array, v: Array) -> tuple[Array, Array]:
    pairs = zip(q.tolist(), v.tolist(), strict=True)
    return tuple(np.array([position_interval(limits, i, *pair) for i, pair in enumerate(pairs)]).T)


def velocity_intervals(limits: FilterLimits, v: Array) -> tuple[Array, Array]:
    return tuple(
        np.array([velocity_interval(limits, i, speed, speed, 0.0) for i, speed in enumerate(v.tolist())]).T
    )


def braking_accelerations(limits: FilterLimits, room: Array, speed: Array) -> Array:
    columns = (room, speed, limits.deceleration, limits.return_speed)
    each = zip(*(column.tolist() for column in columns), strict=True)
    return np.array([braking_acceleration(*case, limits.horizon) for case in each])


def step(q: Array, v: Array, a: Array, period: float) -> tuple[Array, ...]:
    """Exact motion under constant acceleration; also the farthest point reached on the way."""
    turning = np.where((v * a < 0) & (np.abs(v) < np.abs(a) * period), -v / np.where(a == 0, 1, a), period)
    peak = q + v * turning + 0.5 * a * turning**2
    return q + v * period + 0.5 * a * period**2, v + a * period, peak


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("greedy", [True, False])
def test_obeying_joint_never_leaves_its_range_nor_its_speed(seed: int, greedy: bool) -> None:
    limits, rng = random_limits(seed), np.random.default_rng(seed + 10)
    (middle, top), b = middle_and_half(limits), limits.deceleration
    offset = rng.uniform(-1.0, 1.0, CASES) * top
    room = top - np.abs(offset)
    v = np.sign(offset) * np.minimum(limits.velocity_max, np.sqrt(2 * b * room)) * rng.random(CASES)
    q = middle + offset
    push = rng.choice([-1.0, 1.0], CASES) * 1e4
    for _ in range(300):
        if not greedy:
            push = rng.normal(size=CASES) * 100.0
        low, high = position_intervals(limits, q, v)
        low_v, high_v = velocity_intervals(limits, v)
        low, high = np.maximum(low, low_v), np.minimum(high, high_v)
        assert (low <= high + 1e-9 * b).all()
        assert (np.maximum(low, -high) <= b * (1 + 1e-12)).all()
        q, v, peak = step(q, v, np.clip(push, low, high), limits.period)
        assert (np.abs(q - middle) <= top + 1e-9).all()
        assert (np.abs(peak - middle) <= top + 1e-9).all()
        assert (np.abs(v) <= limits.velocity_max * (1 + 1e-9)).all()


@pytest.mark.parametrize("seed", range(6))
def test_bound_is_the_largest_acceleration_that_still_stops(seed: int) -> None:
    """Slightly more than the bound, held for a horizon, and braking then is too late."""
    limits, rng = random_limits(seed), np.random.default_rng(seed + 20)
    b, h = limits.deceleration, limits.horizon
    room = 10.0 ** rng.uniform(-5, 0.5, CASES)
    v = np.sqrt(2 * b * room) * rng.uniform(-1.0, 1.0, CASES)
    bound = braking_accelerations(limits, room, v)
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
    limits, rng = random_limits(seed), np.random.default_rng(seed + 30)
    (middle, top), b, back = middle_and_half(limits), limits.deceleration, limits.return_speed
    q = middle + (top + 10.0 ** rng.uniform(-3, -1.5, CASES)) * rng.choice([-1.0, 1.0], CASES)
    v = rng.uniform(-1.0, 1.0, CASES) * 0.3
    bound = np.maximum(np.maximum(np.abs(v), back), b * limits.period)
    steps, fastest = 0, np.zeros(CASES)
    while (np.abs(q - middle) > top + 1e-4).any():
        low, high = position_intervals(limits, q, v)
        a = np.clip(0.0, low, high)
        assert (np.abs(a) <= b * (1 + 1e-12)).all()
        q, v, _ = step(q, v, a, limits.period)
        assert (np.abs(v) <= bound + 1e-9).all()
        fastest = np.maximum(fastest, np.abs(v))
        steps += 1
        assert steps < 5_000
    assert (np.abs(q - middle) <= top + 1e-4).all()


def test_far_outside_a_joint_is_asked_for_its_return_speed() -> None:
    limits = random_limits(0)
    at_speed = -limits.return_speed
    bound = braking_accelerations(limits, np.full(CASES, -5.0), at_speed)
    assert bound == pytest.approx(np.zeros(CASES), abs=1e-9)


def test_bound_is_continuous_where_a_returning_joint_enters_its_range() -> None:
    v = np.linspace(-1.0, 0.0, 101)
    just_in, just_out = (
        np.array([braking_acceleration(d, speed, 1e3, 0.2, 0.01) for speed in v.tolist()])
        for d in (1e-14, -1e-14)
    )
    assert just_out == pytest.approx(-v / 0.01, abs=1e-6)
    assert (just_in >= just_out - 1e-6).all()
    assert just_in[-1] == pytest.approx(just_out[-1], abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_middle_of_the_range_is_free(seed: int) -> None:
    """Any acceleration after which the joint can still stop is allowed."""
    limits, rng = random_limits(seed), np.random.default_rng(seed + 40)
    (middle, top), b, h = middle_and_half(limits), limits.deceleration, limits.horizon
    v = rng.uniform(-0.9, 0.9, CASES) * limits.velocity_max
    a = rng.uniform(-3, 3, CASES) * b
    after = v + a * h
    need = np.abs(v) * h + 0.5 * np.abs(a) * h**2 + np.maximum(v**2, after**2) / (2 * b)
    q = middle + rng.uniform(-1, 1, CASES) * (top - need)
    free = (need < top) & (np.abs(after) < limits.velocity_max)
    assert free.sum() > CASES / 10
    low, high = position_intervals(limits, q, v)
    low_v, high_v = velocity_intervals(limits, v)
    allowed = (np.maximum(low, low_v) <= a + 1e-9) & (a <= np.minimum(high, high_v) + 1e-9)
    assert allowed[free].all()


def test_range_too_short_to_stop_in_still_gives_an_interval() -> None:
    limits = random_limits(0)
    limits.position_min[:], limits.position_max[:], limits.deceleration[:] = -1e-3, 1e-3, 1e3
    for speed in (3.0, -3.0):
        low, high = position_intervals(limits, np.zeros(CASES), np.full(CASES, speed))
        assert (low <= high).all()


def test_too_fast_joint_slows_down_with_bounded_braking() -> None:
    limits = random_limits(1)
    limits.period, limits.horizon = 0.005, 0.02
    b, top = limits.deceleration, limits.velocity_max
    v = 2.5 * top * np.where(np.arange(CASES) % 2, 1.0, -1.0)
    for _ in range(600):
        low, high = velocity_intervals(limits, v)
        assert (low <= high).all()
        a = np.clip(0.0, low, high)
        assert (np.abs(a) <= b * (1 + 1e-12)).all()
        assert (np.abs(v + a * limits.period) <= np.abs(v)).all()
        v = v + a * limits.period
    assert (np.abs(v) <= top * (1 + 1e-3)).all()


def separations(limits: FilterLimits, distance: Array, rate: Array) -> Array:
    pairs = zip(distance.tolist(), rate.tolist(), strict=True)
    return np.array([separation_acceleration(limits, *pair, 0.0) for pair in pairs])


@pytest.mark.parametrize("claimed", [0.0, 1e9])
@pytest.mark.parametrize("seed", range(3))
def test_pair_never_enters_its_margin_and_leaves_it_from_inside(seed: int, claimed: float) -> None:
    """Also where a push is counted on that is not there; the horizon is then two periods or more."""
    limits, rng = random_limits(seed), np.random.default_rng(seed)
    if claimed > 0.0:
        limits.pair_horizon = max(limits.pair_horizon, 2.0 * limits.period)
        limits.approach_time = max(limits.approach_time, 4.0 * limits.pair_horizon)
    approach, margin, back, inside = limits.approach_time, limits.margin, limits.separation_speed, CASES // 2
    distance = margin + 10.0 ** rng.uniform(-4, -0.5, CASES)
    rate = -(distance - margin) / approach * rng.uniform(-1, 1, CASES)
    distance[:inside] = margin - rng.uniform(0, 0.03, inside)
    rate[:inside] = 0.0
    start = distance.copy()
    steps = int((5 * approach + 0.6) / limits.period)
    for _ in range(steps):
        least = separations(limits, distance, rate).tolist()
        low = np.array([least_with_push(bound, claimed) for bound in least])
        push = rng.normal(size=CASES) * 10.0 - 5.0
        push[:inside] = -1e9
        distance, rate, peak = step(distance, rate, np.maximum(push, low), limits.period)
        assert (np.minimum(distance, peak)[inside:] >= margin - 1e-12).all()
        assert (rate[:inside] <= back + 1e-12).all()
        assert (distance[:inside] >= start[:inside] - 1e-12).all()
    closer = np.abs(margin - distance[:inside]) / np.maximum(margin - start[:inside], 1e-6)
    assert (closer < 0.1).all()


def swing_of_a_motor(limits: FilterLimits, i: int, case: tuple[float, ...], effort: float) -> Array:
    """Speed of a motor under a constant torque against a link that goes on steadily, over one swing (200,)."""
    v, swing, load = case
    own, compliance = limits.reflected_inertia[i], limits.compliance[i]
    frequency = 1.0 / np.sqrt(own * compliance)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    return v + swing * np.cos(angle) + (effort - load) / (own * frequency) * np.sin(angle)


@pytest.mark.parametrize("seed", range(3))
def test_a_motor_swings_up_to_its_speed_and_no_farther(seed: int) -> None:
    """At the bounds a constant torque lets it just reach its speed; between them it stays below."""
    limits, rng = random_limits(seed), np.random.default_rng(seed + 50)
    for i in range(CASES):
        top = limits.velocity_max[i]
        v = rng.uniform(-0.9, 0.9) * top
        case = (v, rng.uniform(-0.95, 0.95) * (top - abs(v)), rng.normal() * 5.0)
        low, high = motor_interval(limits, i, *case)
        assert low <= high
        for effort in (low, high):
            speeds = swing_of_a_motor(limits, i, case, effort)
            assert (speeds.max() if effort == high else -speeds.min()) == pytest.approx(top, rel=1e-3)


def test_a_motor_that_swings_too_fast_is_asked_back_and_never_thrown_over() -> None:
    limits = random_limits(1)
    top, own, load = float(limits.velocity_max[0]), float(limits.reflected_inertia[0]), 3.0
    impedance = np.sqrt(own / limits.compliance[0])
    low, high = motor_interval(limits, 0, 0.5 * top, 0.7 * top, load)
    assert high == pytest.approx(load - impedance * 0.2 * top)
    assert low == pytest.approx(load - impedance * np.sqrt(1.5**2 - 0.7**2) * top)
    low, high = motor_interval(limits, 0, 0.9 * top, 5.0 * top, load)
    assert low == high == pytest.approx(load - impedance * 1.9 * top)
    low, high = motor_interval(limits, 0, 0.5 * top, -0.7 * top, load)
    assert high == load
    assert motor_interval(limits, 0, 2.0 * top, 0.0, load)[1] == load


def test_a_joint_without_a_motor_behind_a_spring_has_no_swing() -> None:
    limits = random_limits(0)
    limits.compliance[0], limits.reflected_inertia[1] = 0.0, 0.0
    for i in (0, 1):
        assert motor_interval(limits, i, 0.0, 0.0, 1.0) == (-np.inf, np.inf)


def test_what_pushes_a_joint_is_taken_off_and_what_holds_it_is_half_trusted() -> None:
    limits = random_limits(0)
    top, b, h = float(limits.velocity_max[0]), float(limits.deceleration[0]), limits.horizon
    room = min(0.5 * b, 0.5 * top / h)
    v = top - room * h
    for push, allowed in (
        (0.0, room),
        (0.3 * b, room - 0.3 * b),
        (5.0 * b, room - b),
        (-0.5 * room, 1.5 * room),
    ):
        assert velocity_interval(limits, 0, v, v, push)[1] == pytest.approx(allowed)
        assert velocity_interval(limits, 0, -v, -v, -push)[0] == pytest.approx(-allowed)
    assert velocity_interval(limits, 0, v, v, -50.0 * b)[1] == pytest.approx(2.0 * room)
    assert velocity_interval(limits, 0, 0.0, v, 0.0)[1] == pytest.approx(room)
    low, high = velocity_interval(limits, 0, 2.0 * top, -2.0 * top, 0.0)
    assert low == high


def test_limits_of_one_joint_narrow_each_other_and_never_contradict() -> None:
    problem = make_problem(FilterLayout(("j",), ()), np.full(1, 50.0))
    row = 2
    for least, most, bounds, left in (
        (-5.0, 5.0, (-5.0, 5.0), (-5.0, 5.0)),
        (-50.0, 5.0, (-np.inf, 5.0), (-10.0, 5.0)),
        (-50.0, 50.0, (-np.inf, np.inf), (-10.0, 10.0)),
        (12.0, 15.0, (10.0, np.inf), (10.0, 10.0)),
        (-15.0, -12.0, (-np.inf, -10.0), (-10.0, -10.0)),
    ):
        assert narrow(problem, row, -10.0, 10.0, least, most) == left
        assert (problem.lower[row], problem.upper[row]) == bounds


def test_drift_of_a_distance_is_made_up_for() -> None:
    """A pair whose distance would shrink by itself is asked for that much more, up to the most that is ever asked."""
    limits = random_limits(2)
    limits.separation_acceleration = 5.0
    still = separation_acceleration(limits, 0.1, 0.0, 0.0)
    assert separation_acceleration(limits, 0.1, 0.0, -2.0) == pytest.approx(min(5.0, still + 2.0))
    assert separation_acceleration(limits, 0.1, 0.0, 2.0) == pytest.approx(still - 2.0)
    assert separation_acceleration(limits, 0.0, 0.0, -1e3) == 5.0


def test_what_pushes_a_pair_apart_is_counted_on_up_to_as_much_again() -> None:
    for least, push, found in (
        (-4.0, 0.0, -4.0),
        (-4.0, 3.0, -7.0),
        (-4.0, 50.0, -8.0),
        (-4.0, -3.0, -4.0),
        (0.0, 5.0, 0.0),
        (2.0, 5.0, 2.0),
    ):
        assert least_with_push(least, push) == pytest.approx(found)
