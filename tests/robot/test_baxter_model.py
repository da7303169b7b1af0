# SPDX-License-Identifier: BSD-3-Clause
"""Baxter's model agrees with two independent sources and with the numbers people have published."""

import importlib.metadata
import xml.etree.ElementTree as ET
from collections import defaultdict
from functools import cache
from itertools import product
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.spec.document import read_document
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.schema import schema_problems
from impedance_modules.spec.urdf import read_urdf
from tests.reference.kdl_tree import KdlArm

STATES = 500
SIDES = ("right", "left")
JOINTS = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
DYNAMICS = ("mass_matrix", "gravity")
PUBLIC_URDF = "cmeel.prefix/share/example-robot-data/robots/baxter_description/urdf/baxter.urdf"
WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Arm:
    """One arm of a pinocchio model, everything in the arm's joint order."""

    def __init__(self, model: pin.Model, side: str, hand: str) -> None:
        self.model, self.data = model, model.createData()
        joints = [model.joints[model.getJointId(f"{side}_{name}")] for name in JOINTS]
        self.indices = np.array([joint.idx_v for joint in joints])
        self.frame = model.getFrameId(hand, pin.FrameType.BODY)
        self.lower = model.lowerPositionLimit[self.indices]
        self.upper = model.upperPositionLimit[self.indices]

    def full(self, q: np.ndarray) -> np.ndarray:
        whole = pin.neutral(self.model)
        whole[self.indices] = q
        return whole

    def pose(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pin.framesForwardKinematics(self.model, self.data, self.full(q))
        placement = self.data.oMf[self.frame]
        return placement.rotation.copy(), placement.translation.copy()

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        all_columns = pin.computeFrameJacobian(self.model, self.data, self.full(q), self.frame, WORLD_AXES)
        return all_columns[:, self.indices]

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        upper = np.triu(pin.crba(self.model, self.data, self.full(q)))
        return (upper + np.triu(upper, 1).T)[np.ix_(self.indices, self.indices)]

    def gravity(self, q: np.ndarray) -> np.ndarray:
        return pin.computeGeneralizedGravity(self.model, self.data, self.full(q))[self.indices]


@cache
def baxter() -> pin.Model:
    return pin.buildModelFromUrdf(str(read_robot("baxter").urdf))


@cache
def public_model() -> pin.Model:
    """The example-robot-data model without grippers, its marker links (0.1 g) made weightless."""
    try:
        package = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the package example-robot-data is not installed")
    root = ET.parse(Path(str(package.locate_file(PUBLIC_URDF)))).getroot()
    gone = {f"{side}_gripper_base_link" for side in SIDES}

    def hangs_on(joint: ET.Element) -> bool:
        return bool({joint.find(end).get("link") for end in ("parent", "child")} & gone)

    while joints := list(filter(hangs_on, root.findall("joint"))):
        gone |= {joint.find("child").get("link") for joint in joints}
        for joint in joints:
            root.remove(joint)
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
        inertial = link.find("inertial")
        if link.get("name") in gone:
            root.remove(link)
        elif inertial is not None and float(inertial.find("mass").get("value")) <= 0.0001:
            link.remove(inertial)
    return pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))


def random_postures(arm: Arm, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (STATES, len(JOINTS)))


def worst_differences(arm: Arm, other: Arm | KdlArm, seed: int) -> dict[str, float]:
    """Largest difference of each quantity over the random postures."""
    worst: dict[str, float] = defaultdict(float)
    for q in random_postures(arm, seed):
        of_both = {name: (getattr(arm, name)(q), getattr(other, name)(q)) for name in ("jacobian", *DYNAMICS)}
        of_both["rotation"], of_both["translation"] = zip(arm.pose(q), other.pose(q), strict=True)
        for name, (ours, theirs) in of_both.items():
            worst[name] = max(worst[name], float(np.abs(ours - theirs).max()))
    return worst


def check_agreement(worst: dict[str, float]) -> None:
    assert len(worst) == 5
    for name, difference in worst.items():
        assert difference < (1e-9 if name in DYNAMICS else 1e-10), worst


