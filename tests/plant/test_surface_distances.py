# SPDX-License-Identifier: BSD-3-Clause
"""Round surfaces and meshes: their distances are exact, the plant presses along the normal, forecasts agree."""

from dataclasses import replace

import coal
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from impedance_modules.plant.mesh_surface import MeshTree, distance_from_triangle, nearest_triangle
from impedance_modules.plant.point_contact import CLEARANCE
from impedance_modules.plant.surfaces import SurfaceShape
from impedance_modules.prediction.contact_geometry import find_contacts, place_surface, surface_distance
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.task import MeshSpec
from tests.support.both_ways import ways  # noqa: F401 - a fixture
from tests.support.closed_meshes import SHAPES, ball_mesh, block_under, box_mesh, mesh, saddle_block, surface
from tests.support.plant_parts import BAXTER, WEIGHTLESS, exact, loose, place_object, spec_of, started

ROBOT = exact(spec_of(BAXTER))
LENGTH = st.floats(0.03, 0.5)
SHARE = st.floats(-1.3, 1.3)
POINT = st.tuples(SHARE, SHARE, SHARE)

EVERY_SHAPE = pytest.mark.parametrize("kind", SHAPES)


def point_about(shape: SurfaceShape, share: tuple[float, float, float]) -> np.ndarray:
    """A point inside the box around a shape, or a little outside."""
    return 0.5 * (shape.low + shape.high) + 0.5 * (shape.high - shape.low) * np.array(share)


