# SPDX-License-Identifier: BSD-3-Clause
"""Geoms of MuJoCo models as collision shapes: links are as far apart in our robot as in MuJoCo's own model."""

from __future__ import annotations

import struct
from pathlib import Path

import coal
import mujoco
import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.cli.main import impedance
from impedance_modules.export.mujoco_as_urdf import urdf_of_mujoco
from impedance_modules.robot.description import rigid_model
from impedance_modules.robot.link_geometry import read_geometry
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_reader import read_robot

NEAR = 1e-4
"""By how much distances may differ [m]."""

FAR = 10.0
"""Up to which distance MuJoCo measures [m]."""

ARM = """<mujoco model="arm"><compiler angle="{angle}" eulerseq="{sequence}" {folders}/>
<default>
  <geom rgba="1 1 1 1"/>
  <mesh scale="0.5 0.5 0.5"/>
  <default class="visual"><geom contype="0" conaffinity="0" group="1" type="sphere" size="0.5"/></default>
  <default class="solid"><geom group="3" type="capsule" size="0.03"/>
    <default class="disc"><geom type="cylinder" size="0.06 0.02" euler="{turn} 0 0" pos="0 0 0.01"/></default></default>
</default>
<asset>{assets}</asset>
<worldbody>
  <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -2"/>
  <geom name="table" type="box" size="0.2 0.3 0.02" pos="0.9 0 -0.4" euler="0 {turn} 0"/>
  <body name="stand" pos="0 0.1 0.2" euler="0 {turn} 0">
    <geom class="visual"/>
    <geom type="box" size="0.05 0.08 0.03" pos="-0.2 0 0" quat="1 0.2 0.3 0.1"/>
    <body name="upper" pos="0 0 0.1" euler="{turn} 0 {turn}">
      <joint name="turn" axis="0 0.2 1" pos="0.02 0.01 0" ref="{turn}" range="-{far} {far}"/>
      <inertial mass="2" pos="0.1 0 0" diaginertia="0.02 0.03 0.03"/>
      <geom class="solid" fromto="0.02 0 0 0.25 0.05 0.1"/>
      <frame pos="0 0 0.1" euler="0 0 {turn}">
        <geom class="disc"/>
        <geom type="sphere" size="0.04" pos="0.1 0 0.05" contype="0"/>
      </frame>
      <geom type="box" fromto="0 0 0 -0.1 0.02 -0.05" size="0.02"/>
      <body name="fore" pos="0.3 0 0.1" xyaxes="0 1 0 -1 0 0.2" childclass="solid">
        <joint name="lift" axis="0 1 0" range="-{far} {far}"/>
        <inertial mass="1" pos="0.1 0 0" diaginertia="0.02 0.03 0.03"/>
        <geom size="0.04 0.1" pos="0.1 0 0" zaxis="1 0.1 0"/>
        <geom type="cylinder" fromto="0.1 0.1 0 0.2 0.1 0.1" size="0.02"/>
        <body name="palm" pos="0.25 0 0.05" axisangle="0 1 1 {turn}">
          <joint name="wrist" axis="1 0 0" range="-{far} {far}"/>
          <inertial mass="0.5" pos="0 0 0.05" diaginertia="0.002 0.003 0.003"/>
          {hand}
        </body>
      </body>
    </body>
  </body>
</worldbody></mujoco>
"""

BOX = '<geom type="box" size="0.02 0.04 0.06" pos="0 0 0.05"/>'
MESH = '<geom type="mesh" mesh="wedge" pos="0 0.01 0.05" quat="0.5 0.1 -0.7 0.4"/>'
UNITS = {"degree": {"turn": "23", "far": "170"}, "radian": {"turn": "0.4", "far": "3"}}


def wedge(path: Path) -> None:
    """Writes a mesh that no solid is equal to: a tetrahedron beside the origin, as binary STL."""
    corners = np.array([[0.02, 0.0, 0.0], [0.2, 0.03, 0.01], [0.05, 0.15, 0.0], [0.04, 0.02, 0.12]])
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
    body = b"".join(
        struct.pack("<12fH", *(0.0,) * 3, *(float(v) for k in face for v in corners[k]), 0) for face in faces
    )
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(faces)) + body)