@pytest.mark.external
@pytest.mark.parametrize("side", SIDES)
def test_agrees_with_the_public_description(side: str) -> None:
    arm, other = Arm(baxter(), side, f"{side}_hand"), Arm(public_model(), side, f"{side}_hand_link")
    np.testing.assert_allclose(arm.lower, other.lower, rtol=0, atol=1e-11)
    np.testing.assert_allclose(arm.upper, other.upper, rtol=0, atol=1e-11)
    check_agreement(worst_differences(arm, other, seed=1))


@pytest.mark.external
@pytest.mark.parametrize("side", SIDES)
def test_agrees_with_pykdl(side: str) -> None:
    other = KdlArm(read_robot("baxter").urdf, f"{side}_hand")
    assert other.joint_names == [f"{side}_{name}" for name in JOINTS]
    check_agreement(worst_differences(Arm(baxter(), side, f"{side}_hand"), other, seed=2))


def test_the_comparison_can_fail() -> None:
    """A millimetre and ten grams are seen."""
    model = baxter().copy()
    joint = model.getJointId("left_w1")
    model.jointPlacements[joint].translation += np.array([0.0, 0.0, 0.001])
    model.inertias[joint].mass += 0.01
    worst = worst_differences(Arm(model, "left", "left_hand"), Arm(baxter(), "left", "left_hand"), seed=3)
    assert worst["translation"] > 1e-4
    assert worst["mass_matrix"] > 1e-4
    assert worst["gravity"] > 1e-3


