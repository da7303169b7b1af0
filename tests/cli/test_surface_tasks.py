# SPDX-License-Identifier: BSD-3-Clause
"""Tasks on round surfaces and meshes, as a user has them: checked, run, drawn, replayed bit by bit, refused."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from rerun.chunk import RrdReader

from impedance_modules.control.assembly import assemble
from impedance_modules.errors import BadFile
from impedance_modules.prediction.energy_need import forecast_tank
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.spec.locate import find_task
from impedance_modules.tools.surface_fit import SurfaceMap
from impedance_modules.tools.surface_truth import true_surface
from tests.support.closed_meshes import ball_mesh, box_mesh, obj_text, surface, write_stl
from tests.support.commands import invoke, refusal
from tests.support.shipped_runs import watch

FORCE = 20.0
TASKS = {"hold-to-pipe": "y", "hold-to-saddle": "z", "hold-to-fouled-pipe": "z"}
EVERY_TASK = pytest.mark.parametrize("name", TASKS)


@EVERY_TASK
def test_the_hands_keep_their_hold_under_a_push_and_on_the_way(name: str) -> None:
    """Contact never ends; what presses along the force axis is the asked force, less what joint springs take."""
    run = watch(find_task(name))
    assert run.done and run.slowed == 0 and run.limit_margin() > 0.25
    axis = "xyz".index(TASKS[name])
    for arm in run.assembly.modules.arms:
        hand = arm.limb.hand
        force = run.seen(f"surface on {hand}", "hold", "slide", "stay")[50:]
        assert np.min(np.linalg.norm(force, axis=1)) > 0.4 * FORCE
        assert np.mean(np.abs(force[:, axis])) == pytest.approx(FORCE, rel=0.1)
    first = run.assembly.modules.arms[0].limb.hand
    path, pushed = run.seen(f"at {first}", "slide", "stay"), run.seen(f"at {first}", "hold")
    assert path[-1, 0] - path[0, 0] > 0.04
    assert 0.01 < np.max(np.linalg.norm(pushed - pushed[100], axis=1)[100:]) < 0.06


@EVERY_TASK
def test_the_tank_holds_at_most_half_again_what_check_says(name: str) -> None:
    assembly = assemble(name, effects=None, rate=None, scale=1.0, arm=None)
    need = forecast_tank(assembly, Mechanism(assembly), predict_motion(assembly)).need
    assert need <= assembly.tank.initial <= 1.5 * need


@EVERY_TASK
def test_a_recording_is_replayed_bit_by_bit_and_shows_the_surface(name: str, tmp_path: Path) -> None:
    invoke("run", name, "--duration", "3", "--out", tmp_path / "out")
    assert "bit" in invoke("replay", "--verify", tmp_path / "out").output
    seen = RrdReader(str(tmp_path / "out" / "recording.rrd")).store().schema().entity_paths()
    assert any("surface" in path for path in seen)


def test_a_recording_of_a_mesh_is_read_where_the_mesh_is_and_refused_where_it_is_not(tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    for path in (
        find_task("hold-to-fouled-pipe"),
        find_task("hold-to-fouled-pipe").with_name("fouled-pipe.stl"),
    ):
        shutil.copy(path, there)
    invoke("run", there / "hold-to-fouled-pipe.yaml", "--duration", "1", "--out", tmp_path / "out")
    invoke("replay", "--verify", tmp_path / "out")
    (there / "fouled-pipe.stl").unlink()
    assert f"{there}/fouled-pipe.stl: no such file" in refusal("replay", "--verify", tmp_path / "out")


INSIDE = {
    "cylinder": "position: [0.7, -0.3, 0], size: [0.2, 0.4], rotation: [0, 1.57, 0]",
    "sphere": "position: [0.7, -0.3, 0], size: [0.2]",
    "saddle": "position: [0.7, -0.3, 0.09], size: [0.2, 0.2], radii: [0.2, 0.2]",
    "mesh": "position: [0.7, -0.3, 0], file: body.obj",
}


@pytest.mark.parametrize("kind", INSIDE)
def test_a_hand_that_begins_inside_is_refused_at_the_surface_s_line(kind: str, tmp_path: Path) -> None:
    (tmp_path / "body.obj").write_text(obj_text(box_mesh((0.2, 0.2, 0.2))))
    text = find_task("press-by-force").read_text()
    hard = "stiffness: 100000, damping: 100, friction: 0.2}]"
    text = re.sub(r"environment: .*", f"environment: [{{surface: {kind}, {INSIDE[kind]}, {hard}", text)
    (tmp_path / "task.yaml").write_text(text)
    with pytest.raises(BadFile) as refused:
        refuse_infeasible(assemble(str(tmp_path / "task.yaml"), effects=None, rate=None, scale=1.0, arm=None))
    (problem,) = refused.value.problems
    assert "mm inside this surface" in problem.message
    assert text.splitlines()[problem.line - 1].startswith("environment:")


@pytest.mark.parametrize("name", ["hold-to-saddle", "hold-to-pipe"])
def test_where_the_forecast_comes_to_rest_the_surface_carries_what_presses(name: str) -> None:
    """At every phase's rest forces balance on the curved surface, to rounding: the search converged."""
    assembly = assemble(name, effects=None, rate=None, scale=1.0, arm=None)
    for phase, rest in zip(assembly.task.phases, refuse_infeasible(assembly).rests, strict=True):
        assert rest is not None, phase.name
        for wrench in rest.pressure.values():
            assert np.linalg.norm(wrench[:3]) == pytest.approx(FORCE, rel=0.1)