@settings(deadline=None, max_examples=60)
@given(diameter=LENGTH, length=LENGTH, share=POINT)
def test_a_cylinder_and_a_sphere_are_as_far_as_their_nearest_point(diameter, length, share) -> None:
    """Outside as far as the point with its coordinates cut to size, and as coal says; inside, as the nearest face."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    solids = {
        "cylinder": ((diameter, length), coal.Cylinder(0.5 * diameter, length)),
        "sphere": ((diameter,), coal.Sphere(0.5 * diameter)),
    }
    for kind, (size, solid) in solids.items():
        shape, upright = SurfaceShape(surface(kind, size=size)), kind == "cylinder"
        point = point_about(shape, share)
        round_part = np.array([1.0, 1.0, 0.0 if upright else 1.0]) * point
        away = np.linalg.norm(round_part)
        faces = [away - 0.5 * diameter] + ([abs(point[2]) - 0.5 * length] if upright else [])
        cut = round_part * min(1.0, 0.5 * diameter / max(away, 1e-300))
        cut[2] = np.clip(point[2], -0.5 * length, 0.5 * length) if upright else cut[2]
        distance, normal = shape.distance(point)
        outside = float(np.linalg.norm(point - cut))
        if outside > 1e-6:
            np.testing.assert_allclose(normal, (point - cut) / outside, atol=1e-6)
        assert distance == pytest.approx(outside if max(faces) > 0.0 else max(faces), abs=1e-12)
        # Where solids touch or overlap, coal's answer is another.
        if outside > 1e-3:
            result.clear()
            place = coal.Transform3s(np.eye(3), point)
            found = coal.distance(coal.Sphere(1e-9), place, solid, coal.Transform3s(), request, result)
            assert distance == pytest.approx(found, abs=1e-5)


@settings(deadline=None, max_examples=40)
@given(radii=st.tuples(LENGTH, LENGTH), share=POINT, depth=st.floats(-0.9, 0.9))
def test_a_saddle_is_as_far_as_its_nearest_point(radii, share, depth) -> None:
    """From a point of the saddle along the normal: as far as the centres of curvature no other point is nearer."""
    up, down = radii
    shape = SurfaceShape(surface("saddle", size=(0.2, 0.1), radii=radii))
    u, v = 0.1 * share[0], 0.05 * share[1]
    normal = np.array([-u / up, v / down, 1.0])
    normal /= np.linalg.norm(normal)
    # The sharpest curvature is at the middle: up to its radius a point sees its own foot alone.
    expected = depth * min(radii)
    foot = np.array([u, v, u**2 / (2.0 * up) - v**2 / (2.0 * down)])
    distance, found = shape.distance(foot + expected * normal)
    np.testing.assert_allclose(found, normal, atol=1e-9)
    beside = max(abs(share[0]), abs(share[1]))
    if abs(beside - 1.0) < 1e-9:
        return  # on the rectangle's very edge
    assert distance == (pytest.approx(expected, abs=1e-12) if beside < 1.0 else np.inf)
    if beside > 1.0:
        return

    def squared(at: np.ndarray) -> float:
        height = at[0] ** 2 / (2.0 * up) - at[1] ** 2 / (2.0 * down)
        return float(np.sum((np.array([*at, height]) - foot - expected * normal) ** 2))

    near = min(minimize(squared, [u + a, v + b], tol=1e-12).fun for a in (-0.03, 0.03) for b in (-0.03, 0.03))
    assert abs(distance) <= np.sqrt(near) + 1e-6


@settings(deadline=None, max_examples=80)
@given(kind=st.sampled_from(sorted(SHAPES)), share=POINT, out=st.floats(0.0, 0.1))
def test_the_normal_leads_from_the_surface_through_the_point(kind, share, out) -> None:
    """p - d n lies on the surface, and every step along n is that much farther away, inside as outside."""
    shape = SurfaceShape(SHAPES[kind])
    point = point_about(shape, share)
    distance, normal = shape.distance(point)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    if kind == "saddle" and abs(distance) > 0.14:
        return  # beside it, or beyond its centres of curvature
    foot, farther = (shape.distance(point + step * normal)[0] for step in (-distance, out))
    # At the very edge of a saddle's rectangle the foot may be beside it.
    assert foot == pytest.approx(0.0, abs=1e-9) or (kind == "saddle" and foot == np.inf)
    if kind != "saddle" or distance + out < 0.14:
        assert farther == pytest.approx(distance + out, abs=1e-9) or farther == np.inf


@settings(deadline=None, max_examples=300)
@given(kind=st.sampled_from(sorted(SHAPES)), share=POINT)
def test_the_box_around_a_surface_is_never_farther_than_the_surface(kind, share) -> None:
    """And a point below it, over its rectangle, is inside the box, however deep."""
    shape = SurfaceShape(SHAPES[kind])
    point = np.array(share) * [0.25, 0.25, 0.15]
    distance, _ = shape.distance(point)
    if kind != "saddle" or -0.14 < distance < 0.14:
        gap = shape.gaps(point[None])[0]
        assert gap <= abs(distance) + 1e-12
        over = np.all(np.abs(point[:2]) < 0.14)
        assert gap <= 0.0 or distance > 0.0 or not over


def distance_to_box(point: np.ndarray, half: np.ndarray) -> float:
    beyond = np.abs(point) - half
    return float(np.linalg.norm(np.maximum(beyond, 0.0)) + min(0.0, beyond.max()))


@settings(deadline=None, max_examples=80)
@given(size=st.tuples(LENGTH, LENGTH, LENGTH), share=POINT)
def test_a_mesh_of_a_box_is_the_box_inside_outside_and_around_its_corners(size, share) -> None:
    shape = SurfaceShape(surface("mesh", mesh=box_mesh(size)))
    point = 0.5 * np.array(size) * share
    distance, normal = shape.distance(point)
    assert distance == pytest.approx(distance_to_box(point, 0.5 * np.array(size)), abs=1e-12)
    assert np.linalg.norm(normal) == pytest.approx(1.0)


@settings(deadline=None, max_examples=60)
@given(radius=st.floats(0.02, 0.3), way=POINT, depth=st.floats(-0.9, 1.0))
def test_a_fine_mesh_is_its_sphere_within_its_facets(radius, way, depth) -> None:
    shape, turn = SurfaceShape(surface("mesh", mesh=ball_mesh(radius))), np.array(way) + 1e-6
    point = (1.0 + depth) * radius * turn / np.linalg.norm(turn)
    distance, normal = shape.distance(point)
    sagitta = radius * (1.0 - np.cos(np.pi / 24.0) ** 2)
    assert depth * radius - 1e-9 <= distance <= depth * radius + sagitta
    if depth > -0.5:
        assert normal @ point > np.cos(0.3) * np.linalg.norm(point)


def test_a_mesh_of_a_saddle_is_the_saddle_on_both_sides() -> None:
    radii, size, rng = (0.15, 0.1), (0.2, 0.2), np.random.default_rng(3)
    exactly = SurfaceShape(surface("saddle", size=size, radii=radii))
    cut = SurfaceShape(surface("mesh", mesh=saddle_block(radii, size)))
    bulge = (0.2 / 40) ** 2 / 4.0 * sum(1.0 / radius for radius in radii)
    for _ in range(100):
        x, y = rng.uniform(-0.07, 0.07, 2)
        height = x**2 / 0.3 - y**2 / 0.2
        point = np.array([x, y, height + rng.uniform(-0.015, 0.015)])
        distance, normal = exactly.distance(point)
        meshed, facet = cut.distance(point)
        assert meshed == pytest.approx(distance, abs=bulge)
        assert abs(distance) < 2.0 * bulge or normal @ facet > 0.98


def fan(height: float) -> MeshSpec:
    """A needle over a triangle; one of its three sides is cut into many thin triangles that meet at the tip."""
    rim = [[1.0, 0.0, 0.0], *([-0.5, 0.8 * y, 0.0] for y in np.linspace(1.0, -1.0, 21))]
    count, tip = len(rim), [[-0.4, 0.0, height]]
    sides = [(k, (k + 1) % count, count) for k in range(count)]
    below = [(0, k + 1, k) for k in range(1, count - 1)]
    return mesh(0.1 * np.array(rim + tip), sides + below)


@settings(deadline=None, max_examples=150)
@given(share=POINT, height=st.floats(0.1, 3.0), corner=st.integers(0, 22), near=st.floats(0.01, 0.5))
def test_the_sign_is_right_near_sharp_edges_and_tips(share, height, corner, near) -> None:
    """A point is inside this convex body where it is below the planes of all its sides."""
    body = fan(height)
    shape, tree = SurfaceShape(surface("mesh", mesh=body)), MeshTree(body)
    point = body.vertices[corner] + 0.1 * near * np.array(share)
    rows = tree.triangles
    above = np.einsum("ij,ij->i", rows["face_normal"], point - rows["corners"][:, 0])
    distance, _ = shape.distance(point)
    if abs(above).min() > 1e-9:
        assert (distance < 0.0) == bool((above < 0.0).all())


def test_beyond_a_tip_of_many_thin_triangles_the_tip_is_the_nearest_point_and_the_point_outside() -> None:
    """Without the angles as weights the many would outvote the two large sides."""
    body, rng = fan(3.0), np.random.default_rng(9)
    shape, rows, tip = SurfaceShape(surface("mesh", mesh=body)), MeshTree(body).triangles, body.vertices[22]
    meets = (np.linalg.norm(rows["corners"] - tip, axis=2) == 0.0).any(axis=1)
    normals = np.unique(rows["face_normal"][meets].round(9), axis=0)
    assert len(normals) == 3
    for shares in rng.dirichlet(np.full(3, 0.3), 200):
        way = shares @ normals
        point = tip + 0.02 * way / np.linalg.norm(way)
        distance, found = shape.distance(point)
        assert distance == pytest.approx(0.02, abs=1e-6)
        np.testing.assert_allclose(found, (point - tip) / 0.02, atol=1e-3)


def stairs() -> np.ndarray:
    """Vertices and triangles of a block with a step: one edge of it points inwards."""
    x, y = np.array([-0.1, 0.0, 1e-9, 0.1]), np.array([-0.1, 0.1])
    heights = np.array([[0.02, 0.02], [0.02, 0.02], [-0.03, -0.03], [-0.03, -0.03]])
    return block_under(heights, x, y, -0.1)


def test_the_sign_is_right_near_edges_that_point_inwards_and_outwards() -> None:
    shape, rng = SurfaceShape(surface("mesh", mesh=stairs())), np.random.default_rng(5)
    for _ in range(300):
        point = rng.uniform([-0.12, -0.12, -0.12], [0.12, 0.12, 0.05])
        within = abs(point[0]) < 0.1 and abs(point[1]) < 0.1 and point[2] > -0.1
        inside = within and point[2] < (0.02 if point[0] < 0.0 else -0.03)
        distance, _ = shape.distance(point)
        assert (distance < 0.0) == inside, point


def test_the_search_finds_the_nearest_triangle_from_any_guess(ways) -> None:  # noqa: F811
    """Against all triangles one by one, and outside against coal's own mesh."""
    tree, rng = MeshTree(stairs()), np.random.default_rng(6)
    body = coal.BVHModelOBBRSS()
    body.beginModel(len(tree.triangles), 3 * len(tree.triangles))
    for corners in tree.triangles["corners"]:
        body.addTriangle(*corners)
    body.endModel()
    one, other = np.empty(3), np.empty(3)
    for _ in range(40):
        point = rng.uniform(-0.2, 0.2, 3)
        guess = int(rng.integers(len(tree.triangles)))
        found = nearest_triangle(tree.nodes, tree.triangles, 0, point, guess)
        distance = distance_from_triangle(tree.triangles[found], point, one)
        each = [abs(distance_from_triangle(row, point, other)) for row in tree.triangles]
        assert abs(distance) == pytest.approx(min(each), abs=1e-15)
        if distance > 0.0:
            place = coal.Transform3s(np.eye(3), point)
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            least = coal.distance(coal.Sphere(1e-9), place, body, coal.Transform3s(), request, result)
            assert distance == pytest.approx(least, abs=1e-6)


