# SPDX-License-Identifier: BSD-3-Clause
"""A MuJoCo model of one's own: the same links move alike, one arm is attached twice, another arm is refused."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from impedance_modules.backends.mujoco.mujoco_plant import MujocoPlant
from impedance_modules.backends.mujoco.robot_bodies import add_robot
from impedance_modules.backends.mujoco.scene import build_scene
from impedance_modules.backends.mujoco.worn_effects import worn_effects
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.robot.model import RobotModel
from tests.support.commands import refusal
from tests.support.mujoco_models import rigid
from tests.support.paths import CHECKOUT
from tests.support.plant_parts import BAXTER, exact, middle, spec_of

FR3 = CHECKOUT / "robots" / "fr3-pair"
Change = Callable[[mujoco.MjSpec], None]


def model_of(folder: Path) -> RobotModel:
    return RobotModel(exact(spec_of(folder)))


def links_of(model: RobotModel) -> mujoco.MjSpec:
    """The robot's links as a MuJoCo model, its joints without rotors on springs."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    add_robot(spec, RobotModel(rigid(model.spec.folder)), np.zeros(3), np.zeros(model.n))
    return spec


def written(spec: mujoco.MjSpec, folder: Path) -> Path:
    spec.compile()
    path = folder / "robot.xml"
    path.write_text(spec.to_xml())
    return path


def one_arm(model: RobotModel, folder: Path, change: Change = lambda _: None) -> Path:
    """The model of the right arm alone, somewhere else, its joints called as a single robot's are."""
    spec = links_of(model)
    for limb, found in model.limbs.items():
        base = spec.joint(found.joint_names[0]).parent
        if limb != "right":
            spec.delete(base)
            continue
        base.pos = np.add(base.pos, (0.4, -0.2, 0.9))
        for name in found.joint_names:
            spec.joint(name).name = name.removeprefix("right_")
    change(spec)
    return written(spec, folder)


def started(model: RobotModel, mjcf: Path | None) -> MujocoPlant:
    worn, posture = worn_effects(model, None), middle(model)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = build_scene(model, (), None, posture, worn.plant, mjcf)
    subject = MujocoPlant(model, scene, worn, PlantOptions(rate=1000.0, seed=0))
    subject.reset(posture)
    return subject


def swung(subject: MujocoPlant) -> np.ndarray:
    strength = 0.05 * subject.model.column("effort_max")
    for k in range(300):
        subject.advance(subject.start_command + strength * np.sin(0.02 * k + np.arange(subject.model.n)))
    return np.array([subject.position, subject.sense().effort])


@pytest.mark.parametrize("folder", [BAXTER, FR3], ids=["springs", "rigid"])
def test_a_model_of_the_same_links_moves_as_the_folders(tmp_path: Path, folder: Path) -> None:
    model = model_of(folder)
    own = swung(started(model, None))
    theirs = swung(started(model, written(links_of(model), tmp_path)))
    np.testing.assert_allclose(own, theirs, atol=1e-4)
    assert np.ptp(own[0] - middle(model)) > 0.01


def test_a_model_of_one_arm_is_attached_for_each_limb_where_the_urdf_has_it(tmp_path: Path) -> None:
    model = model_of(FR3)
    path = one_arm(model, tmp_path, lambda spec: spec.worldbody.bodies[-1].add_joint(name="finger"))
    own, theirs = started(model, None), started(model, path)
    for frame in (limb.hand for limb in model.limbs.values()):
        name = f"impedance/hand/{frame}"
        np.testing.assert_allclose(own.data.site(name).xpos, theirs.data.site(name).xpos, atol=1e-9)
    np.testing.assert_allclose(swung(own), swung(theirs), atol=1e-4)


def longer(spec: mujoco.MjSpec) -> None:
    forearm = spec.joint("fr3_joint4").parent
    forearm.pos = np.add(forearm.pos, (0.0, 0.02, 0.0))


def turned_round(spec: mujoco.MjSpec) -> None:
    spec.joint("fr3_joint4").axis = -np.array(spec.joint("fr3_joint4").axis)


def other_zero(spec: mujoco.MjSpec) -> None:
    spec.joint("fr3_joint5").ref = 0.1


def renamed(spec: mujoco.MjSpec) -> None:
    spec.joint("fr3_joint5").name = "elbow"


@pytest.mark.parametrize("change", [longer, turned_round, other_zero, renamed])
def test_another_arm_is_refused_with_the_joint(tmp_path: Path, change: Change) -> None:
    model = model_of(FR3)
    with pytest.raises(BadInput, match=r"robot\.xml: .*fr3_joint\d.*\(valid: "):
        started(model, one_arm(model, tmp_path, change))


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    missing, broken = tmp_path / "no.xml", tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody>")
    for path in (missing, broken):
        with pytest.raises(BadInput, match="not a MuJoCo model that can be read"):
            started(model_of(FR3), path)
    assert "--backend mujoco" in refusal("run", "soft-hold", "--mjcf", missing, "--out", tmp_path / "out")
