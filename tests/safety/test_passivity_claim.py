# SPDX-License-Identifier: BSD-3-Clause
"""The passivity claim against adversaries: integral of tau_applied . dtheta <= T_0 + U_0 - U."""

import numpy as np
import pytest

from impedance_modules.safety.tank import Tank, measure, missed, rescale_springs
from tests.support.tank_worlds import (
    ElasticArm,
    Springs,
    Wire,
    admit_part,
    filled_tank,
    limited,
    random_springs,
    sensing_uncertainty,
    settings_of,
    stored,
)

pytestmark = pytest.mark.usefixtures("ways")

EPS = 1e-9


def rounded(x: np.ndarray, resolution: float) -> np.ndarray:
    return np.round(x / resolution) * resolution if resolution else x


def adversarial_run(
    seed: int, *, delay: int, resolution: float, hold_periods: int, cycles: int = 250
) -> None:
    """Rotors moved by the worst environment: any path within v_max, any link angle, any allowed miss."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    c = rng.choice([0.0, 1 / 300], size=n)
    e = np.full(n, 0.5 * resolution) + c * 0.5 * resolution
    initial, hold = float(rng.uniform(0.6, 4)), hold_periods * 0.002
    s = settings_of(n, delay=delay, hold=hold, compliance=c, sensing_error=e, initial=initial)
    springs = random_springs(rng, n)

    def read() -> tuple[np.ndarray, np.ndarray]:
        twist = np.where(c > 0, (theta - q) / np.where(c > 0, c, 1.0), 0.0)
        return rounded(q, resolution), rounded(twist, resolution)

    q, theta = rng.normal(size=n), np.zeros(n)
    theta = np.where(c > 0, q + rng.normal(size=n) * 0.01, q)
    qm, fm = read()
    tank = filled_tank(s, qm, fm, springs.potential(qm))
    wire, true_work, v = Wire(delay, n), 0.0, np.zeros(n)
    yielding, misses, first = rng.uniform(), 0, True
    for _ in range(cycles):
        if not first:
            if misses + 1 < hold_periods and rng.uniform() < 0.2:
                misses += 1
                missed(tank)
                command = None
            else:
                misses = 0
                qm, fm = read()
                assert measure(tank, qm, fm, springs.potential(qm)) == n
        if misses == 0:
            if rng.uniform() < 0.3:
                move_springs(rng, tank, springs, qm)
            rescale_springs(tank)
            assert tank.level >= s.floor - EPS
            assert tank.level <= s.max + EPS
            assert true_work <= tank.work_bound + EPS
            assert abs(true_work - tank.work) <= sensing_uncertainty(tank) + EPS
            wanted = springs.effort(qm, v, tank.spring_scale)
            level = tank.level
            command = limited(tank, wanted)
            assert np.abs(command) @ s.speed_bound * (1 + s.delay) * s.period <= level - s.floor + EPS
        first = False
        applied = wire.applied(command)
        bound = s.speed_bound * s.period
        worst = bound * np.sign(applied)
        step = np.where(rng.uniform(size=n) < yielding, worst, rng.uniform(-1, 1, n) * bound)
        true_work += float(applied @ step)
        theta = theta + step
        q_new = np.where(c > 0, theta + rng.normal(size=n) * 0.05, theta)
        v, q = (q_new - q) / s.period, q_new


def move_springs(rng: np.random.Generator, tank: Tank, springs: Springs, q: np.ndarray) -> None:
    n = q.size
    A = rng.normal(size=(n, n))
    x1, K1 = springs.x0 + rng.normal(size=n), rng.uniform(1, 200) * A @ A.T

    def blend(part: float) -> tuple[np.ndarray, np.ndarray]:
        return springs.x0 + part * (x1 - springs.x0), (1 - part) * springs.K + part * K1

    total = stored(tank) + tank.spilled
    part = admit_part(tank, lambda a: springs.potential(q, *blend(a)))
    springs.x0, springs.K = blend(part)
    assert tank.potential == pytest.approx(springs.potential(q), rel=1e-9, abs=1e-12)
    assert stored(tank) + tank.spilled == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("delay", range(5))
@pytest.mark.parametrize("resolution", [0.0, 4e-4, 1e-2])
def test_claim_holds_against_any_path_of_the_rotors(delay: int, resolution: float) -> None:
    for seed in range(6):
        adversarial_run(100 * delay + seed, delay=delay, resolution=resolution, hold_periods=1)


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("resolution", [0.0, 4e-4])
def test_claim_holds_when_cycles_are_missed(delay: int, resolution: float) -> None:
    for seed in range(6):
        adversarial_run(7000 + 100 * delay + seed, delay=delay, resolution=resolution, hold_periods=3)


def run_arm(seed: int, delay: int, resolution: float, steps: int = 400) -> tuple[Tank, float, float]:
    """A controller on elastic joints whose links are shaken and pushed along the torque.

    Returns the tank, the true work up to its last measurement, and the least distance to the claim.
    """
    rng = np.random.default_rng(seed)
    n, h, sub = int(rng.integers(1, 4)), 0.002, 8
    arm = ElasticArm(rng, n, h / sub)
    c = 1 / arm.k
    e = 0.5 * resolution * (1 + c)
    s = settings_of(n, delay=delay, compliance=c, sensing_error=e, speed_bound=np.full(n, 20.0), initial=3.5)
    springs = random_springs(rng, n)
    springs.K *= 0.2
    qm = np.zeros(n)
    springs.x0 = np.zeros(n)
    tank, wire, work, command = filled_tank(s, qm, qm, 0.0), Wire(delay, n), 0.0, np.zeros(n)
    target, margin, measured = rng.normal(size=n), np.inf, 0.0
    for k in range(steps):
        if k:
            qm = rounded(arm.part(0), resolution)
            fm = rounded(arm.k * (arm.part(1) - arm.part(0)), resolution)
            too_fast = measure(tank, qm, fm, springs.potential(qm))
            assert too_fast == n, "the test's own bound is too small"
        start = springs.x0
        step = 0.02 * (target - start)
        part = admit_part(tank, lambda a, q=qm, x=start, d=step: springs.potential(q, x + a * d))
        springs.x0 = start + part * step
        rescale_springs(tank)
        assert tank.level >= s.floor - EPS
        margin, measured = min(margin, tank.work_bound - work), work
        assert margin >= -EPS
        assert abs(work - tank.work) <= sensing_uncertainty(tank) + EPS
        wanted = springs.effort(qm, arm.part(2), tank.spring_scale)
        command = limited(tank, wanted)
        applied, before = wire.applied(command), arm.part(1).copy()
        for _ in range(sub):
            force = 15 * rng.normal(size=n) + 10 * np.sign(command) * np.sin(k / 20)
            arm.step(force, applied)
        work += float(applied @ (arm.part(1) - before))
    return tank, measured, margin


@pytest.mark.parametrize("delay", range(5))
@pytest.mark.parametrize("resolution", [0.0, 3.8e-4])
def test_claim_holds_on_elastic_joints(delay: int, resolution: float) -> None:
    for seed in range(3):
        run_arm(seed + 50 * delay, delay, resolution)


def test_the_energy_balance_is_exact_without_sensor_noise() -> None:
    tank, work, _ = run_arm(3, 2, 0.0)
    assert tank.work == pytest.approx(work, abs=1e-9)
    assert tank.charged == 0.0
    total = stored(tank) + tank.work + tank.spilled
    assert total == pytest.approx(tank.initial_energy, abs=1e-9)
    assert work > 0.1


def least_energy(delay: int, rule: str, cycles: int) -> float:
    """Least T - floor when rotors always run away at v_max along the torque; one joint, a pure push."""
    s = settings_of(1, delay=delay, floor=1.0, initial=4.0, compliance=np.zeros(1))
    tank, least, theta = filled_tank(s, np.zeros(1), np.zeros(1), 0.0), np.inf, np.zeros(1)
    wire, wanted = Wire(delay, 1), np.array([1e6])
    for k in range(cycles):
        if k:
            measure(tank, theta, np.zeros(1), 0.0)
        least = min(least, tank.level - s.floor)
        if rule == "sentence alone":
            most = max(0.0, tank.level - s.floor) / (s.speed_bound * (1 + s.delay) * s.period)
            tank.pending[-1] = command = np.minimum(wanted, most)
        else:
            command = limited(tank, wanted)
        applied = wire.applied(command)
        theta = theta + s.speed_bound * s.period * np.sign(applied)
    return float(least)


@pytest.mark.parametrize("delay", [1, 2, 4])
def test_scaling_by_period_plus_delay_alone_breaks_the_floor_and_the_reserve_does_not(delay: int) -> None:
    assert least_energy(delay, "sentence alone", 60) < -0.1
    assert least_energy(delay, "reserve", 60) >= -EPS