@EVERY_SHAPE
def test_the_plant_presses_along_the_normal_as_the_forecast_says(kind, ways) -> None:  # noqa: F811
    """Everywhere around a turned surface: k d along n, and the same distance in both; two of them do not mix."""
    turned = replace(SHAPES[kind], rotation=(0.3, -0.2, 0.5))
    beside = surface("mesh", mesh=box_mesh((0.1, 0.1, 0.1)), position=(5.0, 0.0, 0.0))
    ball = loose(shape="sphere", size=(0.004,))
    subject = started(ROBOT, [beside, turned], ball, gravity=WEIGHTLESS)
    placed, shape, rng = place_surface(turned), SurfaceShape(turned), np.random.default_rng(1)
    contact, pressed = subject.state.contacts[-1], 0
    for _ in range(60):
        point = placed.origin + placed.rotation @ point_about(shape, rng.uniform(-1.0, 1.0, 3))
        distance, normal = surface_distance(placed, point)
        place_object(subject, Pose(np.eye(3), point), np.zeros(6))
        contact["face"] = 1
        subject._integrator.refresh()
        if not contact["near"]:
            assert kind == "saddle" or distance - 0.002 >= CLEARANCE
            continue
        assert contact["distance"] == pytest.approx(distance - 0.002, abs=1e-12)
        subject._integrator.rate()
        force = subject.state.contact_wrench[-1, :3]
        if distance < 0.002:
            pressed += 1
            np.testing.assert_allclose(force, 20000.0 * (0.002 - distance) * normal, atol=1e-6)
        else:
            assert not force.any()
    assert pressed > 5


