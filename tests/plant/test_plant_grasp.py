# SPDX-License-Identifier: BSD-3-Clause
"""The held object: momentum on its own, equal and opposite squeeze in two hands, a grasp that slips."""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.errors import BadInput
from impedance_modules.plant.grasp import GRASP_ANGULAR_STIFFNESS, GRASP_LINEAR_STIFFNESS
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.rigid_object import principal_inertia
from impedance_modules.robot.pose import Pose, carry
from impedance_modules.robot.rotation import exp3, log3
from tests.support.plant_parts import (
    BAXTER,
    SIX_JOINTS,
    WEIGHTLESS,
    exact,
    idle,
    in_both_hands,
    loose,
    place_object,
    plant,
    posture,
    spec_of,
)

G = 9.81
HOLD = {
    "turn": 0.13236,
    "lift": 0.97313,
    "bend": -1.85784,
    "roll": -1.67345,
    "tilt": 1.65450,
    "spin": 0.68178,
}


def hold_posture(subject: Plant) -> np.ndarray:
    """Both robots with palms apart, for a box between them."""
    if subject.model.spec.name != "six_joint_pair":
        return posture(subject.model)
    sign = subject.model.spec.mirror.joint_sign
    other = {name: sign[name] * angle for name, angle in HOLD.items()}
    return posture(subject.model, {"port": HOLD, "starboard": other})


def spin_of(subject: Plant) -> np.ndarray:
    inertia = principal_inertia("box", (0.3, 0.2, 0.1), 1.2)
    rotation = subject.object_pose.rotation
    return rotation @ (inertia * (rotation.T @ subject.object_twist[3:]))


