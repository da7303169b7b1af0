# SPDX-License-Identifier: BSD-3-Clause
"""A target that retraces a recording: through its samples, from rest to rest; refused with its line; replayed alone."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.recorded_paths import fit_course, paths_as_metadata, paths_of_metadata
from impedance_modules.errors import BadInput
from impedance_modules.modules.minimum_jerk import minimum_jerk
from impedance_modules.modules.pose_motion import motion_along
from impedance_modules.modules.recorded_path import PathMotion, ramp_way
from impedance_modules.modules.spring import displacement_of
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.robot.rotation import exp3, write_quaternion
from impedance_modules.spec.path_spec import PathCourse
from impedance_modules.spec.task_text import beside_another, changed, task_document
from tests.support.arm_samples import Array, random_pose
from tests.support.both_ways import ways  # noqa: F401 - a fixture
from tests.support.commands import invoke, refusal
from tests.support.paths import CHECKOUT

SEEDS = st.integers(0, 2**32 - 1)
TASK = CHECKOUT / "tasks" / "retrace-path.yaml"
RECORDING = CHECKOUT / "tasks" / "figure-of-eight.parquet"


def smooth_poses(random: np.random.Generator, time: Array) -> Array:
    """Poses of a slow motion with large turns, the sign of the quaternions at random."""
    places, phases = 0.1 * random.normal(size=(2, 3)), random.uniform(0.0, 6.0, 3)
    axis, turns = random.normal(size=3), random.uniform(0.5, 1.5)
    poses = np.empty((len(time), 7))
    for row, t in zip(poses, time, strict=True):
        row[:3] = places[0] + places[1] * np.sin(1.5 * t + phases)
        write_quaternion(exp3(turns * t * axis / np.linalg.norm(axis)), row[3:])
        row[3:] *= random.choice([-1.0, 1.0])
    return poses


def sampled(random: np.random.Generator, length: float = 4.0) -> tuple[Array, Array, PathCourse]:
    """Times that jitter, poses, and the path through them."""
    time = np.linspace(0.0, length, 801) + np.r_[0.0, random.uniform(-0.001, 0.001, 799), 0.0]
    poses = smooth_poses(random, time)
    return time, poses, fit_course(time, poses, 0.1)


@given(seed=SEEDS)
@settings(max_examples=15, deadline=None)
def test_the_path_passes_through_its_samples(seed: int) -> None:
    """Where the speed is 1 and the ramps are over, the pose is the recorded one at that time, half a ramp later."""
    random = np.random.default_rng(seed)
    time, poses, course = sampled(random)
    motion = PathMotion(course, 1.0, 0.5)
    assert course.deviation < 2e-5
    for k in random.choice(np.flatnonzero((time > 0.3) & (time < 3.7)), 12):
        found = motion.pose(motion.approach + time[k] + 0.5 * motion.ramp)
        quaternion = np.empty(4)
        write_quaternion(found.rotation, quaternion)
        np.testing.assert_allclose(found.translation, poses[k, :3], atol=2e-5)
        assert abs(quaternion @ poses[k, 3:]) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.usefixtures("ways")
@pytest.mark.parametrize("speed", [0.4, 1.0, 2.5, 20.0])
def test_velocity_is_the_derivative_and_both_ends_are_at_rest(speed: float) -> None:
    """Through approach, ramps and path; the same at any speed; and nothing jumps."""
    random = np.random.default_rng(int(10 * speed))
    course = sampled(random)[2]
    motion = motion_along(PathMotion(course, speed, 0.7), random_pose(random), random_pose(random, angle=1.0))
    path = motion.path
    assert path is not None and path.end == pytest.approx(0.7 + 4.0 / speed + min(0.5, 4.0 / speed))
    for clock in np.r_[random.uniform(0.0, path.end, 40), 0.7 - 1e-5, 0.7 + 1e-5]:
        ahead, behind = motion.pose(clock + 1e-6), motion.pose(clock - 1e-6)
        slope = displacement_of(ahead, behind) / 2e-6
        scale = max(1.0, speed)
        np.testing.assert_allclose(motion.velocity(clock), slope, atol=2e-5 * scale)
    for clock in (0.7, path.end, path.end + 1.0):
        np.testing.assert_allclose(motion.velocity(clock), 0.0, atol=1e-9)
    np.testing.assert_allclose(displacement_of(motion.pose(0.7 + 1e-9), motion.pose(0.7)), 0.0, atol=1e-7)
    last = PathMotion(course, 1.0, 0.1)
    np.testing.assert_allclose(
        displacement_of(motion.pose(path.end + 1.0), last.pose(last.end)), 0.0, atol=1e-12
    )


@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
def test_time_runs_as_fast_as_the_factor_says(speed: float) -> None:
    """A straight line at 0.1 m/s is retraced at 0.1 m/s times the factor; quarter of a ramp is not half as fast."""
    time = np.linspace(0.0, 5.0, 501)
    poses = np.zeros((501, 7))
    poses[:, 0], poses[:, 6] = 0.1 * time, 1.0
    motion = PathMotion(fit_course(time, poses, 0.1), speed, 0.5)
    middle = motion.approach + 0.5 * (motion.end - motion.approach)
    np.testing.assert_allclose(motion.velocity(middle)[:3], [0.1 * speed, 0.0, 0.0], atol=1e-9)
    quarter = motion.velocity(motion.approach + 0.25 * motion.ramp)[0]
    assert quarter == pytest.approx(0.1 * speed * minimum_jerk(0.25), rel=1e-6)
    np.testing.assert_allclose(motion.pose(motion.end).translation[0], 0.5, atol=1e-9)


def test_the_ramps_way_is_the_integral_of_the_minimum_jerk() -> None:
    for x in (0.0, 0.3, 0.8, 1.0):
        steps = np.linspace(0.0, x, 2001)
        values = [minimum_jerk(step) for step in steps]
        assert ramp_way(x) == pytest.approx(np.trapezoid(values, steps), abs=1e-6)


def test_noise_is_smoothed_away() -> None:
    """White noise of 1 mm at 500 Hz leaves less than a third of it on the path."""
    random = np.random.default_rng(1)
    time = np.linspace(0.0, 4.0, 2001)
    clean = smooth_poses(random, time)
    noisy = clean.copy()
    noisy[:, :3] += 1e-3 * random.normal(size=(2001, 3))
    path, motion = fit_course(time, noisy, 0.1), PathMotion(fit_course(time, clean, 0.1), 1.0, 0.5)
    clocks = np.linspace(0.5, motion.end, 300)
    off = [
        PathMotion(path, 1.0, 0.5).pose(clock).translation - motion.pose(clock).translation
        for clock in clocks
    ]
    assert np.sqrt(np.mean(np.square(off))) < 0.33e-3
    assert path.deviation > 2e-3


def assembled(path: Path, **options: object) -> Assembly:
    return assemble(
        str(path),
        **{"effects": None, "rate": None, "scale": 1.0, "arm": None, **options},  # type: ignore[arg-type]
    )


def beside(folder: Path, *changes: tuple[str, str]) -> Path:
    """The shipped task and its recording in a folder of their own, changed."""
    text = TASK.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    shutil.copy(RECORDING, folder / RECORDING.name)
    task = folder / TASK.name
    task.write_text(text, encoding="utf-8")
    return task


def rewrite(
    folder: Path, keep: tuple[str, ...] = ("time", "position", "pose"), **metadata: object
) -> pa.Table:
    """Rewrites the recording with some kinds of columns, and other metadata."""
    file = folder / RECORDING.name
    table = pq.read_table(file)
    said = json.loads(table.schema.metadata[b"impedance_modules"]) | metadata
    table = table.select([name for name in table.column_names if name.startswith(keep)])
    pq.write_table(table.replace_schema_metadata({b"impedance_modules": json.dumps(said)}), file)
    return table


def test_poses_by_kinematics_are_those_that_were_recorded(tmp_path: Path) -> None:
    """The hand's recorded poses come from the measured joints, so both paths are one."""
    recorded = assembled(TASK).task.phases[1].paths["right.hand"].course
    task = beside(tmp_path)
    rewrite(tmp_path, keep=("time", "position"))
    computed = assembled(task).task.phases[1].paths["right.hand"].course
    np.testing.assert_allclose(computed.control[:, :3], recorded.control[:, :3], atol=1e-9)
    apart = np.abs(np.sum(computed.control[:, 3:] * recorded.control[:, 3:], axis=1))
    np.testing.assert_allclose(apart, np.sum(recorded.control[:, 3:] ** 2, axis=1), atol=1e-9)


