# SPDX-License-Identifier: BSD-3-Clause
"""An object on a hinge: it turns about the axis and nothing else, keeps energy, sticks, slips and stops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.modules.hinge import axis_frame, turned
from impedance_modules.plant import hinge_forces as law
from impedance_modules.plant.hinge_start import hinge_state
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.rigid_object import ObjectBody, principal_inertia
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.hinge_spec import HingeSpec
from tests.support.plant_parts import (
    SIX_JOINTS,
    WEIGHTLESS,
    exact,
    idle,
    loose,
    middle,
    place_object,
    plant,
    spec_of,
    started,
    undamped,
)

CENTRE = np.array([2.0, 0.0, 1.0])
SIZE = (0.3, 0.2, 0.1)
numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers)
axes = vectors.filter(lambda v: float(np.linalg.norm(v)) > 0.2)


def lever(spec: HingeSpec, **numbers: object) -> ObjectBody:
    """A box on a hinge that nobody holds."""
    return loose(hinge=spec, size=SIZE, **numbers)


def hinge_at(arm: tuple[float, ...], axis: tuple[float, ...], **numbers: float) -> HingeSpec:
    """A hinge an arm (3,) [m] away from the object's centre."""
    point = CENTRE + 0.3 * np.array(arm)
    return HingeSpec((point[0], point[1], point[2]), (axis[0], axis[1], axis[2]), **numbers)


def turning_inertia(spec: HingeSpec) -> float:
    """Inertia of the box about the axis, by the parallel axis theorem [kg.m^2]."""
    axis = np.array(spec.axis) / np.linalg.norm(spec.axis)
    arm = np.cross(axis, CENTRE - np.array(spec.point))
    return float(principal_inertia("box", SIZE, 1.2) @ axis**2 + 1.2 * arm @ arm)


def set_turning(subject: Plant, spec: HingeSpec, rate: float) -> None:
    """Gives the object a rate about its hinge [rad/s]."""
    axis = np.array(spec.axis) / np.linalg.norm(spec.axis)
    arm = CENTRE - np.array(spec.point)
    place_object(subject, subject.object_pose, np.concatenate([np.cross(axis, rate * arm), rate * axis]))


@given(arm=vectors, axis=axes, rest=st.floats(-0.5, 0.5), stiffness=st.floats(0.0, 3.0))
@settings(max_examples=20, deadline=None)
def test_a_hinge_without_friction_keeps_energy(arm, axis, rest, stiffness) -> None:
    """Under gravity, on a return spring, from rest: nothing but the bearing's damping takes energy, and little."""
    spec = hinge_at(arm, axis, stiffness=stiffness, rest=rest)
    subject = started(undamped(spec_of(SIX_JOINTS)), held=lever(spec), at=middle)
    before = after = subject.energy()
    exchanged = 1e-3
    for _ in range(20):
        idle(subject, 20)
        after = subject.energy()
        # The largest on the way: after a whole swing the object is where it was, and nothing seems to have moved.
        exchanged = max(exchanged, abs(after.gravity - before.gravity), after.body)
    assert abs(after.imbalance(before)) < 1e-5 * exchanged
    assert -1e-9 < after.dissipated(before)["hinge"] < 2e-2 * exchanged + 1e-9


@given(
    arm=vectors,
    axis=axes,
    rate=st.floats(-4.0, 4.0),
    friction=st.floats(0.0, 1.0),
    damping=st.floats(0.0, 0.2),
    upper=st.floats(0.05, 0.5),
)
@settings(max_examples=20, deadline=None)
def test_friction_damping_and_stops_only_take_energy(
    arm,
    axis,
    rate,
    friction,
    damping,
    upper,
) -> None:
    spec = hinge_at(arm, axis, friction=friction, damping=damping, lower=-upper, upper=upper)
    subject = started(undamped(spec_of(SIX_JOINTS)), held=lever(spec), at=middle, gravity=WEIGHTLESS)
    set_turning(subject, spec, rate)
    before = last = subject.energy()
    for _ in range(10):
        idle(subject, 20)
        now = subject.energy()
        assert abs(now.imbalance(before)) < 1e-4 * max(before.body, 1e-6)
        assert now.dissipated(last)["hinge"] > -1e-9 * max(before.body, 1e-6)
        last = now
    assert last.stored <= before.stored * (1.0 + 1e-9) + 1e-15
    assert abs(subject.hinge_angle) < upper + 0.15


