# SPDX-License-Identifier: BSD-3-Clause
"""Pushes on the plant: their schedule, what they move, and the work they do."""

import numpy as np
import pytest

from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.plant.pushes import push_share, push_wrench
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.task import PushSpec
from tests.support.plant_parts import (
    BAXTER,
    SIX_JOINTS,
    WEIGHTLESS,
    exact,
    in_both_hands,
    middle,
    spec_of,
    undamped,
)


def pushed(spec, pushes, held=None, **options) -> Plant:
    options = PlantOptions(**{"rate": 1000.0, **options}, seed=0, noise=False)
    return Plant(RobotModel(spec), (), held, options, pushes=pushes)


def test_a_push_grows_stays_and_goes_without_a_jump() -> None:
    push = PushSpec("right", (2.0, 0.0, 0.0, 0.0, 0.0, 1.0), start=1.0, rise=0.5, hold=0.4, fall=0.2)
    time = np.arange(0.0, 3.0, 1e-4)
    share = np.array([push_share(push, t) for t in time])
    assert np.all(share[(time < 1.0) | (time > 2.1)] == 0.0)
    assert np.allclose(share[(time > 1.5) & (time < 1.9)], 1.0)
    assert np.max(np.abs(np.diff(share))) < 1.9 / 0.2 * 1e-4
    assert np.sum(share) * 1e-4 == pytest.approx(0.25 + 0.4 + 0.1, rel=1e-6)
    twice = push_wrench([push, push], "right", 1.25)
    np.testing.assert_allclose(twice, [2.0, 0, 0, 0, 0, 1.0])
    assert not np.any(push_wrench([push], "left", 1.25))


def test_a_support_that_is_pulled_away_is_gone_at_once() -> None:
    push = PushSpec("right", (0.0, 0.0, 20.0, 0.0, 0.0, 0.0), start=0.0, rise=0.0, hold=1.0, fall=0.0)
    assert [push_share(push, t) for t in (0.0, 0.5, 0.999, 1.0, 2.0)] == [1.0, 1.0, 1.0, 0.0, 0.0]


@pytest.mark.parametrize("seed", range(3))
def test_a_push_does_the_work_that_the_bodies_gain(seed: int) -> None:
    """Undamped, weightless: all energy in the arms and the object came from the pushes."""
    rng = np.random.default_rng(seed)
    spec = undamped(spec_of(SIX_JOINTS))
    held = in_both_hands(spec, grasp="weld", friction=None, squeeze=0.0) if seed else None
    targets = ["object", "port"] if held else ["port", "starboard"]
    when = {"start": 0.01, "rise": 0.05, "hold": 0.05, "fall": 0.0}
    pushes = [PushSpec(on, tuple(3.0 * rng.normal(size=6)), **when) for on in targets]
    subject = pushed(spec, pushes, held, gravity=WEIGHTLESS)
    subject.reset(middle(subject.model))
    before = subject.energy()
    for _ in range(100):
        subject.advance(np.zeros(subject.model.n))
    after = subject.energy()
    assert after.push_work > 1e-2
    gained = after.stored - before.stored + sum(after.dissipated(before).values())
    assert after.push_work == pytest.approx(gained, rel=2e-4)
    assert abs(after.imbalance(before)) < 2e-4 * after.push_work


def test_a_hand_starts_to_move_as_its_mobility_says() -> None:
    """Pushed for a moment, the hand accelerates by J M^-1 J^T F of the links alone: the rotors lag behind."""
    spec = exact(spec_of(BAXTER))
    force = np.array([3.0, -2.0, 1.0, 0.1, 0.2, -0.1])
    push = PushSpec("left", tuple(force), start=0.0, rise=0.0, hold=1.0, fall=0.0)
    subject = pushed(spec, [push], rate=4000.0)
    q = middle(subject.model)
    subject.reset(q)
    kinematics = Kinematics(subject.model, ("left_hand",))
    kinematics.update(q, np.zeros_like(q))
    jacobian = kinematics.jacobian_of("left_hand")
    links = subject.model.mass_matrix(q) - np.diag(subject.model.reflected_inertia)
    subject.advance(subject.start_command)
    np.testing.assert_array_equal(subject.push_wrench("left_hand"), force)
    gained = jacobian @ subject.velocity * 4000.0
    expected = jacobian @ np.linalg.solve(links, jacobian.T @ force)
    np.testing.assert_allclose(gained, expected, rtol=0.03, atol=0.02 * np.abs(expected).max())
    subject.reset(q)
    assert not subject.push_wrench("left_hand").any()


def test_what_the_plant_does_not_have_cannot_be_pushed() -> None:
    with pytest.raises(BadInput, match=r"called 'object'.*left"):
        pushed(spec_of(BAXTER), [PushSpec("object", (1.0, 0, 0, 0, 0, 0), 0.0, 0.0, 1.0, 0.0)])
