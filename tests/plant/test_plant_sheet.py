# SPDX-License-Identifier: BSD-3-Clause
"""A flexible sheet: it bends as a beam does, presses along the gradient of its energy, and conserves it."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.plant.sheet import Sheet
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.task import SheetSpec, SurfaceSpec
from tests.support.plant_parts import BAXTER, exact, idle, loose, place_object, posture, spec_of, started

HILLS = (
    (-0.4, 0.0), (-0.38, 0.0), (-0.1, 0.0), (0.0, 0.025), (0.03, 0.025), (0.2, 0.05), (0.25, 0.05), (0.5, 0.0),
)  # fmt: skip


def surface(sheet: SheetSpec, **numbers: float) -> SurfaceSpec:
    values = {"stiffness": 20000.0, "damping": 0.0, "friction": 0.0, **numbers}
    turned = (0.0, 0.1, 0.7)
    return SurfaceSpec("sheet", None, (0.3, 3.0, 0.2), turned, None, **values, sheet=sheet)


def by_finite_elements(sheet: SheetSpec, x: float, elements: int = 60) -> tuple[float, float]:
    """Height at rest and compliance at x from a Hermite beam, its supports as constraints: nothing shared with ours."""
    at, height = np.array(sheet.supports).T
    nodes = np.unique(np.concatenate([np.linspace(at[0], at[-1], elements), at, [x]]))
    stiffness = np.zeros((2 * nodes.size, 2 * nodes.size))
    for i, h in enumerate(np.diff(nodes)):
        local = np.array(
            [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
             [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
        )  # fmt: skip
        stiffness[2 * i : 2 * i + 4, 2 * i : 2 * i + 4] += sheet.bending_stiffness / h**3 * local
    held = 2 * np.searchsorted(nodes, at)
    free = np.setdiff1d(np.arange(2 * nodes.size), held)
    place = int(2 * np.searchsorted(nodes, x))
    shape = np.zeros(2 * nodes.size)
    shape[held] = height
    shape[free] = np.linalg.solve(stiffness[np.ix_(free, free)], -stiffness[np.ix_(free, held)] @ height)
    give = 0.0
    if place in free:
        load = (free == place).astype(float)
        give = float(load @ np.linalg.solve(stiffness[np.ix_(free, free)], load))
    return float(shape[place]), give


def test_it_rests_and_gives_as_a_beam_over_its_supports() -> None:
    random = np.random.default_rng(0)
    for _ in range(20):
        count = int(random.integers(2, 8))
        at = np.cumsum(random.uniform(0.02, 0.3, count))
        supports = tuple(zip(at, random.uniform(0.0, 0.02, count), strict=True))
        sheet = SheetSpec(supports, 0.3, 10.0 ** random.uniform(-1, 2))
        ours = Sheet(sheet)
        x = float(random.uniform(at[0], at[-1]))
        point = ours.point(x)
        height, give = by_finite_elements(sheet, x)
        assert point.height == pytest.approx(height, abs=1e-7)
        assert point.compliance == pytest.approx(give, rel=1e-5, abs=1e-10)
        # A simple beam where there is one span, pressed in its middle: L^3 / 48 EI.
        if count == 2:
            middle = ours.point(float(at.mean()))
            assert middle.compliance == pytest.approx((at[1] - at[0]) ** 3 / 48.0 / sheet.bending_stiffness)


def test_its_force_is_the_gradient_of_its_energy_and_normal_to_the_bent_sheet() -> None:
    sheet, stiffness, random = Sheet(SheetSpec(HILLS, 0.3, 2.0)), 5000.0, np.random.default_rng(1)

    def energy(local: np.ndarray) -> float:
        point = sheet.point(local[0])
        return 0.5 * (point.height - local[2]) ** 2 / (1.0 / stiffness + point.compliance)

    for _ in range(50):
        x = random.uniform(-0.39, 0.49)
        local = np.array([x, 0.0, sheet.point(x).height - random.uniform(1e-4, 0.02)])
        force = sheet.force(local, stiffness)
        step = 1e-6 * np.eye(3)
        slope = [(energy(local + d) - energy(local - d)) / 2e-6 for d in step[[0, 2]]]
        most = np.abs(force).max()
        np.testing.assert_allclose(force[[0, 2]], np.negative(slope), rtol=1e-4, atol=1e-4 * most)
        point = sheet.point(x)
        # The bent sheet's own slope under the load: f c'/2 less steep than at rest where the give grows.
        bent = point.slope - 0.5 * force[2] * point.change
        assert force[0] == pytest.approx(-force[2] * bent, abs=1e-9)
    assert sheet.force(np.array([0.1, 0.2, -0.1]), stiffness) is None
    assert sheet.force(np.array([0.6, 0.0, -0.1]), stiffness) is None


def thrown(sheet: SheetSpec, velocity: float, **numbers: float):
    """A ball on the sheet's left end, thrown along it."""
    ground = surface(sheet, **numbers)
    ball = loose(shape="sphere", size=(0.002,), mass=0.5)
    subject = started(exact(spec_of(BAXTER)), [ground], ball)
    turn = np.array(subject.state.surfaces[0]["rotation"])
    at = np.array(ground.position) + turn @ np.array([-0.3, 0.0, Sheet(sheet).point(-0.3).height + 0.0009])
    place_object(subject, Pose(np.eye(3), at), np.append(turn @ [velocity, 0.0, 0.0], np.zeros(3)))
    return subject, turn, ground