@pytest.mark.long
def test_a_runs_folder_is_a_recording_and_its_targets_a_path(tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert invoke("run", "reach-out", "--out", run, "--duration", 1.5).return_value in (0, 130)
    text = "path: {episode: run, of: target, to: 1.2}"
    task = beside(
        tmp_path, ("path: {episode: figure-of-eight.parquet, to: 8, speed: 0.8, approach: 1.5}", text)
    )
    motion = assembled(task).task.phases[1].paths["right.hand"].course
    recorded = pq.read_table(run / "episode.parquet")
    x = recorded.column("target.right_hand.x").to_numpy()
    assert PathMotion(motion, 1.0, 0.5).pose(0.5).translation[0] == pytest.approx(x[0], abs=1e-5)


PATH_KEYS = "episode: figure-of-eight.parquet, to: 8, speed: 0.8, approach: 1.5"


@pytest.mark.parametrize(
    ("stated", "key", "said"),
    [
        ("episode: nowhere.parquet", "episode", "nowhere.parquet: no such file"),
        ("episode: .", "episode", "no episode here"),
        ("episode: figure-of-eight.parquet, frame: right_hnd", "frame", "did you mean 'right_hand'"),
        (
            "episode: figure-of-eight.parquet, of: target",
            "frame",
            "no equilibrium of 'right_hand' was recorded",
        ),
        ("episode: figure-of-eight.parquet, to: 99", "to", "99 s is not within the recording"),
        (
            "episode: figure-of-eight.parquet, to: 8, speed: 0.5",
            "speed",
            "the phase lasts 12.5 s (valid: duration: 17",
        ),
        ("episode: figure-of-eight.parquet, smoothing: 0.02", "smoothing", "smoothing: 0.04 or more"),
        ("episode: figure-of-eight.parquet, to: 8", "approach", "the path begins"),
        ("episode: figure-of-eight.parquet, to: 8, speed: 20, approach: 2", "speed", "whose limit is"),
    ],
)
def test_check_refuses_with_the_line(tmp_path: Path, stated: str, key: str, said: str) -> None:
    task = beside(tmp_path, (PATH_KEYS, stated))
    found = refusal("check", task)
    line = (
        task.read_text().splitlines().index(next(t for t in task.read_text().splitlines() if "path:" in t))
        + 1
    )
    assert f"{task}:{line}:" in found and f"phases[1].equilibrium.right.hand.path.{key}: " in found
    assert said in found, found


def test_a_way_onto_the_path_that_is_too_fast_is_refused(tmp_path: Path) -> None:
    away, hasty = ("{y: -0.3, z: 0.14}", "{y: -0.5, z: 0.14}"), (PATH_KEYS, PATH_KEYS.replace("1.5", "0.1"))
    found = refusal("check", beside(tmp_path, away, hasty))
    assert (
        "path.approach: phase 'retrace'" in found and "on the way onto the path (valid: approach: " in found
    )


def test_every_key_of_a_path_is_used() -> None:
    path = CHECKOUT / "tests" / "data" / "every-path-key.yaml"
    spec = assembled(path).task.phases[0].paths["right.hand"]
    assert (spec.frame, spec.of, spec.first, spec.last) == ("right_hand", "pose", 1.5, 4.0)
    assert (spec.speed, spec.approach, spec.smoothing) == (1.2, 1.0, 0.2)
    assert spec.course.length == pytest.approx(2.5, abs=0.03) and 0.18 < spec.course.spacing <= 0.2
    assert "valid" in invoke("check", path).output


def test_what_check_names_as_valid_is_valid(tmp_path: Path) -> None:
    """Where the path is too fast, the speed that the message names is not."""
    full = ("initial: 1, max: 2", "initial: 30, max: 60")
    fast = refusal("check", beside(tmp_path, full, (PATH_KEYS, PATH_KEYS.replace("0.8", "20"))))
    speed = fast.partition("(valid: speed: ")[2].partition(" ")[0]
    assert 0.8 < float(speed) < 20.0
    slower = beside(tmp_path, full, (PATH_KEYS, PATH_KEYS.replace("0.8", speed)))
    assert refuse_infeasible(assembled(slower)).motion.phases[1].clock == 12.5


def test_a_path_out_of_reach_is_refused(tmp_path: Path) -> None:
    task = beside(tmp_path)
    table = rewrite(tmp_path)
    far = table.column("pose.right_hand.x").to_numpy() + 1.5
    table = table.set_column(
        table.column_names.index("pose.right_hand.x"), "pose.right_hand.x", pa.array(far)
    )
    pq.write_table(
        table.replace_schema_metadata(pq.read_schema(tmp_path / RECORDING.name).metadata),
        tmp_path / RECORDING.name,
    )
    assert "phases[1].equilibrium.right.hand: phase 'retrace': 'right_hand' comes no nearer" in refusal(
        "check", task
    )


def test_joints_of_another_robot_give_no_poses_and_jumps_are_no_path(tmp_path: Path) -> None:
    task = beside(tmp_path)
    table = rewrite(tmp_path, keep=("time", "position"), robot="panda")
    assert "its joints are those of the robot 'panda', not of 'baxter'" in refusal("check", task)
    task = beside(tmp_path)
    table = pq.read_table(tmp_path / RECORDING.name)
    jumps = table.column("pose.right_hand.y").to_numpy().copy()
    jumps[200:] += 0.05
    column = table.column_names.index("pose.right_hand.y")
    pq.write_table(table.set_column(column, "pose.right_hand.y", pa.array(jumps)), tmp_path / RECORDING.name)
    assert "the recorded place jumps" in refusal("check", task)


@pytest.mark.long
def test_a_run_verifies_where_the_recording_is_gone(tmp_path: Path) -> None:
    """The path is kept inside the run, bit by bit."""
    out = tmp_path / "run"
    task = beside(tmp_path, ("duration: 2}", "duration: 0.3}"), ("{y: -0.3, z: 0.14}", "{z: 0.105}"))
    invoke("run", task, "--out", out, "--duration", 2.5)
    (tmp_path / RECORDING.name).unlink()
    assert "no such file" in refusal("check", task)
    assert "bit-equal" in invoke("replay", out, "--verify").output


def test_metadata_keep_a_path_exactly() -> None:
    task = assembled(TASK).task
    kept = json.loads(json.dumps(paths_as_metadata(task)))
    course = paths_of_metadata(kept, "run")["retrace", "right.hand"]
    original = task.phases[1].paths["right.hand"].course
    np.testing.assert_array_equal(course.control, original.control)
    assert (course.spacing, course.length) == (original.spacing, original.length)
    for wrong in (
        {"control": [[1.0]]},
        {"control": "x"},
        {"spacing": 0.0},
        {"control": [[float("nan")] * 7] * 9},
    ):
        with pytest.raises(BadInput, match="run: metadata 'paths'"):
            paths_of_metadata({"paths": [kept["paths"][0] | wrong]}, "run")
    assert paths_as_metadata(assembled(CHECKOUT / "tasks" / "soft-hold.yaml").task) == {}


def test_a_task_that_is_written_elsewhere_names_its_recording_by_the_whole_path(tmp_path: Path) -> None:
    document = task_document(TASK)
    for text in (changed(document, {}), beside_another(document.text, document.path)):
        (tmp_path / "elsewhere.yaml").write_text(text, encoding="utf-8")
        course = assembled(tmp_path / "elsewhere.yaml").task.phases[1].paths["right.hand"].course
        assert course.length == pytest.approx(8.0, abs=0.03)
