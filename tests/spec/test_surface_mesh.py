# SPDX-License-Identifier: BSD-3-Clause
"""Files of meshes: three ways to write one body give the same triangles, and no bad body comes through."""

import struct
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from docs import fouled_pipe_file
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec import surface_mesh
from impedance_modules.spec.document import parse_document
from impedance_modules.spec.locate import find_task
from impedance_modules.spec.surface_mesh import mesh_faults, read_mesh
from impedance_modules.spec.task_reader import check_task, read_task
from impedance_modules.spec.task_text import beside_another, changed, task_document
from tests.spec.test_task_files import cached_robot
from tests.support.closed_meshes import ball_mesh, box_mesh, mesh, obj_text, write_stl, written_stl

CUBE = box_mesh((1.0, 1.0, 1.0))
FOULED = "hold-to-fouled-pipe"


def corners(found) -> np.ndarray:
    """All triangles' corners, in an order that does not depend on how vertices are numbered."""
    return found.vertices[found.triangles]


def read(folder: Path, name: str, text: str, scale: float = 1.0):
    path = folder / name
    path.write_text(text)
    return read_mesh(path, name, scale)


def test_every_way_to_write_a_body_gives_the_same_triangles(tmp_path) -> None:
    body = ball_mesh(0.25, rings=6)
    exactly = mesh(body.vertices.astype("<f4"), body.triangles)
    found = [
        read_mesh(write_stl(tmp_path / "a.stl", exactly), "a.stl", 2.0),
        read(tmp_path, "b.STL", written_stl(exactly), 2.0),
        read(tmp_path, "c.obj", obj_text(exactly), 2.0),
        read(tmp_path, "d.obj", obj_text(exactly, backwards=True), 2.0),
    ]
    for one in found:
        np.testing.assert_array_equal(corners(one), 2.0 * corners(exactly))
        assert len(one.vertices) == len(body.vertices)
        assert not list(mesh_faults(one))


def test_a_face_of_four_corners_is_two_triangles(tmp_path) -> None:
    places = "".join("v " + " ".join(map(str, place)) + "\n" for place in CUBE.vertices)
    quads = "".join(
        f"f {a + 1} {b + 1} {c + 1} {d + 1}\n" for (a, b, c), (_, _, d) in CUBE.triangles.reshape(-1, 2, 3)
    )
    found = read(tmp_path, "cube.obj", places + quads)
    assert len(found.triangles) == 12 and not list(mesh_faults(found))


FLIPPED = mesh(CUBE.vertices, CUBE.triangles[:, ::-1])
ONE_FLIPPED = mesh(CUBE.vertices, [CUBE.triangles[0, ::-1], *CUBE.triangles[1:]])
LEAF = mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]])
NEEDLE = mesh([*CUBE.vertices, [0, 0, 0], [1, 1, 1], [2, 2, 2]], [*CUBE.triangles, [8, 9, 10]])
FIN = mesh([*CUBE.vertices, [2, 0, 0]], [*CUBE.triangles, [0, 1, 8], [1, 0, 8]])
TWO = mesh(np.concatenate([CUBE.vertices, CUBE.vertices + 3.0]), [*CUBE.triangles, *FLIPPED.triangles + 8])

FAULTS = {
    "open": (mesh(CUBE.vertices, CUBE.triangles[1:]), "is open: only one triangle has the edge"),
    "inside-out": (FLIPPED, "is inside out around (0, 0, 0) m"),
    "one-turned-round": (ONE_FLIPPED, "has neighbours that turn opposite ways, at the edge"),
    "no-volume": (LEAF, "has no volume"),
    "no-area": (NEEDLE, "triangle 13 has no area"),
    "three-at-an-edge": (FIN, "has an edge of more than two triangles"),
    "second-body-inside-out": (TWO, "is inside out around (3, 3, 3) m"),
    "in-millimetres": (mesh(1000.0 * CUBE.vertices, CUBE.triangles), "reaches 500 m from its origin"),
    "tiny": (mesh(1e-4 * CUBE.vertices, CUBE.triangles), "is only 0.0001 m long"),
}


def task_with(folder: Path, file: str, **more: object) -> str:
    """The shipped task with another mesh, as text; the mesh lies in a folder of the test."""
    data = yaml.safe_load(find_task(FOULED).read_text())
    ground = data["environment"][0]
    del ground["scale"]
    ground.update(file=file, **more)
    return yaml.safe_dump(data, sort_keys=False)


def problems(folder: Path, file: str, **more: object) -> tuple[str, list]:
    text = task_with(folder, file, **more)
    with pytest.raises(BadFile) as caught:
        check_task(parse_document(folder / "task.yaml", text), cached_robot)
    return text, list(caught.value.problems)


@pytest.mark.parametrize("name", FAULTS)
def test_a_body_that_is_not_closed_is_refused_at_its_line(name, tmp_path) -> None:
    body, sentence = FAULTS[name]
    write_stl(tmp_path / "body.stl", body)
    text, found = problems(tmp_path, "body.stl")
    assert any(f"{tmp_path}/body.stl {sentence}" in problem.message for problem in found)
    assert len(found) == 1 or name == "no-area"
    for problem in found:
        assert problem.path == "environment[0].file"
        assert text.splitlines()[problem.line - 1][problem.column - 1 :] == "body.stl"


