# SPDX-License-Identifier: BSD-3-Clause
"""Laws of the diagnosis's own inverse dynamics: equal to pinocchio's, linear in inertia, with a symmetric M."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.diagnosis.data.rigid_dynamics import (
    BatchedRigidModel,
    gravity_regressor,
    inertial_regressor,
    inverse_dynamics,
    mass_matrix,
)
from impedance_modules.diagnosis.data.rigid_tree import RigidTree, can_exist, read_tree
from impedance_modules.effects.rigid_model import RigidModel
from tests.support.paths import CHECKOUT

URDF = CHECKOUT / "robots" / "baxter" / "baxter.urdf"


def chains() -> list[list[str]]:
    names = [name for name in pin.buildModelFromUrdf(str(URDF)).names if name.startswith(("left_", "right_"))]
    return [names, names[:7], names[2:5]]


def reduced(tree: RigidTree) -> pin.Model:
    full = pin.buildModelFromUrdf(str(URDF))
    others = [full.getJointId(name) for name in full.names[1:] if name not in tree.joints]
    return pin.buildReducedModel(full, others, pin.neutral(full))


@pytest.mark.parametrize("joints", chains())
def test_inverse_dynamics_equal_pinocchios(joints: list[str]) -> None:
    tree = read_tree(URDF, joints)
    model = reduced(tree)
    data = model.createData()
    order = [model.joints[model.getJointId(name)].idx_v for name in tree.joints]
    random = np.random.default_rng(1)
    q, v, a = (random.normal(size=(40, len(joints))) for _ in range(3))
    expected = np.empty_like(q)
    for row in range(len(q)):
        x, u, w = (np.zeros(model.nv) for _ in range(3))
        x[order], u[order], w[order] = q[row], v[row], a[row]
        expected[row] = pin.rnea(model, data, x, u, w)[order]
    assert np.allclose(inertial_regressor(tree, q, v, a) @ tree.inertia, expected, atol=1e-10)


SLIDING = """<robot name="sliding">
  <link name="base"/>
  <link name="mast"><inertial><origin xyz="0.1 0.2 0.3" rpy="0.3 0.1 0.2"/><mass value="3"/>
    <inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.2" iyz="-0.01" izz="0.15"/></inertial></link>
  <link name="slide"><inertial><origin xyz="-0.1 0.05 0.2"/><mass value="2"/>
    <inertia ixx="0.03" ixy="0" ixz="0.004" iyy="0.02" iyz="0" izz="0.04"/></inertial></link>
  <link name="hand"><inertial><origin xyz="0 0.1 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="mast"/>
    <origin xyz="0 0.1 0.5" rpy="0.4 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="reach" type="prismatic"><parent link="mast"/><child link="slide"/>
    <origin xyz="0.2 0 0.1" rpy="0 0.7 0.1"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <joint name="bend" type="continuous"><parent link="slide"/><child link="hand"/>
    <origin xyz="0.3 0 0" rpy="0 0 1"/><axis xyz="0 1 0"/></joint>
</robot>"""


@pytest.mark.parametrize("gravity", [None, np.zeros(3), np.array([1.0, -2.0, 9.0])])
def test_torques_without_the_regressor_are_those_with_it(gravity: np.ndarray | None, tmp_path: Path) -> None:
    (tmp_path / "sliding.urdf").write_text(SLIDING)
    trees = [read_tree(URDF, joints) for joints in chains()]
    trees.append(read_tree(tmp_path / "sliding.urdf", ["turn", "reach", "bend"]))
    random = np.random.default_rng(4)
    for tree in trees:
        q, v, a = (random.normal(size=(25, len(tree.joints))) for _ in range(3))
        expected = inertial_regressor(tree, q, v, a, gravity) @ tree.inertia
        assert np.allclose(inverse_dynamics(tree, q, v, a, gravity), expected, atol=1e-11)


def test_mass_matrix_is_symmetric_positive_and_completes_the_weight() -> None:
    tree = read_tree(URDF, chains()[1])
    random = np.random.default_rng(2)
    q, a = (random.normal(size=(30, 7)) for _ in range(2))
    M = mass_matrix(tree, q)
    assert np.allclose(M, M.transpose(0, 2, 1), atol=1e-12)
    assert np.linalg.eigvalsh(M).min() > 0.0
    still = np.zeros_like(q)
    whole = inertial_regressor(tree, q, still, a) @ tree.inertia
    assert np.allclose(whole, np.einsum("nij,nj->ni", M, a) + gravity_regressor(tree, q) @ tree.inertia)


def test_only_bodies_of_positive_mass_can_exist() -> None:
    """Clouds of positive points can; take a point out that was not there, and they cannot."""
    random = np.random.default_rng(5)
    for _ in range(100):
        points, masses = random.normal(size=(6, 3)), random.uniform(0.1, 1.0, size=6)
        body = sum((_point(m, p) for m, p in zip(masses, points, strict=True)), np.zeros(10))
        more = _point(random.uniform(0.0, 2.0), random.normal(size=3))
        assert can_exist(body, more)
        assert can_exist(body, -random.uniform(0.0, 0.99) * _point(masses[0], points[0]))
        away = random.normal(size=3)
        hole = _point(1e-3 * masses.sum(), 200.0 * away / np.linalg.norm(away))
        assert not can_exist(body, -hole)
        assert (body - hole)[0] > 0.0


def _point(mass: float, place: np.ndarray) -> np.ndarray:
    """Parameters of a point mass, written out."""
    x, y, z = place
    inertia = [y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
    return mass * np.array([1.0, x, y, z, *inertia])


def arm() -> tuple[BatchedRigidModel, tuple[np.ndarray, ...]]:
    joints = [f"right_{name}" for name in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
    motion = tuple(np.random.default_rng(3).normal(size=(3, 9, len(joints))))
    return BatchedRigidModel.of_tree(URDF, read_tree(URDF, joints)), motion


def test_the_weight_by_gravity_is_that_of_pinocchio_sample_by_sample() -> None:
    model, (q, _, _) = arm()
    columns = model.weight_columns(q)
    assert columns == pytest.approx(RigidModel.weight_columns(model, q), abs=1e-9)
    assert columns @ model.gravity == pytest.approx(model.weight(q), abs=1e-9)


def test_a_kept_regressor_serves_its_own_motion_alone() -> None:
    model, (q, v, a) = arm()
    link = model.tree.bodies[-1].link
    moving, resting = model.body_columns(link, q, v, a), model.weight_of_body(link, q)
    with model.remembering():
        for _ in range(2):
            assert model.body_columns(link, q, v, a) == pytest.approx(moving)
            assert model.weight_of_body(link, q) == pytest.approx(resting)
    assert model.body_columns(link, q, v, a) == pytest.approx(moving)
