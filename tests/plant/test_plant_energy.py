# SPDX-License-Identifier: BSD-3-Clause
"""The plant creates no energy: drift of free arms, deflected springs, free fall; balance with everything."""

from itertools import pairwise

import numpy as np
import pytest

from impedance_modules.plant.plant import Plant
from tests.support.plant_parts import (
    BAXTER,
    SIX_JOINTS,
    WEIGHTLESS,
    exact,
    idle,
    in_both_hands,
    middle,
    plane,
    plant,
    posture,
    spec_of,
    started,
    undamped,
)

SECONDS = 10


def pass_time(subject: Plant, periods: int) -> None:
    silence = np.zeros(subject.model.n)
    for _ in range(periods):
        subject.advance(silence)


@pytest.mark.parametrize(("folder", "seed"), [(BAXTER, 0), (BAXTER, 1), (SIX_JOINTS, 2)])
def test_moving_links_with_rotors_co_moving_keep_their_energy(folder, seed) -> None:
    """Random link velocities up to 1 rad/s for 10 s: drift below 1e-6 of E_0."""
    subject = started(undamped(spec_of(folder)), at=middle, gravity=WEIGHTLESS)
    n = subject.model.n
    subject.place(np.random.default_rng(seed).uniform(-1.0, 1.0, n), np.zeros(n))
    before = subject.energy()
    pass_time(subject, 1000 * SECONDS)
    drift = subject.energy().stored / before.stored - 1.0
    print(f"{folder.name} seed {seed}: E_0 {before.stored:.3f} J, drift {drift:.2e} of E_0 in {SECONDS} s")
    assert before.stored > 0.5
    assert abs(drift) < 1e-6
    assert subject.motor_work == 0.0


def spring_loss(step: float, seconds: float) -> float:
    """Share of E_0 lost by springs deflected 0.02 rad."""
    subject = started(undamped(spec_of(BAXTER)), at=middle, gravity=WEIGHTLESS, step=step)
    subject.place(np.zeros(subject.model.n), np.full(subject.model.n, 0.02))
    before = subject.energy().stored
    pass_time(subject, round(1000 * seconds))
    return 1.0 - subject.energy().stored / before


def test_deflected_springs_lose_little_and_by_the_methods_order() -> None:
    """Below 2 % in 10 s at 0.25 ms; a fourth-order method damps an oscillation by h^5: 32 times less."""
    whole = spring_loss(0.25e-3, SECONDS)
    losses = [spring_loss(step, 1.0) for step in (0.5e-3, 0.25e-3, 0.125e-3)]
    ratios = [coarse / fine for coarse, fine in pairwise(losses)]
    print(f"springs deflected 0.02 rad: {whole:.2e} of E_0 lost in {SECONDS} s; halving the step: x {ratios}")
    assert abs(whole) < 0.02
    assert all(ratio > 2.0**4 for ratio in ratios)


def test_motion_converges_with_the_fourth_order() -> None:
    """Arms that fall, swing and vibrate: halving the step divides the change of the state by about 16."""
    states = []
    for step in (0.5e-3, 0.25e-3, 0.125e-3):
        subject = started(undamped(spec_of(BAXTER)), step=step)
        subject.place(np.linspace(-1.0, 1.0, subject.model.n), np.full(subject.model.n, 0.005))
        pass_time(subject, 50)
        states.append(np.concatenate([subject.position, subject.motor_position]))
    changes = [np.linalg.norm(fine - coarse) for coarse, fine in pairwise(states)]
    print(f"changes of the state {changes}: x {changes[0] / changes[1]:.1f}")
    assert 13.0 < changes[0] / changes[1] < 32.0


def test_free_fall_keeps_its_energy() -> None:
    """All arms fall for 10 s: drift below 1e-4 of the largest kinetic energy."""
    subject = started(undamped(spec_of(BAXTER)))
    before = subject.energy()
    largest = 0.0
    for _ in range(100 * SECONDS):
        pass_time(subject, 10)
        largest = max(largest, subject.energy().kinetic)
    drift = (subject.energy().stored - before.stored) / largest
    print(f"free fall: largest kinetic energy {largest:.1f} J, drift {drift:.2e} of it")
    assert largest > 10.0
    assert abs(drift) < 1e-4


@pytest.mark.parametrize("grasp", ["weld", "friction"])
def test_the_energy_balance_closes_with_contact_grasp_and_damping(grasp) -> None:
    """A box pressed on a table, rubbed along it and lifted: what came in is stored or dissipated."""
    spec = exact(spec_of(BAXTER))
    held = in_both_hands(spec, grasp=grasp, friction=0.6 if grasp == "friction" else None, squeeze=15.0)
    bare = plant(spec)
    table = float(bare.model.pose(posture(bare.model), bare.frames[0]).translation[2]) - 0.105
    subject = started(spec, [plane(table)], held)
    start = posture(subject.model)
    before = subject.energy()
    bias = np.full(subject.model.n, 10.0)
    jacobian = sum(subject.state.jacobian.copy())
    pressed = 0.0
    for k in range(1500):
        t = 1e-3 * k
        force = np.array([0.0, 6.0 * np.sin(4.0 * t), -15.0 * np.sin(2.0 * t), 0.0, 0.0, 0.0])
        state = subject.sense()
        command = bias * (start - state.position) - state.velocity + jacobian.T @ force
        subject.advance(subject.start_command + command)
        pressed = max(pressed, subject.contact_wrench("object")[2])
    after = subject.energy()
    lost = after.dissipated(before)
    turned_over = sum(lost.values()) + abs(after.command_work) + abs(after.robot_work)
    missing = after.imbalance(before)
    print(f"{grasp}: pressed {pressed:.1f} N; {missing:.1e} J unaccounted of {turned_over:.2f}; {lost}")
    assert pressed > 10.0
    assert lost["contact"] > 1e-3
    assert abs(missing) < 1e-4 * turned_over
    assert all(value > -1e-6 for value in lost.values())


def test_at_rest_nothing_flows() -> None:
    """The start is an equilibrium: with its own command nothing moves and no work is done."""
    spec = exact(spec_of(BAXTER))
    subject = started(spec, held=in_both_hands(spec, squeeze=15.0))
    before = subject.energy()
    idle(subject, 200)
    after = subject.energy()
    assert after.kinetic < 1e-12
    assert abs(after.stored - before.stored) < 1e-9
