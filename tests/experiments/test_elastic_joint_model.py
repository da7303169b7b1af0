# SPDX-License-Identifier: BSD-3-Clause
"""One series-elastic joint: ports, limits, and the same joint as the sampled model of whole arms sees it."""

import numpy as np
import pytest
from scipy.linalg import expm

from impedance_experiments.elastic_joint_model import SeriesElasticJoint, rigid_up_to
from impedance_modules.superposition.elastic_joints import Drives, Sampling, sampled_arm


@pytest.fixture(params=range(20))
def joint(request) -> SeriesElasticJoint:
    rng = np.random.default_rng(request.param)
    inertias = np.exp(rng.uniform(np.log(0.02), np.log(2.0), 2))
    spring, *dampings = rng.uniform([100.0, 0.05, 0.02], [2000.0, 1.0, 0.5])
    return SeriesElasticJoint(*inertias, spring, *dampings)


def test_collocated_ports_are_passive_and_the_other_is_not(joint) -> None:
    mobility = joint.mobility(np.geomspace(1e-3, 1e5, 5000))
    assert np.all(mobility[:, 0, 0].real >= 0.0) and np.all(mobility[:, 1, 1].real >= 0.0)
    assert np.min(mobility[:, 0, 1].real) < 0.0
    np.testing.assert_allclose(mobility[:, 0, 1], mobility[:, 1, 0], rtol=1e-8)  # reciprocity


def test_slow_motion_is_that_of_the_reduced_model(joint) -> None:
    slow = 1e-3 * joint.rotor_frequency
    both = joint.mobility(slow)[0, 0]
    np.testing.assert_allclose(both, joint.rigid_mobility(slow)[0], rtol=1e-2)
    assert rigid_up_to(joint, motor=True) < joint.elastic_frequency


def test_a_damper_at_the_link_is_stable_up_to_its_limit_only(joint) -> None:
    limit = joint.highest_damping_gain(sensed_at_link=True)
    for share, stable in ((0.99, True), (1.01, False)):
        loop = joint.system.copy()
        loop[3, 2] -= share * limit / joint.reflected_inertia
        moving = np.linalg.eigvals(loop)
        moving = moving[np.abs(moving) > 1e-6 * joint.elastic_frequency]  # the angle itself is free
        assert (np.max(moving.real) < 0.0) == stable
    at_motor = joint.system.copy()
    at_motor[3, 3] -= 100.0 * limit / joint.reflected_inertia
    assert np.max(np.linalg.eigvals(at_motor).real) < 1e-6


def test_it_is_the_joint_of_the_sampled_arm(joint) -> None:
    spring, damping = (
        (joint.spring_stiffness, joint.reflected_inertia),
        (joint.motor_damping, joint.spring_damping),
    )
    drives = Drives(*(np.array([value]) for value in (*spring, *damping)))
    inertia = np.array([[joint.link_inertia + joint.reflected_inertia]])
    arm = sampled_arm(inertia, drives, Sampling(1000.0, 0, 1, 0.0, False), None, None)
    own = expm(joint.system / 1000.0)
    np.testing.assert_allclose(arm.A[:4, :4], own, rtol=1e-9, atol=1e-12)
