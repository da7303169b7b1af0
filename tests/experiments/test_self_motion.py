# SPDX-License-Identifier: BSD-3-Clause
"""A redundant arm led round a closed path (fig. 4-3): two ways drift along the self-motion, joint springs do not."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_experiments.self_motion import by_pseudo_inverse
from impedance_modules.control.assembly import assemble
from impedance_modules.robot.kinematics import Kinematics


@pytest.fixture(scope="module")
def assembly():
    return assemble("self-motion", effects=None, rate=None, scale=1.0, arm=None)


@pytest.mark.long
def test_the_hand_comes_back_and_only_joint_springs_bring_the_joints_back(facts_of) -> None:
    facts = facts_of("self-motion")
    for way in ("hand spring alone", "hand spring and joint springs", "pseudo-inverse"):
        assert facts[f"hand, {way}"] < 1e-3
    assert facts["drift, hand spring and joint springs"] < 2e-3
    assert facts["drift, hand spring alone"] > 10.0 * facts["drift, hand spring and joint springs"]
    assert facts["drift, pseudo-inverse"] > 0.05
    # The pseudo-inverse's drift is no error of its steps.
    assert facts["step error"] < 0.01 * facts["drift, pseudo-inverse"]


def test_the_pseudo_inverse_drifts_along_the_self_motion_alone(assembly) -> None:
    model, limb = assembly.model, assembly.model.limbs["right"]
    found = by_pseudo_inverse(assembly, 1, 200)
    start, moved = found.q[0], found.q[1] - found.q[0]
    q = np.zeros(model.n)
    q[limb.joints] = start + 0.5 * moved
    kinematics = Kinematics(model, (limb.hand,))
    kinematics.update(q, np.zeros(model.n))
    jacobian = kinematics.jacobian_of(limb.hand)[:, limb.joints]
    assert np.linalg.norm(moved) > 0.02
    assert np.linalg.norm(jacobian @ moved) < 0.02 * np.linalg.norm(moved)


def test_a_path_without_area_brings_the_joints_back(assembly) -> None:
    """To a corner and back: the smallest joint motions retrace each other."""
    there, *_, home = assembly.task.phases[:4]
    home = replace(home, equilibrium={"right.hand": {"y": float(_place(assembly)[1])}})
    short = replace(assembly, task=replace(assembly.task, phases=(there, home)))
    found = by_pseudo_inverse(short, 1, 400)
    assert np.linalg.norm(found.q[1] - found.q[0]) < 2e-3


def _place(assembly) -> np.ndarray:
    return assembly.model.pose(assembly.modules.posture, assembly.model.limbs["right"].hand).translation
