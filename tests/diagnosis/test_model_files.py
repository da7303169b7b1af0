# SPDX-License-Identifier: BSD-3-Clause
"""Descriptions as their makers ship them: MuJoCo models, joints that follow others, joints that stand somewhere."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.model_file import compared_model, driven_joints
from impedance_modules.diagnosis.data.rigid_dynamics import inverse_dynamics
from impedance_modules.diagnosis.data.rigid_tree import read_tree
from impedance_modules.errors import BadInput
from impedance_modules.export.mujoco_as_urdf import urdf_of_mujoco

# As model collections ship arms: default classes, armature, a finger that slides, meshes that are not there.
ARM = """<mujoco model="arm">
  <compiler angle="degree" meshdir="assets"/>
  <default>
    <default class="arm">
      <joint axis="0 0 1" armature="0.1" damping="1.5" frictionloss="0.4" range="-166 166"/>
      <default class="wrist"><joint armature="0.05" frictionloss="0"/></default>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="link0" childclass="arm">
      <inertial mass="0.6" pos="-0.04 0 0.05" diaginertia="0.003 0.004 0.005"/>
      <body name="link1" pos="0 0 0.333">
        <inertial mass="4.9" pos="0.003 0.002 -0.17" fullinertia="0.7 0.7 0.009 -0.0001 0.006 0.019"/>
        <joint name="joint1"/>
        <body name="link2" quat="1 -1 0 0">
          <inertial mass="0.65" pos="-0.003 -0.03 0.003" quat="0.7 0.1 0.2 0.3" diaginertia="0.03 0.028 0.026"/>
          <joint name="joint2" range="-101 101" ref="30"/>
          <body name="link3" pos="0 -0.316 0" euler="90 0 20">
            <joint name="joint3" class="wrist"/>
            <inertial mass="3.2" pos="0.03 0.04 -0.07" fullinertia="0.04 0.04 0.01 -0.005 -0.01 -0.01"/>
            <body name="finger" pos="0 0 0.2">
              <joint name="slide" type="slide" axis="0 1 0" range="0 0.04" armature="0.01" damping="3"/>
              <geom type="box" size="0.01 0.01 0.03" mass="0.015"/>
            </body>
          </body>
        </body>
      </body>
    </body>
    <body name="box" pos="0.5 0 0"><freejoint/><geom type="box" size="0.02 0.02 0.02" mass="0.1"/></body>
  </worldbody>
