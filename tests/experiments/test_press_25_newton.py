# SPDX-License-Identifier: BSD-3-Clause
"""The statics of a pressing hand against laws, against the package's own statics, and against the plant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_experiments.press_statics import FLAT, TABLE, PressingArm
from impedance_modules.control.assembly import assemble
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import find_rest

TASK = assemble("slide-flat", effects=None, rate=None, scale=1.0, arm=None)
LIMB = TASK.modules.arms[0].limb
POSTURE = TASK.modules.posture[LIMB.joints]
JOINTS, END = np.array([0.005, 5.0, 5.0, 0.005, 0.005, 5.0, 5.0]), np.diag([300.0, 300.0, 50.0])


def arm(joints: np.ndarray = JOINTS) -> PressingArm:
    return PressingArm(TASK.model, LIMB, joints, END)


def on_table(pressing: PressingArm) -> tuple[np.ndarray, np.ndarray]:
    return POSTURE, pressing.look(POSTURE)[0].translation


def test_joint_springs_that_rest_at_the_table_leave_the_hand_spring_alone() -> None:
    pressing = arm()
    q, hand = on_table(pressing)
    found = pressing.press(q, hand - np.array([0.0, 0.0, 0.24]), float(hand[2]), q, flat=False)
    assert found.force == pytest.approx(50.0 * 0.24, rel=0.02)


@settings(max_examples=8, deadline=None)
@given(depth=st.floats(0.0003, 0.002), share=st.floats(0.2, 2.0))
def test_a_small_depth_of_both_springs_gives_the_net_stiffness(depth: float, share: float) -> None:
    """The linear answer: springs K of eq. 4.15 against a table that bears along z and keeps the orientation."""
    pressing = arm(share * np.full(7, 5.0))
    q, hand = on_table(pressing)
    goal = hand - np.array([0.0, 0.0, depth])
    deep = pressing.posture_at(goal, q, pressing.look(q)[0].rotation)
    found = pressing.press(deep, goal, float(hand[2]), q, flat=True)
    net = pressing.net_stiffness(q)
    held = net + np.diag([0.0, 0.0, TABLE, FLAT, FLAT, FLAT])
    moved = np.linalg.solve(held, net @ np.array([0.0, 0.0, -depth, 0.0, 0.0, 0.0]))
    assert found.force == pytest.approx(-TABLE * moved[2], rel=0.03)


def test_statics_of_the_package_find_the_same_force() -> None:
    pressing = arm()
    q, hand = on_table(pressing)
    table = TASK.task.environment[0].height
    goal = np.array([*hand[:2], table - 0.24])
    found = pressing.press(q, goal, table, q, flat=False)
    mechanism = Mechanism(TASK)
    start = start_equilibrium(TASK.modules)
    name, pose = next(iter(start.springs.items()))
    moved = {name: type(pose)(pose.rotation, goal)}
    mechanism.update(TASK.modules.posture, np.zeros(TASK.model.n))
    damping = phase_damping(TASK.modules, mechanism.kinematics)
    targets = type(start)(moved, start.object, start.rests)
    rest = find_rest(mechanism, Setting(TASK.modules, targets, damping), TASK.modules.posture)
    assert rest is not None
    assert found.force == pytest.approx(rest.pressure[LIMB.hand][2], rel=1e-3)


def test_only_joint_springs_that_rest_deep_come_near_the_thesis(facts_of) -> None:
    facts = facts_of("press-25-newton")
    statics = {name: force for name, force in facts.items() if name.startswith("statics")}
    near = {name for name, force in statics.items() if abs(force - 25.0) < 2.5}
    assert near == {
        "statics, joint springs rest with the hand deep, it lies flat",
        "statics, net stiffness of eq. 4.15, K_zz D",
    }
    assert facts["plant, rest at the table"] == pytest.approx(
        facts["statics, joint springs rest at the table"], rel=0.03
    )
    assert facts["plant, rest deep, flat"] == pytest.approx(23.4, abs=1.0)
    assert (
        facts["plant, rest above it"] < facts["plant, rest at the table"] < facts["plant, rest deep, point"]
    )
