# SPDX-License-Identifier: BSD-3-Clause
"""Writes what the commands read into the current folder: tasks, robots, patches, foreign logs, recordings."""

from __future__ import annotations

import shutil
from pathlib import Path
from unittest.mock import patch

import numpy as np
import scipy.io
import yaml

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.episode import file_format
from impedance_modules.episode.file_format import write_episode
from impedance_modules.spec.locate import find_task
from tests.cli.test_command_line import SHORT
from tests.diagnosis import test_diagnosis as pendulum
from tests.effects.test_effects_applied import RUNS
from tests.episode.test_import_bags import KINDS, arm_bag, bag_map_data, two_rates
from tests.export.test_mujoco_models import MODEL, ORIENTATIONS
from tests.export.test_urdf_export import ARM
from tests.spec.test_robot_files import CASES as ROBOT_MISTAKES
from tests.support.closed_meshes import box_mesh, mesh, obj_text, written_stl
from tests.support.effect_recordings import AppliedEffect, applied
from tests.support.import_logs import base_map, motion, table_log, write_map, write_table
from tests.support.log_metadata import log_metadata
from tests.support.paths import CHECKOUT, TESTS
from tests.support.plant_recordings import SIX_JOINTS, patch_text, record, robot_folder

HERE = Path()
PATCHES = CHECKOUT / "robots" / "baxter" / "patches"
PATCHED = tuple(f"patch-{name}.yaml" for name in RUNS)
BAGS = tuple(f"log-{kind}" + ".bag" * kind.startswith("bag") for kind in KINDS)
BROKEN = tuple(sorted((TESTS / "broken_tasks").glob("*.yaml")))
BROKEN_ROBOTS = tuple(f"broken-robot-{number}" for number in range(len(ROBOT_MISTAKES)))


MODELS = tuple(f"model-{number}.xml" for number in range(len(ORIENTATIONS)))
BARE = (ARM[ARM.index("<inertial>") : ARM.index("</link>")], "")
"""What makes the small robot's root link nothing but a frame."""

BLOCK = box_mesh((200.0, 200.0, 208.0))
"""A block in millimetres, as high as the shipped mesh's pipe."""

MISTAKEN_LOGS = (
    ("ragged", "text"),
    ("words", "text"),
    ("degrees", "text"),
    ("fast", "text"),
    ("signs", "text"),
    ("text", "missing-column"),
)
"""Logs that a map does not describe rightly, and the map."""


def write_tasks() -> None:
    """The tests' tasks with the robots that they name, and variants of shipped ones that are short."""
    for path in (TESTS / "data").glob("*.yaml"):
        shutil.copy(path, HERE)
    shutil.copytree(SIX_JOINTS, HERE / "robots" / "six_joint_pair")
    (HERE / "short.yaml").write_text(SHORT)
    write_variant("short.yaml", "unmet.yaml", "duration: 0.5}", "duration: 0.5, until: {contact: true}}")
    write_variant("short.yaml", "long.yaml", "duration: 0.3", "duration: 300")
    for solver in ("proxsuite", "qpsolvers:daqp"):
        folder = HERE / "robots" / f"by_{solver.partition(':')[0]}"
        shutil.copytree(SIX_JOINTS, folder)
        write_variant(folder / "robot.yaml", folder / "robot.yaml", "solver: daqp", f"solver: {solver}")
        task = f"solved-by-{solver.partition(':')[0]}.yaml"
        write_variant("pair-hold.yaml", task, "robot: six_joint_pair", f"robot: ./{folder}")
    write_variant(find_task("map-sheet"), "strokes.yaml", "duration: 9", "duration: 4")
    write_variant(find_task("sand-until-smooth"), "sanding.yaml", "duration: 60", "duration: 16")
    write_variant(find_task("soft-hold"), "near.yaml", "s0: 0.5462", "s0: 0.35")
    write_meshes()


def write_meshes() -> None:
    """Tasks on surfaces from files: as shipped, written, as OBJ, open, and not there; and on a ball."""
    task, named = find_task("hold-to-fouled-pipe"), "fouled-pipe.stl"
    shutil.copy(task, HERE / "fouled.yaml")
    shutil.copy(task.with_name(named), HERE)
    (HERE / "written.stl").write_text(written_stl(BLOCK))
    (HERE / "block.obj").write_text(obj_text(BLOCK))
    (HERE / "open.obj").write_text(obj_text(mesh(BLOCK.vertices, BLOCK.triangles[1:])))
    for name, file in (
        ("written", "written.stl"),
        ("block", "block.obj"),
        ("open", "open.obj"),
        ("away", "no.stl"),
    ):
        write_variant("fouled.yaml", f"{name}.yaml", named, file)
    saddle = find_task("hold-to-saddle")
    write_variant(saddle, "ball.yaml", "size: [0.3, 0.2] # m, along x and y", "size: [0.3]")
    write_variant("ball.yaml", "ball.yaml", "surface: saddle", "surface: sphere")
    write_variant("ball.yaml", "ball.yaml", "    radii: [0.15, 0.1] # m: up along x, down along y\n", "")
    write_variant("ball.yaml", "ball.yaml", "-0.3, -0.03]", "-0.3, -0.18]")
    write_variant("ball.yaml", "ball.yaml", "initial: 1.9", "initial: 2.5")


