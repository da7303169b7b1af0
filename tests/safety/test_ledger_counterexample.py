# SPDX-License-Identifier: BSD-3-Clause
"""Why the ledger counts at the motor: one elastic joint on which ``tau . dq`` certifies what is not passive.

A link M and a rotor I on a spring k, both free. The controller is ``tau = -b dq/dt``: plain damping of the
link, as innocent as a controller gets, and ``tau . dq = -b v^2 dt`` is never positive. In the mode where link
and rotor swing against each other, the torque pushes the rotor the way it goes: the swing grows for ever.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from impedance_modules.safety.tank import TankSettings, measure, rescale_springs
from tests.support.both_ways import ways  # noqa: F401
from tests.support.tank_worlds import filled_tank, limited

pytestmark = pytest.mark.usefixtures("ways")

PERIOD, SUBSTEPS = 0.0005, 4


@dataclass(frozen=True)
class Joint:
    """M qdd = k (theta - q), I thetadd = tau - k (theta - q); state (q, theta, dq, dtheta)."""

    link: float
    rotor: float
    stiffness: float

    def rate(self, x: np.ndarray, tau: float) -> np.ndarray:
        twist = self.stiffness * (x[1] - x[0])
        return np.array([x[2], x[3], twist / self.link, (tau - twist) / self.rotor])

    def step(self, x: np.ndarray, tau: float) -> np.ndarray:
        dt = PERIOD / SUBSTEPS
        for _ in range(SUBSTEPS):
            k1 = self.rate(x, tau)
            k2 = self.rate(x + dt / 2 * k1, tau)
            k3 = self.rate(x + dt / 2 * k2, tau)
            k4 = self.rate(x + dt * k3, tau)
            x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return x

    def energy(self, x: np.ndarray) -> float:
        return 0.5 * float(
            self.link * x[2] ** 2 + self.rotor * x[3] ** 2 + self.stiffness * (x[1] - x[0]) ** 2
        )

    def counter_swing(self, speed: float) -> np.ndarray:
        """The mode of zero total momentum: rotor at ``speed``, link against it."""
        return np.array([0.0, 0.0, -speed * self.rotor / self.link, speed])


def swing(
    joint: Joint, damping: float, cycles: int, tank: float | None
) -> tuple[float, float, float, list[float]]:
    """Runs the link damper; returns the largest link-side step, link-side work, motor-side work, energies."""
    x = joint.counter_swing(0.2)
    settings = TankSettings(
        initial=1.0 if tank is None else tank,
        max=10.0,
        floor=0.0,
        period=PERIOD,
        delay=0,
        hold=PERIOD,
        speed_bound=np.array([50.0]),
        compliance=np.array([1 / joint.stiffness]),
        sensing_error=np.zeros(1),
        sensing_deviation=None,
        recovery_time=1.0,
    )
    effort = joint.stiffness * (x[1:2] - x[:1])
    ledger = filled_tank(settings, x[:1], effort, 0.0)
    worst_step, link_work, motor_work, energies = -np.inf, 0.0, 0.0, [joint.energy(x)]
    for k in range(cycles):
        if k:
            measure(ledger, x[:1].copy(), joint.stiffness * (x[1:2] - x[:1]), 0.0)
        wanted = np.array([-damping * x[2]])
        if tank is not None:
            rescale_springs(ledger)
            wanted = limited(ledger, wanted)
        before, x = x, joint.step(x, float(wanted[0]))
        worst_step = max(worst_step, float(wanted[0] * (x[0] - before[0])))
        link_work += float(wanted[0] * (x[0] - before[0]))
        motor_work += float(wanted[0] * (x[1] - before[1]))
        energies.append(joint.energy(x))
        if tank is not None:
            assert ledger.level >= -1e-9
            assert ledger.work <= tank + 1e-9
    return worst_step, link_work, motor_work, energies


JOINTS = [Joint(0.3, 0.6, 843.0), Joint(1.5, 0.6, 843.0), Joint(0.02, 0.044, 250.0)]


@pytest.mark.parametrize("joint", JOINTS)
def test_link_side_ledger_certifies_a_controller_that_pumps_energy_in(joint: Joint) -> None:
    _, link_work, motor_work, energies = swing(joint, damping=4 * joint.link, cycles=4000, tank=None)
    gained = energies[-1] - energies[0]
    assert link_work < 0, "at the link the controller seems to absorb energy all the time"
    assert energies[-1] > 2 * energies[0], "in truth the swing grows"
    assert motor_work == pytest.approx(gained, rel=1e-6), "and the motor port knows exactly by how much"
    assert motor_work > 0 > link_work, "the link-side ledger even has the wrong sign"


@pytest.mark.parametrize("joint", JOINTS)
def test_motor_side_ledger_stops_the_same_controller(joint: Joint) -> None:
    stored = joint.energy(joint.counter_swing(0.2))
    _, link_work, motor_work, energies = swing(joint, damping=4 * joint.link, cycles=4000, tank=stored)
    assert link_work < 0
    assert motor_work <= stored + 1e-9
    assert max(energies) <= energies[0] + stored + 1e-9
    assert motor_work > 0.5 * stored, "the tank was spent, so it is the tank that stopped it"


def test_the_same_damper_on_the_motor_side_is_passive_and_fills_the_tank() -> None:
    joint = JOINTS[0]
    x = joint.counter_swing(0.2)
    start, work = joint.energy(x), 0.0
    for _ in range(4000):
        before, x = x, joint.step(x, -4 * joint.rotor * x[3])
        work += -4 * joint.rotor * before[3] * (x[1] - before[1])
    assert work < -0.5 * start
    assert joint.energy(x) == pytest.approx(start + work, rel=1e-6)