def thesis_hand(q: np.ndarray, d3: float) -> np.ndarray:
    """Origin of the hand in the arm's base, by the thesis's Denavit-Hartenberg chain (2.2 to 2.7)."""
    lengths = (0.27035, 0.0, d3, 0.0, 0.37429, 0.0, 0.229525)
    offsets = (0.069, 0.0, 0.069, 0.0, 0.01, 0.0, 0.0)
    twists = np.array([-1, 1, -1, 1, -1, 1, 0]) * np.pi / 2
    pose = np.eye(4)
    for theta, d, a, alpha in zip(q + np.pi / 2 * np.eye(7)[1], lengths, offsets, twists, strict=True):
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        pose = pose @ np.array(
            [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return pose[:3, 3]


@pytest.mark.parametrize("side", SIDES)
def test_thesis_chain_ends_at_the_hand(side: str) -> None:
    """d3 = 0.102 + 0.26242 agrees; the thesis's 0.36435 is 70 micrometres short."""
    arm = Arm(baxter(), side, f"{side}_hand")
    mount = pin.SE3(baxter().frames[baxter().getFrameId(f"{side}_arm_mount", pin.FrameType.BODY)].placement)
    base = mount * pin.SE3(np.eye(3), np.array([0.055695, 0.0, 0.011038]))
    exact = printed = 0.0
    for q in random_postures(arm, seed=4):
        seen = base.actInv(arm.pose(q)[1])
        exact = max(exact, float(np.abs(seen - thesis_hand(q, 0.36442)).max()))
        printed = max(printed, float(np.linalg.norm(seen - thesis_hand(q, 0.36435))))
    assert exact < 1e-10
    assert printed == pytest.approx(7.0e-5, rel=1e-3)


@pytest.mark.parametrize("side", SIDES)
def test_published_numbers(side: str) -> None:
    model = baxter()
    bodies = [model.inertias[model.getJointId(f"{side}_{name}")] for name in JOINTS]
    masses = [5.70044, 3.22698, 4.31272, 2.07206, 2.24665, 1.60979, 0.35093 + 0.19125]
    np.testing.assert_allclose([body.mass for body in bodies], masses, rtol=0, atol=1e-12)
    gravity = Arm(model, side, f"{side}_hand").gravity(np.array(NEUTRAL))
    np.testing.assert_allclose(gravity[[1, 3]], [-47.6, -13.5], rtol=0, atol=0.05)


@pytest.mark.parametrize("side", SIDES)
def test_published_drives_and_limits(side: str) -> None:
    joints = [read_robot("baxter").joints[f"{side}_{name}"] for name in JOINTS]
    drives = [(j.effort_max, j.velocity_max, j.spring_stiffness, j.reflected_inertia) for j in joints]
    assert drives == [(50.0, 1.5, 843.0, 0.6)] * 4 + [(15.0, 4.0, 250.0, 0.044)] * 3
    lower = [-1.70168, -2.147, -3.05418, -0.05, -3.059, -1.5708, -3.059]
    upper = [1.70168, 1.047, 3.05418, 2.618, 3.059, 2.094, 3.059]
    np.testing.assert_allclose([j.position_min for j in joints], lower, atol=1e-5)
    np.testing.assert_allclose([j.position_max for j in joints], upper, atol=1e-5)
    # Thesis 2.1: below 0.06 rad of deflection at the peak torque, which 15 / 250 just meets.
    assert all(j.effort_max / j.spring_stiffness < 0.06 + 1e-12 for j in joints)


def test_every_frame_has_one_name() -> None:
    """pin.buildReducedModel refuses a model in which a fixed joint is called like a link."""
    model = baxter()
    names = [frame.name for frame in model.frames]
    assert len(names) == len(set(names))
    reduced = pin.buildReducedModel(model, [model.getJointId("head_pan")], pin.neutral(model))
    assert reduced.nq == 14


def test_inertias_are_physical() -> None:
    """Each body's principal moments are positive and no one exceeds the sum of the other two."""
    for body, name in zip(baxter().inertias, baxter().names, strict=True):
        if name != "universe":
            moments = np.linalg.eigvalsh(body.inertia)
            assert moments[0] > 0
            assert moments[2] < moments[0] + moments[1], name


def pair_distance(geometry: pin.GeometryModel, data: pin.GeometryData, pair: tuple[str, str]) -> float:
    """Smallest distance between the shapes of two links [m]."""
    shapes = [
        [i for i, shape in enumerate(geometry.geometryObjects) if shape.name.rsplit("_", 1)[0] == link]
        for link in pair
    ]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    distances = []
    for both in product(*shapes):
        result.clear()
        placed = []
        for k in both:
            place = coal.Transform3s(data.oMg[k].rotation, data.oMg[k].translation)
            placed += [geometry.geometryObjects[k].geometry, place]
        distances.append(coal.distance(*placed, request, result))
    return min(distances)


NEUTRAL = (0.0, -0.55, 0.0, 0.75, 0.0, 1.26, 0.0)
THESIS = (0.9407, 0.080917, -0.10316, 1.102548, -3.0434, -0.3482, 1.451529)


@pytest.mark.parametrize("posture", [NEUTRAL, THESIS], ids=["neutral", "thesis"])
def test_working_postures_are_free_of_collision_rows(posture: tuple[float, ...]) -> None:
    spec, model = read_robot("baxter"), baxter()
    geometry = pin.buildGeomFromUrdf(model, str(spec.urdf), pin.GeometryType.COLLISION)
    q = pin.neutral(model)
    signs = spec.mirror.joint_sign
    for name, angle in zip(JOINTS, posture, strict=True):
        q[model.joints[model.getJointId(f"right_{name}")].idx_q] = angle
        q[model.joints[model.getJointId(f"left_{name}")].idx_q] = signs[name] * angle
    data, shapes = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, shapes, q)
    for pair in spec.collision.pairs:
        assert pair_distance(geometry, shapes, pair) > spec.collision.margin, pair


def test_arm_shapes_are_capsules() -> None:
    spec, model = read_robot("baxter"), baxter()
    geometry = pin.buildGeomFromUrdf(model, str(spec.urdf), pin.GeometryType.COLLISION)
    for shape in geometry.geometryObjects:
        kind = type(shape.geometry)
        moved = shape.parentJoint != 0 and model.names[shape.parentJoint] != "head_pan"
        assert kind in ({coal.Capsule, coal.Sphere} if moved else {coal.Box}), shape.name
    with_shapes = read_urdf(spec.urdf).links_with_collision
    assert {link for pair in spec.collision.pairs for link in pair} <= with_shapes


def test_patch_covers_every_joint() -> None:
    spec = read_robot("baxter")
    document = read_document(spec.folder / "patches" / "without-reflected-inertia.yaml")
    assert schema_problems(document, "patch") == []
    effect = document.data["effects"][0]
    assert set(effect["joints"]) == set(effect["parameters"]) == set(spec.joints)
    assert {parameter["Ia"]["value"] for parameter in effect["parameters"].values()} == {0}