def write_variant(source: str | Path, target: str | Path, old: str, new: str) -> None:
    """Writes a text with one piece of it changed, wherever it occurs."""
    text = Path(source).read_text()
    if old not in text:
        raise AssertionError(f"{source} no longer says '{old}'")
    Path(target).write_text(text.replace(old, new))


def write_patches() -> None:
    """One patch for each group of effects that the tests apply together."""
    for name, entries in zip(PATCHED, RUNS.values(), strict=True):
        write_patch(HERE / name, list(entries))
    surface = "surface0"
    write_patch(
        HERE / "surfaces.yaml",
        [
            applied("surface_height", "contact", surface, dh=0.002),
            applied("surface_stiffness", "contact", surface, k=15000.0),
            applied("surface_friction", "contact", surface, mu=0.5),
        ],
    )


def write_patch(path: Path, entries: list[AppliedEffect]) -> None:
    write_entries(path, [entry.entry() for entry in entries])


def write_entries(path: Path | str, entries: list[dict[str, object]]) -> None:
    head = {"format": 1, "robot": "six_joint_pair", "provenance": {"origin": "hand", "date": "2026-11-21"}}
    Path(path).write_text(yaml.safe_dump({**head, "effects": entries}, sort_keys=False))


def write_descriptions() -> None:
    """A small URDF and MuJoCo models, with patches that they have a place for, and others."""
    (HERE / "small.urdf").write_text(ARM)
    write_variant("small.urdf", "bare.urdf", *BARE)
    write_variant("small.urdf", "entity.urdf", "<robot", '<!DOCTYPE robot [<!ENTITY e "x">]><robot')
    (HERE / "small.xml").write_text(MODEL.format(turned=""))
    for name, turned in zip(MODELS, ORIENTATIONS, strict=True):
        (HERE / name).write_text(MODEL.format(turned=turned))
    lean = applied("base_tilt", "link", "base", rx=0.1, ry=0.2).entry()
    bodies = [
        applied_to("payload", "link", "arm", m=0.5, cx=0.1, cy=0.0, cz=0.2),
        applied_to("viscous_friction", "link", "turn", fv=0.3),
        applied_to("coulomb_friction", "actuator", "turn", fc=0.2),
        linear("torque_saturation", "actuator", "slide", limit=40.0),
        linear("encoder_offset", "sensor", "slide", dq0=0.01),
    ]
    write_entries("bodies.yaml", [*bodies, lean])
    at_motors = [
        applied_to("torque_gain", "actuator", "shoulder", s=0.9),
        *(applied_to("torque_saturation", "actuator", "shoulder", limit=limit) for limit in (4.0, 6.0)),
        applied_to("command_delay", "timing", "shoulder", T=0.01),
        applied_to("controller_gain", "actuator", "elbow", dkp=3.0),
        applied_to("reflected_inertia", "actuator", "elbow", Ia=0.1),
        applied_to("coulomb_friction", "link", "elbow", fc=0.2),
        applied_to("quadratic_drag", "link", "elbow", c=0.2),
        applied_to("viscous_friction", "link", "elbow", fv=0.2),
        applied_to("parallel_spring", "link", "elbow", k=2.0, q0=0.1),
        applied_to("encoder_offset", "sensor", "elbow", dq0=0.1),
    ]
    write_entries("numbers.yaml", [*at_motors, lean])
    write_entries("fixed.yaml", [applied_to("payload", "link", "upper", m=0.5, cx=0.1, cy=0.0, cz=0.2)])
    unfit = [
        applied_to("actuator_lag", "actuator", "shoulder", T=0.01),
        applied_to("torque_gain", "actuator", "elbow", s=0.9),
        applied_to("torque_ripple", "actuator", "elbow", A=0.1, N=4.0),
    ]
    write_entries("unfit.yaml", unfit)


def applied_to(effect: str, port: str, key: str, **values: float) -> dict[str, object]:
    """An entry of a patch."""
    return applied(effect, port, key, **values).entry()


def linear(effect: str, port: str, key: str, **values: float) -> dict[str, object]:
    """The same for a joint that slides."""
    found = applied(effect, port, key, **values).entry()
    description = CATALOGUE[effect].description
    for symbol, quantity in found["parameters"][key].items():
        quantity["unit"] = description.parameter(symbol).linear_unit
    return found