def test_check_says_where_only_friction_holds_on_a_pipe(tmp_path: Path) -> None:
    """A pipe of 2 R = 20 cm is held: N/R is half of K. On one of 8 cm it is more than K."""
    data = yaml.safe_load(find_task("hold-to-saddle").read_text())
    data["phases"], data["pushes"] = data["phases"][:1], []
    for diameter, slides in ((0.2, False), (0.08, True)):
        data["environment"] = [
            {"surface": "cylinder", "position": [0.7, -0.3, -0.03 - 0.5 * diameter], "rotation": [0, 1.5707963, 0],
             "size": [diameter, 0.4], "stiffness": 20000, "damping": 100, "friction": 0.3}
        ]  # fmt: skip
        (tmp_path / "task.yaml").write_text(yaml.safe_dump(data))
        said = " ".join(invoke("check", tmp_path / "task.yaml").output.split())
        assert ("only friction keeps it there" in said) == slides


def flat_map(places: np.ndarray) -> SurfaceMap:
    """A map that only says where it was pressed."""
    nothing = np.zeros(len(places))
    fields = {name: nothing for name in SurfaceMap.__dataclass_fields__}
    return SurfaceMap(**{**fields, "place": places, "pressed": nothing - 1.0})


def test_the_true_height_under_a_map_is_the_surface_s_own(tmp_path: Path) -> None:
    """On top of a pipe, a ball, a ball of facets, and a saddle; a face with normal n gives 1 / (k n_z^2)."""
    places = np.array([[0.02, 0.03], [-0.05, 0.01], [0.0, 0.0]])
    x, y = places.T
    at, k = {"position": (0.0, 0.0, 0.2)}, 20000.0
    round_height = 0.2 + np.sqrt(0.01 - x**2 - y**2)
    cases = {
        "cylinder": (
            surface("cylinder", size=(0.2, 0.4), rotation=(0.0, np.pi / 2, 0.0), **at),
            0.2 + np.sqrt(0.01 - y**2),
            k * (1.0 - y**2 / 0.01),
        ),
        "sphere": (surface("sphere", size=(0.2,), **at), round_height, k * (1.0 - (x**2 + y**2) / 0.01)),
        "saddle": (
            surface("saddle", size=(0.2, 0.2), radii=(0.1, 0.2), **at),
            0.2 + x**2 / 0.2 - y**2 / 0.4,
            k / (1.0 + (x / 0.1) ** 2 + (y / 0.2) ** 2),
        ),
        "mesh": (surface("mesh", mesh=ball_mesh(0.1, rings=60), **at), round_height, None),
    }
    for kind, (ground, height, stiffness) in cases.items():
        truth = true_surface([replace(ground, stiffness=k)], flat_map(places))
        np.testing.assert_allclose(truth.height, height, atol=3e-4 if kind == "mesh" else 1e-8)
        if stiffness is not None:
            np.testing.assert_allclose(truth.compliance, 1.0 / stiffness, rtol=1e-6)
    for kind in ("saddle", "sphere"):
        with pytest.raises(Exception, match="no surface under"):
            true_surface([cases[kind][0]], flat_map(np.array([[0.15, 0.0]])))


def test_a_task_may_name_a_mesh_anywhere(tmp_path: Path) -> None:
    """By a path below its folder, above it, or a whole one; a sweep's files find it again."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "tasks").mkdir()
    body = write_stl(tmp_path / "meshes" / "block.stl", box_mesh((0.4, 0.4, 0.1)))
    data = yaml.safe_load(find_task("press-by-force").read_text())
    for file in ("../meshes/block.stl", str(body)):
        data["environment"] = [
            {"surface": "mesh", "file": file, "position": [0.7, -0.3, -0.08], "stiffness": 20000, "damping": 100,
             "friction": 0.2}
        ]  # fmt: skip
        (tmp_path / "tasks" / "task.yaml").write_text(yaml.safe_dump(data))
        assert "the task is valid" in invoke("check", tmp_path / "tasks" / "task.yaml").output
