# SPDX-License-Identifier: BSD-3-Clause
"""A patch in a URDF: pinocchio on the written file has inertia, weight, friction and limits of the patched model."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.effects.apply import apply_patch
from impedance_modules.export.body_inertia import rotation_of_rpy, rpy_of_rotation
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.urdf import read_urdf
from tests.support.commands import invoke
from tests.support.effect_recordings import AppliedEffect, applied, patch_of, write_patch
from tests.support.plant_parts import BAXTER, SIX_JOINTS, spec_of

ROBOTS = (BAXTER, SIX_JOINTS)
LINK = "link"


def exported(folder: Path, entries: list[AppliedEffect], robot: RobotSpec) -> Path:
    patch, out = (
        write_patch(folder, *(entry.entry() for entry in entries), robot=robot.name),
        folder / "out.urdf",
    )
    invoke("patch", "export", patch, "--urdf", robot.urdf, "--out", out)
    return out


def bodies_of(robot: RobotSpec) -> list[str]:
    """Links with an inertia of their own that a joint moves."""
    facts = read_urdf(robot.urdf)
    moved = [name for name in facts.links if set(facts.moving_joints(name)) - set(robot.locked)]
    return [name for name in moved if name not in facts.links_without_inertia]


def random_bodies(robot: RobotSpec, source: np.random.Generator) -> list[AppliedEffect]:
    """Things fixed to links, links that are heavier or a little lighter, a base that leans."""
    links = source.permutation(bodies_of(robot)).tolist()
    x, y, z = source.uniform(-0.2, 0.2, 3)
    entries = [applied("payload", LINK, links[0], m=source.uniform(0.0, 3.0), cx=x, cy=y, cz=z)]
    entries += [applied("payload", LINK, link, m=0.4, cx=y, cy=z, cz=x) for link in links[:2]]
    sizes = {s: source.uniform(-1e-5, 1e-5) for s in ("dhx", "dhy", "dhz", "dIxy", "dIxz", "dIyz")}
    entries.append(applied("link_inertia", LINK, links[2], dm=0.2, dIxx=3e-3, dIyy=4e-3, dIzz=5e-3, **sizes))
    entries.append(applied("link_inertia", LINK, links[3], dm=-1e-3, **sizes))
    rx, ry = source.uniform(-0.5, 0.5, 2)
    return [*entries, applied("base_tilt", LINK, "base", rx=rx, ry=ry)]


def largest_difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


@pytest.mark.parametrize("folder", ROBOTS, ids=lambda folder: folder.name)
@pytest.mark.parametrize("seed", range(5))
def test_inertia_and_weight_are_those_of_the_patched_model(folder: Path, seed: int, tmp_path: Path) -> None:
    source, robot = np.random.default_rng(seed), spec_of(folder)
    entries = random_bodies(robot, source)
    ours = RobotModel(apply_patch(robot, patch_of(robot.name, entries)))
    theirs = RobotModel(replace(robot, urdf=exported(tmp_path, entries, robot)))
    nominal = RobotModel(robot)
    for q in source.uniform(-1.0, 1.0, (5, ours.n)):
        assert largest_difference(theirs.mass_matrix(q), ours.mass_matrix(q)) < 1e-12
        assert largest_difference(theirs.gravity(q), ours.gravity(q)) < 1e-12
        assert largest_difference(theirs.gravity(q), nominal.gravity(q)) > 1e-3


@pytest.mark.parametrize("folder", ROBOTS, ids=lambda folder: folder.name)
def test_a_reported_angle_is_the_joints_coordinate(folder: Path, tmp_path: Path) -> None:
    """M, weight and poses at q + q_e are those of the true q, and the stops stay where they were."""
    source, robot = np.random.default_rng(3), spec_of(folder)
    nominal = RobotModel(robot)
    offset = source.uniform(-0.3, 0.3, nominal.n)
    joints = zip(nominal.joint_names, offset, strict=True)
    entries = [applied("encoder_offset", "sensor", joint, dq0=dq0) for joint, dq0 in joints]
    theirs = RobotModel(replace(robot, urdf=exported(tmp_path, entries, robot)))
    for q in source.uniform(-1.0, 1.0, (5, nominal.n)):
        assert largest_difference(theirs.mass_matrix(q + offset), nominal.mass_matrix(q)) < 1e-12
        assert largest_difference(theirs.gravity(q + offset), nominal.gravity(q)) < 1e-12
        for limb in nominal.limbs.values():
            there, here = theirs.pose(q + offset, limb.hand), nominal.pose(q, limb.hand)
            np.testing.assert_allclose(there.translation, here.translation, rtol=0.0, atol=1e-12)
    for name in ("lowerPositionLimit", "upperPositionLimit"):
        before, after = (getattr(model.pin_model, name) for model in (nominal, theirs))
        np.testing.assert_allclose(after, before + offset, rtol=0.0, atol=1e-12)


ARM = """<?xml version='1.0'?>
<robot name="arm"> <!-- two joints -->
  <link name="base"><inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/>
    <origin xyz="0 0.1 0.4" rpy="0.3 -0.2 0.7"/><axis xyz="0 2 1"/>
    <limit lower="-0.5" upper='0.5' effort="90" velocity="1"/><dynamics damping="0.3"/></joint>
  <link name="cart"><inertial><origin xyz="0 0 0.1" rpy="0.2 1.1 -0.4"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0.003" ixz="0.001" iyy="0.03" iyz="0.002" izz="0.025"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="cart"/><child link="arm"/>
    <axis xyz="1 0 0"/></joint>
  <link name="arm"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.02"/></inertial></link>
