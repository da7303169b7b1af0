# SPDX-License-Identifier: BSD-3-Clause
"""A palm on an object: it feels faces and nothing beyond them, slips, lets go, returns, and never gives energy away."""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.plant.grasp import grasp_forces, place_couplings
from impedance_modules.plant.palm import update_slipping_palms
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.rigid_object import (
    SHAPES,
    ObjectState,
    depth_beneath_face,
    half_extent,
    object_motion,
    object_state,
    update_object_rotation,
)
from impedance_modules.robot.rotation import exp3, log3
from tests.reference.plant_equations import depth_and_direction, palm_wrench
from tests.support.both_ways import ways  # noqa: F401 - a fixture
from tests.support.plant_parts import SIX_JOINTS, in_both_hands, loose, middle, plant, spec_of

pytestmark = pytest.mark.usefixtures("ways")
SIZES = {"box": (0.3, 0.2, 0.12), "cylinder": (0.2, 0.3), "sphere": (0.24,)}
STEP = 0.25e-3


def shape(name: str) -> ObjectState:
    return object_state(loose(shape=name, size=SIZES[name]), np.zeros(3))


@pytest.mark.parametrize("name", SHAPES)
def test_depth_is_continuous_and_its_gradient_points_out_of_the_nearest_face(name: str) -> None:
    """Along random lines through the object; at most 1 m/m; below 0 outside; as the plain formula says."""
    rng, body, inward = np.random.default_rng(1), shape(name), np.empty(3)
    half = half_extent(name, SIZES[name])
    for _ in range(60):
        point, margin = rng.uniform(-1.2, 1.2, 3) * half, rng.uniform(-0.005, 0.01)
        depth = depth_beneath_face(body, margin, point, inward)
        expected, direction = depth_and_direction(body, margin, point)
        assert depth == pytest.approx(expected, abs=1e-15)
        np.testing.assert_allclose(inward, direction, atol=1e-12)
        far = depth_beneath_face(body, margin, point + 1e-7 * direction, inward)
        assert far - depth == pytest.approx(1e-7, rel=1e-3) or np.linalg.norm(direction - inward) > 0.1
        other = point + rng.normal(scale=1e-3, size=3)
        assert (
            abs(depth_beneath_face(body, margin, other, inward) - depth)
            <= np.linalg.norm(other - point) + 1e-15
        )
        if np.any(np.abs(point) > half + margin):
            assert depth < 0.0


def test_at_the_centre_some_direction_is_taken() -> None:
    for name in SHAPES:
        inward = np.full(3, np.nan)
        assert depth_beneath_face(shape(name), 0.0, np.zeros(3), inward) == pytest.approx(
            0.5 * min(SIZES[name])
        )
        assert np.linalg.norm(inward) == pytest.approx(1.0)


class Palm:
    """The first hand of a robot, led along a path of our own past an object that moves along another one."""

    def __init__(self, name: str = "box", friction: float = 0.5, **numbers: object) -> None:
        spec = spec_of(SIX_JOINTS)
        held = in_both_hands(
            spec, grasp="friction", friction=friction, shape=name, size=SIZES[name], **numbers
        )
        subject: Plant = plant(spec, held=held)
        subject._start.rest(middle(subject.model))
        self.state = subject.state
        self.state.hands["holds"] = 0
        self.hand, self.body = self.state.hands[0], self.state.body
        self.hand["holds"], self.hand["palm_offset"] = 1, 0.004
        self.row, self.work = len(self.state.hands), 0.0
        self.turn_object(np.eye(3))
        self.state.start.object_position[:] = [0.6, 0.1, 0.3]

    def turn_object(self, rotation: np.ndarray) -> None:
        self.body.rotation[:] = self.body.rotation_now[:] = rotation
        self.body.step_rotation[:] = np.eye(3)

    def put(self, point: np.ndarray, turn: np.ndarray | None = None) -> None:
        """Puts the hand at a point (3,) of the object's axes, with relaxed friction springs."""
        turned = np.eye(3) if turn is None else turn
        self.hand["translation"] = self.state.start.object_position + self.body.rotation @ point
        self.hand["rotation"] = self.body.rotation @ turned
        self.hand["rest_point"] = point
        self.hand["rest_rotation"] = turned
        place_couplings(self.state)

    @property
    def stored(self) -> float:
        """U of the coupling [J], from the row as it stands."""
        hand = self.hand
        place_couplings(self.state)
        linear = max(0.0, float(hand["depth"])) ** 2 + float(np.sum(hand["deflection"] ** 2))
        angular = float(np.sum(hand["angular_deflection"] ** 2))
        return 0.5 * float(hand["linear_stiffness"] * linear + hand["angular_stiffness"] * angular)

    def feel(self, own: np.ndarray, other: np.ndarray, time: float) -> np.ndarray:
        """Evaluates the wrench (6,) on the hand ``time`` into a step in which both move with constant twists."""
        state, start = self.state, self.state.start
        state.stage.whole[:] = start.whole
        state.stage.object_position[:] = start.object_position + time * other[:3]
        state.stage.object_rotation[:] = time * other[3:]
        object_motion(state)
        state.displacement[0], state.twist[0] = time * own, own
        state.twist[self.row] = other
        state.grasp_wrench[:] = 0.0
        power = grasp_forces(state)
        assert power == pytest.approx(float(np.sum(state.grasp_wrench * state.twist)), abs=1e-9)
        return state.grasp_wrench[0].copy()

    def move(self, own: np.ndarray, other: np.ndarray, step: float) -> None:
        """Leads hand and object through one step; ``work`` adds up what the coupling takes from both."""
        place_couplings(self.state)
        for time, weight in ((0.0, 1.0), (0.5 * step, 4.0), (step, 1.0)):
            self.feel(own, other, time)
            self.work -= weight * step / 6.0 * float(np.sum(self.state.grasp_wrench * self.state.twist))
        update_slipping_palms(self.state)
        update_object_rotation(self.state)
        self.state.start.object_position[:] += step * other[:3]
        self.hand["translation"] += step * own[:3]
        self.hand["rotation"] = exp3(step * own[3:]) @ self.hand["rotation"]


