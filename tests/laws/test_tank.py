# SPDX-License-Identifier: BSD-3-Clause
"""The passivity claim against adversaries: integral of tau_applied . dtheta <= T_0 + U_0 - U."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.linalg import expm

from impedance_modules.errors import BadInput, SafetyStop
from impedance_modules.safety.ledger import grant, measure, missed, pay, settle
from impedance_modules.safety.motor_port import motor_positions, sensing_error, spring_compliances
from impedance_modules.safety.tank import (
    Tank,
    TankSettings,
    filled_tank,
    power_budget,
    sensing_uncertainty,
)
from impedance_modules.spec.robot import JointSpec, SensorSpec

EPS = 1e-9


def settings_of(n: int, **changes: object) -> TankSettings:
    base = TankSettings(
        initial=2.0,
        max=4.0,
        floor=0.5,
        period=0.002,
        delay=0,
        hold=0.002,
        speed_bound=np.full(n, 2.0),
        compliance=np.full(n, 1 / 300),
        sensing_error=np.zeros(n),
        recovery_time=0.2,
    )
    return replace(base, **changes)


@dataclass
class Springs:
    """U = (q - x0)^T K (q - x0) / 2, viscous damping and a constant push that no potential pays for."""

    K: np.ndarray
    x0: np.ndarray
    D: float
    push: np.ndarray

    def potential(self, q: np.ndarray, x0: np.ndarray | None = None, K: np.ndarray | None = None) -> float:
        d = q - (self.x0 if x0 is None else x0)
        return 0.5 * float(d @ (self.K if K is None else K) @ d)

    def effort(self, q: np.ndarray, v: np.ndarray, scale: float) -> np.ndarray:
        return scale * (self.K @ (self.x0 - q)) - self.D * v + self.push


def random_springs(rng: np.random.Generator, n: int) -> Springs:
    A = rng.normal(size=(n, n))
    return Springs(
        rng.uniform(1, 200) * A @ A.T, rng.normal(size=n), rng.uniform(0, 5), rng.normal(size=n) * 5
    )


class Wire:
    """The robot's command path: a command of cycle k acts in [k + delay, k + delay + 1], and is held on."""

    def __init__(self, delay: int, n: int) -> None:
        self.line = deque([np.zeros(n)] * delay)
        self.last = np.zeros(n)

    def applied(self, command: np.ndarray | None) -> np.ndarray:
        """Torque of the next interval; None: no new command came, the last one stays."""
        self.last = self.last if command is None else command
        self.line.append(self.last)
        return self.line.popleft()