@pytest.mark.parametrize("kind", ["cylinder", "sphere", "saddle"])
def test_a_forecast_knows_how_the_normal_turns(kind) -> None:
    """By 1/R along a circle around a pipe and a ball, and not at all along the pipe; by -1/R in a saddle's hollow."""
    across, along = {"cylinder": (10.0, 0.0), "sphere": (10.0, 10.0), "saddle": (1.0 / 0.2, -1.0 / 0.15)}[
        kind
    ]
    ground = replace(SHAPES[kind], rotation=(0.0, np.pi / 2, 0.0) if kind == "cylinder" else (0.0, 0.0, 0.0))
    top = np.array(ground.position) + np.array([0.0, 0.0, 0.0 if kind == "saddle" else 0.1])
    (contact,) = find_contacts(
        0, Pose(np.eye(3), top - [0.0, 0.0, 1e-9]), [(np.zeros(3), 0.0)], [place_surface(ground)], 0.01
    )
    np.testing.assert_allclose(contact.turning, np.diag([along, across, 0.0]), atol=1e-4)
    assert contact.depth == pytest.approx(1e-9)


def test_a_body_of_two_parts_and_a_cavity_has_both() -> None:
    """Two boxes and a cavity in one of them, its triangles the other way round."""
    outer, inner = box_mesh((0.2, 0.2, 0.2)), box_mesh((0.1, 0.1, 0.1))
    vertices = np.concatenate([outer.vertices, inner.vertices, outer.vertices + np.array([0.5, 0.0, 0.0])])
    triangles = np.concatenate([outer.triangles, inner.triangles[:, ::-1] + 8, outer.triangles + 16])
    shape = SurfaceShape(surface("mesh", mesh=mesh(vertices, triangles)))
    for point, expected in (
        ((0.0, 0.0, 0.03), 0.02),
        ((0.0, 0.0, 0.06), -0.01),
        ((0.0, 0.0, 0.12), 0.02),
        ((0.5, 0.0, 0.09), -0.01),
        ((0.25, 0.0, 0.0), 0.15),
    ):
        assert shape.distance(np.array(point))[0] == pytest.approx(expected)
