# SPDX-License-Identifier: BSD-3-Clause
"""Each step of the ledger by itself, and how a run feels when the tank is full, low or empty."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.errors import BadInput
from impedance_modules.safety.motor_port import motor_position, sensing_error, spring_compliances
from impedance_modules.safety.tank import available, budget, measure, missed, release_springs, rescale_springs
from impedance_modules.spec.robot_spec import JointSpec, SensorSpec
from tests.support.tank_worlds import (
    Springs,
    Wire,
    admit_part,
    altered,
    filled_tank,
    limited,
    settings_of,
    still_tank,
    stored,
)

pytestmark = pytest.mark.usefixtures("ways")

EPS = 1e-9


def steps_to_target(initial: float) -> int:
    """Cycles until a damped one-joint arm's equilibrium has moved 1 rad; a low tank waits for refunds."""
    s = settings_of(1, initial=initial, max=10.0, floor=0.1, compliance=np.zeros(1))
    springs = Springs(np.array([[20.0]]), np.zeros(1), 6.0, np.zeros(1))
    q, v, tank, progress = np.zeros(1), np.zeros(1), still_tank(s), 0.0
    for k in range(20_000):
        if k:
            measure(tank, q, np.zeros(1), springs.potential(q))
        wish = min(1.0, progress + 0.004) - progress
        targets = np.array([progress]), np.array([wish])
        part = admit_part(tank, lambda a, to=targets, x=q: springs.potential(x, to[0] + a * to[1]))
        progress += part * wish
        springs.x0 = np.array([progress])
        rescale_springs(tank)
        tau = limited(tank, springs.effort(q, v, tank.spring_scale))
        if progress >= 1.0:
            return k
        for _ in range(4):
            v = v + tau / 0.3 * s.period / 4
            q = q + v * s.period / 4
    raise AssertionError(f"stuck at {progress}, {tank}")


def test_a_starved_tank_slows_the_task_and_does_not_stop_it() -> None:
    rich, poor = steps_to_target(9.0), steps_to_target(0.6)
    assert rich == 249
    assert rich * 1.3 < poor < 20_000


def test_a_push_that_meets_nothing_fades_out_at_the_floor() -> None:
    s = settings_of(1, delay=2, compliance=np.zeros(1), max=4.0, initial=4.0)
    q, work, wire, tank = np.zeros(1), 0.0, Wire(2, 1), still_tank(s)
    for k in range(3000):
        if k:
            measure(tank, q, np.zeros(1), 0.0)
        rescale_springs(tank)
        tau = limited(tank, np.array([12.0]))
        applied = wire.applied(tau)
        q = q + 1.5 * s.period
        work += float(applied[0] * 1.5 * s.period)
    assert tau[0] < 0.1
    assert tank.starved_time > 1.0
    assert 0.9 * (4.0 - s.floor) < work <= 4.0 - s.floor


def test_a_full_tank_does_not_touch_a_gentle_torque() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        n = int(rng.integers(1, 4))
        s = settings_of(n, delay=int(rng.integers(0, 5)), sensing_error=np.full(n, 2e-4))
        q = rng.normal(size=n)
        tank = filled_tank(s, q, np.zeros(n), 0.3)
        for _ in range(8):
            measure(tank, q, np.zeros(n), 0.3)
            part = admit_part(tank, lambda a: 0.3 + 0.01 * a)
            tank.potential = 0.3
            rescale_springs(tank)
            wanted = rng.uniform(-5, 5, n)
            sent = limited(tank, wanted)
            assert part == 1.0
            assert np.array_equal(sent, wanted)
            assert tank.spring_scale == 1.0
            assert tank.starved_time == 0.0