def adversarial_run(
    seed: int, *, delay: int, resolution: float, hold_periods: int, cycles: int = 250
) -> None:
    """Rotors moved by the worst environment: any path within v_max, any link angle, any allowed miss."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    c = rng.choice([0.0, 1 / 300], size=n)
    e = np.full(n, 0.5 * resolution) + c * 0.5 * resolution
    s = settings_of(
        n,
        delay=delay,
        hold=hold_periods * 0.002,
        compliance=c,
        sensing_error=e,
        initial=float(rng.uniform(0.6, 4)),
    )
    springs = random_springs(rng, n)

    def read(x: np.ndarray) -> np.ndarray:
        return np.round(x / resolution) * resolution if resolution else x

    def twist(x: np.ndarray) -> np.ndarray:
        return np.where(c > 0, x / np.where(c > 0, c, 1.0), 0.0)

    q, theta = rng.normal(size=n), np.zeros(n)
    theta = np.where(c > 0, q + rng.normal(size=n) * 0.01, q)
    qm, fm = read(q), read(twist(theta - q))
    tank = filled_tank(s, qm, fm, springs.potential(qm))
    wire, true_work, v = Wire(delay, n), 0.0, np.zeros(n)
    greed, misses, first = rng.uniform(), 0, True
    for _ in range(cycles):
        if not first:
            if misses + 1 < hold_periods and rng.uniform() < 0.2:
                misses += 1
                tank = missed(tank, s)
                command = None
            else:
                misses = 0
                qm, fm = read(q), read(twist(theta - q))
                tank = measure(tank, s, qm, fm, springs.potential(qm))
        if misses == 0:
            if rng.uniform() < 0.3:
                tank = move_springs(rng, tank, s, springs, qm)
            tank = settle(tank, s)
            assert tank.level >= s.floor - EPS
            assert tank.level <= s.max + EPS
            assert true_work <= tank.work_bound + EPS
            assert abs(true_work - tank.work) <= sensing_uncertainty(tank, s) + EPS
            wanted = springs.effort(qm, v, tank.spring_scale)
            level = tank.level
            tank, command = pay(tank, s, wanted, stopping=False)
            assert np.abs(command) @ s.speed_bound * s.reach <= level - s.floor + EPS
        first = False
        applied = wire.applied(command)
        bound = s.speed_bound * s.period
        thief = bound * np.sign(applied)
        step = np.where(rng.uniform(size=n) < greed, thief, rng.uniform(-1, 1, n) * bound)
        true_work += float(applied @ step)
        theta = theta + step
        q_new = np.where(c > 0, theta + rng.normal(size=n) * 0.05, theta)
        v, q = (q_new - q) / s.period, q_new
        assert not tank.overspeed


def move_springs(
    rng: np.random.Generator, tank: Tank, s: TankSettings, springs: Springs, q: np.ndarray
) -> Tank:
    n = q.size
    A = rng.normal(size=(n, n))
    x1, K1 = springs.x0 + rng.normal(size=n), rng.uniform(1, 200) * A @ A.T

    def blend(part: float) -> tuple[np.ndarray, np.ndarray]:
        return springs.x0 + part * (x1 - springs.x0), (1 - part) * springs.K + part * K1

    before = tank
    tank, part = grant(tank, s, lambda a: springs.potential(q, *blend(a)))
    total = before.level + before.declared + before.spilled
    springs.x0, springs.K = blend(part)
    assert tank.potential == pytest.approx(springs.potential(q), rel=1e-9, abs=1e-12)
    assert tank.level + tank.declared + tank.spilled == pytest.approx(total, rel=1e-9)
    return tank


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


class ElasticArm:
    """n joints: M qdd + C qd = k (theta - q) + f, I thetadd + D thetad = tau - k (theta - q); exact steps."""

    def __init__(self, rng: np.random.Generator, n: int, dt: float) -> None:
        A = rng.normal(size=(n, n))
        self.n, self.k = n, rng.uniform(100, 900, n)
        M, inertia = A @ A.T + 0.3 * np.eye(n), rng.uniform(0.05, 0.6, n)
        Z, E, K = np.zeros((n, n)), np.eye(n), np.diag(self.k)
        Mi, Ii = np.linalg.inv(M), np.diag(1 / inertia)
        F = np.block(
            [
                [Z, Z, E, Z],
                [Z, Z, Z, E],
                [-Mi @ K, Mi @ K, -0.2 * Mi, Z],
                [Ii @ K, -Ii @ K, Z, -0.1 * Ii],
            ]
        )
        G = np.block([[Z, Z], [Z, Z], [Mi, Z], [Z, Ii]])
        big = expm(np.block([[F, G], [np.zeros((2 * n, 6 * n))]]) * dt)
        self.A, self.B = big[: 4 * n, : 4 * n], big[: 4 * n, 4 * n :]
        self.x = np.zeros(4 * n)
        self.M, self.inertia = M, inertia

    def step(self, force: np.ndarray, tau: np.ndarray) -> None:
        self.x = self.A @ self.x + self.B @ np.concatenate((force, tau))

    def part(self, i: int) -> np.ndarray:
        return self.x[i * self.n : (i + 1) * self.n]


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

    def read(x: np.ndarray) -> np.ndarray:
        return np.round(x / resolution) * resolution if resolution else x

    qm = np.zeros(n)
    springs.x0 = np.zeros(n)
    tank, wire, work, command = filled_tank(s, qm, qm, 0.0), Wire(delay, n), 0.0, np.zeros(n)
    target, margin, measured = rng.normal(size=n), np.inf, 0.0
    for k in range(steps):
        if k:
            qm, fm = read(arm.part(0)), read(arm.k * (arm.part(1) - arm.part(0)))
            tank = measure(tank, s, qm, fm, springs.potential(qm))
        start = springs.x0
        step = 0.02 * (target - start)
        tank, part = grant(
            tank,
            s,
            lambda a, q=qm, x=start, d=step: springs.potential(q, x + a * d),
        )
        springs.x0 = start + part * step
        tank = settle(tank, s)
        assert not tank.overspeed, "the test's own bound is too small"
        assert tank.level >= s.floor - EPS
        margin, measured = min(margin, tank.work_bound - work), work
        assert margin >= -EPS
        assert abs(work - tank.work) <= sensing_uncertainty(tank, s) + EPS
        wanted = springs.effort(qm, arm.part(2), tank.spring_scale)
        tank, command = pay(tank, s, wanted, stopping=False)
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


def test_books_balance_exactly_without_sensor_noise() -> None:
    tank, work, _ = run_arm(3, 2, 0.0)
    assert tank.work == pytest.approx(work, abs=1e-9)
    assert tank.charged == 0.0
    total = tank.level + tank.declared + tank.work + tank.spilled
    assert total == pytest.approx(tank.initial_energy, abs=1e-9)
    assert work > 0.1


def greedy_energy(delay: int, rule: str, cycles: int) -> float:
    """Least T - floor when rotors always run away at v_max along the torque; one joint, a pure push."""
    s = settings_of(1, delay=delay, floor=1.0, initial=4.0, compliance=np.zeros(1))
    tank, least, theta = filled_tank(s, np.zeros(1), np.zeros(1), 0.0), np.inf, np.zeros(1)
    wire, wanted = Wire(delay, 1), np.array([1e6])
    for k in range(cycles):
        if k:
            tank = measure(tank, s, theta, np.zeros(1), 0.0)
        least = min(least, tank.level - s.floor)
        if rule == "sentence alone":
            most = max(0.0, tank.level - s.floor) / (s.speed_bound * s.reach)
            pending = tank.pending.copy()
            pending[-1] = command = np.minimum(wanted, most)
            tank = replace(tank, pending=pending)
        else:
            tank, command = pay(tank, s, wanted, stopping=False)
        applied = wire.applied(command)
        theta = theta + s.speed_bound * s.period * np.sign(applied)
    return float(least)


@pytest.mark.parametrize("delay", [1, 2, 4])
def test_scaling_by_period_plus_delay_alone_breaks_the_floor_and_the_reserve_does_not(delay: int) -> None:
    assert greedy_energy(delay, "sentence alone", 60) < -0.1
    assert greedy_energy(delay, "reserve", 60) >= -EPS


def test_a_full_tank_does_not_touch_a_gentle_torque() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        n = int(rng.integers(1, 4))
        s = settings_of(n, delay=int(rng.integers(0, 5)), sensing_error=np.full(n, 2e-4))
        q = rng.normal(size=n)
        tank = filled_tank(s, q, np.zeros(n), 0.3)
        for _ in range(8):
            tank = measure(tank, s, q, np.zeros(n), 0.3)
            tank, part = grant(tank, s, lambda a: 0.3 + 0.01 * a)
            tank = settle(replace(tank, potential=0.3), s)
            wanted = rng.uniform(-5, 5, n)
            tank, sent = pay(tank, s, wanted, stopping=False)
            assert part == 1.0
            assert sent is wanted
            assert tank.spring_scale == 1.0
            assert tank.starved_time == 0.0


def test_grant_spends_at_most_the_budget_and_nearly_all_of_it() -> None:
    rng = np.random.default_rng(8)
    s = settings_of(1)
    for _ in range(300):
        tank = replace(
            filled_tank(s, np.zeros(1), np.zeros(1), float(rng.uniform(0, 5))),
            level=float(rng.uniform(-1, 4)),
            need=float(rng.uniform(0, 2)),
            spring_scale=float(rng.uniform(0, 1)),
        )
        rise = float(rng.uniform(0, 20))
        budget = max(0.0, tank.level - s.floor - tank.need)
        after, part = grant(tank, s, lambda a, t=tank, r=rise: t.potential + r * a * a)
        cost = tank.level - after.level
        assert -EPS <= cost <= budget + EPS
        if part < 1:
            assert tank.spring_scale * rise * (part + 1 / 4096) ** 2 >= budget - EPS
        assert after.short == (part == 0.0)
        refund, whole = grant(tank, s, lambda a, t=tank: t.potential * (1 - a))
        assert whole == 1.0
        assert refund.level + refund.spilled == pytest.approx(tank.level + tank.declared)


def test_relaxing_always_reaches_the_floor_and_moves_no_energy_out() -> None:
    rng = np.random.default_rng(9)
    s = settings_of(2, sensing_error=np.full(2, 1e-3))
    for _ in range(500):
        applied = rng.normal(size=2) * 10
        base = s.floor + float(np.abs(applied) @ s.sensing_error)
        potential, scale = float(rng.uniform(0.01, 30)), float(rng.uniform(0.01, 1))
        excess = float(rng.uniform(0, 1)) * scale * potential
        tank = replace(
            filled_tank(s, np.zeros(2), np.zeros(2), potential),
            level=base - scale * potential + excess,
            spring_scale=scale,
            applied=applied,
            need=float(rng.uniform(0, 3)),
        )
        after = settle(tank, s)
        assert after.level >= base - EPS
        assert 0 <= after.spring_scale <= scale
        kept_need = after.spring_scale / scale * min(tank.need, s.max - base)
        assert after.level == pytest.approx(base + kept_need), "what is kept can be paid"
        assert after.level + after.declared == pytest.approx(tank.level + tank.declared)
        assert after.short


def test_relaxed_springs_tighten_again_only_as_the_tank_pays() -> None:
    s = settings_of(1)
    tank = replace(filled_tank(s, np.zeros(1), np.zeros(1), 6.0), spring_scale=0.1, level=3.9, need=0.4)
    total = tank.level + tank.declared
    for _ in range(2000):
        last, tank = tank, settle(tank, s)
        assert tank.spring_scale >= last.spring_scale
        assert tank.level >= s.floor + tank.need - EPS
        assert tank.level + tank.declared == pytest.approx(total)
    assert tank.spring_scale == pytest.approx(0.6, abs=1e-3)
    rich = replace(tank, level=s.max, potential=0.1)
    for _ in range(2000):
        rich = settle(rich, s)
    assert rich.spring_scale == 1.0


def steps_to_target(initial: float) -> int:
    """Cycles until a damped one-joint arm's equilibrium has moved 1 rad; a low tank waits for refunds."""
    s = settings_of(1, initial=initial, max=10.0, floor=0.1, compliance=np.zeros(1))
    springs = Springs(np.array([[20.0]]), np.zeros(1), 6.0, np.zeros(1))
    q, v = np.zeros(1), np.zeros(1)
    tank, progress = filled_tank(s, q, np.zeros(1), 0.0), 0.0
    for k in range(20_000):
        if k:
            tank = measure(tank, s, q, np.zeros(1), springs.potential(q))
        wish = min(1.0, progress + 0.004) - progress
        tank, part = grant(
            tank, s, lambda a, p=progress, w=wish, x=q: springs.potential(x, np.array([p + a * w]))
        )
        progress += part * wish
        springs.x0 = np.array([progress])
        tank = settle(tank, s)
        tank, tau = pay(tank, s, springs.effort(q, v, tank.spring_scale), stopping=False)
        if progress >= 1.0:
            return k
        for _ in range(4):
            v = v + tau / 0.3 * s.period / 4
            q = q + v * s.period / 4
    raise AssertionError(f"stuck at {progress}, {tank}")


