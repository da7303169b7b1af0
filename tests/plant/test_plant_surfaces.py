# SPDX-License-Identifier: BSD-3-Clause
"""A body on round surfaces and meshes: forces have a potential, damping only takes, no frame is special."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.plant.surfaces import SurfaceShape
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3, log3
from tests.support.closed_meshes import SHAPES, block_under, surface
from tests.support.plant_parts import BAXTER, WEIGHTLESS, exact, idle, loose, place_object, spec_of, started

ROBOT = exact(spec_of(BAXTER))
EVERY_SHAPE = pytest.mark.parametrize("kind", SHAPES)

BOWL = np.linspace(-0.2, 0.2, 21)
HOLLOWS = {
    "cylinder": (replace(SHAPES["cylinder"], rotation=(0.0, np.pi / 2, 0.0)), (0.0, 0.0005, 0.1008), (0.1, 0.0, 0.0)),
    "sphere": (SHAPES["sphere"], (0.001, 0.0, 0.1008), (0.0, 0.05, 0.0)),
    "saddle": (SHAPES["saddle"], (0.0, 0.0, 0.0011), (0.3, 0.0, 0.0)),
    "mesh": (
        surface("mesh", mesh=block_under((BOWL[:, None] ** 2 + BOWL**2) / 0.4, BOWL, BOWL, -0.05)),
        (0.101, 0.003, 0.0296),
        (0.0, 0.3, 0.0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", HOLLOWS)
def test_without_damping_and_friction_a_slide_neither_gains_nor_loses(kind) -> None:
    """A ball slides along a pipe, down a sphere, along a saddle, and round and round in a bowl of facets."""
    ground, place, velocity = HOLLOWS[kind]
    subject = started(ROBOT, [ground], loose(shape="sphere", size=(0.002,), mass=0.5))
    at = np.array(ground.position) + place
    place_object(subject, Pose(np.eye(3), at), np.array([*velocity, 0.0, 0.0, 0.0]))
    before, touched, worst = subject.energy(), 0, 0.0
    for _ in range(800):
        subject.advance(subject.start_command)
        book = subject.energy()
        touched += book.contact > 0.0
        worst = max(worst, abs(book.dissipated(before)["contact"]))
        if subject.object_pose.translation[2] < 0.2 and kind != "mesh":
            break
    assert touched > 100
    # A step that ends behind an edge of facets took the force of the facet before: a little more, or a little less.
    assert worst < (1e-3 if kind == "mesh" else 3e-5) * (book.kinetic + book.contact + 0.1)
    assert abs(book.imbalance(before)) < 1e-5


@EVERY_SHAPE
def test_damping_and_friction_only_take(kind) -> None:
    ground, place, velocity = HOLLOWS[kind]
    rough = replace(ground, damping=30.0, friction=0.3)
    subject = started(ROBOT, [rough], loose(shape="sphere", size=(0.002,), mass=0.5))
    at = np.array(rough.position) + place
    place_object(subject, Pose(np.eye(3), at), np.array([*velocity, 0.0, 0.0, 0.0]))
    before, last = subject.energy(), 0.0
    for _ in range(60):
        idle(subject, 5)
        lost = subject.energy().dissipated(before)["contact"]
        assert lost >= last - 2e-6
        last = lost
    assert last > 1e-4


@EVERY_SHAPE
def test_surface_and_ball_moved_together_do_the_same(kind) -> None:
    """Without weight: the same blow in another place and direction, with friction and damping."""
    rng, ends = np.random.default_rng(8), []
    turn, shift = exp3(np.array([0.4, -0.7, 1.1])), np.array([0.3, 1.0, -0.2])
    shape = SurfaceShape(SHAPES[kind])
    start = 0.5 * (shape.low + shape.high) + np.array([0.01, 0.02, 0.5 * (shape.high - shape.low)[2] + 0.003])
    velocity, spin = np.array([0.2, 0.1, -0.5]), rng.normal(size=3)
    for R, t in ((np.eye(3), np.zeros(3)), (turn, shift)):
        origin = R @ np.array([0.0, 3.0, 0.2]) + t
        ground = replace(
            SHAPES[kind], position=tuple(origin), rotation=tuple(log3(R)), damping=20.0, friction=0.4
        )
        subject = started(ROBOT, [ground], loose(shape="sphere", size=(0.004,)), gravity=WEIGHTLESS)
        place_object(subject, Pose(R, origin + R @ start), np.concatenate([R @ velocity, R @ spin]))
        pushed = 0.0
        for _ in range(400):
            subject.advance(subject.start_command)
            pushed = max(pushed, float(np.linalg.norm(subject.contact_wrench("object")[:3])))
        assert pushed > 10.0
        twist = subject.object_twist
        ends.append([R.T @ (subject.object_pose.translation - origin), R.T @ twist[:3], R.T @ twist[3:]])
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-6, atol=1e-8)


def test_a_saddle_is_not_felt_from_below_nor_beside() -> None:
    ground = SHAPES["saddle"]
    subject = started(ROBOT, [ground], loose(shape="sphere", size=(0.002,)), gravity=WEIGHTLESS)
    for place, way in (((0.05, 0.0, -0.03), (0.0, 0.0, 0.3)), ((-0.25, 0.0, 0.01), (0.4, 0.0, 0.0))):
        at = np.array(ground.position) + place
        place_object(subject, Pose(np.eye(3), at), np.array([*way, 0.0, 0.0, 0.0]))
        wrenches = idle(subject, 60)
        assert not np.any(wrenches)
