# SPDX-License-Identifier: BSD-3-Clause
"""What imperfect sensors cost: the charge covers the error in the measured work, white or not."""

import numpy as np
import pytest

from impedance_modules.safety.motor_port import sensing_deviation, sensing_error
from impedance_modules.safety.tank import measure, rescale_springs
from impedance_modules.spec.robot_spec import SensorSpec
from tests.support.tank_worlds import filled_tank, limited, settings_of, still_tank

pytestmark = pytest.mark.usefixtures("ways")

GRID = 3.8e-4


def sensors(noise: float) -> SensorSpec:
    return SensorSpec(GRID, 0.004, noise, 0.02 if noise else 0.0, 0.0)


@pytest.mark.parametrize("delay", [0, 1, 2])
@pytest.mark.parametrize("noise", [0.0, 0.4 * GRID])
def test_the_charge_covers_the_error_in_the_work(delay: int, noise: float) -> None:
    """A spring and damper on noisy angles, a shaken arm: true work minus measured work stays below the charge."""
    rng = np.random.default_rng(delay)
    n, cycles = 3, 3000
    compliance = np.zeros(n)
    error = sensing_error(sensors(noise), compliance, np.full(n, 2.0), latency=0.0)
    s = settings_of(
        n,
        delay=delay,
        compliance=compliance,
        sensing_error=error,
        sensing_deviation=sensing_deviation(sensors(noise), compliance),
        initial=400.0,
        max=500.0,
        speed_bound=np.full(n, 50.0),
    )
    stiffness, damping = 40.0, 4.0
    frequency, phase = rng.uniform(0.2, 2.0, n), rng.uniform(0, 6, n)

    def angle(k: int) -> np.ndarray:
        return 0.05 * np.sin(2 * np.pi * frequency * k * s.period + phase)

    def reading(k: int) -> np.ndarray:
        return np.round((angle(k) + noise * rng.standard_normal(n)) / GRID) * GRID

    q = reading(0)
    tank = filled_tank(s, q, np.zeros(n), 0.0)
    true_work, last, speed = 0.0, q, np.zeros(n)
    worst = -np.inf
    for k in range(1, cycles):
        acting = tank.pending[0].copy()
        true_work += float(acting @ (angle(k) - angle(k - 1)))
        q = reading(k)
        speed += 0.1 * ((q - last) / s.period - speed)
        last = q
        measure(tank, q, np.zeros(n), 0.0)
        rescale_springs(tank)
        end = float(np.abs(tank.applied) @ error)
        worst = max(worst, true_work - tank.work - tank.charged - end)
        limited(tank, -stiffness * q - damping * speed)
    assert worst <= 1e-9


def test_white_sensors_cost_a_small_part_of_the_worst_case() -> None:
    rng = np.random.default_rng(1)
    n = 7
    compliance = np.full(n, 1 / 843)
    found = sensing_deviation(sensors(0.4 * GRID), compliance)
    assert found is not None
    error = sensing_error(sensors(0.4 * GRID), compliance, np.full(n, 2.0), latency=0.0)
    white = settings_of(n, compliance=compliance, sensing_error=error, sensing_deviation=found)
    worst = settings_of(n, compliance=compliance, sensing_error=error, sensing_deviation=None)
    charged = []
    for s in (white, worst):
        tank = still_tank(s)
        for _ in range(2000):
            measure(tank, np.zeros(n), np.zeros(n), 0.0)
            limited(tank, 0.05 * rng.standard_normal(n))
        charged.append(tank.charged)
    assert 0.0 < charged[0] < 0.1 * charged[1]


def test_a_grid_coarser_than_its_noise_is_not_called_white() -> None:
    assert sensing_deviation(sensors(0.2 * GRID), np.zeros(2)) is None
    assert sensing_deviation(sensors(0.0), np.zeros(2)) is None


def test_the_deviation_of_a_white_error_is_that_of_noisy_rounded_readings() -> None:
    rng = np.random.default_rng(2)
    grid = 0.2
    spec = SensorSpec(GRID, grid, 0.5 * GRID, 0.5 * grid, 0.0)
    compliance = np.array([0.0, 1 / 843])
    found = sensing_deviation(spec, compliance)
    assert found is not None
    q, effort = rng.uniform(-1, 1, 40_000), rng.uniform(-20, 20, 40_000)
    read_q = np.round((q + 0.5 * GRID * rng.standard_normal(q.size)) / GRID) * GRID
    read_effort = np.round((effort + 0.5 * grid * rng.standard_normal(q.size)) / grid) * grid
    for deviation, twist in zip(found, compliance, strict=True):
        assert np.std(read_q - q + twist * (read_effort - effort)) == pytest.approx(deviation, rel=0.02)