def test_a_pendulum_swings_as_its_equation_says() -> None:
    """I phi'' = -m g l sin phi: the period of a small swing, from the parallel axis theorem alone."""
    spec = HingeSpec((2.0, 0.0, 1.4), (0.0, 1.0, 0.0))
    subject = started(exact(spec_of(SIX_JOINTS)), held=lever(spec), at=middle)
    set_turning(subject, spec, 0.1)
    angles = []
    for _ in range(1500):
        idle(subject, 1)
        angles.append(subject.hinge_angle)
    crossings = [k for k in range(1, len(angles)) if angles[k - 1] > 0.0 >= angles[k]]
    half = 1e-3 * (
        crossings[0] + angles[crossings[0] - 1] / (angles[crossings[0] - 1] - angles[crossings[0]])
    )
    assert half == pytest.approx(math.pi * math.sqrt(turning_inertia(spec) / (1.2 * 9.81 * 0.4)), rel=2e-3)


def test_the_bearing_yields_no_more_than_its_stiffness_says() -> None:
    """Pushed across the axis and against tilting, the object moves by force over stiffness, and does not turn."""
    spec = HingeSpec((2.0, 0.1, 1.0), (0.0, 0.0, 1.0), friction=0.5)
    subject = started(exact(spec_of(SIX_JOINTS)), held=lever(spec), at=middle)
    start = subject.object_pose
    subject.state.push_wrench[-1] = [0.0, 20.0, -30.0, 1.0, 0.5, 0.0]
    subject._pushes.apply = lambda *_: None
    idle(subject, 400)
    pose, held = subject.object_pose, np.array([0.0, 0.1, 0.0])
    moved = pose.translation + pose.rotation @ held - start.translation - start.rotation @ held
    tilt = np.linalg.norm(pose.rotation[:, 2] - start.rotation[:, 2])
    moment = np.array([1.0, 0.5, 0.0]) + np.cross([0.0, -0.1, 0.0], [0.0, 20.0, -30.0])
    np.testing.assert_allclose(moved, np.array([0.0, 20.0, -30.0]) / law.BEARING_LINEAR_STIFFNESS, atol=2e-8)
    assert tilt == pytest.approx(np.linalg.norm(moment[:2]) / law.BEARING_ANGULAR_STIFFNESS, rel=2e-3)
    assert abs(subject.hinge_angle) < 1e-6


@pytest.mark.parametrize(("torque", "turns"), [(0.45, False), (0.55, True), (-0.45, False), (-0.55, True)])
def test_friction_holds_up_to_its_torque(torque: float, turns: bool) -> None:
    spec = HingeSpec((2.0, 0.1, 1.0), (0.0, 0.0, 1.0), friction=0.5)
    subject = started(exact(spec_of(SIX_JOINTS)), held=lever(spec), at=middle)
    subject._pushes.apply = lambda *_: None
    rates = []
    for share in np.minimum(1.0, np.arange(1, 301) / 100.0):
        subject.state.push_wrench[-1, 5] = share * torque
        idle(subject, 1)
        rates.append(subject.object_twist[5])
    if turns:
        gained = 0.15 * (torque - math.copysign(0.5, torque)) / turning_inertia(spec)
        assert rates[-1] - rates[-151] == pytest.approx(gained, rel=1e-3)
        assert subject.hinge_torque == pytest.approx(-math.copysign(0.5, torque), rel=1e-6)
    else:
        assert subject.hinge_angle == pytest.approx(torque / law.FRICTION_STIFFNESS, rel=1e-3)
        assert subject.hinge_torque == pytest.approx(-torque, rel=1e-3)


@given(axis=axes, tilt=vectors, angle=st.floats(-3.0, 3.0), twist=st.tuples(*[numbers] * 6))
@settings(max_examples=25, deadline=None)
def test_the_wrench_is_the_derivative_of_the_energy(axis, tilt, angle, twist) -> None:
    """Without dampers, -dU along any small motion is the wrench times it: numerically, from two energies."""
    spec = hinge_at((0.3, -0.2, 0.5), axis, stiffness=2.0, rest=0.3, lower=-1.0, upper=1.0, angle=0.0)
    subject = WRENCH.plant(spec)
    hinge, frame = subject.state.hinge, axis_frame(np.array(axis))
    arm = np.array(spec.point) - CENTRE
    rotation = exp3(1e-3 * np.array(tilt)) @ frame @ turned(angle) @ frame.T
    position = np.array(spec.point) - rotation @ arm + 1e-5 * np.array(tilt)
    hinge.angle = law.angle_near(relative_of(subject, rotation), angle)
    hinge.friction, hinge.friction_rest = 10.0, hinge.angle - 1e-4
    wrench = wrench_at(subject, rotation, position)
    motion, step = np.array(twist), 1e-6
    sides = [
        law.hinge_energy(hinge, exp3(s * step * motion[3:]) @ rotation, position + s * step * motion[:3])
        for s in (1.0, -1.0)
    ]
    change = (sides[0] - sides[1]) / (2.0 * step)
    assert change == pytest.approx(-float(wrench @ motion), rel=1e-4, abs=1e-3)


