# SPDX-License-Identifier: BSD-3-Clause
"""Why the ledger counts at the motor: one elastic joint on which ``tau . dq`` certifies what is not passive.

A link M and a rotor I on a spring k, both free. The controller is ``tau = -b dq/dt``: plain damping of the
link, as innocent as a controller gets, and ``tau . dq = -b v^2 dt`` is never positive. In the mode where link
and rotor swing against each other, the torque pushes the rotor the way it goes: the swing grows for ever.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
from scipy.linalg import expm

from impedance_modules.safety.tank import measure, rescale_springs
from tests.support.tank_worlds import filled_tank, limited, settings_of

pytestmark = pytest.mark.usefixtures("ways")

PERIOD = 0.0005


@dataclass(frozen=True)
class Joint:
    """M qdd = k (theta - q), I thetadd = tau - k (theta - q); state (q, theta, dq, dtheta)."""

    link: float
    rotor: float
    stiffness: float

    @cached_property
    def motion(self) -> np.ndarray:
        """The state after a period, from the state and a constant torque; exact."""
        a, b = self.stiffness / self.link, self.stiffness / self.rotor
        rates = [[0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [-a, a, 0, 0, 0], [b, -b, 0, 0, 1 / self.rotor], [0] * 5]
        return expm(PERIOD * np.array(rates))[:4]

    def step(self, x: np.ndarray, tau: float) -> np.ndarray:
        return self.motion @ np.append(x, tau)

    def energy(self, x: np.ndarray) -> float:
        spring = self.stiffness * (x[1] - x[0]) ** 2
        return 0.5 * float(self.link * x[2] ** 2 + self.rotor * x[3] ** 2 + spring)

    def counter_swing(self, speed: float) -> np.ndarray:
        """The mode of zero total momentum: rotor at ``speed``, link against it."""
        return np.array([0.0, 0.0, -speed * self.rotor / self.link, speed])


def swing(joint: Joint, tank: float | None) -> tuple[float, float, list[float]]:
    """Runs the link damper for 4000 cycles; returns link-side work, motor-side work, energies."""
    x, damping = joint.counter_swing(0.2), 4 * joint.link
    settings = settings_of(
        1,
        initial=1.0 if tank is None else tank,
        max=10.0,
        floor=0.0,
        period=PERIOD,
        hold=PERIOD,
        speed_bound=np.array([50.0]),
        compliance=np.array([1 / joint.stiffness]),
        recovery_time=1.0,
    )
    effort = joint.stiffness * (x[1:2] - x[:1])
    ledger = filled_tank(settings, x[:1], effort, 0.0)
    link_work, motor_work, energies = 0.0, 0.0, [joint.energy(x)]
    for k in range(4000):
        if k:
            measure(ledger, x[:1].copy(), joint.stiffness * (x[1:2] - x[:1]), 0.0)
        wanted = np.array([-damping * x[2]])
        if tank is not None:
            rescale_springs(ledger)
            wanted = limited(ledger, wanted)
        before, x = x, joint.step(x, float(wanted[0]))
        link_work += float(wanted[0] * (x[0] - before[0]))
        motor_work += float(wanted[0] * (x[1] - before[1]))
        energies.append(joint.energy(x))
        if tank is not None:
            assert ledger.level >= -1e-9
            assert ledger.work <= tank + 1e-9
    return link_work, motor_work, energies


JOINTS = [Joint(0.3, 0.6, 843.0), Joint(1.5, 0.6, 843.0), Joint(0.02, 0.044, 250.0)]


@pytest.mark.parametrize("joint", JOINTS)
def test_link_side_ledger_certifies_a_controller_that_pumps_energy_in(joint: Joint) -> None:
    link_work, motor_work, energies = swing(joint, None)
    gained = energies[-1] - energies[0]
    assert link_work < 0, "at the link the controller seems to absorb energy all the time"
    assert energies[-1] > 2 * energies[0], "in truth the swing grows"
    assert motor_work == pytest.approx(gained, rel=1e-6), "and the motor port knows exactly by how much"
    assert motor_work > 0 > link_work, "the link-side ledger even has the wrong sign"


@pytest.mark.parametrize("joint", JOINTS)
def test_motor_side_ledger_stops_the_same_controller(joint: Joint) -> None:
    stored = joint.energy(joint.counter_swing(0.2))
    link_work, motor_work, energies = swing(joint, stored)
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
