# SPDX-License-Identifier: BSD-3-Clause
"""Shapes as makers ship them: a mesh is its hull, and one that is not there matters to who asks for it only."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import coal
import numpy as np
import pytest

from impedance_modules.errors import BadFile
from impedance_modules.robot.description import rigid_model
from impedance_modules.robot.distances import Distances
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.link_geometry import read_geometry
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.shapes import link_shapes
from impedance_modules.spec.mesh_files import find_mesh
from impedance_modules.spec.robot_reader import read_robot
from tests.support.arm_samples import random_position
from tests.support.paths import SIX_JOINT_PAIR

BOX = '<box size="0.18 0.26 1.0"/>'
EDGES = (0.18, 0.26, 1.0)
MESH = '<mesh filename="package://pair_description/meshes/post.stl"/>'


def stl_of_box(path: Path, edges: tuple[float, float, float]) -> None:
    """Twelve triangles, two for each face."""
    corners = {signs: 0.5 * np.array(signs) * edges for signs in itertools.product((-1, 1), repeat=3)}
    lines = ["solid box"]
    for axis, side in itertools.product(range(3), (-1, 1)):
        face = [corners[s] for s in sorted(corners) if s[axis] == side]
        for triangle in ((face[0], face[1], face[2]), (face[3], face[2], face[1])):
            points = "".join(f"vertex {p[0]} {p[1]} {p[2]}\n" for p in triangle)
            lines.append(f"facet normal 0 0 0\nouter loop\n{points}endloop\nendfacet")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, "endsolid box\n"]))


def robot(folder: Path, *, there: bool, pairs: bool = True) -> Path:
    """A copy of the pair whose post is a mesh of the same box."""
    home = folder / "pair_description" / "robots" / "pair"
    shutil.copytree(SIX_JOINT_PAIR, home)
    urdf = home / "six_joint_pair.urdf"
    text = urdf.read_text()
    assert BOX in text
    urdf.write_text(text.replace(BOX, MESH))
    if there:
        stl_of_box(folder / "pair_description" / "meshes" / "post.stl", EDGES)
    if not pairs:
        described = (home / "robot.yaml").read_text()
        start = described.index("  pairs:")
        end = described.index("\n\n", start)
        (home / "robot.yaml").write_text(f"{described[:start]}  pairs: []{described[end:]}")
    return home


def distances(model: RobotModel, q: np.ndarray) -> np.ndarray:
    kinematics = Kinematics(model, [limb.hand for limb in model.limbs.values()])
    found = Distances(
        kinematics, model.spec.collision.pairs, margin=100.0, approach_time=0.2, horizon=0.01, period=0.001
    )
    still = np.zeros(model.n)
    kinematics.update(q, still)
    found.update(q, still)
    return found.distance.copy()


def test_a_mesh_has_the_distances_of_its_hull(tmp_path: Path) -> None:
    meshed, plain = (
        RobotModel(read_robot(str(path))) for path in (robot(tmp_path, there=True), SIX_JOINT_PAIR)
    )
    random = np.random.default_rng(0)
    for _ in range(20):
        q = random_position(random, plain)
        np.testing.assert_allclose(distances(meshed, q), distances(plain, q), atol=1e-5)
    drawn, exact = (
        {shape.link: shape for shape in link_shapes(model) if "post" in shape.link}
        for model in (meshed, plain)
    )
    assert drawn.keys() == exact.keys()
    for link, shape in drawn.items():
        assert shape.kind == "box" and shape.size == pytest.approx(exact[link].size, abs=1e-6)
        np.testing.assert_allclose(shape.pose.translation, exact[link].pose.translation, atol=1e-6)


def test_the_hull_of_a_mesh_with_a_bay_covers_the_bay(tmp_path: Path) -> None:
    """An hourglass: corners and a waist. The nearest point of its hull is never further than any corner."""
    mesh = tmp_path / "hourglass.stl"
    heights, radii = (-0.2, -0.05, 0.05, 0.2), (0.1, 0.01, 0.01, 0.1)
    stl_of_turned_profile(mesh, heights, radii)
    urdf = tmp_path / "one.urdf"
    urdf.write_text(
        '<robot name="one"><link name="base"/><link name="turning"><collision><geometry>'
        '<mesh filename="hourglass.stl"/></geometry></collision></link>'
        '<joint name="axle" type="continuous"><parent link="base"/><child link="turning"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    (shape,) = read_geometry(rigid_model(urdf), urdf, None).geometryObjects
    random = np.random.default_rng(1)
    for _ in range(50):
        angle, height = random.uniform(0.0, 2.0 * np.pi), random.uniform(-0.2, 0.2)
        ball = coal.Transform3s(np.eye(3), np.array([np.cos(angle), np.sin(angle), height]))
        found = coal.DistanceResult()
        coal.distance(
            shape.geometry, coal.Transform3s(), coal.Sphere(0.05), ball, coal.DistanceRequest(True), found
        )
        # The hull of the hourglass is a prism of twelve sides between its outermost rings.
        assert 0.85 - 1e-6 <= found.min_distance <= 0.95 - 0.1 * np.cos(np.pi / 12) + 1e-6


def stl_of_turned_profile(path: Path, heights: tuple[float, ...], radii: tuple[float, ...]) -> None:
    """A closed body of twelve sides."""
    turns = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    rings = [
        [(radius * np.cos(turn), radius * np.sin(turn), height) for turn in turns]
        for height, radius in zip(heights, radii, strict=True)
    ]
    triangles = []
    for lower, upper in itertools.pairwise(rings):
        for i in range(12):
            j = (i + 1) % 12
            triangles += [(lower[i], lower[j], upper[j]), (lower[i], upper[j], upper[i])]
    for ring in (rings[0][::-1], rings[-1]):
        triangles += [(ring[0], ring[i], ring[i + 1]) for i in range(1, 11)]
    facets = (
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in triangles
    )
    path.write_text("solid body\n" + "".join(facets) + "endsolid body\n")


def test_a_mesh_that_is_not_there_is_refused_where_its_distance_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(
        BadFile, match=r"robot\.yaml:\d+:\d+: collision\.pairs.*meshes/post\.stl.*is not there"
    ) as caught:
        read_robot(str(robot(tmp_path, there=False)))
    for folder in (tmp_path, tmp_path / "pair_description"):
        assert str(folder.resolve() / "pair_description") in str(caught.value)


def test_without_a_pair_it_is_only_not_drawn(tmp_path: Path) -> None:
    model = RobotModel(read_robot(str(robot(tmp_path, there=False, pairs=False))))
    names = {shape.link for shape in link_shapes(RobotModel(read_robot(str(SIX_JOINT_PAIR))))}
    assert {shape.link for shape in link_shapes(model)} == {name for name in names if "post" not in name}
    assert distances(model, np.zeros(model.n)).size == 0


def test_meshes_are_looked_for_beside_the_description_and_in_packages_above_it(tmp_path: Path) -> None:
    urdf = tmp_path / "share" / "arm_description" / "urdf" / "arm.urdf"
    mesh = tmp_path / "share" / "arm_description" / "meshes" / "link.stl"
    for path in (urdf, mesh):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    for name in (
        "package://arm_description/meshes/link.stl",
        "../meshes/link.stl",
        f"file://{mesh}",
        str(mesh),
    ):
        found = find_mesh(urdf, name)
        assert found is not None and found.resolve() == mesh
    renamed = tmp_path / "share" / "arm-1.2"
    shutil.move(tmp_path / "share" / "arm_description", renamed)
    assert find_mesh(renamed / "urdf" / "arm.urdf", "package://arm_description/meshes/link.stl") is None
    assert find_mesh(renamed / "urdf" / "arm.urdf", "package://arm-1.2/meshes/link.stl") is not None
    for name in (
        "/dev/null",
        "",
        "package://",
        "package://a",
        "x" * 5000,
        f"package://{'x' * 5000}/y",
        "a\0b",
    ):
        assert find_mesh(renamed / "urdf" / "arm.urdf", name) is None