def test_a_palm_feels_its_equations() -> None:
    """Random places, stretches, turns and motions on all shapes: force and moment, in the cone, and the opposite."""
    rng, touched, slipped = np.random.default_rng(2), 0, 0
    palms = {name: Palm(name) for name in SHAPES}
    for k in range(60):
        name = list(SHAPES)[k % 3]
        palm, half = palms[name], half_extent(name, SIZES[name])
        palm.turn_object(exp3(rng.normal(size=3)))
        place = rng.normal(size=3)
        palm.put(place / np.linalg.norm(place / half), exp3(rng.normal(size=3)))
        palm.hand["rest_point"] += rng.normal(scale=1e-4, size=3)
        palm.hand["rest_rotation"] = palm.hand["rest_rotation"] @ exp3(rng.normal(scale=1e-3, size=3))
        point = palm.body.rotation.T @ (palm.hand["translation"] - palm.state.start.object_position)
        palm.hand["palm_offset"] = rng.uniform(-2e-5, 2e-4) - depth_and_direction(palm.body, 0.0, point)[0]
        own, other = rng.normal(scale=0.1, size=(2, 6))
        place_couplings(palm.state)
        angle = palm.hand["angular_deflection"].copy()
        felt = palm.feel(own, other, 0.0)
        offset = palm.hand["translation"] - palm.state.start.object_position
        force, moment = palm_wrench(palm.hand, palm.body, palm.body.rotation, offset, angle, own, other)
        np.testing.assert_allclose(felt, np.concatenate([force, moment]), rtol=1e-9, atol=1e-9)
        back = palm.state.grasp_wrench[palm.row]
        np.testing.assert_allclose(back[:3], -force, atol=1e-9)
        np.testing.assert_allclose(back[3:], -moment - np.cross(offset, force), atol=1e-9)
        touched += bool(np.any(force))
        slipped += bool(np.any(force)) and in_cone(palm) > 1.0 - 1e-9
    assert touched > 30 and slipped > 10


def in_cone(palm: Palm) -> float:
    """Gives friction over its bound, of force and moment the greater; fails outside the cone."""
    hand, wrench = palm.hand, palm.state.grasp_wrench[0]
    normal = palm.body.rotation_now @ hand["normal"]
    pressed = -float(wrench[:3] @ normal)
    bound = float(hand["friction"]) * pressed
    if pressed <= 0.0:
        assert not wrench.any()
        return 0.0
    shares = np.linalg.norm(wrench[:3] + pressed * normal), np.linalg.norm(wrench[3:]) / hand["palm_radius"]
    assert max(shares) <= bound * (1.0 + 1e-9)
    return float(max(shares) / bound)


