# SPDX-License-Identifier: BSD-3-Clause
"""Descriptions as their makers ship them: a joint and a link of one name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.errors import BadInput
from impedance_modules.robot.description import name_apart, rigid_model

LINK = (
    '<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="0.01 0 0.2"/>'
    '<inertia ixx=".02" iyy=".02" izz=".004" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="0 0 0.4"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="2"/></joint>'
)


def arm(folder: Path, *, hand_joint: str, head_joint: str) -> Path:
    """An arm of two joints with a hand fixed to it, and a head that is not recorded."""
    masses = {"upper": 2.0, "fore": 1.0, "left_hand": 0.5, "head": 1.5}
    links = "".join(LINK.format(name=name, mass=mass) for name, mass in masses.items())
    chain = (
        ("shoulder", "revolute", "base", "upper"),
        ("elbow", "revolute", "upper", "fore"),
        (hand_joint, "fixed", "fore", "left_hand"),
        (head_joint, "revolute", "base", "head"),
    )
    joints = "".join(JOINT.format(name=n, kind=k, parent=p, child=c) for n, k, p, c in chain)
    path = folder / f"{hand_joint}-{head_joint}.urdf"
    path.write_text(f'<robot name="arm"><link name="base"/>{links}{joints}</robot>')
    return path


@pytest.mark.parametrize(
    ("hand_joint", "head_joint"),
    [("left_hand", "neck"), ("wrist", "head"), ("left_hand", "head"), ("wrist", "fore")],
)
def test_a_joint_called_like_a_link_is_another_frame(
    tmp_path: Path, hand_joint: str, head_joint: str
) -> None:
    shared = arm(tmp_path, hand_joint=hand_joint, head_joint=head_joint)
    apart = arm(tmp_path, hand_joint="fastening", head_joint="turning")
    names = ("shoulder", "elbow")
    found, expected = (RigidModel.from_urdf(path, names) for path in (shared, apart))
    random = np.random.default_rng(1)
    q, v, a = random.uniform(-2.0, 2.0, (3, 5, 2))
    np.testing.assert_array_equal(found.torque(q, v, a), expected.torque(q, v, a))
    np.testing.assert_array_equal(found.body_inertia("left_hand"), expected.body_inertia("left_hand"))
    # Every single joint of the description can be locked.
    for joint in range(1, rigid_model(shared).njoints):
        model = rigid_model(shared)
        name_apart(model, [joint])
        assert pin.buildReducedModel(model, [joint], pin.neutral(model)).nq == model.nq - 1


def test_a_moving_joint_called_like_the_link_before_it_can_be_kept_or_locked(tmp_path: Path) -> None:
    """As the SO-100's ``gripper``: parent link and joint of one name."""
    path = arm(tmp_path, hand_joint="fastening", head_joint="base")
    apart = arm(tmp_path, hand_joint="fastening", head_joint="neck")
    for kept, same in (
        (("shoulder", "elbow"), ("shoulder", "elbow")),
        (("base", "elbow"), ("neck", "elbow")),
    ):
        q, v, a = np.random.default_rng(2).uniform(-2.0, 2.0, (3, 5, 2))
        found = RigidModel.from_urdf(path, kept)
        assert set(found.joint_names) == set(kept)
        np.testing.assert_array_equal(
            found.torque(q, v, a), RigidModel.from_urdf(apart, same).torque(q, v, a)
        )


def test_what_is_no_description_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text("<robot><link/></robot>")
    with pytest.raises(BadInput, match=r"arm\.urdf: not a robot description that can be read"):
        rigid_model(path)
