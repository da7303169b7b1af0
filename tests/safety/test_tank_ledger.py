# SPDX-License-Identifier: BSD-3-Clause
"""The ledger against sums over a run's whole history: measured and missed cycles, moved springs, a stop."""

import numpy as np
import pytest

from impedance_modules.safety.tank import (
    Tank,
    measure,
    missed,
    release_springs,
    rescale_springs,
)
from impedance_modules.safety.tank_settings import TankSettings
from tests.reference.tank_ledger import History
from tests.support.tank_worlds import admit_part, filled_tank, limited, settings_of

Random = np.random.Generator

pytestmark = pytest.mark.usefixtures("ways")


def random_settings(random: Random) -> TankSettings:
    n = int(random.integers(1, 8))
    compliance = np.where(random.random(n) < 0.3, 0.0, random.uniform(1e-3, 5e-3, n))
    error = random.choice([0.0, 1e-4, 1e-3]) * random.uniform(0.5, 1.0, n)
    return settings_of(
        n,
        delay=int(random.integers(0, 4)),
        hold=0.002 * int(random.integers(1, 4)),
        compliance=compliance,
        speed_bound=random.uniform(0.5, 4.0, n),
        sensing_error=error,
        sensing_deviation=0.2 * error if random.random() < 0.5 else None,
        initial=float(random.uniform(0.6, 4.0)),
        recovery_time=float(random.choice([0.001, 0.05, 0.5])),
    )


def history_of(s: TankSettings, theta: np.ndarray, potential: float) -> History:
    idle = [np.zeros_like(theta) for _ in range(s.delay)]
    sensing = (s.speed_bound, s.sensing_error, s.sensing_deviation)
    return History(s.period, s.max, *sensing, s.initial, potential, theta, idle)


def agree(tank: Tank, history: History) -> None:
    assert tank.level == pytest.approx(history.level, rel=1e-9, abs=1e-9)
    assert tank.work == pytest.approx(history.work, rel=1e-9, abs=1e-9)
    assert tank.charged == pytest.approx(sum(history.charges), rel=1e-9, abs=1e-12)
    assert tank.spilled == pytest.approx(sum(history.spills), rel=1e-9, abs=1e-9)
    assert tank.level <= tank.max + 1e-12


def run(seed: int, cycles: int = 120) -> set[str]:
    """A random run; returns what happened in it."""
    random = np.random.default_rng(seed)
    s = random_settings(random)
    n, seen = s.speed_bound.size, set()
    q, effort = random.normal(size=n), random.normal(size=n)
    tank = filled_tank(s, q, effort, float(random.uniform(0.0, 2.0)))
    history = history_of(s, q + effort * s.compliance, tank.potential)
    size, shaken = 10.0 ** random.uniform(-1.0, 1.5), float(random.uniform(0.0, 0.3))
    stop_at = int(cycles * random.uniform(0.6, 1.0))
    for k in range(cycles):
        stopped = k >= stop_at
        if k == stop_at:
            release_springs(tank)
            history.scale = history.potential = 0.0
        if k and random.random() < 0.15:
            missed(tank)
            history.miss()
            agree(tank, history)
            if stopped:
                history.command(limited(tank, size * random.normal(size=n), stopping=True))
            seen.add("missed")
            continue
        if k:
            q = q + random.uniform(-1.05, 1.05, n) * s.speed_bound * s.period * random.random()
            sensed = effort + 0.1 * random.normal(size=n)
            potential = 0.0 if stopped else max(0.0, tank.potential + shaken * random.normal())
            measure(tank, q, sensed, potential)
            history.measure(q + sensed * s.compliance, potential)
            agree(tank, history)
        if not stopped:
            here, there = tank.potential, float(random.uniform(0.0, 3.0)) * (random.random() < 0.5)
            part = admit_part(tank, lambda part, a=here, b=there: a + part**2 * (b - a))
            history.potential = here + part**2 * (there - here)
            history.spill()
            agree(tank, history)
            before = tank.spring_scale
            rescale_springs(tank)
            history.scale = tank.spring_scale
            agree(tank, history)
            seen |= {"relaxed"} if tank.spring_scale < before else set()
            seen |= {"tightened"} if tank.spring_scale > before else set()
        wanted = size * random.normal(size=n)
        sent = limited(tank, wanted, stopping=stopped)
        history.command(sent)
        seen.add("scaled" if not np.array_equal(sent, wanted) else "untouched")
    return seen


@pytest.mark.parametrize("block", range(3))
def test_the_ledger_is_the_sum_over_the_history(block: int) -> None:
    seen: set[str] = set()
    for seed in range(12):
        seen |= run(100 * block + seed)
    assert seen == {"missed", "relaxed", "tightened", "scaled", "untouched"}
