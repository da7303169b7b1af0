# SPDX-License-Identifier: BSD-3-Clause
"""Wood: its texture conserves energy, its roughness wears by friction's work, its splinters hold and break."""

import numpy as np
import pytest

from impedance_modules.plant.plant import Plant
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import RoughnessSpec, SplintersSpec, WoodSpec
from tests.support.plant_parts import (
    BAXTER,
    block,
    exact,
    idle,
    loose,
    place_object,
    posture,
    spec_of,
    started,
)

MASS = 0.8
ROUGH = RoughnessSpec(height=4e-4, wavelength=0.02, friction=0.4, wear=500.0)


def on_wood(
    wood: WoodSpec, shape: str = "box", angle: float = 0.0, velocity: float = 0.0, **surface: float
) -> Plant:
    """An object on a piece of wood, 0.9 m x 0.6 m, tilted about y; nobody holds it."""
    tilt = exp3(np.array([0.0, angle, 0.0]))
    numbers = {"stiffness": 20000.0, "damping": 50.0, "friction": 0.2, **surface}
    middle = np.array([0.0, 3.0, 0.0])
    board = block(tuple(middle), (0.9, 0.6, 0.1), rotation=(0.0, angle, 0.0), wood=wood, **numbers)
    size = {"box": (0.1, 0.1, 0.04), "sphere": (0.04,)}[shape]
    subject = started(exact(spec_of(BAXTER)), [board], loose(shape=shape, size=size, mass=MASS))
    along, normal = tilt[:, 0], tilt[:, 2]
    start = middle - 0.25 * along + 0.0702 * normal
    place_object(subject, Pose(tilt, start), np.concatenate([velocity * along, np.zeros(3)]))
    return subject


@pytest.mark.parametrize("seed", [1, 2])
def test_a_slippery_texture_shakes_and_keeps_the_energy(seed) -> None:
    """Over frictionless hills: what climbing takes, going down gives back."""
    wood = WoodSpec(seed, RoughnessSpec(2e-3, 0.03, 0.0, 500.0), None)
    subject = on_wood(wood, "sphere", velocity=0.5, friction=0.0, damping=0.0)
    before = subject.energy()
    wrench = np.array(idle(subject, 800))
    after = subject.energy()
    stored = [book.body + book.gravity + book.contact for book in (before, after)]
    moved = 0.5 * MASS * 0.25
    assert np.ptp(wrench[:, 0]) > 0.5
    assert abs(stored[1] - stored[0]) < 5e-3 * moved


def test_rough_wood_rubs_harder_and_wears_by_the_work_done_on_it() -> None:
    subject = on_wood(WoodSpec(3, ROUGH, None), velocity=1.2)
    before = subject.energy()
    wrench = np.array(idle(subject, 200))
    after = subject.energy()
    state = subject.woods[0]
    worn = -np.log(state.remaining).sum() * ROUGH.wear * 0.01**2
    lost = after.dissipated(before)["contact"]
    # Nearly all contact loss is rubbing; the rest is bouncing and the bristles' damping.
    assert worn == pytest.approx(state.rubbed, rel=1e-9)
    assert 0.7 * lost < state.rubbed < lost
    assert state.remaining.min() < 0.8 and state.remaining.max() == 1.0
    ratio = -wrench[20:120, 0].sum() / wrench[20:120, 2].sum()
    assert 0.45 < ratio < 0.2 + 0.4 + 0.01


def test_worn_wood_is_the_smooth_wood_below() -> None:
    """With everything worn off, it slides as on a bare box."""
    fragile = RoughnessSpec(height=4e-4, wavelength=0.02, friction=0.4, wear=1e-3)
    subject = on_wood(WoodSpec(3, fragile, None), velocity=1.0, damping=500.0)
    wrench = np.array(idle(subject, 200))
    ratio = -wrench[100:, 0].sum() / wrench[100:, 2].sum()
    assert ratio == pytest.approx(0.2, abs=0.02)


def test_splinters_hold_what_friction_cannot_are_damaged_by_the_law_and_break_for_good() -> None:
    """A box on a slope, all corners caught: D is the integral of exp(10 (f / F - 1)) / T along the run."""
    force, endurance, angle = 1.2, 0.2, 0.42
    wood = WoodSpec(5, None, SplintersSpec(400.0, (force, force), endurance, 0.04))
    subject = on_wood(wood, angle=angle, friction=0.1, damping=300.0)
    start = subject.object_pose.translation
    contacts, damage, first = subject.state.contacts, {}, None
    before = subject.energy()
    for period in range(3000):
        idle(subject, 1)
        for contact in contacts[contacts["splinter"] >= 0]:
            bound = 0.1 * contact["normal_force"]
            load = 2e4 * float(np.linalg.norm(contact["stretch"])) - bound
            held = int(contact["splinter"])
            if load > 0.0:
                damage[held] = damage.get(held, 0.0) + 1e-3 / endurance * np.exp(10.0 * (load / force - 1.0))
        if subject.woods[0].broken and first is None:
            first = period
            break
        crept = float(np.linalg.norm(subject.object_pose.translation - start))
    state = subject.woods[0]
    largest = max(damage.values())
    assert first is not None and 100 < first < 2900
    assert crept < 2e-3
    assert largest == pytest.approx(1.0, abs=0.1)
    idle(subject, 1500)
    after, end = subject.energy(), subject.woods[0]
    lost = after.dissipated(before)["contact"]
    assert end.broken > state.broken and end.standing + end.broken == state.standing + state.broken
    assert 0.0 < end.broken_work < lost
    assert abs(after.imbalance(before)) < 1e-3 * lost


def test_a_seed_is_a_piece_of_wood_and_reset_makes_it_fresh() -> None:
    splinters = SplintersSpec(300.0, (1.0, 5.0), 0.2, 0.02)
    ends = []
    for seed in (7, 7, 8):
        subject = on_wood(WoodSpec(seed, ROUGH, splinters), velocity=1.0)
        idle(subject, 100)
        ends.append(subject.state.start.whole.copy())
    np.testing.assert_array_equal(ends[0], ends[1])
    assert not np.array_equal(ends[0], ends[2])
    assert subject.woods[0].rubbed > 0.0
    subject.reset(posture(subject.model))
    fresh = subject.woods[0]
    assert fresh.rubbed == fresh.broken == 0.0 and fresh.remaining.min() == 1.0
