# SPDX-License-Identifier: BSD-3-Clause
"""The claim where motors give s times what is asked, s somewhere in a known interval: on the torque that acts."""

import numpy as np
import pytest

from impedance_modules.safety.tank import measure, missed, rescale_springs
from tests.support.tank_worlds import Wire, filled_tank, limited, random_springs, settings_of

pytestmark = pytest.mark.usefixtures("ways")

EPS = 1e-9


def run(seed: int, *, delay: int, booked: bool, misses: float = 0.0, cycles: int = 250) -> float:
    """Rotors run with or against the torque as they like; returns the least distance to the claim [J].

    ``booked`` False tells the ledger of no gain: the world is the same, the motors give up to a third more.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    least, most = rng.uniform(0.7, 1.0, n), rng.uniform(1.0, 1.35, n)
    true = np.where(rng.random(n) < 0.5, least, most)
    ends = {"least_gain": least, "most_gain": most} if booked else {}
    s = settings_of(n, delay=delay, hold=0.006 if misses else 0.002, **ends)
    springs, q = random_springs(rng, n), rng.normal(size=n)
    tank = filled_tank(s, q, np.zeros(n), springs.potential(q))
    wire, work, v, margin = Wire(delay, n), 0.0, np.zeros(n), np.inf
    gap, command, yielding = 0, np.zeros(n), rng.uniform()
    for k in range(cycles):
        if k and gap < 2 and rng.random() < misses:
            gap += 1
            missed(tank)
            sent = None
        else:
            gap = 0
            if k:
                assert measure(tank, q, np.zeros(n), springs.potential(q)) == n
            rescale_springs(tank)
            margin = min(margin, tank.work_bound - work, tank.level - s.floor if booked else np.inf)
            command = limited(tank, springs.effort(q, v, tank.spring_scale))
            sent = command
        applied, bound = wire.applied(sent), s.speed_bound * s.period
        along = np.where(rng.random(n) < yielding, np.sign(applied), rng.uniform(-1, 1, n))
        work += float((true * applied) @ (along * bound))
        v, q = along * s.speed_bound, q + along * bound
    return margin


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_claim_holds_for_the_torque_that_acts(delay: int) -> None:
    for seed in range(8):
        assert run(100 * delay + seed, delay=delay, booked=True) >= -EPS


def test_the_claim_holds_when_cycles_are_missed() -> None:
    for seed in range(8):
        assert run(500 + seed, delay=1, booked=True, misses=0.2) >= -EPS


def test_a_ledger_that_knows_no_gain_breaks_it() -> None:
    assert min(run(900 + seed, delay=0, booked=False) for seed in range(8)) < -0.01


def test_to_and_fro_costs_nothing_but_the_worst_end() -> None:
    """A constant torque on a rotor that swings: what is booked is that of one gain, not of the worse each way."""
    s = settings_of(1, least_gain=np.array([0.8]), most_gain=np.array([1.2]), compliance=np.zeros(1))
    tank, q = filled_tank(s, np.zeros(1), np.zeros(1), 0.0), np.zeros(1)
    for k in range(400):
        limited(tank, np.array([2.0]))
        q = np.array([0.05 * np.sin(0.05 * (k + 1))])
        measure(tank, q, np.zeros(1), 0.0)
        work = 2.0 * q[0]
        assert tank.work == pytest.approx(max(0.8 * work, 1.2 * work), abs=1e-12)
