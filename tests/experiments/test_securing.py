# SPDX-License-Identifier: BSD-3-Clause
"""One hold on surfaces of several shapes: contact is kept, a smooth pipe takes N/R from the stiffness."""

import numpy as np
import pytest

from impedance_experiments.fouled_pipe import fouled_pipe
from impedance_experiments.securing_runs import given_way
from impedance_modules.plant.surfaces import SurfaceShape
from impedance_modules.spec.surface_mesh import mesh_faults
from tests.support.closed_meshes import surface


def test_contact_is_kept_and_the_law_of_curvature_holds(facts_of) -> None:
    facts = facts_of("securing")
    for name in ("flat", "pipe", "saddle", "fouled pipe 1"):
        assert facts[f"{name}, done"] == 1.0 and facts[f"{name}, contact"] > 0.99
        assert facts[f"{name}, force error"] < 3.0
        assert 0.003 < facts[f"{name}, moved"] < 0.05 and facts[f"{name}, paid"] < 1.5
    assert facts["pipe, moved"] > 1.3 * facts["flat, moved"]
    for name in ("0", "10", "hollow"):
        assert facts[f"smooth {name}, contact"] == 1.0
        assert facts[f"smooth {name}, moved"] == pytest.approx(facts[f"smooth {name}, law"], rel=0.03)
    assert facts["smooth hollow, moved"] < facts["smooth 0, moved"] < facts["smooth 10, moved"]


@pytest.mark.parametrize("curvature", [-8.0, 0.0, 5.0, 12.0])
def test_the_law_is_a_balance_of_forces_along_the_pipe(curvature: float) -> None:
    """(F - K y) cos(phi) + N sin(phi) = 0 on the outside, the last sign turned in a hollow."""
    y = given_way(400.0, 20.0, 3.0, curvature)
    angle = np.arcsin(y * abs(curvature))
    along = (3.0 - 400.0 * y) * np.cos(angle) + np.sign(curvature) * 20.0 * np.sin(angle)
    assert abs(along) < 0.01
    assert given_way(400.0, 20.0, 3.0, 25.0) == np.inf


def test_a_fouled_pipe_is_closed_and_between_the_bare_pipe_and_its_highest_growth() -> None:
    mesh = fouled_pipe(seed=4, diameter=0.2, length=0.3, growth=0.005, spacing=0.02)
    assert not list(mesh_faults(mesh))
    shape, rng = SurfaceShape(surface("mesh", mesh=mesh)), np.random.default_rng(2)
    for angle, z in rng.uniform([-np.pi, -0.13], [np.pi, 0.13], (100, 2)):
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        assert shape.distance(0.1055 * way + [0.0, 0.0, z])[0] > 0.0
        assert shape.distance(0.0985 * way + [0.0, 0.0, z])[0] < 0.0
    other = fouled_pipe(seed=5, diameter=0.2, length=0.3, growth=0.005, spacing=0.02)
    assert not np.array_equal(mesh.vertices, other.vertices)