def test_a_starved_tank_slows_the_task_and_does_not_strand_it() -> None:
    rich, poor = steps_to_target(9.0), steps_to_target(0.6)
    assert rich == 249
    assert rich * 1.3 < poor < 20_000


def test_a_push_that_meets_nothing_fades_out_at_the_floor() -> None:
    s = settings_of(1, delay=2, compliance=np.zeros(1), max=4.0, initial=4.0)
    q, work, wire = np.zeros(1), 0.0, Wire(2, 1)
    tank = filled_tank(s, q, np.zeros(1), 0.0)
    for k in range(3000):
        if k:
            tank = measure(tank, s, q, np.zeros(1), 0.0)
        tank = settle(tank, s)
        tank, tau = pay(tank, s, np.array([12.0]), stopping=False)
        applied = wire.applied(tau)
        q = q + 1.5 * s.period
        work += float(applied[0] * 1.5 * s.period)
    assert tau[0] < 0.1
    assert tank.starved_time > 1.0
    assert 0.9 * (4.0 - s.floor) < work <= 4.0 - s.floor


def test_the_floor_is_there_for_the_stop() -> None:
    s = settings_of(2)
    tank = replace(filled_tank(s, np.zeros(2), np.zeros(2), 0.0), level=s.floor)
    brake = np.array([3.0, -4.0])
    assert np.all(pay(tank, s, brake, stopping=False)[1] == 0)
    assert pay(tank, s, brake, stopping=True)[1] is brake


