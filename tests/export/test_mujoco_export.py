# SPDX-License-Identifier: BSD-3-Clause
"""A patch in a MuJoCo model: MuJoCo moves as our plant does with the same patch, for one joint and for two arms."""

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.robot.model import RobotModel
from tests.support.effect_recordings import AppliedEffect, applied, start
from tests.support.mujoco_models import Motions, OtherPlant, both_motions, patched_plant, rigid
from tests.support.paths import CHECKOUT
from tests.support.plant_parts import SIX_JOINTS

WHEEL = CHECKOUT / "robots" / "single_wheel"
A, L, P, S = "actuator", "link", "port_", "starboard_"

LIFT = P + "lift"
SMOOTH = {
    "payload": [applied("payload", L, P + "flange", m=0.9, cx=0.04, cy=0.02, cz=0.1)],
    "link_inertia": [
        applied("link_inertia", L, S + "forearm", dm=0.5, dhx=0.03, dhz=0.04, dIxx=7e-3, dIyy=8e-3, dIzz=4e-3)
    ],
    "viscous_friction": [applied("viscous_friction", port, LIFT, fv=1.7) for port in (A, L)],
    "quadratic_drag": [
        applied("quadratic_drag", A, S + "lift", c=1.2),
        applied("quadratic_drag", L, LIFT, c=2.7),
    ],
    "reflected_inertia": [applied("reflected_inertia", A, S + "bend", Ia=0.9)],
    "parallel_spring": [applied("parallel_spring", L, LIFT, k=k, preload=-4.0) for k in (17.0, 3.0)],
    "bench_spring": [applied("bench_spring", "contact", LIFT, k=9.0, q0=0.3, d=0.2)],
    "base_tilt": [applied("base_tilt", L, "base", rx=0.2, ry=-0.3)],
    "torque_gain": [applied("torque_gain", A, LIFT, s=0.91)],
    "torque_saturation": [applied("torque_saturation", A, LIFT, limit=limit) for limit in (14.0, 19.0)],
    "saturated gain": [
        applied("torque_gain", A, LIFT, s=0.91),
        applied("torque_saturation", A, LIFT, limit=14.0),
    ],
}
"""Effects whose law is the same in MuJoCo."""

LATE_AND_DRY = {
    "command_delay": [applied("command_delay", "timing", LIFT, T=0.007)],
    "actuator_lag": [applied("actuator_lag", A, LIFT, T=0.012)],
    "coulomb_friction": [applied("coulomb_friction", port, LIFT, fc=0.7) for port in (A, L)],
}
"""Effects that MuJoCo computes otherwise: from the step's start, or sgn(v) by a constraint instead of by tanh."""


def pull(time: float) -> np.ndarray:
    """Torques (12,) on both arms beside those that carry their weight [N.m]."""
    joint = np.arange(12)
    size = np.array([8.0, 8.0, 5.0, 1.0, 1.0, 0.5] * 2)
    return (-1.0) ** joint * size * np.sin(7.0 * time + joint)


def two_arms(folder: Path, entries: list[AppliedEffect], **more: object) -> Motions:
    robot = rigid(SIX_JOINTS)
    return both_motions(folder, robot, entries, start=start(RobotModel(robot)), pull=pull, **more)


def apart(motions: Motions) -> float:
    """How far positions of plant and MuJoCo differ at most [rad]."""
    return float(np.abs(motions.plant - motions.mujoco).max())


@pytest.mark.parametrize("name", SMOOTH)
def test_two_arms_move_as_in_the_plant(name: str, tmp_path: Path) -> None:
    with_patch = two_arms(tmp_path, SMOOTH[name])
    assert apart(with_patch) < 1e-12
    assert float(np.abs(with_patch.plant_velocity - with_patch.mujoco_velocity).max()) < 1e-11
    assert apart(two_arms(tmp_path, SMOOTH[name], nominal=True)) > 0.02


def test_all_smooth_effects_at_once_move_as_in_the_plant(tmp_path: Path) -> None:
    alone = [entries for name, entries in SMOOTH.items() if name not in ("torque_gain", "torque_saturation")]
    together = [entry for entries in alone for entry in entries]
    assert apart(two_arms(tmp_path, together)) < 1e-12
    assert apart(two_arms(tmp_path, together, nominal=True)) > 0.02


@pytest.mark.parametrize("name", LATE_AND_DRY)
def test_late_and_dry_joints_move_nearly_as_in_the_plant(name: str, tmp_path: Path) -> None:
    """Within 2 % of what the effect changes."""
    with_patch = apart(two_arms(tmp_path, LATE_AND_DRY[name]))
    assert with_patch < 0.02 * apart(two_arms(tmp_path, LATE_AND_DRY[name], nominal=True))


def test_a_dry_joint_only_creeps_where_the_torque_is_too_small(tmp_path: Path) -> None:
    """Both regularise: the plant by tanh(v / v_0), MuJoCo by a soft constraint. Without friction: 3 rad/s."""
    robot = rigid(WHEEL)
    entries = [applied("coulomb_friction", L, "axle", fc=2.0)]
    stuck = both_motions(
        tmp_path, robot, entries, start=np.zeros(1), pull=lambda time: np.array([1.9]), seconds=0.2
    )
    assert np.abs(stuck.mujoco_velocity).max() < 0.03 and np.abs(stuck.plant_velocity).max() < 0.03


ONE_JOINT = [
    applied("viscous_friction", A, "axle", fv=0.3),
    applied("parallel_spring", L, "axle", k=7.0, q0=0.2),
    applied("reflected_inertia", A, "axle", Ia=0.05),
    applied("payload", L, "wheel", m=0.8, cx=0.1, cy=-0.2, cz=0.05),
    applied("base_tilt", L, "base", rx=0.3, ry=0.1),
    applied("torque_gain", A, "axle", s=1.2),
]


@pytest.mark.parametrize("kind", ["general", "motor"])
def test_one_joint_moves_as_in_the_plant(kind: str, tmp_path: Path) -> None:
    def push(time: float) -> np.ndarray:
        return np.array([4.0 * np.cos(9.0 * time)])

    motion = {"start": np.array([0.4]), "pull": push, "kind": kind}
    assert apart(both_motions(tmp_path, rigid(WHEEL), ONE_JOINT, **motion)) < 1e-12
    assert apart(both_motions(tmp_path, rigid(WHEEL), ONE_JOINT, nominal=True, **motion)) > 0.1


def test_a_joint_reports_what_the_plants_encoder_reports(tmp_path: Path) -> None:
    """True motions agree, and the coordinate of each joint is the reported angle, its springs' included."""
    robot = rigid(SIX_JOINTS)
    offsets = {P + "lift": 0.12, S + "roll": -0.08}
    entries = [applied("encoder_offset", "sensor", joint, dq0=dq0) for joint, dq0 in offsets.items()]
    entries.append(applied("parallel_spring", L, LIFT, k=17.0, preload=-4.0))
    assert apart(two_arms(tmp_path, entries)) < 1e-12
    plant, at = patched_plant(robot, entries), start(RobotModel(robot))
    plant.reset(at)
    other = OtherPlant(tmp_path / "out.xml", plant, at)
    reported = [float(other.data.joint(name).qpos[0]) for name in plant.model.joint_names]
    np.testing.assert_allclose(plant.sense().position, reported, rtol=0.0, atol=1e-12)
    assert np.abs(np.array(reported) - at).max() > 0.1