def test_a_change_spends_at_most_the_budget_and_nearly_all_of_it() -> None:
    rng = np.random.default_rng(8)
    s = settings_of(1)
    for _ in range(300):
        tank = still_tank(
            s,
            float(rng.uniform(0, 5)),
            level=float(rng.uniform(-1, 4)),
            need=float(rng.uniform(0, 2)),
            spring_scale=float(rng.uniform(0, 1)),
        )
        rise = float(rng.uniform(0, 20))
        allowed = max(0.0, tank.level - s.floor - tank.need)
        assert budget(tank) == allowed
        after = altered(tank)
        part = admit_part(after, lambda a, t=tank, r=rise: t.potential + r * a * a)
        cost = tank.level - after.level
        assert -EPS <= cost <= allowed + EPS
        if part < 1:
            assert tank.spring_scale * rise * (part + 1 / 4096) ** 2 >= allowed - EPS
        assert after.short == (part == 0.0)
        refund = altered(tank)
        whole = admit_part(refund, lambda a, t=tank: t.potential * (1 - a))
        assert whole == 1.0
        assert refund.level + refund.spilled == pytest.approx(stored(tank))


def test_relaxing_always_reaches_the_floor_and_moves_no_energy_out() -> None:
    rng = np.random.default_rng(9)
    s = settings_of(2, sensing_error=np.full(2, 1e-3))
    for _ in range(500):
        applied = rng.normal(size=2) * 10
        base = s.floor + float(np.abs(applied) @ s.sensing_error)
        potential, scale = float(rng.uniform(0.01, 30)), float(rng.uniform(0.01, 1))
        excess = float(rng.uniform(0, 1)) * scale * potential
        level, need = base - scale * potential + excess, float(rng.uniform(0, 8))
        tank = still_tank(s, potential, level=level, spring_scale=scale, applied=applied, need=need)
        after = altered(tank)
        rescale_springs(after)
        assert after.level >= base - EPS
        assert 0 <= after.spring_scale <= scale
        kept_need = after.spring_scale / scale * min(tank.need, s.max - base)
        assert after.level == pytest.approx(base + kept_need), "what is kept can be paid"
        assert stored(after) == pytest.approx(stored(tank))
        assert after.short


def test_relaxed_springs_tighten_again_only_as_the_tank_pays() -> None:
    s = settings_of(1)
    tank = still_tank(s, 6.0, spring_scale=0.1, level=3.9, need=0.4)
    total = stored(tank)
    for _ in range(2000):
        last = tank.spring_scale
        rescale_springs(tank)
        assert tank.spring_scale >= last
        assert tank.level >= s.floor + tank.need - EPS
        assert stored(tank) == pytest.approx(total)
    assert tank.spring_scale == pytest.approx(0.6, abs=1e-3)
    rich = altered(tank, level=s.max, potential=0.1)
    total = stored(rich)
    for _ in range(2000):
        rescale_springs(rich)
    assert rich.spring_scale == 1.0
    assert stored(rich) == pytest.approx(total)


def test_springs_tighten_with_the_time_constant_of_recovery() -> None:
    s = settings_of(1)
    tank = still_tank(s, 6.0, spring_scale=0.0, level=2.0)
    rescale_springs(tank)
    assert tank.level == pytest.approx(2.0 - (2.0 - s.floor) * s.period / s.recovery_time)
    assert tank.spring_scale == pytest.approx((2.0 - s.floor) * s.period / s.recovery_time / 6.0)
    assert not tank.short


def test_need_is_the_level_at_which_a_lasting_torque_is_just_covered() -> None:
    rng = np.random.default_rng(10)
    for _ in range(30):
        delay = int(rng.integers(0, 4))
        hold, error = 0.002 * int(rng.integers(1, 4)), rng.uniform(0, 1e-3, 3)
        s = settings_of(3, delay=delay, hold=hold, sensing_error=error)
        tank, torque = still_tank(s), 5.0 * rng.normal(size=3)
        limited(tank, torque)
        lasting = altered(tank, applied=torque, pending=np.tile(torque, (delay + 1, 1)))
        for part, covered in ((1.0 + 1e-9, True), (0.99, False)):
            level = s.floor + part * tank.need
            assert np.array_equal(limited(altered(lasting, level=level), torque), torque) == covered


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_first_torque_is_answered_for_until_it_acts_and_ends(delay: int) -> None:
    s = settings_of(2, delay=delay)
    tank, torque = still_tank(s), np.array([300.0, -400.0])
    sent = limited(tank, torque)
    spent = np.abs(sent) @ s.speed_bound * (1 + delay) * s.period
    assert spent == pytest.approx(s.initial - s.floor)
    assert sent == pytest.approx(torque * np.abs(sent[0]) / 300.0)


