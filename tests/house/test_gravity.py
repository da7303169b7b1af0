# SPDX-License-Identifier: BSD-3-Clause
"""Gravity is one constant: the number stands in one file, and everything that falls or is carried falls by it."""

import ast

import numpy as np

from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.data.rigid_tree import read_tree
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.modules.held_object import carry_weight
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import STANDARD_GRAVITY, UPRIGHT_GRAVITY
from tests.house.test_imports import PACKAGE
from tests.support.paths import CHECKOUT


def test_the_number_is_written_once() -> None:
    """No other number between 9.75 and 9.85 in either package, so neither 9.8 nor 9.80665."""
    found = [
        f"{path.relative_to(CHECKOUT)}:{node.lineno}"
        for folder in (PACKAGE, CHECKOUT / "impedance_experiments")
        for path in sorted(folder.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and 9.75 < node.value < 9.85
    ]
    assert len(found) == 1 and found[0].startswith("impedance_modules/spec/robot_spec.py:"), found


def test_model_plant_object_and_diagnosis_fall_alike() -> None:
    spec = read_robot("baxter")
    model, down = RobotModel(spec), np.array([0.0, 0.0, -STANDARD_GRAVITY])
    diagnosed = RigidModel.from_urdf(spec.urdf, model.joint_names)
    for said in (
        UPRIGHT_GRAVITY,
        spec.gravity,
        model.pin_model.gravity.linear,
        diagnosed.gravity,
        PlantOptions(rate=1000.0, seed=0).gravity,
        -carry_weight(np.zeros((1, 3)), 1.0)[0, :3],
    ):
        np.testing.assert_array_equal(said, down)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, model.n))
    batched = BatchedRigidModel.of_tree(spec.urdf, read_tree(spec.urdf, model.joint_names))
    np.testing.assert_allclose(batched.weight(q), diagnosed.weight(q), rtol=1e-9, atol=1e-9)
