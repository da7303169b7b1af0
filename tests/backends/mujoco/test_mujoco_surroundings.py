# SPDX-License-Identifier: BSD-3-Clause
"""Surfaces and objects in MuJoCo: each shape bears a body as the plant's does; what has no shape there is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.mujoco.mujoco_plant import MujocoPlant
from impedance_modules.backends.mujoco.scene import build_scene
from impedance_modules.backends.mujoco.worn_effects import worn_effects
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.plant.rigid_object import ObjectBody
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.hinge_spec import HingeSpec
from impedance_modules.spec.task import SurfaceSpec
from tests.support.closed_meshes import box_mesh
from tests.support.commands import refusal
from tests.support.plant_parts import SIX_JOINTS, block, box, exact, middle, plane, spec_of

AWAY = (3.0, 0.0, 0.0)
"""Where the robot cannot be [m]."""


def surface(kind: str, **numbers: object) -> SurfaceSpec:
    values = {"height": None, "position": AWAY, "rotation": (0.0, 0.0, 0.0), "size": None}
    values |= {"stiffness": 20000.0, "damping": 200.0, "friction": 0.5}
    return SurfaceSpec(**{"surface": kind, **values, **numbers})


SURFACES = {
    "plane": (plane(0.05, damping=200.0), 0.05),
    "tilted plane": (plane(0.0, rotation=(0.1, 0.0, 0.0), damping=200.0, friction=2.0), 0.0),
    "box": (block(AWAY, (0.4, 0.4, 0.1), damping=200.0), 0.05),
    "lying cylinder": (surface("cylinder", size=(0.2, 0.6), rotation=(0.0, np.pi / 2.0, 0.0)), 0.1),
    "sphere": (surface("sphere", size=(0.2,)), 0.1),
    "convex mesh": (surface("mesh", mesh=box_mesh((0.4, 0.4, 0.1))), 0.05),
}
"""Surface -> what it is, and how high it reaches where the ball stands [m]."""


def both(held: ObjectBody, surfaces: tuple[SurfaceSpec, ...] = ()) -> tuple[Plant, MujocoPlant]:
    model = RobotModel(exact(spec_of(SIX_JOINTS)))
    options, worn, at = PlantOptions(rate=1000.0, seed=0), worn_effects(model, None), middle(model)
    plant = Plant(model, surfaces, held, options)
    subject = MujocoPlant(model, build_scene(model, surfaces, held, at, worn.plant), worn, options)
    plant.reset(at)
    subject.reset(at)
    return plant, subject


@pytest.mark.parametrize("name", SURFACES)
def test_a_ball_comes_to_rest_where_it_does_in_the_plant(name: str) -> None:
    found, top = SURFACES[name]
    ball = box(shape="sphere", size=(0.1,), mass=1.5, position=(3.0, 0.0, top + 0.0495))
    plant, subject = both(ObjectBody(ball, ()), (found,))
    for _ in range(400):
        plant.advance(plant.start_command)
        subject.advance(subject.start_command)
    place = subject.data.body("impedance/object").xpos
    np.testing.assert_allclose(place, plant.object_pose.translation, atol=1e-3)
    assert place[2] > top + 0.04, "it has not fallen through"
    if name == "tilted plane":
        assert place[1] < -0.02, "it rolls down"


def test_an_object_on_a_hinge_swings_as_in_the_plant() -> None:
    hinge = HingeSpec(
        (3.0, 0.0, 1.3),
        (0.0, 1.0, 0.0),
        friction=0.1,
        damping=0.05,
        stiffness=2.0,
        rest=0.7,
        angle=0.1,
        upper=0.5,
    )
    plant, subject = both(ObjectBody(box(position=(3.0, 0.0, 1.0), hinge=hinge), ()))
    angles = []
    for _ in range(1200):
        plant.advance(plant.start_command)
        subject.advance(subject.start_command)
        angles.append((plant.hinge_angle, float(subject.data.joint("impedance/object").qpos[0])))
    ours, theirs = np.array(angles).T
    assert np.ptp(ours) > 0.2
    np.testing.assert_allclose(ours, theirs, atol=0.02)


REFUSED = {
    "slide-over": "sheet",
    "hold-to-saddle": "saddle",
    "hold-to-fouled-pipe": "hollows",
    "sand-wood": "splinters",
}


@pytest.mark.parametrize("task", REFUSED)
def test_what_mujoco_has_no_shape_for_is_refused_by_its_line(task: str, tmp_path: Path) -> None:
    said = refusal("run", task, "--backend", "mujoco", "--out", tmp_path / "out")
    assert REFUSED[task] in said and "environment[" in said and "(valid: --backend sim" in said
    assert f"{task}.yaml:" in said and not (tmp_path / "out").exists()


def test_a_contact_too_fast_for_any_step_is_refused() -> None:
    hard = surface("sphere", size=(0.2,), stiffness=1e16)
    with pytest.raises(BadInput, match=r"integration step .* contact that vibrates"):
        both(ObjectBody(box(mass=1e-3, size=(0.01, 0.01, 0.01), position=(5.0, 0.0, 0.0)), ()), (hard,))