def written(
    folder: Path, hand: str = BOX, *, angle: str = "degree", sequence: str = "xyz", assets: str = ""
) -> Path:
    (folder / "meshes").mkdir()
    wedge(folder / "meshes" / "wedge.stl")
    path = folder / "arm.xml"
    words = {"angle": angle, "sequence": sequence, "hand": hand, "assets": assets, **UNITS[angle]}
    path.write_text(ARM.format(folders='assetdir="nowhere" meshdir="meshes"', **words))
    return path


def new(folder: Path, description: Path, *options: str) -> tuple[Path, str]:
    """Makes a robot by the command line; returns its folder, and what was said."""
    arguments = ["robot", "new", "arm", "--urdf", str(description), "--out", str(folder / "robots"), *options]
    result = CliRunner().invoke(impedance, arguments, standalone_mode=False, catch_exceptions=True)
    if result.exception is not None:
        raise result.exception
    return folder / "robots" / "arm", result.output


def shaped(path: Path) -> Path:
    """Writes the URDF of a MuJoCo model with its shapes beside it, without making a robot."""
    urdf = path.with_suffix(".urdf")
    urdf.write_text(urdf_of_mujoco(path, shapes=True).urdf)
    return urdf


class Both:
    """A MuJoCo model and the URDF that was made of it."""

    def __init__(self, path: Path, urdf: Path) -> None:
        self.theirs = mujoco.MjModel.from_xml_path(str(path))
        self._data = mujoco.MjData(self.theirs)
        self._ours = rigid_model(urdf)
        self._geometry = read_geometry(self._ours, urdf, None)
        self._placed = pin.GeometryData(self._geometry)
        self.n = self._ours.nq
        self.links = sorted({self._link(shape) for shape in self._geometry.geometryObjects})

    def _link(self, shape: pin.GeometryObject) -> str:
        return str(self._ours.frames[shape.parentFrame].name)

    def distances(self, q: np.ndarray) -> dict[tuple[str, str], tuple[float, float]]:
        """Distance of each pair of links, ours and MuJoCo's, at the joints' positions (n,) [rad]."""
        pin.updateGeometryPlacements(self._ours, self._ours.createData(), self._geometry, self._placed, q)
        names = [self.theirs.joint(k).name for k in range(self.theirs.njnt)]
        self._data.qpos[:] = q[[self._ours.joints[self._ours.getJointId(name)].idx_q for name in names]]
        mujoco.mj_kinematics(self.theirs, self._data)
        pairs = [(a, b) for i, a in enumerate(self.links) for b in self.links[i + 1 :]]
        return {(a, b): (self._our_distance(a, b), self._their_distance(a, b)) for a, b in pairs}

    def _our_distance(self, first: str, second: str) -> float:
        shapes = [
            [i for i, shape in enumerate(self._geometry.geometryObjects) if self._link(shape) == link]
            for link in (first, second)
        ]
        request, result, found = coal.DistanceRequest(), coal.DistanceResult(), []
        for i in shapes[0]:
            for j in shapes[1]:
                result.clear()
                one, other = (self._geometry.geometryObjects[k].geometry for k in (i, j))
                X, Y = (self._placed.oMg[k] for k in (i, j))
                poses = [coal.Transform3s(pose.rotation, pose.translation) for pose in (X, Y)]
                found.append(coal.distance(one, poses[0], other, poses[1], request, result))
        return min(found)

    def _their_distance(self, first: str, second: str) -> float:
        ends = np.zeros(6)
        return min(
            mujoco.mj_geomDistance(self.theirs, self._data, i, j, FAR, ends)
            for i in self._colliding(first)
            for j in self._colliding(second)
        )

    def _colliding(self, link: str) -> list[int]:
        model, body = self.theirs, self.theirs.body(link).id
        return [
            k
            for k in range(model.ngeom)
            if model.geom_bodyid[k] == body
            and (model.geom_contype[k] or model.geom_conaffinity[k])
            and model.geom_type[k] != mujoco.mjtGeom.mjGEOM_PLANE
        ]