def write_logs() -> None:
    """A log of every kind that can be imported, and some that must be refused."""
    write_text_logs()
    write_arrays()
    for kind, name in zip(KINDS, BAGS, strict=True):
        arm_bag().write(HERE / name.removesuffix(".bag"), kind)
    two_rates().write(HERE / "springs", "bag")
    write_map(HERE / "springs.yaml", bag_map_data())
    write_damaged()


def write_damaged() -> None:
    """An episode in three blocks that was cut off in the third."""
    time, q, _ = motion()
    path = HERE / "damaged.parquet"
    with patch.object(file_format, "ROWS_PER_GROUP", 150):
        write_episode(path, {"time": time, "position.a": q[:, 0], "position.b": q[:, 1]}, log_metadata())
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])


def write_text_logs() -> None:
    time, q, v = motion()
    table_log(HERE / "text.csv")
    write_map(HERE / "text.yaml", base_map())
    write_map(HERE / "contradiction.yaml", base_map(joints=["a", "a"], colour="red"))
    write_map(HERE / "thinned.yaml", base_map(decimate={"keep_every": 2, "low_pass": 15}))
    shutil.copy(HERE / "text.csv", HERE / "thinned.csv")
    table_log(HERE / "uneven.csv", time=np.where(np.arange(400) == 200, time - 0.05, time))
    timed = base_map()["tables"][0]
    timeless = {key: value for key, value in timed.items() if key != "time"}
    write_map(HERE / "untimed.yaml", base_map(tables=[timeless]))
    shutil.copy(HERE / "text.csv", HERE / "untimed.csv")
    write_mistaken(time, q, v)
    header = ["t", "q1", "q2", "v1", "v2", "e1", "e2"]
    write_table(HERE / "zeros.csv", header, time, q, v, 0.0 * q)
    effort = {"columns": "e{index}", "unit": "N.m"}
    write_map(HERE / "zeros.yaml", base_map(effort_source="motor", tables=[{**timed, "effort": effort}]))
    write_motors(time, q, v)
    write_many(time, q)
    write_prismatic(time, q)
    write_recorder()


