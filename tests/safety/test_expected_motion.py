# SPDX-License-Identifier: BSD-3-Clause
"""The expected motion against elastic arms that are integrated: what is true now, and when the next torque acts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from impedance_modules.safety.expected_motion import (
    ExpectedMotion,
    _free_acceleration,
    begin_steady,
    expect_motion,
    expected_motion,
)
from tests.support.both_ways import ways  # noqa: F401

pytestmark = pytest.mark.usefixtures("ways")

N = 3
Array = np.ndarray


@dataclass
class ElasticArm:
    """Three coupled links behind springs, their motors, and sensors without noise whose velocity lags by ``lag``.

    The robot carries the weight, and beside it ``extra``, which nobody told the estimate, and ``stretch`` per radian.
    """

    random: np.random.Generator
    period: float = 1e-3
    lag: float = 0.0135
    delay: int = 2
    extra: float = 0.0
    stretch: float = 0.0
    link: Array = field(init=False)
    rotor: Array = field(init=False)
    compliance: Array = field(init=False)
    damping: Array = field(init=False)
    weight: Array = field(init=False)

    def __post_init__(self) -> None:
        random = self.random
        basis = np.linalg.qr(random.normal(size=(N, N)))[0]
        self.link = basis @ np.diag(random.uniform(0.2, 1.5, N)) @ basis.T
        self.rotor, self.compliance = random.uniform(0.05, 0.6, N), 1.0 / random.uniform(200.0, 900.0, N)
        self.damping, self.weight = random.uniform(0.0, 0.7, N), random.normal(size=N) * 5.0
        self.q, self.v = np.zeros(N), np.zeros(N)
        self.theta, self.w = self.carried * self.compliance, np.zeros(N)
        self.reported, self.push = np.zeros(N), np.zeros(N)

    @property
    def load(self) -> Array:
        """Torque of the springs, weight included."""
        return (self.theta - self.q) / self.compliance

    @property
    def carried(self) -> Array:
        """What the robot carries by itself."""
        return self.weight + self.extra + self.stretch * self.q

    def go_on(self, effort: Array) -> None:
        """One period under a torque; the robot carries the weight."""
        step = self.period / 20
        for _ in range(20):
            load = self.load - self.carried
            self.v = self.v + step * np.linalg.solve(self.link, load + self.push)
            self.w = self.w + step * (effort - load - self.damping * self.w) / self.rotor
            self.q, self.theta = self.q + step * self.v, self.theta + step * self.w
            self.reported = self.reported + (1.0 - np.exp(-step / self.lag)) * (self.v - self.reported)

    @property
    def mobility(self) -> Array:
        return np.linalg.inv(self.link + np.diag(self.rotor))

    def momentum_velocity(self) -> Array:
        """What motor and link of every joint share: their momentum over their inertia."""
        return self.mobility @ (self.link @ self.v + self.rotor * self.w)


def follow(arm: ElasticArm, cycles: int, push_from: int) -> tuple[ExpectedMotion, list[dict[str, Array]]]:
    """Runs smooth random torques through the arm; returns the estimate and, per cycle, expected and true motion."""
    random, d = arm.random, arm.delay
    slow, before = np.zeros(N), arm.load * arm.compliance
    motion = expected_motion(
        compliance=arm.compliance, reflected_inertia=arm.rotor, motor_damping=arm.damping,
        arms=(arm.mobility, np.zeros(N), arm.weight), slow=slow, period=arm.period, lag=arm.lag, delay=d,
    )  # fmt: skip
    begin_steady(motion, np.zeros(N), arm.load, np.zeros(N))
    pending, applied = np.zeros((d + 1, N)), np.zeros(N)
    waves, phase = random.uniform(5.0, 25.0, N), random.uniform(0.0, 6.0, N)
    seen: list[dict[str, Array]] = []
    for cycle in range(cycles):
        if cycle == push_from:
            arm.push = random.normal(size=N) * 10.0
        deflection = arm.load * arm.compliance
        slow += (1.0 - np.exp(-arm.period / arm.lag)) * ((deflection - before) / arm.period - slow)
        before = deflection
        motion.measured[:] = arm.q, arm.reported, arm.load
        expect_motion(motion, 1, applied, pending)
        seen.append({
            "w": arm.w.copy(), "w_found": motion.motor_velocity.copy(), "u_found": motion.velocity.copy(),
            "u": arm.momentum_velocity(), "r": arm.w - arm.v, "r_found": motion.swing.copy(),
            "v": arm.v.copy(), "v_found": motion.link_velocity.copy(), "reported": arm.reported.copy(),
            "s": arm.load - arm.carried, "s_found": motion.load.copy(),
            "q": arm.q.copy(), "q_found": motion.position.copy(), "p_found": motion.push.copy(),
        })  # fmt: skip
        pending[-1] = 6.0 * np.sin(waves * cycle * arm.period + phase)
        applied = pending[0].copy()
        arm.go_on(applied)
        pending[:-1], pending[-1] = pending[1:].copy(), 0.0
    return motion, seen


def errors(seen: list[dict[str, Array]], what: str, late: int) -> float:
    """RMS of expected less true ``late`` cycles after, over the RMS of the true."""
    found = np.array([each[f"{what}_found"] for each in seen[100 : len(seen) - late]])
    true = np.array([each[what] for each in seen[100 + late :]])
    return float(np.sqrt(np.mean((found - true) ** 2) / np.mean(true**2)))


@pytest.mark.parametrize(("extra", "stretch"), [(0.0, 0.0), (20.0, 10.0)])
@pytest.mark.parametrize(("period", "delay", "close"), [(1e-3, 2, 0.03), (4e-3, 1, 0.06)])
def test_motion_is_known_when_the_torque_acts(
    period: float,
    delay: int,
    close: float,
    extra: float,
    stretch: float,
    ways: str,  # noqa: F811
) -> None:
    """Also where springs beside the joints, 20 N.m and 10 N.m/rad, are none of the model's."""
    close += 0.005 * stretch
    for seed in range(4 if ways == "machine code" else 1):
        arm = ElasticArm(
            np.random.default_rng(seed), period=period, delay=delay, extra=extra, stretch=stretch
        )
        _, seen = follow(arm, 400, push_from=10_000)
        reported = np.array([each["reported"] - each["v"] for each in seen[100:]])
        true = np.array([each["v"] for each in seen[100:]])
        assert errors(seen, "w", 0) < close
        assert errors(seen, "u", delay) < close
        assert errors(seen, "v", delay) < 2.0 * close
        assert errors(seen, "r", delay) < 0.09 + close
        assert errors(seen, "s", delay) < 0.09 + close
        assert errors(seen, "q", delay) < 0.01
        # The robot's own velocity is later and wronger than all of them.
        assert np.sqrt(np.mean(reported**2) / np.mean(true**2)) > 0.12