def compare(both: Both, seed: int, *, postures: int = 8) -> None:
    """Distances agree wherever both say that links are apart; both agree on which ones are."""
    dice = np.random.default_rng(seed)
    for _ in range(postures):
        q = dice.uniform(-2.5, 2.5, both.n)
        for pair, (ours, theirs) in both.distances(q).items():
            if max(ours, theirs) > NEAR:
                assert ours == pytest.approx(theirs, abs=NEAR), pair
            else:
                assert min(ours, theirs) <= NEAR, pair


@pytest.mark.parametrize("sequence", ["xyz", "ZXY"])
@pytest.mark.parametrize("angle", list(UNITS))
def test_links_are_as_far_apart_as_in_mujoco(tmp_path: Path, angle: str, sequence: str) -> None:
    path = written(tmp_path, angle=angle, sequence=sequence)
    both, notes = Both(path, shaped(path)), urdf_of_mujoco(path, shapes=True).notes
    assert both.links == ["fore", "palm", "stand", "upper", "world"]
    compare(both, 0)
    assert "1 geoms collide with nothing (contype and conaffinity are 0) and are left out" in notes
    assert "no collision shape, since it is a plane, which a URDF does not have: floor" in notes


@settings(max_examples=10, deadline=None)
@given(
    angles=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    scale=st.tuples(*[st.sampled_from([0.5, 1.0, -0.8, 1.3])] * 3),
    refpos=st.tuples(*[st.floats(-0.05, 0.05)] * 3),
    seed=st.integers(0, 999),
)
def test_meshes_stand_where_mujoco_puts_them(tmp_path_factory, angles, scale, refpos, seed) -> None:
    """A mesh is moved, turned and scaled before it is placed; turned only where the scale is even."""
    folder = tmp_path_factory.mktemp("mesh")
    quat = pin.Quaternion(pin.rpy.rpyToMatrix(*angles)).coeffs()[[3, 0, 1, 2]]
    if len(set(scale)) > 1:
        quat = np.array([1.0, 0.0, 0.0, 0.0])
    words = {"scale": scale, "refpos": refpos, "refquat": quat}
    attributes = " ".join(f'{key}="{" ".join(map(str, values))}"' for key, values in words.items())
    path = written(folder, MESH, assets=f'<mesh file="wedge.stl" {attributes}/>')
    compare(Both(path, shaped(path)), seed, postures=2)


def test_a_mesh_takes_its_scale_from_a_default_class_and_its_file_from_the_mesh_folder(
    tmp_path: Path,
) -> None:
    path = written(tmp_path, MESH, assets='<mesh name="wedge" file="wedge.stl"/>')
    folder, _ = new(tmp_path, path)
    assert (folder / "meshes" / "wedge.stl").is_file() and 'scale="0.5 0.5 0.5"' in (
        folder / "arm.urdf"
    ).read_text()
    compare(Both(path, folder / "arm.urdf"), 3)


@settings(max_examples=8, deadline=None)
@given(size=st.tuples(*[st.floats(0.02, 0.1)] * 3), seed=st.integers(0, 999))
def test_an_ellipsoid_becomes_a_capsule_around_it(tmp_path_factory, size, seed) -> None:
    """No distance is larger than MuJoCo's, and none is smaller by more than the said width and the ends."""
    folder = tmp_path_factory.mktemp("ellipsoid")
    text = " ".join(map(str, size))
    path = written(
        folder, f'<geom name="egg" type="ellipsoid" size="{text}" pos="0 0 0.05" quat="1 0.2 -0.3 0.4"/>'
    )
    assert any(
        "the ellipsoid egg becomes the capsule around it" in note
        for note in urdf_of_mujoco(path, shapes=True).notes
    )
    both, dice = Both(path, shaped(path)), np.random.default_rng(seed)
    a, b, c = sorted(size, reverse=True)
    for _ in range(3):
        for pair, (ours, theirs) in both.distances(dice.uniform(-2.5, 2.5, 3)).items():
            if "palm" in pair and theirs > NEAR:
                # Support of the capsule less that of the ellipsoid: at most b - c, and (a - b) / 2 between the axes.
                assert theirs - (b - c) - 0.5 * (a - b) - NEAR <= ours <= theirs + NEAR