TEXTS = {
    "missing.stl": (None, "no such file"),
    "empty.stl": ("", "is no STL file of 0 bytes"),
    "short.stl": ("x" * 200, "is no STL file of 200 bytes"),
    "none.stl": ("solid nothing\nendsolid\n", "has no triangle"),
    "word.stl": ("solid\nfacet\nvortex 1 2 3\n", "word.stl:3: 'vortex' cannot stand in an STL file"),
    "number.stl": ("solid\nvertex 1 2 three\n", "number.stl:2: 'vertex 1 2 three' needs 3 finite numbers"),
    "nan.stl": ("solid\nvertex 1 2 nan\n", "nan.stl:2: 'vertex 1 2 nan' needs 3 finite numbers"),
    "huge.obj": ("v 1 2 1e300\n", "huge.obj:1: 'v 1 2 1e300' needs 3 finite numbers"),
    "two.stl": ("solid\nvertex 0 0 0\nvertex 1 0 0\nendloop\n", "two.stl:4: a facet"),
    "ends.stl": ("solid\nvertex 0 0 0\n", "ends within a facet"),
    "corner.obj": ("v 0 0 0\nf 1 2 3\n", "corner.obj:2: the corner '2' names no vertex (valid: 1 to 1"),
    "pair.obj": ("v 0 0 0\nf 1 1\n", "pair.obj:2: a face of 2 corners"),
    "curve.obj": ("v 0 0 0\ncurv 0 1 1 2\n", "curve.obj:2: 'curv' is not read"),
    "one.obj": ("v 0 0 0\nf 1 1 1\n", "one.obj is only 0 m long"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_file_that_is_no_mesh_is_refused_with_its_own_line(name, tmp_path) -> None:
    text, sentence = TEXTS[name]
    if text is not None:
        (tmp_path / name).write_text(text)
    _, found = problems(tmp_path, name)
    assert any(sentence in problem.message for problem in found)
    assert all(problem.path == "environment[0].file" for problem in found)


def test_numbers_that_are_not_finite_and_too_many_triangles_are_refused(tmp_path, monkeypatch) -> None:
    raw = bytearray(write_stl(tmp_path / "body.stl", CUBE).read_bytes())
    struct.pack_into("<f", raw, 84 + 50 + 12, float("inf"))
    (tmp_path / "body.stl").write_bytes(raw)
    with pytest.raises(BadInput, match="triangle 2 has a coordinate that is not finite"):
        read_mesh(tmp_path / "body.stl", "body.stl", 1.0)
    monkeypatch.setattr(surface_mesh, "MOST_TRIANGLES", 11)
    write_stl(tmp_path / "body.stl", CUBE)
    for name, text in (("body.stl", None), ("text.stl", written_stl(CUBE)), ("body.obj", obj_text(CUBE))):
        if text is not None:
            (tmp_path / name).write_text(text)
        with pytest.raises(BadInput, match="12 triangles; at most 11 are read"):
            read_mesh(tmp_path / name, name, 1.0)
    monkeypatch.setattr(surface_mesh, "LARGEST_FILE", 100)
    with pytest.raises(BadInput, match="684 bytes; at most 100 are read"):
        read_mesh(tmp_path / "body.stl", "body.stl", 1.0)


def test_every_fault_of_a_mesh_is_told_at_once(tmp_path) -> None:
    both = mesh([*CUBE.vertices, [0, 0, 0], [1, 1, 1], [2, 2, 2]], [*CUBE.triangles[1:], [8, 9, 10]])
    write_stl(tmp_path / "body.stl", both)
    _, found = problems(tmp_path, "body.stl", friction=-1)
    said = " ".join(problem.message for problem in found)
    assert "less than the least allowed" in said
    _, found = problems(tmp_path, "body.stl")
    said = " ".join(problem.message for problem in found)
    assert "has no area" in said and "is open" in said


@settings(deadline=None, max_examples=60)
@given(
    data=st.binary(max_size=300),
    kind=st.sampled_from([".stl", ".obj"]),
    start=st.sampled_from([b"", b"solid\n", b"v 1 2 3\n"]),
)
def test_any_bytes_are_a_mesh_or_refused(tmp_path_factory, data, kind, start) -> None:
    path = tmp_path_factory.mktemp("bytes") / f"any{kind}"
    path.write_bytes(start + data)
    try:
        found = read_mesh(path, path.name, 1.0)
    except BadInput as refused:
        assert path.name in str(refused)
    else:
        assert list(mesh_faults(found))


def test_the_shipped_mesh_is_what_its_script_writes() -> None:
    assert fouled_pipe_file.PATH.read_bytes() == fouled_pipe_file.made()


def test_a_task_that_is_written_elsewhere_names_its_mesh_by_its_whole_path(tmp_path) -> None:
    document = task_document(FOULED)
    for text in (changed(document, {}), beside_another(document.text, document.path)):
        (tmp_path / "task.yaml").write_text(text)
        task, _ = read_task(tmp_path / "task.yaml", cached_robot)
        original, _ = read_task(FOULED, cached_robot)
        np.testing.assert_array_equal(
            task.environment[0].mesh.vertices, original.environment[0].mesh.vertices
        )
    assert beside_another("no: task", tmp_path / "task.yaml") == "no: task"
    assert beside_another("[", tmp_path / "task.yaml") == "["


def test_a_playback_may_be_taught_on_a_mesh(tmp_path) -> None:
    data = yaml.safe_load(find_task("slide-over-position").read_text())
    write_stl(tmp_path / "body.stl", CUBE)
    ground = {
        "surface": "mesh",
        "position": [0, 0, -2],
        "file": "body.stl",
        "stiffness": 1e4,
        "damping": 1,
        "friction": 0,
    }
    data["playback"]["taught_on"] = [ground]
    task, _ = check_task(parse_document(tmp_path / "task.yaml", yaml.safe_dump(data)), cached_robot)
    np.testing.assert_array_equal(corners(task.playback.taught_on[0].mesh), corners(CUBE))