class _OnePlant:
    """One robot for many hinges: building it takes longer than asking it."""

    def __init__(self) -> None:
        self._kept: Plant | None = None

    def plant(self, spec: HingeSpec) -> Plant:
        if self._kept is None:
            self._kept = started(exact(spec_of(SIX_JOINTS)), held=lever(spec), at=middle)
        other = hinge_state(lever(spec))
        other.mount_point[:] = np.array(spec.point) - CENTRE
        other.mount_rotation[:] = other.frame
        self._kept.state.hinge.restore(other.snapshot())
        return self._kept


WRENCH = _OnePlant()


def relative_of(subject: Plant, rotation: np.ndarray) -> np.ndarray:
    out = np.empty((3, 3))
    law.relative_turn(subject.state.hinge, np.ascontiguousarray(rotation), out)
    return out


def wrench_at(subject: Plant, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """The hinge's wrench on an object that stands still."""
    state = subject.state
    state.body.rotation_now[:] = rotation
    state.stage.object_position[:] = position
    state.stage.object_velocity[:] = 0.0
    state.twist[-1] = 0.0
    assert law.hinge_wrench(state) == 0.0
    return state.hinge.wrench.copy()


@given(axis=axes, turn=vectors, shift=vectors)
@settings(max_examples=5, deadline=None)
def test_turning_the_whole_world_turns_the_motion(axis, turn, shift) -> None:
    """A box and its hinge, turned and moved together: the same angle at every time, without gravity."""
    angles = []
    spec = hinge_at((0.4, -0.3, 0.2), axis, friction=0.05, damping=0.01, upper=0.3)
    for rotation, moved in ((np.eye(3), np.zeros(3)), (exp3(np.array(turn)), np.array(shift))):
        subject = plant(exact(spec_of(SIX_JOINTS)), held=lever(spec), gravity=WEIGHTLESS)
        subject.reset(middle(subject.model))
        state, hinge = subject.state, subject.state.hinge
        hinge.point[:] = CENTRE + rotation @ (hinge.point - CENTRE) + moved
        hinge.frame[:] = rotation @ hinge.frame
        axis_now, arm = hinge.frame[:, 2], CENTRE + moved - hinge.point
        twist = np.concatenate([2.0 * np.cross(axis_now, arm), 2.0 * axis_now])
        place_object(subject, Pose(rotation @ np.eye(3), CENTRE + moved), twist)
        idle(subject, 150)
        angles.append((subject.hinge_angle, state.hinge.torque))
    np.testing.assert_allclose(angles[0], angles[1], atol=1e-9)


def test_more_than_a_turn_is_counted() -> None:
    spec = HingeSpec((2.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    subject = started(exact(spec_of(SIX_JOINTS)), held=lever(spec), at=middle, gravity=WEIGHTLESS)
    set_turning(subject, spec, 15.0)
    idle(subject, 1000)
    assert subject.hinge_angle == pytest.approx(15.0, rel=1e-3)


def test_it_starts_at_rest_with_its_weight_on_the_bearing() -> None:
    """A door with a vertical axis, hung on one side, and its start angle: nothing moves."""
    spec = HingeSpec((2.0, 0.4, 1.0), (0.0, 0.0, 1.0), angle=0.7)
    subject = started(exact(spec_of(SIX_JOINTS)), held=lever(spec), at=middle)
    idle(subject, 100)
    assert subject.hinge_angle == pytest.approx(0.7, abs=1e-9)
    assert np.linalg.norm(subject.object_twist) < 1e-8
    np.testing.assert_allclose(subject.hinge_wrench[:3], [0.0, 0.0, 1.2 * 9.81], atol=1e-6)
