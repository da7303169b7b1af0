# SPDX-License-Identifier: BSD-3-Clause
"""Laws of the diagnosis's own inverse dynamics: equal to pinocchio's, linear in inertia, with a symmetric M."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.diagnosis.dynamics import gravity_regressor, inertial_regressor, mass_matrix
from impedance_modules.diagnosis.physical import can_exist
from impedance_modules.diagnosis.tree import RigidTree, read_tree

URDF = Path(__file__).parents[2] / "robots" / "baxter" / "baxter.urdf"


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
