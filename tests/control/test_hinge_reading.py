# SPDX-License-Identifier: BSD-3-Clause
"""What the arms measure of a hinge is the hinge's geometry and the hands' wrenches, as Python and as machine code."""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.control.hinge_reading import hinge_reading, read_hinge
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.pose import carry
from tests.support.both_ways import ways  # noqa: F401 - a fixture
from tests.support.forecast_tasks import assembled


@pytest.mark.usefixtures("ways")
@pytest.mark.parametrize("task", ["turn-lever", "turn-wheel"])
def test_angle_and_torque_follow_from_poses_and_wrenches(task: str) -> None:
    assembly = assembled(task)
    model, modules = assembly.model, assembly.modules
    held, hands = modules.held, tuple(arm.limb.hand for arm in modules.arms)
    reading, kinematics = hinge_reading(held, hands), Kinematics(model, modules.frames)
    random = np.random.default_rng(3)
    for _ in range(20):
        q = modules.posture + random.normal(0.0, 0.2, model.n)
        kinematics.update(q, np.zeros(model.n))
        wrench = random.normal(0.0, 5.0, (len(hands), 6))
        read_hinge(reading, kinematics.arms, wrench)
        pose = held.pose_from(tuple(kinematics.pose(hand) for hand in held.hands))
        assert reading.angle == pytest.approx(held.hinge.angle(pose), abs=1e-12)
        on_object = -sum(
            carry(kinematics.pose(hand).translation - pose.translation).T @ wrench[hands.index(hand)]
            for hand in held.hands
        )
        assert reading.torque == pytest.approx(held.hinge.torque(on_object, pose.translation), abs=1e-9)


def test_there_is_no_reading_without_a_hinge() -> None:
    modules = assembled("box-hold").modules
    assert hinge_reading(modules.held, ()) is None
    assert hinge_reading(None, ()) is None