def test_a_rotor_faster_than_declared_is_reported() -> None:
    s = settings_of(3, compliance=np.zeros(3), sensing_error=np.full(3, 1e-4))
    tank = filled_tank(s, np.zeros(3), np.zeros(3), 0.0)
    limit = s.speed_bound[0] * s.period + 2e-4
    assert not measure(tank, s, np.full(3, limit), np.zeros(3), 0.0).overspeed
    seen = measure(tank, s, np.array([0, 1.01 * limit, -1.01 * limit]), np.zeros(3), 0.0)
    assert seen.overspeed == (1, 2)
    late = missed(tank, s)
    assert not measure(late, s, np.full(3, 1.9 * limit), np.zeros(3), 0.0).overspeed


def test_power_budget_is_what_the_guarantee_allows() -> None:
    s = settings_of(1, delay=3)
    tank = filled_tank(s, np.zeros(1), np.zeros(1), 0.0)
    assert power_budget(tank, s) == pytest.approx((2.0 - 0.5) / 0.008)
    assert power_budget(replace(tank, level=0.2), s) == 0.0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_never_booked_or_sent(value: float) -> None:
    s = settings_of(1)
    tank = filled_tank(s, np.zeros(1), np.zeros(1), 0.0)
    with pytest.raises(SafetyStop, match="finite"):
        pay(tank, s, np.array([value]), stopping=False)
    with pytest.raises(SafetyStop, match="finite"):
        measure(tank, s, np.array([value]), np.zeros(1), 0.0)
    for potential in (value, -0.1):
        with pytest.raises(SafetyStop, match="potential"):
            measure(tank, s, np.zeros(1), np.zeros(1), potential)
    same, part = grant(tank, s, lambda a: value)
    assert part == 0.0
    assert same.level == tank.level


@pytest.mark.parametrize(
    "wrong",
    [
        {"floor": -0.1},
        {"floor": 2.0},
        {"initial": 5.0},
        {"period": 0.0},
        {"delay": -1},
        {"hold": 0.001},
        {"recovery_time": 0.0},
        {"speed_bound": np.array([np.inf])},
        {"compliance": np.array([-1.0])},
        {"sensing_error": np.array([np.nan])},
    ],
)
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
        seen = motor_positions(np.round(q / 4e-4) * 4e-4, np.round(effort / 0.2) * 0.2, compliance)
        worst = np.maximum(worst, np.abs(seen - motor_positions(q, effort, compliance)))
    assert np.all(worst <= bound + 1e-15)
    assert np.all(worst >= 0.9 * bound)
    late = sensing_error(sensors, compliance, np.full(2, 2.0), latency=0.01)
    assert np.allclose(late - bound, 0.02)