def test_the_floor_is_there_for_the_stop() -> None:
    s = settings_of(2)
    tank = still_tank(s, 0.0, level=s.floor)
    brake = np.array([3.0, -4.0])
    assert np.all(limited(tank, brake) == 0)
    assert np.array_equal(limited(tank, brake, stopping=True), brake)


def test_released_springs_give_their_energy_back() -> None:
    s = settings_of(1)
    tank = still_tank(s, 1.0, level=0.7, spring_scale=0.5)
    release_springs(tank)
    assert (tank.level, tank.spring_scale, tank.potential) == (1.2, 0.0, 0.0)


def test_a_rotor_faster_than_declared_is_reported() -> None:
    s = settings_of(3, compliance=np.zeros(3), sensing_error=np.full(3, 1e-4))
    tank = still_tank(s)
    limit = s.speed_bound[0] * s.period + 2e-4
    assert measure(altered(tank), np.full(3, limit), np.zeros(3), 0.0) == 3
    assert measure(altered(tank), np.array([0, 1.01 * limit, -1.01 * limit]), np.zeros(3), 0.0) == 1
    assert measure(altered(tank), np.array([0, 0, -1.01 * limit]), np.zeros(3), 0.0) == 2
    late = altered(tank)
    missed(late)
    assert measure(altered(late), np.full(3, 1.9 * limit), np.zeros(3), 0.0) == 3
    assert measure(altered(late), np.full(3, 2.1 * limit), np.zeros(3), 0.0) == 0


def test_the_power_row_may_spend_what_is_above_the_floor() -> None:
    tank = still_tank(settings_of(1, delay=3))
    assert available(tank) == 1.5
    assert available(altered(tank, level=0.2)) == 0.0


WRONG = [
    {"floor": -0.1}, {"floor": 2.0}, {"initial": 5.0}, {"period": 0.0}, {"delay": -1}, {"hold": 0.001},
    {"recovery_time": 0.0}, {"speed_bound": np.array([np.inf])}, {"compliance": np.array([-1.0])},
    {"sensing_error": np.array([np.nan])},
]  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_settings_that_would_void_the_proof_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(BadInput, match="energy tank"):
        settings_of(1, **wrong)


def test_the_sensing_bound_covers_quantised_readings() -> None:
    joint = JointSpec("a", -1, 1, 2, 50, 100, 843.0, 0.6, 0, 0)
    compliance = spring_compliances((joint, replace(joint, spring_stiffness=None)))
    assert compliance.tolist() == [1 / 843, 0.0]
    sensors = SensorSpec(4e-4, 0.2, 0.0, 0.0, 0.0)
    bound = sensing_error(sensors, compliance, np.full(2, 2.0), latency=0.0)
    rng = np.random.default_rng(1)
    worst = np.zeros(2)
    for _ in range(3000):
        q, effort = rng.normal(size=2), rng.normal(size=2) * 20
        read_q, read_effort = np.round(q / 4e-4) * 4e-4, np.round(effort / 0.2) * 0.2
        for i in range(2):
            seen = motor_position(read_q[i], read_effort[i], compliance[i])
            worst[i] = max(worst[i], abs(seen - motor_position(q[i], effort[i], compliance[i])))
    assert np.all(worst <= bound + 1e-15)
    assert np.all(worst >= 0.9 * bound)
    late = sensing_error(sensors, compliance, np.full(2, 2.0), latency=0.01)
    assert np.allclose(late - bound, 0.02)
