# SPDX-License-Identifier: BSD-3-Clause
"""The first touch of a guarded move: the law against its limits, and the plant against the law (thesis 1.3)."""

import math
from dataclasses import replace

import numpy as np
import pytest

from impedance_experiments.apparent_mass import against
from impedance_experiments.guarded_touch import TASK, UP, elastic_peak
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel


def with_springs(stiffness: float) -> Assembly:
    """The task on an arm without friction, with springs of that stiffness [N.m/rad] in all joints."""
    assembly = assemble(TASK, effects=None, rate=None, scale=1.0, arm=None)
    loose = {"spring_stiffness": stiffness, "spring_damping": 0.0, "motor_damping": 0.0}
    joints = {name: replace(joint, **loose) for name, joint in assembly.robot.joints.items()}
    return replace(assembly, model=RobotModel(replace(assembly.robot, joints=joints)))


@pytest.mark.parametrize("stiffness", [2000.0, 40000.0])
@pytest.mark.parametrize("rotors", [True, False])
def test_stiff_springs_bring_the_rotors_into_the_blow_and_soft_ones_leave_them_out(
    rotors: bool, stiffness: float
) -> None:
    """Thrown along M^-1 J^T the arm is one mass: v sqrt(k m) is exact, m with rotors or of the links alone."""
    assembly = against(with_springs(1e8 if rotors else 1e-6), stiffness)
    model, hand = assembly.model, assembly.modules.arms[0].limb.hand
    q, kinematics = assembly.modules.posture, Kinematics(assembly.model, (hand,))
    kinematics.update(q, np.zeros(model.n))
    row = UP @ kinematics.jacobian_of(hand)[:3]
    inertia = model.mass_matrix(q) - (0.0 if rotors else np.diag(model.reflected_inertia))
    thrown = np.linalg.solve(inertia, row)
    mass = 1.0 / float(row @ thrown)
    for speed in (0.01, 0.2):
        found = elastic_peak(assembly, q, -speed * mass * thrown)
        assert found == pytest.approx(speed * math.sqrt(stiffness * mass), rel=2e-3)


def test_the_blow_is_over_before_the_guard_notices_and_follows_the_law(facts_of) -> None:
    facts = facts_of("guarded-move")
    assert 0.98 < facts["least exponent over speed"] <= facts["largest exponent over speed"] < 1.03
    # Links and rotors on the joints' springs, the controller left out: within a few percent.
    assert 0.99 < facts["least peak over predicted"] <= facts["largest peak over predicted"] < 1.06
    # A stiffer surface meets less of the rotors, so the peak grows with less than the root of the stiffness.
    assert 0.0 < facts["rotors' share on the stiffest"] < facts["rotors' share on the softest"] < 1.0
    assert 0.35 < facts["exponent over stiffness"] < 0.48
    assert facts["earliest notice over peak time"] > 1.5
    assert 0.85 < facts["peak time over a quarter swing"] < 1.2
    assert 0.015 < facts["harmless speed"] < 0.021