</robot>
"""  # noqa: E501


def models_of(folder: Path, *entries: dict[str, object]) -> tuple[pin.Model, pin.Model]:
    """Pinocchio's models of the small arm as it is, and with a patch."""
    return models_of_text(folder, ARM, *entries)


def models_of_text(folder: Path, text: str, *entries: dict[str, object]) -> tuple[pin.Model, pin.Model]:
    (folder / "arm.urdf").write_text(text)
    patch = write_patch(folder, *entries, robot="arm")
    invoke("patch", "export", patch, "--urdf", folder / "arm.urdf", "--out", folder / "out.urdf")
    return tuple(pin.buildModelFromUrdf(str(folder / name)) for name in ("arm.urdf", "out.urdf"))


def entry(effect: str, port: str, key: str, unit: str, **values: float) -> dict[str, object]:
    quantities = {symbol: {"value": value, "unit": unit} for symbol, value in values.items()}
    return {"effect": effect, "joints": [key], "port": port, "parameters": {key: quantities}}


def test_friction_adds_up_and_the_smaller_limit_counts(tmp_path: Path) -> None:
    before, after = models_of(
        tmp_path,
        entry("coulomb_friction", "actuator", "slide", "N", fc=1.5),
        entry("coulomb_friction", "link", "slide", "N", fc=0.7),
        entry("viscous_friction", "actuator", "slide", "N.s/m", fv=2.0),
        entry("viscous_friction", "link", "turn", "N.m.s/rad", fv=0.4),
        entry("torque_saturation", "actuator", "slide", "N", limit=70.0),
        entry("torque_saturation", "actuator", "slide", "N", limit=60.0),
    )
    slide, turn = (after.joints[after.getJointId(name)].idx_v for name in ("slide", "turn"))
    assert after.friction[slide] == 2.2 and after.friction[turn] == 0.0
    assert after.damping[slide] == before.damping[slide] + 2.0 == 2.3
    assert after.damping[turn] == 0.4
    assert (before.effortLimit[slide], after.effortLimit[slide]) == (90.0, 60.0)


def test_mujoco_reads_friction_and_limits_of_the_written_file(tmp_path: Path) -> None:
    models_of(
        tmp_path,
        entry("coulomb_friction", LINK, "slide", "N", fc=0.7),
        entry("viscous_friction", LINK, "slide", "N.s/m", fv=2.0),
        entry("torque_saturation", "actuator", "slide", "N", limit=60.0),
    )
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.urdf"))
    assert (model.dof_frictionloss[0], model.dof_damping[0]) == (0.7, 2.3)
    assert list(model.jnt_actfrcrange[0]) == [-60.0, 60.0]


