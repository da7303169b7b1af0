# SPDX-License-Identifier: BSD-3-Clause
"""Contact: weight is carried, friction sticks below mu N and slides at mu N, nothing is ever pulled."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from tests.support.plant_parts import (
    BAXTER,
    block,
    exact,
    idle,
    loose,
    place_object,
    plane,
    plant,
    posture,
    spec_of,
    started,
)

G = 9.81
STILL = np.zeros(6)
ROBOT = exact(spec_of(BAXTER))


def on_slope(
    angle: float, shape: str = "box", mass: float = 1.2, **surface: float
) -> tuple[Plant, np.ndarray]:
    """An object at rest on a plane tilted about y, already as deep as its weight asks; and the normal."""
    tilt = exp3(np.array([0.0, angle, 0.0]))
    normal = tilt[:, 2]
    numbers = {"stiffness": 20000.0, "damping": 50.0, "friction": 0.3, **surface}
    size = {"box": (0.3, 0.2, 0.2), "cylinder": (0.2, 0.2), "sphere": (0.2,)}[shape]
    points = {"box": 4, "cylinder": 8, "sphere": 1}[shape]
    slope = plane(0.0, rotation=(0.0, angle, 0.0), **numbers)
    subject = started(ROBOT, [slope], loose(shape=shape, size=size, mass=mass))
    depth = mass * G * np.cos(angle) / (numbers["stiffness"] * points)
    # At the foot of the world's z axis, far from the robot's hands.
    place = 3.0 * tilt[:, 1] + (0.1 - depth) * normal
    place_object(subject, Pose(tilt, place), STILL)
    return subject, normal


@pytest.mark.parametrize("shape", ["box", "cylinder", "sphere"])
def test_a_dropped_mass_comes_to_rest_on_its_weight(shape) -> None:
    subject, _ = on_slope(0.0, shape, mass=0.8)
    place_object(subject, Pose(np.eye(3), np.array([0.0, 3.0, 0.12])), STILL)
    forces = idle(subject, 1500)
    wrench = forces[-1]
    peak = max(force[2] for force in forces)
    assert wrench[2] == pytest.approx(0.8 * G, rel=1e-3)
    assert peak > 2.0 * 0.8 * G
    assert np.abs(wrench[[0, 1, 3, 4, 5]]).max() < 1e-2
    assert np.linalg.norm(subject.object_twist) < 1e-3


@pytest.mark.parametrize("angle", [0.1, 0.25])
def test_it_sticks_below_mu_n(angle) -> None:
    """tan(angle) < mu: after the tangential spring has stretched, nothing creeps."""
    subject, normal = on_slope(angle, friction=0.3)
    idle(subject, 500)
    before = subject.object_pose.translation
    wrench = idle(subject, 1000)[-1]
    crept = np.linalg.norm(subject.object_pose.translation - before)
    along = wrench[:3] - (wrench[:3] @ normal) * normal
    assert np.linalg.norm(along) == pytest.approx(1.2 * G * np.sin(angle), rel=1e-3)
    assert crept < 1e-6


@pytest.mark.parametrize(("angle", "friction"), [(0.5, 0.3), (0.3, 0.1), (0.2, 0.0)])
def test_it_slides_above_mu_n_with_mu_n(angle, friction) -> None:
    """The slope's acceleration is g (sin - mu cos)."""
    subject, normal = on_slope(angle, friction=friction)
    idle(subject, 200)
    start = subject.object_twist[:3]
    wrenches = idle(subject, 300)
    gained = np.linalg.norm(subject.object_twist[:3] - start) / 0.3
    expected = G * (np.sin(angle) - friction * np.cos(angle))
    assert gained == pytest.approx(expected, rel=5e-3)
    for wrench in wrenches[::50]:
        pressure = wrench[:3] @ normal
        along = np.linalg.norm(wrench[:3] - pressure * normal)
        assert along == pytest.approx(friction * pressure, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("damping", [0.0, 500.0])
def test_a_surface_never_pulls(damping) -> None:
    """Even with a damper that would hold on: what leaves is held back by its weight alone."""
    subject, normal = on_slope(0.0, damping=damping)
    place_object(subject, Pose(np.eye(3), np.array([0.0, 3.0, 0.0999])), np.array([0, 0, 1.0, 0, 0, 0]))
    forces = idle(subject, 150)
    assert min(force[:3] @ normal for force in forces) >= 0.0
    # Thrown upwards it only gains from the spring, then falls freely.
    assert subject.object_twist[2] >= 1.0 - G * 0.15 - 1e-9


def test_friction_only_dissipates() -> None:
    subject, _ = on_slope(0.4, friction=0.2)
    before, last = subject.energy(), 0.0
    for _ in range(30):
        idle(subject, 10)
        lost = subject.energy().dissipated(before)["contact"]
        assert lost >= last - 1e-7
        last = lost
    assert last > 0.1


def test_a_box_surface_carries_above_its_top_and_not_beside_it() -> None:
    table = block((0.0, 3.0, 0.4), (1.0, 1.0, 0.2))
    for offset, carried in ((0.0, True), (0.9, False)):
        subject = started(ROBOT, [table], loose(position=(0.0, 3.0, 0.61)))
        place_object(subject, Pose(np.eye(3), np.array([offset, 3.0, 0.6005])), STILL)
        wrench = idle(subject, 400)[-1]
        if carried:
            assert wrench[2] == pytest.approx(1.2 * G, rel=5e-3)
        else:
            assert np.abs(wrench).max() == 0.0
            assert subject.object_twist[2] == pytest.approx(-0.4 * G, rel=1e-6)


def test_a_hand_feels_what_it_presses() -> None:
    """At rest the joints' effort is the weight minus J^T times the surface's wrench on the hand."""
    bare = plant(ROBOT)
    start, hand = posture(bare.model), bare.frames[0]
    height = float(bare.model.pose(start, hand).translation[2]) - 0.005
    subject = started(ROBOT, [plane(height)])
    jacobian = subject.state.jacobian[0].copy()
    for _ in range(3000):
        state = subject.sense()
        back = 20.0 * (start - state.position) - state.velocity
        subject.advance(subject.start_command + back + jacobian.T @ np.array([0.0, 0.0, -20.0, 0, 0, 0]))
    wrench = subject.contact_wrench(hand)
    load = subject.sense().effort - subject.model.gravity(subject.position)
    assert wrench[2] > 10.0
    np.testing.assert_allclose(load, -subject.state.jacobian[0].T @ wrench, atol=0.1)
    assert np.abs(wrench[3:]).max() < 1e-9


def test_an_unknown_surface_is_refused() -> None:
    with pytest.raises(BadInput, match="plane with height"):
        plant(ROBOT, [replace(plane(0.0), surface="sheet")])


def distance_to_box(point: np.ndarray, half: np.ndarray) -> float:
    """Signed distance of a point to a box about the origin, from first principles."""
    beyond = np.abs(point) - half
    return float(np.linalg.norm(np.maximum(beyond, 0.0)) + min(0.0, beyond.max()))


@pytest.mark.parametrize("stride", [3e-5, 3e-4])
def test_distances_follow_a_moving_point_around_an_edge(stride) -> None:
    """Between two questions to coal the surface counts as flat; what that costs is below a micrometre."""
    radius, half = 0.05, np.array([0.5, 0.5, 0.1])
    board = block((0.0, 3.0, 0.4), tuple(2.0 * half))
    subject = started(ROBOT, [board], loose(shape="sphere", size=(2.0 * radius,), position=(0.0, 3.0, 2.0)))
    ball = subject.state.contacts[-1]
    worst = 0.0
    for angle in np.arange(-0.3, np.pi / 2 + 0.3, stride / radius):
        offset = np.array([0.0, 0.5 + 0.049 * np.sin(angle), 0.1 + 0.049 * np.cos(angle)])
        place_object(subject, Pose(np.eye(3), np.array([0.0, 3.0, 0.4]) + offset), STILL)
        subject._integrator.refresh()
        assert ball["near"]
        worst = max(worst, abs(ball["distance"] - (distance_to_box(offset, half) - radius)))
    assert worst < 1e-6


def test_distances_follow_a_point_through_a_box_and_along_its_faces() -> None:
    """Coal is not asked again while one face is nearest; straight lines through a turned box meet all of them."""
    half, turn = np.array([0.03, 0.04, 0.05]), np.array([0.3, -0.2, 0.5])
    place = np.array([0.0, 3.0, 0.4])
    board = block(tuple(place), tuple(2.0 * half), rotation=tuple(turn))
    subject = started(ROBOT, [board], loose(shape="sphere", size=(0.002,), position=(0.0, 3.0, 2.0)))
    ball, rotation, rng = subject.state.contacts[-1], exp3(turn), np.random.default_rng(4)
    asked, near = 0, 0
    for _ in range(20):
        start, end = rng.uniform(-0.06, 0.06, (2, 3))
        for share in np.linspace(0.0, 1.0, 200):
            point = start + share * (end - start)
            place_object(subject, Pose(np.eye(3), place + rotation @ point), STILL)
            subject._integrator.refresh()
            if ball["near"]:
                near, asked = near + 1, asked + int(ball["stale"])
                assert abs(ball["distance"] - (distance_to_box(point, half) - 0.001)) < 1e-6
    assert near > 1000
    assert asked < 0.5 * near