def write_mistaken(time: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
    """Logs of which the map says something wrong, or that are damaged."""
    lines = (HERE / "text.csv").read_text().splitlines()
    (HERE / "ragged.csv").write_text("\n".join([*lines[:50], "1,2", *lines[50:]]))
    (HERE / "words.csv").write_text(
        "\n".join([*lines[:50], lines[50].replace(",", ",none,", 1), *lines[51:]])
    )
    table_log(HERE / "degrees.csv", q=np.degrees(q), v=np.degrees(v))
    table_log(HERE / "fast.csv", v=np.degrees(v))
    table_log(HERE / "signs.csv", v=v * [1, -1])
    position = {"columns": ["q1", "q7"], "unit": "rad"}
    missing = {**base_map()["tables"][0], "position": position}
    write_map(HERE / "missing-column.yaml", base_map(tables=[missing]))


def write_motors(time: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
    """What was measured before gears, in other units, without a header."""
    gears = np.array([[100.0, 0.0], [-20.0, 80.0]])
    columns = (time * 1e3, np.degrees(q @ gears.T), v @ gears.T * 30.0 / np.pi, np.cos(q))
    write_table(HERE / "motors.csv", [], *columns, separator=";")
    table = {
        **{"separator": "semicolon", "header": False},
        "time": {"column": 1, "unit": "ms"},
        "position": {"columns": [2, 3], "unit": "deg", "side": "motor", "offset": {"a": 0.1}},
        "velocity": {"columns": [4, 5], "unit": "rpm", "side": "motor"},
        "effort": {"columns": [6, 7], "unit": "A", "gain": 0.2, "side": "motor", "sign": {"b": -1}},
        "extra": {"raw": {"column": 2, "scale": 0.1}},
    }
    transmission = {"ratio": [100, 80], "coupling": {"b": {"a": -20}}}
    write_map(
        HERE / "motors.yaml", base_map(effort_source="motor", transmission=transmission, tables=[table])
    )


def write_many(time: np.ndarray, q: np.ndarray) -> None:
    """Three recordings of two files each, in a folder; two of them repeat one motion."""
    (HERE / "many").mkdir()
    for name in ("run-1", "run-2", "other"):
        write_table(HERE / "many" / f"{name}-q.csv", ["t", "n1", "n2"], time, q * 4096 / (2 * np.pi))
        write_table(HERE / "many" / f"{name}-e.csv", ["t", "e1", "e2"], time, np.cos(q))
    text = {"separator": "comma", "header": True, "time": {"column": "t", "unit": "s"}}
    position = {"columns": "n{index}", "unit": "counts", "counts_per_rev": {"a": 4096, "b": 8192}}
    tables = [
        {"file": "{episode}-q.csv", **text, "position": position},
        {"file": "{episode}-e.csv", **text, "effort": {"columns": "e{index}", "unit": "N.m"}},
    ]
    write_map(
        HERE / "many.yaml", base_map(effort_source="motor", repeats=[["run-1", "run-2"]], tables=tables)
    )


def write_prismatic(time: np.ndarray, q: np.ndarray) -> None:
    """A slide in millimetres, as its URDF says."""
    links = "".join(f"<link name='{name}'/>" for name in "wxy")
    joint = (
        "<joint name='{}' type='{}'><parent link='{}'/><child link='{}'/>"
        "<limit lower='-1' upper='1' velocity='9' effort='1'/></joint>"
    )
    joints = joint.format("a", "revolute", "w", "x") + joint.format("b", "prismatic", "x", "y")
    (HERE / "two.urdf").write_text(f"<robot name='two'>{links}{joints}</robot>")
    write_table(HERE / "slide.csv", ["t", "q1", "q2"], time, q * [1, 1000])
    table = {**base_map()["tables"][0], "position": {"columns": "q{index}", "unit": {"a": "rad", "b": "mm"}}}
    del table["velocity"]
    write_map(HERE / "slide.yaml", base_map(urdf="two.urdf", tables=[table]))


def write_recorder() -> None:
    """A file as Rethink's joint_recorder.py writes it, which needs no map."""
    shorts = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
    names = [f"{side}_{short}" for side in ("left", "right") for short in shorts]
    time, q, _ = motion(joints=14)
    values = 0.2 * q + [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] * 2
    write_table(HERE / "wave", ["time", *names], time, values)


def write_arrays() -> None:
    time, q, v = motion()
    scipy.io.savemat(HERE / "arrays.mat", {"t": time, "q": q.T, "v": v, "s": {"tau": q, "k": 3.0}})
    np.savez(HERE / "arrays.npz", **{"t": time, "q": q, "v": v, "s.tau": q, "s.k": 3.0})
    names = {"t": time} | {f"{n}[{i + 1}]": a[:, i] for n, a in (("q", q), ("v", v)) for i in (0, 1)}
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(names), HERE / "arrays.parquet")
    table = {
        "time": {"column": "t", "unit": "s"},
        "position": {"columns": "q[{index}]", "unit": "rad"},
        "velocity": {"columns": ["v[1]", "v[2]"], "unit": "rad/s"},
    }
    write_map(HERE / "columns.yaml", base_map(tables=[table]))
    effort = {"columns": "s.tau[{index}]", "unit": "other", "gain": "s.k"}
    write_map(HERE / "arrays.yaml", base_map(effort_source="motor", tables=[{**table, "effort": effort}]))


def write_recordings() -> None:
    """Recordings with one withheld cause: of a pendulum with a URDF, and of two joints of the six-joint robot."""
    for name, effect, seconds in (
        ("pendulum", "viscous_friction", 8.0),
        ("tone", "tone", 8.0),
        ("table", "table", 14.0),
        ("spring", "parallel_spring", 8.0),
        ("stop", "sudden_stop", 8.0),
        ("short-pendulum", "nothing", 0.5),
    ):
        (HERE / name).mkdir()
        pendulum.record(HERE / name, effect, seconds=seconds)
    (HERE / "pendulum" / "robot.urdf").write_text(pendulum.URDF)
    (HERE / "single").mkdir()
    shutil.copy(HERE / "table" / "run3.parquet", HERE / "single")
    robot = HERE / "robots" / "noisy_pair"
    shutil.move(robot_folder(HERE), robot)
    (HERE / "rich").mkdir()
    record(HERE / "rich", robot, patch_text("backlash", "actuator", "port_lift", b=(0.01, "rad")))


def write_mistakes() -> None:
    """A patch and robots with a mistake; each robot has a task of its own beside it."""
    write_patch(HERE / "misplaced-patch.yaml", [applied("viscous_friction", "link", "nobody", fv=1.0)])
    (HERE / "broken-patch.yaml").write_text("format: 1\nrobot: nobody\neffects: [{effect: payloat}]\n")
    for folder, (file, old, new, *_) in zip(BROKEN_ROBOTS, ROBOT_MISTAKES, strict=True):
        shutil.copytree(SIX_JOINTS, HERE / folder)
        path = HERE / folder / file
        path.write_text(path.read_text().replace(old, new, 1))
        write_variant("pair-hold.yaml", f"{folder}.yaml", "robot: six_joint_pair", f"robot: ./{folder}")