@pytest.mark.parametrize("seed", range(3))
def test_a_palm_stores_no_less_than_nothing_and_gives_back_no_more_than_it_took(seed: int) -> None:
    """Led at random onto faces, along them, around edges, off and back, turned all the while: U >= 0, U - U_0 <= W."""
    rng = np.random.default_rng(seed)
    name = list(SHAPES)[seed % 3]
    palm = Palm(name, friction=rng.uniform(0.1, 1.2))
    palm.turn_object(exp3(rng.normal(size=3)))
    half = half_extent(name, SIZES[name])
    palm.put(np.array([half[0] + palm.hand["palm_offset"], 0.0 if name != "box" else half[1] - 0.005, 0.0]))
    begin, least, slips, touches, spare = palm.stored, 0.0, 0, 0, []
    tones = rng.uniform(5.0, 40.0, (4, 6))
    was = False
    for k in range(1200):
        t = STEP * k
        other = 0.15 * np.sin(tones[0] * t + tones[1])
        offset = palm.hand["translation"] - palm.state.start.object_position
        carried = np.concatenate([other[:3] + np.cross(other[3:], offset), other[3:]])
        relative = np.array([0.03, 0.3, 0.3, 0.5, 0.5, 0.5]) * np.sin(tones[2] * t + tones[3])
        depth, inward = depth_and_direction(
            palm.body, float(palm.hand["palm_offset"]), palm.body.rotation.T @ offset
        )
        # Sought at the surface, so that touching, slipping and leaving all happen often.
        relative[:3] += inward * (
            400.0 * (2e-5 + 8e-5 * np.sin(25.0 * t) - depth) - relative[:3] @ inward * 0.9
        )
        turned = np.concatenate([palm.body.rotation @ relative[:3], relative[3:]])
        palm.move(carried + turned, other, STEP)
        slips += in_cone(palm) > 1.0 - 1e-9
        now = palm.state.grasp_wrench[0].any()
        touches += bool(now and not was)
        was = now
        stored = palm.stored
        least = min(least, stored)
        spare.append(palm.work - (stored - begin))
    gained = max(0.0, -min(np.diff([0.0, *spare])))
    print(
        f"{name}: {palm.work:.3e} J taken, {slips} slipping steps, {touches} touches, gained {gained:.1e} J in a step"
    )
    assert least >= 0.0 and touches >= 2 and slips > 100
    assert palm.work > 0.1 and gained < 1e-12


def test_friction_opposes_the_slide_and_bears_its_bound_when_it_stops() -> None:
    """mu N against the motion in every step, and still there at rest: the springs keep their stretch."""
    palm = Palm("box", friction=0.4)
    half, offset = palm.body.half, float(palm.hand["palm_offset"])
    palm.put(np.array([half[0] + offset - 5e-5, 0.0, 0.0]))
    pressed, still = 5e-5 * float(palm.hand["linear_stiffness"]), np.zeros(6)
    slide = np.array([0.0, 0.08, 0.06, 0.0, 0.0, 0.0])
    for k in range(60):
        palm.move(slide if k < 40 else still, still, STEP)
        if k > 20:
            np.testing.assert_allclose(palm.state.grasp_wrench[0, 1:3], -0.4 * pressed * np.array([0.8, 0.6]))


def test_a_palm_that_returns_presses_on_the_face_and_starts_without_friction_force() -> None:
    """Off, along and back: N = k d at the new place; the friction spring is as short as if it had just begun."""
    palm = Palm("box")
    half, offset, k = palm.body.half, float(palm.hand["palm_offset"]), float(palm.hand["linear_stiffness"])
    still = np.zeros(6)
    palm.put(np.array([half[0] + offset - 5e-5, 0.0, 0.0]))
    assert np.linalg.norm(palm.feel(still, still, 0.0)[:3]) == pytest.approx(k * 5e-5)
    away = np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.0])
    along = np.array([0.0, 0.5, 0.3, 0.0, 0.2, 0.1])
    for twist, steps in ((away, 20), (along, 200), (-away, 20)):
        for _ in range(steps):
            palm.move(twist, still, STEP)
    palm.move(still, still, STEP)
    back = palm.feel(still, still, 0.0)
    np.testing.assert_allclose(back[:3], [k * 5e-5, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(back[3:], 0.0, atol=1e-9)
    assert np.linalg.norm(log3(palm.hand["rest_rotation"] @ palm.hand["rotation"].T)) < 1e-9


def test_a_palm_beyond_the_face_holds_nothing() -> None:
    """Pressed and led along the face past its edge: the wrench ends there, and does not come back outside."""
    palm = Palm("box")
    half, offset = palm.body.half, float(palm.hand["palm_offset"])
    palm.put(np.array([half[0] + offset - 5e-5, half[1] - 0.02, 0.0]))
    slide, still, ended = np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.zeros(6), None
    for k in range(400):
        palm.move(slide, still, STEP)
        beyond = (palm.body.rotation.T @ (palm.hand["translation"] - palm.state.start.object_position))[1]
        if ended is None and not palm.state.grasp_wrench.any():
            ended = beyond
        assert ended is None or not palm.state.grasp_wrench.any(), k
    assert ended == pytest.approx(half[1] + offset, abs=3e-4)
    assert palm.stored == 0.0


def test_a_stretch_that_was_not_paid_does_not_survive_a_step() -> None:
    """The force presses only at the step's end: the friction spring begins there, whatever the step slid."""
    palm = Palm("box")
    half, offset = palm.body.half, float(palm.hand["palm_offset"])
    palm.put(np.array([half[0] + offset + 1e-5, 0.0, 0.0]))
    palm.move(np.array([-0.2, 0.4, 0.0, 0.0, 0.0, 0.0]), np.zeros(6), STEP)
    assert palm.state.grasp_wrench[0].any() and palm.hand["depth"] > 0.0
    palm.hand["depth"] = 0.0
    place_couplings(palm.state)
    assert np.linalg.norm(palm.hand["deflection"]) < 1e-12