def test_without_damping_and_friction_sliding_over_hills_conserves_energy() -> None:
    subject, turn, ground = thrown(SheetSpec(HILLS, 0.4, 3.0), 1.6)
    before = subject.energy()
    deepest, reached = 0.0, -1.0
    for _ in range(500):
        subject.advance(subject.start_command)
        book = subject.energy()
        deepest = max(deepest, book.contact)
        local = turn.T @ (subject.object_pose.translation - np.array(ground.position))
        reached = max(reached, local[0])
        if local[0] > 0.45:
            break
    lost = subject.energy().dissipated(before)["contact"]
    assert reached > 0.45 and deepest > 1e-3
    assert abs(lost) < 1e-5 * before.body
    assert abs(book.imbalance(before)) < 1e-5 * before.body


def test_damping_and_friction_only_take() -> None:
    subject, _, _ = thrown(SheetSpec(HILLS, 0.4, 3.0), 1.0, damping=20.0, friction=0.3)
    before, last = subject.energy(), 0.0
    for _ in range(60):
        subject.advance(subject.start_command)
        lost = subject.energy().dissipated(before)["contact"]
        assert lost >= last - 1e-6
        last = lost
    assert last > 0.02


def test_a_resting_weight_sinks_by_its_compliance_and_a_sheet_is_not_felt_from_below() -> None:
    spec = SheetSpec(((0.0, 0.0), (0.4, 0.0)), 0.3, 2.0)
    level = {"rotation": (0.0, 0.0, 0.0), "position": (0.0, 3.0, 0.0), "friction": 0.5}
    ground = replace(surface(spec, damping=20.0), **level)
    subject = started(exact(spec_of(BAXTER)), [ground], loose(shape="sphere", size=(0.02,), mass=1.0))
    for above in (True, False):
        subject.reset(posture(subject.model))
        place = np.array([0.2, 3.0, 0.011 if above else -0.05])
        place_object(subject, Pose(np.eye(3), place), np.zeros(6))
        idle(subject, 1500 if above else 50)
        sunk = 0.01 - subject.object_pose.translation[2]
        if above:
            assert sunk == pytest.approx(9.81 * (1.0 / 20000.0 + 0.4**3 / 48.0 / 2.0), rel=0.01)
        else:
            assert np.abs(subject.contact_wrench("object")).max() == 0.0
