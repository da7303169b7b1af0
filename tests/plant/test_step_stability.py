# SPDX-License-Identifier: BSD-3-Clause
"""The plant chooses its own step: what it takes stays at rest, and what is refused is refused before a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.step_stability import SHORTEST_STEP, StepTooShort, mode_bound, plant_modes
from impedance_modules.spec.robot_spec import RobotSpec
from tests.support.plant_parts import SIX_JOINTS, exact, middle, plant, spec_of

FARTHEST = 2.97
"""Of h |lambda|: the region in which the Runge-Kutta method is stable reaches to 2.96, for modes that oscillate."""


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda exponent: float(10.0**exponent))


def drives(inertia: float, stiffness: float, damping: float) -> RobotSpec:
    """The six-joint pair with other drives on its first elastic joint."""
    spec = exact(spec_of(SIX_JOINTS))
    name = next(name for name, joint in spec.joints.items() if joint.spring_stiffness is not None)
    joint = replace(
        spec.joints[name], reflected_inertia=inertia, spring_stiffness=stiffness, spring_damping=damping
    )
    return replace(spec, joints={**spec.joints, name: joint})


def refused(subject: Plant, way: str) -> str:
    try:
        getattr(subject, way)(middle(subject.model))
    except BadInput as error:
        return str(error)
    return ""


@settings(deadline=None, max_examples=30)
@given(powers(-9.0, 0.0), powers(2.0, 6.0), powers(-3.0, 2.0))
def test_what_reset_refuses_is_refused_before_and_nothing_else(
    inertia: float, stiffness: float, damping: float
) -> None:
    subject = plant(drives(inertia, stiffness, damping))
    said = refused(subject, "refuse_start")
    assert said == refused(subject, "reset")
    fastest = float(np.abs(plant_modes(subject._integrator)).max())
    assert fastest <= mode_bound(subject._integrator) * (1.0 + 1e-6)
    assert (fastest * SHORTEST_STEP > 2.5) == bool(said) or 2.5 < fastest * SHORTEST_STEP < FARTHEST
    if not said:
        assert subject.division.step * fastest <= FARTHEST


@settings(deadline=None, max_examples=10)
@given(powers(-5.5, -2.0), powers(3.0, 5.0), powers(-2.0, 0.0))
def test_a_plant_with_a_step_of_its_own_choice_stays_at_rest(
    inertia: float, stiffness: float, damping: float
) -> None:
    subject = plant(drives(inertia, stiffness, damping))
    if refused(subject, "reset"):
        return
    start = subject.state.start.position.copy()
    for _ in range(20):
        subject.advance(subject.start_command)
    assert np.abs(subject.state.start.position - start).max() < 1e-6
    assert np.abs(subject.state.start.motor_velocity).max() < 1e-4


def test_the_refusal_names_the_joint_that_is_too_light() -> None:
    subject = plant(drives(1e-9, 1e5, 1.0))
    try:
        subject.reset(middle(subject.model))
    except StepTooShort as error:
        assert error.part.kind == "joint" and subject.model.joint_names[error.part.index] in str(error)
    else:
        raise AssertionError("such a rotor cannot be simulated")