def test_a_free_tumbling_object_keeps_momentum_and_energy() -> None:
    """About its middle axis, where it flips over: p, L and energy stay."""
    subject = plant(exact(spec_of(BAXTER)), held=loose(size=(0.3, 0.2, 0.1)), gravity=WEIGHTLESS)
    subject.reset(posture(subject.model))
    twist = np.array([0.3, -0.2, 0.1, 0.05, 6.0, 0.02])
    place_object(subject, Pose(exp3(np.array([0.3, -0.2, 0.9])), np.array([2.0, 0.0, 1.0])), twist)
    before, momentum = subject.energy(), spin_of(subject)
    axis = subject.object_pose.rotation[:, 1]
    flipped = 1.0
    for _ in range(50):
        idle(subject, 100)
        flipped = min(flipped, float(axis @ subject.object_pose.rotation[:, 1]))
    np.testing.assert_allclose(spin_of(subject), momentum, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(subject.object_twist[:3], twist[:3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        subject.object_pose.translation, np.array([2.0, 0.0, 1.0]) + 5.0 * twist[:3], atol=1e-12
    )
    assert subject.energy().body == pytest.approx(before.body, rel=1e-9)
    assert flipped < -0.5
    rotation = subject.object_pose.rotation
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def test_a_free_object_falls() -> None:
    subject = plant(exact(spec_of(BAXTER)), held=loose())
    subject.reset(posture(subject.model))
    idle(subject, 500)
    assert subject.object_twist[2] == pytest.approx(-0.5 * G, rel=1e-12)
    assert subject.object_pose.translation[2] == pytest.approx(1.0 - 0.125 * G, rel=1e-12)


@pytest.mark.parametrize("folder", [BAXTER, SIX_JOINTS])
@pytest.mark.parametrize("grasp", ["weld", "friction"])
def test_two_hands_at_rest_squeeze_equally_and_carry_the_weight(folder, grasp) -> None:
    spec = exact(spec_of(folder))
    friction = 0.8 if grasp == "friction" else None
    subject = plant(spec, held=in_both_hands(spec, grasp=grasp, friction=friction, squeeze=15.0))
    subject.reset(hold_posture(subject))
    idle(subject, 300)
    wrenches = [subject.grasp_wrench(frame) for frame in subject.frames]
    centre = subject.object_pose.translation
    offsets = [subject.pose(frame).translation - centre for frame in subject.frames]
    on_object = -sum(carry(r).T @ F for r, F in zip(offsets, wrenches, strict=True))
    np.testing.assert_allclose(on_object, [0, 0, 1.2 * G, 0, 0, 0], atol=1e-6)
    between = offsets[0] - offsets[1]
    between /= np.linalg.norm(between)
    squeezes = [float(F[:3] @ between) * sign for F, sign in zip(wrenches, (1.0, -1.0), strict=True)]
    print(f"{folder.name} {grasp}: squeeze {squeezes[0]:.3f} and {squeezes[1]:.3f} N")
    assert squeezes[0] == pytest.approx(squeezes[1], rel=1e-6)
    assert squeezes[0] == pytest.approx(15.0, rel=0.05)
    assert np.abs(subject.velocity).max() < 1e-6


def test_a_weld_stays_where_it_was_closed_while_the_arms_move() -> None:
    """Relative pose of object and hand changes by less than a thousandth of the motion."""
    spec = exact(spec_of(BAXTER))
    subject = plant(spec, held=in_both_hands(spec))
    subject.reset(posture(subject.model))

    def relative() -> Pose:
        return subject.pose(subject.frames[0]).inverse() @ subject.object_pose

    before, start = relative(), subject.object_pose.translation
    jacobian = sum(subject.state.jacobian.copy())
    largest = angle = 0.0
    for k in range(1000):
        push = 6.0 * np.array([np.sin(6e-3 * k), np.cos(6e-3 * k), 1.0, 0.0, 0.0, 0.0])
        subject.advance(subject.start_command + jacobian.T @ push - subject.sense().velocity)
        now = relative()
        largest = max(largest, np.linalg.norm(now.translation - before.translation))
        angle = max(angle, np.linalg.norm(log3(before.rotation.T @ now.rotation)))
    moved = np.linalg.norm(subject.object_pose.translation - start)
    print(f"the object moved {moved:.3f} m; in the hand {largest * 1e6:.0f} um and {angle * 1e6:.0f} urad")
    assert moved > 0.05
    assert largest < 1e-3 * moved
    assert angle < 1e-3


def test_a_friction_grasp_slips_at_mu_and_no_earlier() -> None:
    """Per hand 15 N of squeeze carry at most 2 x 15 mu N of weight."""
    spec = exact(spec_of(BAXTER))
    for friction, holds in ((0.45, True), (0.35, False)):
        held = in_both_hands(spec, grasp="friction", friction=friction, squeeze=15.0, carry_weight=False)
        subject = plant(spec, held=held)
        start = posture(subject.model)
        subject.reset(start)
        height = subject.object_pose.translation[2]
        down = float(subject.pose(subject.frames[0]).translation[2])
        for _ in range(400):
            state = subject.sense()
            subject.advance(subject.start_command + 40.0 * (start - state.position) - state.velocity)
        hands_sank = down - float(subject.pose(subject.frames[0]).translation[2])
        slipped = height - subject.object_pose.translation[2] - hands_sank
        print(
            f"mu {friction}: slipped {slipped * 1e3:.2f} mm of a free fall of {1e3 * 0.5 * G * 0.16:.0f} mm"
        )
        assert (slipped < 2e-3) == holds
        for frame in subject.frames:
            force = subject.grasp_wrench(frame)[:3]
            assert np.linalg.norm(force) > 1.0


def test_the_coupling_is_at_least_a_hundred_times_a_task_spring() -> None:
    assert GRASP_LINEAR_STIFFNESS >= 100.0 * 1000.0
    assert GRASP_ANGULAR_STIFFNESS >= 100.0 * 10.0


def test_an_object_too_light_for_any_step_is_refused() -> None:
    """And the message names the object, not the joints that it hangs on; a heavier one is accepted."""
    spec = exact(spec_of(BAXTER))
    held = in_both_hands(spec, mass=0.002, size=(0.03, 0.02, 0.02))
    with pytest.raises(BadInput, match=r"the held object has a mode at .* down to 1e-06 s"):
        plant(spec, held=held).reset(np.zeros(14))
    plant(spec, held=in_both_hands(spec, mass=0.5, size=(0.03, 0.02, 0.02))).reset(np.zeros(14))


@pytest.mark.parametrize(("shape", "size"), [("box", (0.3, 0.2)), ("cone", (0.1,)), ("sphere", (0.1, 0.1))])
def test_an_object_that_cannot_be_built_is_refused(shape, size) -> None:
    with pytest.raises(BadInput, match="valid: box with 3"):
        loose(shape=shape, size=size)
