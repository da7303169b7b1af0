# SPDX-License-Identifier: BSD-3-Clause
"""MuJoCo models as people write them: default classes, degrees, turned inertias, servos, frames."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.export.test_urdf_export import entry
from tests.support.commands import invoke, refusal
from tests.support.effect_recordings import write_patch

MODEL = """<mujoco model="arm">
  <!-- angles in degrees: MuJoCo's own way -->
  <compiler eulerseq="zyx"/>
  <option gravity="0 0 -9.81"/>
  <default>
    <joint damping="0.5" armature="0.01"/>
    <default class="geared"><motor gear="2" forcerange="-8 8"/></default>
    <default class="light">
      <joint frictionloss='0.1' stiffness="3" springref="10"/>
      <default class="wrist"><joint damping="0.2 0.05"/></default>
    </default>
  </default>
  <worldbody>
    <body name="base" pos="0 0 1">
      <frame>
        <body name="upper" euler="20 -30 40">
          <inertial pos="0 0.1 0.2" mass="2" {turned} diaginertia="0.03 0.02 0.015"/>
          <joint name="shoulder" axis="0 1 0" range="-90 60" ref="5"/>
          <body name="fore" pos="0 0 0.4" childclass="light">
            <inertial pos="0.1 0 0.2" mass="1" fullinertia="0.02 0.03 0.04 0.001 0.002 0.003"/>
            <joint name="elbow" axis="1 0 0"/>
            <body name="hand" pos="0 0 0.3">
              <inertial pos="0 0 0.05" mass="0.3" diaginertia="0.002 0.002 0.001"/>
              <joint name="wrist" class="wrist" axis="0 0 1" type="slide" range="-0.1 0.1"/>
            </body>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
  <actuator>
    <motor name="shoulder" class="geared" joint="shoulder"/>
    <position name="elbow" joint="elbow" kp="40" kv="2" forcerange="-9 9"/>
    <general name="wrist" joint="wrist" gaintype="affine" gainprm="3 0.1 0.2" biastype="affine" biasprm="1 -5 -0.5"/>
  </actuator>
</mujoco>
"""
ORIENTATIONS = (
    'quat="0.3 -0.5 0.7 0.2"', 'quat="0 0 -2 0"', 'axisangle="1 -2 0.5 70"', 'euler="25 -50 130"',
    'xyaxes="1 0.2 -0.3 0.5 2 1"', 'zaxis="0.3 -0.4 -0.8"', 'zaxis="0 0 -1"', "",
)  # fmt: skip
"""Ways in which MuJoCo lets an inertia's axes be turned."""

UNTURNED = MODEL.format(turned="")


def models_of(folder: Path, text: str, *entries: dict[str, object]) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """MuJoCo's own reading of a model as it is, and with a patch."""
    (folder / "arm.xml").write_text(text)
    patch = write_patch(folder, *entries, robot="arm")
    invoke("patch", "export", patch, "--mujoco", folder / "arm.xml", "--out", folder / "out.xml")
    return tuple(mujoco.MjModel.from_xml_path(str(folder / name)) for name in ("arm.xml", "out.xml"))


def why_not(folder: Path, text: str, *entries: dict[str, object]) -> str:
    (folder / "arm.xml").write_text(text)
    patch = write_patch(folder, *entries, robot="arm")
    words = refusal("patch", "export", patch, "--mujoco", folder / "arm.xml", "--out", folder / "out.xml")
    assert not (folder / "out.xml").exists()
    return words


def payload(link: str, m: float, **place: float) -> dict[str, object]:
    numbers = {"m": {"value": m, "unit": "kg"}}
    numbers |= {name: {"value": place.get(name, 0.0), "unit": "m"} for name in ("cx", "cy", "cz")}
    return {"effect": "payload", "joints": [], "port": "link", "parameters": {link: numbers}}


def spring(joint: str, k: float, q0: float) -> dict[str, object]:
    numbers = {"k": {"value": k, "unit": "N.m/rad"}, "q0": {"value": q0, "unit": "rad"}}
    return {"effect": "parallel_spring", "joints": [joint], "port": "link", "parameters": {joint: numbers}}


