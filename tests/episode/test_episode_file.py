# SPDX-License-Identifier: BSD-3-Clause
"""An episode says what was recorded, no more and no less, and a bad file is refused with a reason."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from impedance_modules.episode.columns import (
    JOINT_KINDS,
    joint_columns,
    parse_columns,
    pose_columns,
    target_columns,
    wrench_columns,
)
from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.metadata import METADATA_KEY
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_folder import part_path, part_paths, write_summary
from impedance_modules.episode.writer import EpisodeWriter
from impedance_modules.errors import BadInput, SafetyStop, printable
from tests.support.log_metadata import log_metadata

JOINTS = ("shoulder", "elbow.flex")
FRAME = "left.hand"


TWO = ["time", "position.a"]
THREE = [*TWO, "phase"]


NAMING = st.characters(codec="utf-8").filter(lambda sign: printable(sign) == sign)


def metadata(**more):
    return log_metadata(**{"task": "format: 1\nname: press\n", **more})


def new_writer(directory, names=TWO, wait_for_disk=True, **more):
    return EpisodeWriter(directory, names, metadata(**more), wait_for_disk=wait_for_disk)


def module_columns(module, joints):
    """Names of columns that no other kind claims."""
    return tuple(f"module.{module}.{joint}" for joint in joints)


def column_names():
    joints = [name for kind in JOINT_KINDS for name in joint_columns(kind, JOINTS)]
    frames = [*wrench_columns(FRAME), *pose_columns(FRAME), *target_columns("object")]
    return ["time", *joints, *frames, "phase", *module_columns("left", JOINTS), "tank"]


def random_rows(seed, count, width):
    rows = np.random.default_rng(seed).normal(size=(count, width))
    rows[:, 0] = np.arange(count) * 1e-3
    return rows


def record(directory, rows, phases, names=None, **final):
    with new_writer(directory, names or column_names()) as writer:
        for row, phase in zip(rows, phases, strict=True):
            writer.append(row, phase)
        return writer.close(**final)


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 2500))
def test_every_number_comes_back_bit_equal(tmp_path_factory, seed, count):
    directory = tmp_path_factory.mktemp("run")
    names = column_names()
    floats = [name for name in names if name != "phase"]
    rows = random_rows(seed, count, len(floats))
    gaps = np.random.default_rng(seed + 1).random(count) < 0.3
    rows[gaps, floats.index("tank")] = np.nan
    phases = [["lower", None, "slide"][min(2, 3 * index // count)] for index in range(count)]
    record(directory, rows, phases, ended_by="duration")
    episode = read_episode(directory)

    expected = dict(zip(floats, rows.T, strict=True))
    assert np.array_equal(episode.time, expected["time"])
    for kind in JOINT_KINDS:
        assert tuple(getattr(episode, kind)) == JOINTS
        for joint in JOINTS:
            assert np.array_equal(getattr(episode, kind)[joint], expected[f"{kind}.{joint}"])
    for kind, frame, build in (
        ("wrench", FRAME, wrench_columns),
        ("pose", FRAME, pose_columns),
        ("target", "object", target_columns),
    ):
        stacked = np.column_stack([expected[name] for name in build(frame)])
        assert np.array_equal(getattr(episode, kind)[frame], stacked)
    assert np.array_equal(episode.tank, expected["tank"], equal_nan=True)
    assert list(episode.phase) == phases
    assert set(episode.extra) == set(module_columns("left", JOINTS))
    assert episode.metadata == {**metadata(), "ended_by": "duration", "complete": True}
    assert np.array_equal(episode.matrix("effort", JOINTS[::-1])[:, 0], expected[f"effort.{JOINTS[1]}"])
    with pytest.raises(ValueError, match="read-only"):
        episode.position[JOINTS[0]][0] = 1.0


def test_stock_reader_sees_the_contract(tmp_path):
    names = column_names()
    rows = random_rows(3, 50, len(names) - 1)
    rows[7, -1] = np.nan
    path = record(tmp_path, rows, ["lower"] * 20 + [None] + ["slide"] * 29)
    assert [file.name for file in tmp_path.iterdir()] == ["episode.parquet"]
    table = pq.read_table(path)
    assert table.column_names == names
    assert all(pa.types.is_float64(table.schema.field(name).type) for name in names if name != "phase")
    assert table["phase"].to_pylist() == ["lower"] * 20 + [None] + ["slide"] * 29
    assert [index for index, level in enumerate(table["tank"].to_pylist()) if level is None] == [7]
    stored = json.loads(table.schema.metadata[METADATA_KEY.encode()])
    assert stored["format"] == 1
    assert stored["task"].startswith("format: 1\n")


def test_a_long_run_is_one_file_in_order(tmp_path):
    rows = random_rows(4, 30_000, 2)
    path = record(tmp_path, rows, ["x"] * 30_000, names=THREE)
    assert part_paths(tmp_path) == ()
    assert pq.ParquetFile(path).num_row_groups > 1
    assert np.array_equal(read_episode(path).position["a"], rows[:, 1])


@settings(max_examples=200, deadline=None)
@given(
    joints=st.lists(st.text(NAMING, min_size=1), min_size=1, max_size=4, unique=True),
    frames=st.lists(st.text(NAMING, min_size=1), max_size=3, unique=True),
)
def test_names_that_were_built_are_parsed_back(joints, frames):
    names = ["time", *joint_columns("position", joints), *joint_columns("effort", joints)]
    for frame in frames:
        names += [*wrench_columns(frame), *pose_columns(frame), *target_columns(frame)]
    names += module_columns("spring", joints)
    layout = parse_columns(names, "here")
    assert tuple(layout.joints["position"]) == tuple(layout.joints["effort"]) == tuple(joints)
    assert not layout.joints["velocity"]
    for kind, build in (("wrench", wrench_columns), ("pose", pose_columns), ("target", target_columns)):
        found = {frame: tuple(columns) for frame, columns in layout.frames[kind].items()}
        assert found == {frame: build(frame) for frame in frames}
    assert layout.extra == module_columns("spring", joints)


def test_absent_stays_absent(tmp_path):
    columns = {"time": np.arange(3.0), "position.a": np.zeros(3), "wrench.tip.fz": np.ones(3)}
    path = write_episode(tmp_path / "log.parquet", columns, metadata(effort_source=None, task=None))
    episode = read_episode(path)
    assert episode.velocity == episode.effort == episode.effort_command == episode.pose == {}
    assert episode.phase is episode.tank is episode.metadata["task"] is None
    assert episode.phase_intervals() == ()
    assert np.isnan(episode.wrench["tip"][:, :2]).all()
    assert (episode.wrench["tip"][:, 2] == 1).all()
    with pytest.raises(BadInput, match=r"no column 'effort\.a'.*recorded: none"):
        episode.matrix("effort", ["a"])


def test_only_what_is_asked_for_is_read(tmp_path):
    path = record(tmp_path, random_rows(5, 20, len(column_names()) - 1), ["x"] * 20)
    episode = read_episode(path, kinds={"position", "effort"})
    assert tuple(episode.position) == tuple(episode.effort) == JOINTS
    assert not episode.velocity and not episode.extra and episode.tank is None
    with pytest.raises(BadInput, match="'torque' is no kind"):
        read_episode(path, kinds={"torque"})


def test_phase_intervals_cover_the_phases(tmp_path):
    phases = ["a"] * 3 + [None] * 2 + ["b"] + ["a"] * 4
    path = record(tmp_path, random_rows(6, 10, 2), phases, names=THREE)
    assert read_episode(path).phase_intervals() == (("a", 0, 3), ("b", 5, 6), ("a", 6, 10))


def raw_table(**changes):
    columns = {"time": np.arange(4.0), "position.a": np.zeros(4), "effort.a": np.zeros(4), **changes}
    return pa.table({name: values for name, values in columns.items() if values is not None})


def with_metadata(table, **changes):
    stored = {key: value for key, value in {**metadata(), **changes}.items() if value != "remove"}
    return table.replace_schema_metadata({METADATA_KEY: json.dumps(stored)})


def with_columns(**changes):
    return with_metadata(raw_table(**changes))


BAD_TABLES = {
    "no time": (with_columns(time=None), "no column 'time'"),
    "no position": (with_columns(**{"position.a": None}), r"no column 'position\.<joint>'"),
    "time as text": (with_columns(time=["0", "1", "2", "3"]), "column 'time' holds string"),
    "NaN": (with_columns(**{"effort.a": [0, 1, np.nan, 3]}), r"'effort\.a' is missing or NaN in row 2"),
    "null": (with_columns(**{"position.a": [0.0, None, 2, 3]}), "missing or NaN in row 1"),
    "infinite": (with_columns(tank=[0, 1, 2, np.inf]), "'tank' is inf in row 3"),
    "no rows": (with_columns().slice(0, 0), "no samples"),
    "list column": (with_columns(odd=[[1.0]] * 4), "column 'odd' holds list"),
    "no metadata": (raw_table(), "no schema metadata"),
    "not JSON": (raw_table().replace_schema_metadata({METADATA_KEY: "{"}), "is not JSON"),
    "not an object": (raw_table().replace_schema_metadata({METADATA_KEY: "[1]"}), "is a list"),
    "format": (with_metadata(raw_table(), format=2), "'format' is 2 "),
    "robot": (with_metadata(raw_table(), robot="remove"), "'robot' is None"),
    "source": (with_metadata(raw_table(), effort_source="joint_sensors"), "did you mean 'joint_sensor'"),
    "no source": (with_metadata(raw_table(), effort_source=None), "'effort_source' is None"),
    "gravity": (with_metadata(raw_table(), gravity_compensation="remove"), "valid: robot, command, none"),
    "repeat": (with_metadata(raw_table(), repeat_of=3), "'repeat_of' is 3"),
}


@pytest.mark.parametrize("case", BAD_TABLES, ids=str)
def test_bad_tables_are_refused_with_the_reason(tmp_path, case):
    table, reason = BAD_TABLES[case]
    path = tmp_path / "log.parquet"
    pq.write_table(table, path)
    with pytest.raises(BadInput, match=reason) as error:
        read_episode(path)
    assert str(path) in str(error.value)


def test_bad_files_are_refused_with_the_reason(tmp_path):
    whole = record(tmp_path / "run", random_rows(7, 5000, len(column_names()) - 1), ["x"] * 5000)
    content = whole.read_bytes()
    bad = {
        "missing.parquet": (None, "no such file"),
        "empty.parquet": (b"", "the file is empty"),
        "text.parquet": (b"time,position\n0,1\n", "does not begin as a Parquet file does"),
        "truncated.parquet": (content[: len(content) // 2], "not a whole Parquet file"),
        "damaged.parquet": (content[:4] + bytes(4000) + content[4004:], "is damaged|not a whole"),
    }
    for name, (given_bytes, reason) in bad.items():
        path = tmp_path / name
        if given_bytes is not None:
            path.write_bytes(given_bytes)
        with pytest.raises(BadInput, match=reason):
            read_episode(path)
    with pytest.raises(BadInput, match="no episode here"):
        read_episode(tmp_path)


def test_a_recording_is_never_overwritten_unless_it_is_empty(tmp_path):
    pq.write_table(with_columns().slice(0, 0), tmp_path / "episode.parquet")
    path = record(tmp_path, random_rows(8, 10, 2), ["x"] * 10, names=THREE)
    assert len(read_episode(tmp_path)) == 10
    before = path.read_bytes()
    with pytest.raises(BadInput, match="already holds 10 recorded rows"):
        new_writer(tmp_path)
    assert path.read_bytes() == before


def test_two_runs_cannot_share_a_directory(tmp_path):
    with new_writer(tmp_path) as writer:
        writer.append(np.zeros(2))
        with pytest.raises(BadInput, match="another run is writing"):
            new_writer(tmp_path)


def test_a_row_that_does_not_fit_is_refused(tmp_path):
    with new_writer(tmp_path) as writer:
        with pytest.raises(BadInput, match=r"row of shape \(1,\)"):
            writer.append(np.zeros(1))
        with pytest.raises(BadInput, match="without a 'phase' column"):
            writer.append(np.zeros(2), "slide")
        writer.append(np.zeros(2))


def test_an_abandoned_run_gives_its_directory_back(tmp_path):
    new_writer(tmp_path).abandon()
    assert list(tmp_path.iterdir()) == []
    writer = new_writer(tmp_path)
    writer.append(np.ones(2))
    writer.abandon()
    writer.abandon()
    assert len(read_episode(tmp_path)) == 1


def test_an_exception_in_a_run_keeps_what_was_recorded(tmp_path):
    with pytest.raises(ZeroDivisionError), new_writer(tmp_path) as writer:
        writer.append(np.ones(2))
        raise ZeroDivisionError
    episode = read_episode(tmp_path)
    assert len(episode) == 1
    assert episode.metadata["ended_by"] == "ZeroDivisionError"


@pytest.mark.parametrize("wait_for_disk", [True, False])
def test_a_disk_that_refuses_stops_the_run(tmp_path, wait_for_disk):
    writer = new_writer(tmp_path, wait_for_disk=wait_for_disk)
    part_path(tmp_path, 0).mkdir()  # no file can take this name
    with pytest.raises(SafetyStop, match="cannot be written"):
        for index in range(200_000):
            writer.append(np.array([index * 1e-3, 0.0]))
            if not wait_for_disk:
                writer.background.wake()
    with pytest.raises(SafetyStop, match="cannot be written"):
        writer.close()


@pytest.mark.parametrize(
    ("names", "more", "reason"),
    [
        (["position.a", "time"], {}, "'time' first"),
        ([*TWO, "time"], {}, "occurs more than once"),
        (TWO, {"rate": np.nan}, "not JSON"),
        (TWO, {"effort_source": "x"}, "effort_source"),
    ],
)
def test_wrong_columns_or_metadata_are_refused_before_anything_moves(tmp_path, names, more, reason):
    with pytest.raises(BadInput, match=reason):
        new_writer(tmp_path / "a", names, **more)
    assert not (tmp_path / "a").exists()


def test_summary_is_whole_and_plain(tmp_path):
    given = {"tau": np.eye(2), "worst": np.float64(np.inf), "n": 3, "deep": {"a": (1, None)}}
    path = write_summary(tmp_path, given)
    plain = {"tau": [[1, 0], [0, 1]], "worst": None, "n": 3, "deep": {"a": [1, None]}}
    assert json.loads(path.read_text()) == plain
    with pytest.raises(TypeError):
        write_summary(tmp_path, {"odd": object()})
    assert json.loads(path.read_text())["n"] == 3


def test_a_long_recording_can_be_read_decimated(tmp_path):
    rows = {"time": np.arange(1001) / 1000.0, "position.j": np.arange(1001.0), "phase": ["a"] * 1001}
    write_episode(tmp_path / "e.parquet", rows, metadata(effort_source=None))
    thin = read_episode(tmp_path / "e.parquet", most_samples=100)
    np.testing.assert_array_equal(thin.position["j"], np.arange(0.0, 1001.0, 11.0))
    assert len(thin) == len(thin.phase) == 91
