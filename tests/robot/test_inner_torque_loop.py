# SPDX-License-Identifier: BSD-3-Clause
"""Feedback of torque in a joint: passive up to the gain that is computed, and no further.

The reference is the sampled joint itself on passive loads, integrated exactly: Colgate & Hogan (1988) say that it is
passive if and only if it is stable on all of them.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from impedance_modules.arrays import Array
from impedance_modules.robot.inner_torque_loop import (
    LoopTiming,
    admittance,
    highest_passive_gain,
    loop_delay,
)
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import InnerTorqueLoopSpec, JointSpec

PERIOD = 1e-3


def drive(stiffness: float, inertia: float, motor: float, spring: float) -> JointSpec:
    return JointSpec("joint", -1.0, 1.0, 1.0, 10.0, 100.0, stiffness, inertia, motor, spring)


DRIVES = st.builds(
    drive,
    stiffness=st.floats(100.0, 2000.0),
    inertia=st.floats(0.03, 1.0),
    motor=st.floats(0.1, 2.0),
    spring=st.floats(0.1, 1.0),
)


def growth(joint: JointSpec, gain: float, late: int, inertia: float, ground: float) -> float:
    """Spectral radius of one sample of rotor, spring and a load of inertia and a spring to the ground."""
    K, B, D, rotor = (
        joint.spring_stiffness,
        joint.spring_damping,
        joint.motor_damping,
        joint.reflected_inertia,
    )
    flow = np.zeros((5, 5))
    flow[0, 2] = flow[1, 3] = 1.0
    flow[2] = np.array([-K, K, -D - B, B, 1.0]) / rotor
    flow[3] = np.array([K, -K - ground, B, -B, 0.0]) / inertia
    step = expm(PERIOD * flow)
    measured = -gain * K * np.array([1.0, -1.0, 0.0, 0.0])
    loop = np.zeros((4 + late, 4 + late))
    loop[:4, :4] = step[:4, :4]
    if late == 0:
        loop += np.outer(step[:4, 4], measured)
    else:
        loop[:4, 4] = step[:4, 4]
        loop[4:-1, 5:] = np.eye(late - 1)
        loop[-1, :4] = measured
    values = np.linalg.eigvals(loop)
    return float(np.max(np.abs(values[np.abs(values.imag) > 1e-7]), initial=0.0))


def worst_load(joint: JointSpec, gain: float, late: int, frequency: float) -> tuple[float, float]:
    """The load -1 / Y at a frequency: a mass, or a spring around a small one."""
    Y = admittance(joint, gain, LoopTiming(PERIOD, late * PERIOD), np.array([frequency]))[0]
    reactance = float((-1.0 / Y).imag)
    inertia = max(0.01, reactance / frequency)
    return inertia, frequency * (frequency * inertia - reactance)


@settings(max_examples=60, deadline=None)
@given(joint=DRIVES, late=st.integers(0, 3))
def test_beyond_the_highest_passive_gain_some_passive_load_grows(joint: JointSpec, late: int) -> None:
    found = highest_passive_gain([joint], LoopTiming(PERIOD, late * PERIOD))
    gain = 1.1 * found.gain
    loads = (worst_load(joint, gain, late, found.frequency * f) for f in np.linspace(0.7, 1.3, 25))
    assert max(growth(joint, gain, late, *load) for load in loads) > 1.0


@settings(max_examples=20, deadline=None)
@given(joint=DRIVES, late=st.integers(0, 3), share=st.floats(0.05, 0.97))
def test_below_it_no_passive_load_grows(joint: JointSpec, late: int, share: float) -> None:
    gain = share * highest_passive_gain([joint], LoopTiming(PERIOD, late * PERIOD)).gain
    inertias, springs = np.geomspace(1e-3, 100.0, 12), (0.0, *np.geomspace(1.0, 1e5, 8))
    grown = [growth(joint, gain, late, inertia, spring) for inertia in inertias for spring in springs]
    assert max(grown) < 1.0 + 1e-9


@given(joint=DRIVES, gain=st.floats(0.0, 5.0))
def test_slow_torques_meet_a_rotor_that_is_lighter_by_one_plus_the_gain(
    joint: JointSpec, gain: float
) -> None:
    timing = LoopTiming(PERIOD, 0.0)
    frequency = np.array([1e-3])
    rotor = (joint.motor_damping + 1j * frequency * joint.reflected_inertia) / (1.0 + gain)
    assert admittance(joint, gain, timing, frequency) == pytest.approx(1.0 / rotor, rel=1e-3)


@given(joint=DRIVES, late=st.integers(0, 4))
def test_lateness_only_lowers_the_highest_passive_gain(joint: JointSpec, late: int) -> None:
    gains = [highest_passive_gain([joint], LoopTiming(PERIOD, n * PERIOD)).gain for n in (late, late + 1)]
    assert gains[1] < gains[0]


def test_the_joint_that_allows_least_decides() -> None:
    joints = list(read_robot("baxter").joints.values())
    timing = LoopTiming(PERIOD, PERIOD)
    each = [highest_passive_gain([joint], timing) for joint in joints]
    assert highest_passive_gain(joints, timing) == min(each, key=lambda found: found.gain)


def test_a_delay_counts_in_whole_loops() -> None:
    delays: Array = np.array([0.0, 0.4e-3, 1e-3, 1.2e-3])
    assert [loop_delay(InnerTorqueLoopSpec(1.0, float(d)), PERIOD) for d in delays] == [0, 1, 1, 2]