def test_a_push_from_outside_is_found_and_does_not_mislead() -> None:
    arm = ElasticArm(np.random.default_rng(5))
    _, seen = follow(arm, 300, push_from=150)
    before = np.mean([each["p_found"] for each in seen[100:150]], axis=0)
    after = np.mean([each["p_found"] for each in seen[240:]], axis=0)
    pushed = arm.mobility @ arm.push
    assert np.abs(before).max() < 0.1 * np.abs(pushed).max()
    assert after == pytest.approx(pushed, abs=0.2 * np.abs(pushed).max())
    assert errors(seen[140:], "w", 0) < 0.05


def test_a_torque_source_and_a_rigid_joint_move_as_the_whole_joint() -> None:
    """Without rotor or spring there is nothing to swing; a robot without a filter needs no correction."""
    motion = expected_motion(
        compliance=np.zeros(2), reflected_inertia=np.array([0.0, 0.5]), motor_damping=np.zeros(2),
        arms=(np.diag([2.0, 0.5]), np.zeros(2), np.zeros(2)), slow=np.zeros(2), period=0.01, lag=0.0, delay=1,
    )  # fmt: skip
    motion.measured[:2] = [0.1, 0.2], [1.0, -1.0]
    expect_motion(motion, 1, np.zeros(2), np.array([[3.0, 4.0], [0.0, 0.0]]))
    assert motion.velocity == pytest.approx([1.0 + 0.01 * 2.0 * 3.0, -1.0 + 0.01 * 0.5 * 4.0])
    assert motion.position == pytest.approx([0.1 + 0.01 * 1.03, 0.2 - 0.01 * 0.99])
    assert motion.link_velocity == pytest.approx(motion.velocity)
    assert motion.swing.tolist() == [0.0, 0.0]


def test_a_gap_counts_as_long_as_it_was() -> None:
    """After three periods without a state a steadily winding spring winds no faster than before."""
    motion = expected_motion(
        compliance=np.array([0.002]), reflected_inertia=np.array([0.5]), motor_damping=np.zeros(1),
        arms=(np.array([[1.0]]), np.zeros(1), np.zeros(1)), slow=np.zeros(1), period=0.01, lag=0.0, delay=0,
    )  # fmt: skip
    begin_steady(motion, np.zeros(1), np.zeros(1), np.zeros(1))
    for effort, intervals in ((5.0, 1), (10.0, 1), (25.0, 3)):
        motion.measured[2] = effort
        expect_motion(motion, intervals, np.zeros(1), np.zeros((1, 1)))
        assert motion.rate == pytest.approx([1.0])


def test_torques_accelerate_a_joint_by_what_bias_and_motor_damping_leave_of_them() -> None:
    random = np.random.default_rng(4)
    inverse = np.diag(random.uniform(1.0, 3.0, N)) + 0.2
    bias, damping, effort, speed = random.normal(size=(4, N))
    motion = expected_motion(
        compliance=np.zeros(N),
        reflected_inertia=np.zeros(N),
        motor_damping=np.abs(damping),
        arms=(inverse, bias, np.zeros(N)),
        slow=np.zeros(N),
        period=1e-3,
        lag=0.0,
        delay=0,
    )
    motion.motor_velocity[:] = speed
    found = [_free_acceleration(motion, effort, i) for i in range(N)]
    np.testing.assert_allclose(found, inverse @ (effort - bias - np.abs(damping) * speed), rtol=1e-12)