@pytest.mark.parametrize("turned", ORIENTATIONS)
def test_a_turned_inertia_is_the_same_in_the_bodys_axes(turned: str, tmp_path: Path) -> None:
    """A payload without mass only rewrites it."""
    models = models_of(tmp_path, MODEL.format(turned=turned), payload("upper", 0.0), payload("fore", 0.0))
    assert "fullinertia" in (tmp_path / "out.xml").read_text().split("upper")[1].split("joint")[0]
    for body in ("upper", "fore"):
        before, after = (inertia_of(model, body) for model in models)
        np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("sequence", ["xyz", "XYZ", "zyx", "ZxZ"])
def test_euler_angles_are_read_in_the_models_sequence(sequence: str, tmp_path: Path) -> None:
    text = MODEL.format(turned='euler="25 -50 130"').replace("zyx", sequence)
    before, after = (inertia_of(model, "upper") for model in models_of(tmp_path, text, payload("upper", 0.0)))
    np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-12)


def inertia_of(model: mujoco.MjModel, body: str) -> np.ndarray:
    """MuJoCo's own inertia (3, 3) of a body about its centre of mass, in the body's axes."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body(body).iquat)
    R = rotation.reshape(3, 3)
    return R @ np.diag(model.body(body).inertia) @ R.T


def test_a_payload_adds_a_point_mass(tmp_path: Path) -> None:
    before, after = models_of(tmp_path, UNTURNED, payload("fore", 0.7, cx=0.2, cy=-0.1, cz=0.3))
    m, c = float(before.body("fore").mass[0]), before.body("fore").ipos
    place = np.array([0.2, -0.1, 0.3])
    centre = (m * c + 0.7 * place) / (m + 0.7)
    np.testing.assert_allclose(after.body("fore").ipos, centre)
    apart = place - c
    reduced = m * 0.7 / (m + 0.7) * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    np.testing.assert_allclose(inertia_of(after, "fore"), inertia_of(before, "fore") + reduced, atol=1e-12)


def test_what_a_default_class_says_is_added_to(tmp_path: Path) -> None:
    before, after = models_of(
        tmp_path,
        UNTURNED,
        entry("viscous_friction", "link", "shoulder", "N.m.s/rad", fv=0.3),
        entry("viscous_friction", "link", "wrist", "N.s/m", fv=0.3),
        entry("quadratic_drag", "link", "wrist", "N.s^2/m^2", c=0.1),
        entry("quadratic_drag", "link", "elbow", "N.m.s^2/rad^2", c=0.7),
        entry("coulomb_friction", "link", "elbow", "N.m", fc=0.2),
        entry("reflected_inertia", "actuator", "wrist", "kg", Ia=0.3),
    )
    np.testing.assert_allclose(before.dof_damping, [0.5, 0.5, 0.2])
    np.testing.assert_allclose(after.dof_damping, [0.8, 0.5, 0.5])
    np.testing.assert_allclose(after.dof_dampingpoly[:, 0], [0.0, 0.7, 0.15])
    np.testing.assert_allclose(after.dof_frictionloss, [0.0, 0.3, 0.1])
    np.testing.assert_allclose(after.dof_armature, [0.01, 0.01, 0.3])


def test_degrees_are_degrees_and_a_spring_joins_the_joints_own(tmp_path: Path) -> None:
    before, after = models_of(
        tmp_path,
        UNTURNED,
        spring("elbow", 6.0, 0.4),
        spring("shoulder", 2.0, -0.3),
        entry("encoder_offset", "sensor", "elbow", "rad", dq0=0.02),
        entry("encoder_offset", "sensor", "shoulder", "rad", dq0=0.05),
        entry("encoder_offset", "sensor", "wrist", "m", dq0=0.01),
    )
    np.testing.assert_allclose(after.jnt_stiffness, [2.0, 9.0, 3.0])
    relaxed = [-0.3 + 0.05, (3.0 * np.deg2rad(10.0) + 6.0 * 0.4) / 9.0 + 0.02, 10.0 + 0.01]
    np.testing.assert_allclose(after.qpos_spring, relaxed)
    np.testing.assert_allclose(after.qpos0, before.qpos0 + np.array([0.05, 0.02, 0.01]))
    shifted = before.jnt_range + np.array([[0.05], [0.0], [0.01]])
    np.testing.assert_allclose(after.jnt_range, shifted)


def actuator_torques(model: mujoco.MjModel, control: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = [0.3, -0.2, 0.04], [1.0, -2.0, 0.5], control
    mujoco.mj_forward(model, data)
    return data.qfrc_actuator.copy()


GAINS = [
    entry("torque_gain", "actuator", joint, "1", s=s)
    for joint, s in (("shoulder", 0.9), ("elbow", 1.2), ("wrist", 0.7))
]


@pytest.mark.parametrize("control", [0.01, -0.4, 30.0], ids=["small", "negative", "clipped"])
def test_a_gain_scales_what_every_kind_of_actuator_gives(control: float, tmp_path: Path) -> None:
    again = entry("torque_gain", "actuator", "elbow", "1", s=0.5)
    before, after = models_of(tmp_path, UNTURNED, *GAINS, again)
    there, here = (actuator_torques(model, np.full(3, control)) for model in (before, after))
    assert np.all(there != 0.0)
    np.testing.assert_allclose(here, there * [0.9, 0.6, 0.7], rtol=1e-12)


def test_a_limit_clips_within_the_models_own_and_before_the_gain(tmp_path: Path) -> None:
    text = UNTURNED.replace('range="-90 60"', 'range="-90 60" actuatorfrcrange="-3 20"')
    limits = [entry("torque_saturation", "actuator", "shoulder", "N.m", limit=limit) for limit in (5.0, 6.0)]
    _, after = models_of(tmp_path, text, *limits, GAINS[0])
    np.testing.assert_allclose(after.jnt_actfrcrange[0], [-2.7, 4.5])
    assert actuator_torques(after, np.array([30.0, 0.0, 0.0]))[0] == pytest.approx(4.5)


def test_a_position_servo_is_stiffer(tmp_path: Path) -> None:
    before, after = models_of(
        tmp_path, UNTURNED, entry("controller_gain", "actuator", "elbow", "N.m/rad", dkp=7.0)
    )
    control = np.array([0.0, -0.1, 0.0])
    more = actuator_torques(after, control) - actuator_torques(before, control)
    np.testing.assert_allclose(more, [0.0, 7.0 * (-0.1 - -0.2), 0.0], atol=1e-12)


def test_lag_and_delay_reach_back_as_far_as_they_must(tmp_path: Path) -> None:
    text = UNTURNED.replace(
        '<motor name="shoulder" class="geared"', '<general name="shoulder" delay="0.003" nsample="2"'
    )
    lag = entry("actuator_lag", "actuator", "shoulder", "s", T=0.02)
    late = [entry("command_delay", "timing", "shoulder", "s", T=T) for T in (0.011, 0.003)]
    _, after = models_of(tmp_path, text, lag, *late)
    assert after.actuator_delay[0] == 0.017 and after.actuator_history[0, 0] == 10
    assert after.actuator_dyntype[0] == mujoco.mjtDyn.mjDYN_FILTEREXACT
    assert after.actuator_dynprm[0, 0] == 0.02


def test_a_lean_turns_gravity_and_only_where_the_base_is_not_turned(tmp_path: Path) -> None:
    numbers = {"rx": {"value": 0.1, "unit": "rad"}, "ry": {"value": 0.0, "unit": "rad"}}
    lean = {"effect": "base_tilt", "joints": [], "port": "link", "parameters": {"base": numbers}}
    _, after = models_of(tmp_path, UNTURNED, lean)
    np.testing.assert_allclose(after.opt.gravity, [0.0, -9.81 * np.sin(0.1), -9.81 * np.cos(0.1)])
    _, silent = models_of(tmp_path, UNTURNED.replace('  <option gravity="0 0 -9.81"/>\n', ""), lean)
    np.testing.assert_allclose(silent.opt.gravity, after.opt.gravity)
    twice = UNTURNED.replace("<default>", '<option gravity="0 0 -1.62"/><default>', 1)
    nominal, moon = models_of(tmp_path, twice, lean)
    assert nominal.opt.gravity[2] == -1.62
    np.testing.assert_allclose(moon.opt.gravity, after.opt.gravity * 1.62 / 9.81)
    (tmp_path / "out.xml").unlink()
    turned = UNTURNED.replace('pos="0 0 1"', 'pos="0 0 1" euler="0 0 90"')
    assert "line 14: <body> 'base' is turned in the world" in why_not(tmp_path, turned, lean)
    floating = UNTURNED.replace("<frame>", "<freejoint/><frame>")
    assert "<body> 'base' floats" in why_not(tmp_path, floating, lean)


@pytest.mark.parametrize(
    ("old", "new", "effect", "words"),
    [
        ('gravity="0 0 -9.81"/>', '><flag frictionloss="disable"/></option>', "coulomb_friction", "<flag friction"),
        ('range="-90', 'springdamper="0.1 1" range="-90', "viscous_friction", "(springdamper)"),
        ('<motor name="shoulder"', '<motor name="shoulder" armature="0.1"', "reflected_inertia", "an armature"),
        ('joint="shoulder"/>', 'joint="elbow"/>', "torque_gain", "has no actuator on the joint 'shoulder'"),
        ("<motor name", "<muscle name", "torque_gain", "driven by a <muscle>"),
        ('<motor name="shoulder"', '<position name="shoulder"', "torque_gain", "takes defaults from"),
        ("</actuator>", '</actuator><tendon><fixed><joint joint="shoulder" coef="1"/></fixed></tendon>',
         "encoder_offset", "a tendon's length"),
        ("", "", "actuator_lag", "a <motor>, which has no activation"),
        ("", "", "controller_gain", "not driven by one <position> actuator"),
    ],
)  # fmt: skip
def test_what_a_model_has_no_place_for_is_refused(
    old: str, new: str, effect: str, words: str, tmp_path: Path
) -> None:
    values = {
        "coulomb_friction": ("N.m", {"fc": 1.0}), "viscous_friction": ("N.m.s/rad", {"fv": 1.0}),
        "reflected_inertia": ("kg.m^2", {"Ia": 1.0}), "torque_gain": ("1", {"s": 0.9}),
        "encoder_offset": ("rad", {"dq0": 0.1}), "actuator_lag": ("s", {"T": 0.01}),
        "controller_gain": ("N.m/rad", {"dkp": 1.0}),
    }  # fmt: skip
    ports = {"coulomb_friction": "link", "viscous_friction": "link", "encoder_offset": "sensor"}
    unit, numbers = values[effect]
    one = entry(effect, ports.get(effect, "actuator"), "shoulder", unit, **numbers)
    found = why_not(tmp_path, UNTURNED.replace(old, new, 1), one)
    assert words in found and f"{effect} cannot become part of a MuJoCo model" in found


def test_laws_in_another_order_than_the_plants_are_refused(tmp_path: Path) -> None:
    text = UNTURNED.replace("<motor", "<general")
    limit = entry("torque_saturation", "actuator", "shoulder", "N.m", limit=5.0)
    lag = entry("actuator_lag", "actuator", "shoulder", "s", T=0.01)
    assert "acts before it, in MuJoCo behind it" in why_not(tmp_path, text, limit, lag)
    servo = entry("controller_gain", "actuator", "elbow", "N.m/rad", dkp=7.0)
    limit = entry("torque_saturation", "actuator", "elbow", "N.m", limit=5.0)
    assert "would clip it, too" in why_not(tmp_path, UNTURNED, limit, servo)