def test_a_mesh_in_a_capsule_is_no_further_from_others_than_the_mesh(tmp_path: Path) -> None:
    path = written(tmp_path, MESH + BOX, assets='<mesh name="wedge" file="wedge.stl"/>')
    robot, _ = new(tmp_path, path, "--shapes=capsules")
    assert not (robot / "meshes").exists()
    both, dice = Both(path, robot / "arm.urdf"), np.random.default_rng(5)
    for _ in range(5):
        for ours, theirs in both.distances(dice.uniform(-2.5, 2.5, 3)).values():
            assert ours <= max(theirs, 0.0) + NEAR


@pytest.mark.parametrize(
    ("hand", "assets", "words"),
    [
        ('<geom name="odd" type="sdf" size="0.1"/>', "", "it is a sdf, which a URDF does not have: odd"),
        (
            '<geom type="capsule" mesh="wedge"/>',
            '<mesh file="wedge.stl"/>',
            "a capsule that MuJoCo fits to a mesh: geom 1",
        ),
        (
            '<geom type="mesh" mesh="inline"/>',
            '<mesh name="inline" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>',
            "a mesh without a file",
        ),
        (
            '<geom type="mesh" mesh="other"/>',
            '<mesh name="other" file="other.msh"/>',
            "that is none of .stl, .obj",
        ),
        (
            MESH,
            '<mesh name="wedge" file="wedge.stl" scale="1 1 2" refquat="1 1 0 0"/>',
            "before it is scaled unevenly",
        ),
        ('<geom class="disc" quat="1 1 0 0"/>', "", "it is turned in two ways, one by a default class"),
    ],
)
def test_what_has_no_counterpart_is_said_by_name(tmp_path: Path, hand: str, assets: str, words: str) -> None:
    links = urdf_of_mujoco(written(tmp_path, hand, assets=assets), shapes=True)
    assert words in " ".join(links.notes)
    assert "palm 1" not in links.urdf and "fore 1" in links.urdf


def test_a_mesh_that_is_not_there_is_said_with_its_link(tmp_path: Path) -> None:
    path = written(tmp_path, MESH, assets='<mesh name="wedge" file="gone.stl"/>')
    folder, said = new(tmp_path, path)
    assert "collision meshes that are not there, so these links have no shape: palm" in " ".join(said.split())
    assert "palm 1" not in (folder / "arm.urdf").read_text()


def test_two_copies_are_kept_apart_by_their_outer_links(tmp_path: Path) -> None:
    folder, _ = new(tmp_path, written(tmp_path), "--mirror=3")
    spec = read_robot(folder)
    assert len(spec.collision.pairs) == 9
    kinds = [type(shape.geometry).__name__ for shape in RobotModel(spec).geometry().geometryObjects]
    assert kinds.count("Capsule") == 4 and kinds.count("Cylinder") == 4


def test_all_capsules_of_a_link_stay_capsules(tmp_path: Path) -> None:
    """pinocchio reads the first list of capsules of a link only."""
    two = '<geom type="capsule" size="0.02 0.05"/><geom type="capsule" size="0.02 0.05" pos="0 0.1 0"/>'
    path = written(tmp_path, two + MESH, assets='<mesh name="wedge" file="wedge.stl"/>')
    model = RobotModel(read_robot(new(tmp_path, path, "--shapes=capsules")[0]))
    shapes = model.geometry({"palm"}).geometryObjects
    assert [type(shape.geometry).__name__ for shape in shapes] == ["Capsule"] * 3