</mujoco>"""

# Masses from geoms, every way to turn a body, two joints in one body, anchors beside the origin, a frame.
GEOMS = """<mujoco><compiler angle="radian" eulerseq="{sequence}"/>
  <default><geom density="700"/><default class="c"><geom density="300"/></default></default>
  <worldbody><geom type="plane" size="1 1 .1"/>
    <frame pos="0 0 1" axisangle="0 0 1 0.3">
      <body name="a" pos="0.1 0.2 0" euler="0.1 0.2 0.3"><joint name="j1" axis="0 1 1" pos="0.1 0 0"/>
        <geom type="capsule" fromto="0 0 0 0.3 0.1 0" size="0.04"/>
        <geom type="sphere" size="0.05" pos="0.2 0 0" class="c"/>
        <body name="b" pos="0.3 0 0" axisangle="0 1 0 0.4"><joint name="j2" axis="1 0 0"/>
          <geom type="cylinder" size="0.03 0.1"/>
          <geom type="ellipsoid" size=".02 .03 .04" mass="0.2" pos="0 0.1 0"/>
          <body name="c" pos="0 0 0.3" zaxis="0 1 0.2">
            <joint name="j3" axis="0 0 1"/><joint name="j4" axis="0 1 0" pos="0 0.1 0.2"/>
            <geom type="box" size="0.03 0.1 .02" xyaxes="0 1 0 -1 0 0"/>
          </body>
        </body>
      </body>
    </frame>
    <body name="other"><joint name="j5"/><geom type="capsule" size="0.03 0.2" pos="0.2 0 0"/></body>
  </worldbody></mujoco>"""


def _compare(folder: Path, text: str, seed: int) -> None:
    """Inverse dynamics by our tree of the written URDF, and by MuJoCo of its own file."""
    (folder / "robot.xml").write_text(text)
    links = urdf_of_mujoco(folder / "robot.xml")
    (folder / "robot.urdf").write_text(links.urdf)
    model = mujoco.MjModel.from_xml_string(text)
    model.dof_armature[:] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    tree = read_tree(folder / "robot.urdf", driven_joints(folder / "robot.urdf"))
    joints = [model.joint(name).id for name in tree.joints]
    place, dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    data, dice = mujoco.MjData(model), np.random.default_rng(seed)
    q, v, a = dice.uniform(-1.0, 1.0, (3, 1, len(joints)))
    data.qpos[place], data.qvel[dof], data.qacc[dof] = q[0], v[0], a[0]
    mujoco.mj_inverse(model, data)
    expected = data.qfrc_inverse[dof] + data.qfrc_passive[dof]
    np.testing.assert_allclose(inverse_dynamics(tree, q, v, a)[0], expected, rtol=1e-9, atol=1e-9)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 999), sequence=st.sampled_from(["xyz", "XYZ", "zyx", "ZXZ"]))
def test_links_of_a_mujoco_model_need_the_torque_that_mujoco_says(tmp_path_factory, seed, sequence):
    folder = tmp_path_factory.mktemp("mujoco")
    _compare(folder, ARM, seed)
    _compare(folder, GEOMS.format(sequence=sequence), seed)


def test_armature_damping_and_friction_of_a_mujoco_model_are_said_and_used(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    joints = dict.fromkeys(["joint1", "joint2", "joint3"], 0.0)
    with compared_model(tmp_path / "arm.xml", joints, {"slide": 0.01}) as found:
        np.testing.assert_array_equal(found.model.reflected_inertia, [0.1, 0.1, 0.05])
        np.testing.assert_array_equal(found.model.motor_damping, 1.5)
        (friction,) = found.known_effects
        assert friction.effect == "coulomb_friction" and friction.joints == ("joint1", "joint2")
        said = " ".join(found.model.notes)
    assert "armature: joint1 0.1, joint2 0.1, joint3 0.05" in said and "frictionloss: joint1 0.4" in said
    assert "held where it was stated: slide at 0.01 m" in said


def _mujoco(inside: str, compiler: str = "") -> str:
    return f'<mujoco><compiler {compiler}/><worldbody><body name="a">{inside}</body></worldbody></mujoco>'


HINGE = '<joint name="j"/>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_mujoco(HINGE + '<geom type="mesh" mesh="m"/>'), "a geom of the type 'mesh'"),
        (_mujoco(HINGE + '<geom size=".1"/><replicate count="2"><body/></replicate>'), "<replicate> makes"),
        (_mujoco(HINGE + '<geom size=".1"/>', 'settotalmass="3"'), "settotalmass"),
        (_mujoco('<geom size=".1"/>'), "no joint turns"),
        (_mujoco('<joint axis="0 0 0"/><geom size=".1"/>'), "an axis of length 0"),
        (_mujoco(HINGE + '<geom type="box" size=".1"/>'), "needs 3 numbers"),
        ('<mujoco><include file="robot.xml"/></mujoco>', "<include> of 'robot.xml'"),
        ('<mujoco><option gravity="0 0 0"/><worldbody/></mujoco>', "gravity is 0 0 0"),
    ],
)
def test_a_mujoco_model_that_would_mislead_is_refused_with_its_line(tmp_path, text, words):
    (tmp_path / "robot.xml").write_text(text)
    with pytest.raises(BadInput) as caught:
        urdf_of_mujoco(tmp_path / "robot.xml")
    assert words in str(caught.value) and "robot.xml:1:" in str(caught.value)


# A torso that slides and turns carries two arms; a gripper's second finger follows its first.
TORSO = """<robot name="torso"><link name="base"/><link name="torso"/><link name="chest"><inertial><mass value="3"/>
<origin xyz="0 0 0.2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="torso"/><axis xyz="0 0 1"/>
<limit lower="0" upper="0.4" effort="100" velocity="1"/></joint>
<joint name="lean" type="revolute"><parent link="torso"/><child link="chest"/><origin rpy="0.1 0 0.2"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="100" velocity="1"/></joint>{arms}</robot>"""
ARM_PART = """<link name="{s}_upper"><inertial><mass value="2"/><origin xyz="0.1 0 -0.2"/><inertia ixx="0.02"
iyy="0.02" izz="0.01" ixy="0" ixz="0.001" iyz="0"/></inertial></link>
<joint name="{s}_shoulder" type="continuous"><parent link="chest"/><child link="{s}_upper"/>
<origin xyz="0 0.2 0.4" rpy="0 0.3 0"/><axis xyz="1 0 0"/><dynamics damping="0.5" friction="0"/></joint>
<link name="{s}_finger"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0"
iyz="0"/></inertial></link><joint name="{s}_finger" type="prismatic"><parent link="{s}_upper"/>
<child link="{s}_finger"/><axis xyz="0 1 0"/><limit lower="0" upper="0.1" effort="20" velocity="1"/></joint>
<link name="{s}_thumb"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0"
iyz="0"/></inertial></link><joint name="{s}_thumb" type="prismatic"><parent link="{s}_upper"/>
<child link="{s}_thumb"/><axis xyz="0 1 0"/><limit lower="-0.1" upper="0.1" effort="20" velocity="1"/>
<mimic joint="{s}_finger" multiplier="-1" offset="0.01"/></joint>"""


@pytest.fixture
def torso(tmp_path):
    path = tmp_path / "torso.urdf"
    path.write_text(TORSO.format(arms=ARM_PART.format(s="left") + ARM_PART.format(s="right")))
    return path


@settings(max_examples=20, deadline=None)
@given(lift=st.floats(0.0, 0.4), lean=st.floats(-1.0, 1.0), seed=st.integers(0, 99))
def test_a_held_joint_is_one_that_stands_there(tmp_path_factory, lift, lean, seed):
    """Inverse dynamics of the held description equal those of all joints, with the held ones at rest."""
    path = tmp_path_factory.mktemp("held") / "torso.urdf"
    path.write_text(TORSO.format(arms=ARM_PART.format(s="left")))
    whole = read_tree(path, ["lift", "lean", "left_shoulder", "left_finger", "left_thumb"])
    dice = np.random.default_rng(seed)
    q, v, a = dice.uniform(-1.0, 1.0, (3, 1, 5))
    finger = 0.03
    known = {"lift": lift, "lean": lean, "left_finger": finger, "left_thumb": 0.01 - finger}
    for joint, position in known.items():
        place = whole.joints.index(joint)
        q[:, place], v[:, place], a[:, place] = position, 0.0, 0.0
    own = whole.joints.index("left_shoulder")
    stated = {"lift": lift, "lean": lean, "left_finger": finger}  # the thumb follows
    with compared_model(path, {"left_shoulder": 0.0}, stated) as found:
        pick = [own]
        held = inverse_dynamics(found.model.tree, q[:, pick], v[:, pick], a[:, pick])
    np.testing.assert_allclose(held, inverse_dynamics(whole, q, v, a)[:, pick], rtol=1e-9, atol=1e-12)


def test_a_follower_is_held_and_said_and_another_arm_is_said(torso):
    recorded = {"left_shoulder": 0.1, "left_finger": 0.04, "left_thumb": -0.02}
    with compared_model(torso, recorded, {}) as found:
        assert found.model.joints == ("left_shoulder", "left_finger")
        assert found.model.tree.units() == ("N.m", "N")
        said = " ".join(found.model.notes)
    assert "'left_thumb' follows 'left_finger' (mimic)" in said and "-0.02 m, its mean" in said
    assert "right_shoulder, right_finger, right_thumb; the base is taken to stand" in said
    assert "<dynamics> (damping, friction) of left_shoulder is not part of the model" in said
    assert driven_joints(torso) == (
        "lift", "lean", "left_shoulder", "left_finger", "right_shoulder", "right_finger"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("recorded", "held", "words"),
    [
        ({"left_shoulder": 0.0}, {"lfit": 0.1}, "did you mean 'lift'"),
        ({"left_shoulder": 0.0}, {"left_shoulder": 0.1}, "its position was recorded"),
        ({"left_shoulder": 0.0}, {"lift": 0.5}, "its range is 0 to 0.4 m"),
        ({"left_thumb": 0.0}, {}, "all recorded joints follow another one"),
    ],
)
def test_what_cannot_be_held_is_refused(torso, recorded, held, words):
    with pytest.raises(BadInput, match=words), compared_model(torso, recorded, held):
        pass