def test_a_limit_above_the_files_own_changes_nothing(tmp_path: Path) -> None:
    _, after = models_of(tmp_path, entry("torque_saturation", "actuator", "slide", "N", limit=95.0))
    assert after.effortLimit[after.joints[after.getJointId("slide")].idx_v] == 90.0


def test_a_sliding_joints_offset_moves_its_origin_along_its_axis(tmp_path: Path) -> None:
    before, after = models_of(tmp_path, entry("encoder_offset", "sensor", "slide", "m", dq0=0.05))
    q = pin.neutral(before)
    place = before.joints[before.getJointId("slide")].idx_q
    shifted = q.copy()
    q[place], shifted[place] = 0.2, 0.25
    poses = []
    for model, position in ((before, q), (after, shifted)):
        data = model.createData()
        pin.forwardKinematics(model, data, position)
        poses.append(data.oMi[model.getJointId("turn")])
    assert poses[0].isApprox(poses[1], 1e-12)
    np.testing.assert_allclose(after.upperPositionLimit[place], 0.55)


def test_a_payload_joins_an_inertia_in_turned_axes(tmp_path: Path) -> None:
    one = applied("payload", LINK, "cart", m=0.7, cx=0.2, cy=-0.1, cz=0.3).entry()
    before, after = (model.inertias[model.getJointId("slide")] for model in models_of(tmp_path, one))
    assert 'rpy="0.2 1.1 -0.4"' in (tmp_path / "out.urdf").read_text()
    whole = before + pin.Inertia(0.7, np.array([0.2, -0.1, 0.3]), np.zeros((3, 3)))
    np.testing.assert_allclose(after.matrix(), whole.matrix(), rtol=0.0, atol=1e-12)


LEAN = applied("base_tilt", LINK, "base", rx=0.2, ry=-0.3).entry()


def test_a_bare_root_link_stays_upright_and_what_hangs_on_it_leans(tmp_path: Path) -> None:
    bare = ARM.replace(ARM[ARM.index("<inertial>") : ARM.index("</link>")], "", 1)
    lean = pin.SE3(exp3(np.array([0.2, -0.3, 0.0])), np.zeros(3))
    before, after = models_of_text(tmp_path, bare, LEAN)
    joint = before.getJointId("slide")
    assert after.jointPlacements[joint].isApprox(lean * before.jointPlacements[joint], 1e-12)
    assert "upright" not in (tmp_path / "out.urdf").read_text()


def test_a_root_link_with_a_body_hangs_on_a_new_one(tmp_path: Path) -> None:
    before, after = models_of(tmp_path, LEAN)
    before.gravity.linear = exp3(np.array([0.2, -0.3, 0.0])).T @ before.gravity.linear
    q = pin.randomConfiguration(before, -np.ones(before.nq), np.ones(before.nq))
    weights = [pin.computeGeneralizedGravity(model, model.createData(), q) for model in (before, after)]
    np.testing.assert_allclose(weights[1], weights[0], rtol=1e-12)
    assert read_urdf(tmp_path / "out.urdf").joints["base_lean"].parent == "base_upright"


@pytest.mark.parametrize("pitch", [0.3, -1.2, 0.5 * np.pi, -0.5 * np.pi, 0.5 * np.pi - 1e-10])
def test_roll_pitch_and_yaw_are_found_again(pitch: float) -> None:
    R = rotation_of_rpy((0.4, pitch, -2.0))
    quarter = pin.rpy.rpyToMatrix(np.array([0.4, pitch, -2.0]))
    np.testing.assert_allclose(R, quarter, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(rotation_of_rpy(rpy_of_rotation(R)), R, rtol=0.0, atol=1e-9)


def test_everything_else_in_the_file_stays_byte_by_byte(tmp_path: Path) -> None:
    models_of(tmp_path, entry("viscous_friction", LINK, "slide", "N.s/m", fv=0.1))
    expected = ARM.replace('damping="0.3"', 'damping="0.4"')
    assert (tmp_path / "out.urdf").read_text() == expected != ARM
    assert (tmp_path / "arm.urdf").read_text() == ARM
