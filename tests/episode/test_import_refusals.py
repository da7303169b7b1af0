# SPDX-License-Identifier: BSD-3-Clause
"""What the import refuses: each time with the place, the reason and what would be valid, and nothing written."""

import subprocess
import sys

import numpy as np
import pytest

from impedance_modules.episode.imports.pipeline import import_sources
from impedance_modules.errors import BadFile, BadInput
from tests.support.import_logs import (
    COMMA,
    POSITION,
    TIME,
    VELOCITY,
    base_map,
    imported,
    map_of,
    motion,
    position_map,
    table_log,
    write_map,
    write_table,
)


def refused(folder, source, data=None, rate=None):
    """The refusal of one source; nothing is left behind, whatever was done before."""
    before = {path.name for path in folder.iterdir()} | {"map.yaml"}
    with pytest.raises(BadInput) as caught:
        imported(folder, [source], base_map() if data is None else data, rate)
    assert {path.name for path in folder.iterdir()} <= before
    return str(caught.value)


@pytest.fixture
def log(tmp_path):
    return table_log(tmp_path / "log.csv")


def change_line(path, number, change):
    """Changes one line, counted from 1."""
    lines = path.read_text().split("\n")
    lines[number - 1] = change(lines[number - 1])
    path.write_text("\n".join(lines))


def with_table(**more):
    data = base_map()
    data["tables"][0] |= more
    return data


# --- files -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b"t,q1,q2,v1,v2\n", "a header and no rows"),
        (b"t,q1,q2,v1,v2\n0,1,2,3,4\n", "a single sample"),
        (b"\x80\x81\x00\xff" * 100, "no text file"),
        (b"\0" * 100, "binary data"),
    ],
)
def test_files_without_a_table(tmp_path, content, words):
    (tmp_path / "log.csv").write_bytes(content)
    assert words in refused(tmp_path, tmp_path / "log.csv")


def test_missing_and_foreign_files(tmp_path, log):
    assert "no such file (beside it: log.csv)" in refused(tmp_path, tmp_path / "lag.csv")
    (tmp_path / "folder").mkdir()
    assert "a folder without any file that the map describes" in refused(tmp_path, tmp_path / "folder")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda line: line[: len(line) // 2], "log.csv:200: 3 values in a table of 5 columns"),
        (lambda line: line.replace(",", ";"), "log.csv:200: 1 values in a table of 5 columns"),
        (lambda line: "nan," + line.split(",", 1)[1], "log.csv:200: column 't' is nan"),
        (lambda line: line.rsplit(",", 1)[0] + ",inf", "log.csv:200: column 'v2' is inf"),
        (lambda line: line.rsplit(",", 1)[0] + ",", "log.csv:200: column 'v2' is empty"),
        (lambda line: line.rsplit(",", 1)[0] + ",fast", "log.csv:200: column 'v2' is 'fast', not a number"),
        (lambda line: "t,q1,q2,v1,v2", "a second header?"),
    ],
)
def test_bad_rows_are_named_by_their_line(tmp_path, log, change, words):
    change_line(log, 200, change)
    assert words in refused(tmp_path, log)


def test_decimal_commas_are_recognised(tmp_path):
    time, q, v = motion()
    log = write_table(tmp_path / "log.csv", ["t", "q1", "q2", "v1", "v2"], time, q, v, separator=";")
    log.write_text(log.read_text().replace(".", ","))
    assert "(valid: a decimal point)" in refused(tmp_path, log, with_table(separator="semicolon"))


@pytest.mark.parametrize(
    ("time", "words"),
    [
        (np.r_[0:200, 150, 201:400] / 100, "log.csv:202: time runs backwards: 1.5 s after 1.99"),
        (np.r_[0:200, 199, 201:400] / 100, "log.csv:202: time repeats 1.99 s"),
        (np.r_[0:200, 200:600:2] / 100, "Hz from this line on, and "),
        (np.r_[0:300:2, 300:550] / 100, "about 50 Hz from this line on, and 100 Hz"),
    ],
)
def test_time_that_does_not_run_evenly_forwards(tmp_path, time, words):
    log = write_table(tmp_path / "log.csv", ["t", "q1", "q2"], time, motion()[1])
    assert words in refused(tmp_path, log, position_map())


def test_jitter_and_a_late_sample_are_no_other_rate(tmp_path):
    steps = 0.01 * np.random.default_rng(1).uniform(0.4, 1.6, 2000)
    steps[900:930] = 0.03
    time = np.cumsum(steps)
    log = write_table(tmp_path / "log.csv", ["t", "q1", "q2"], time, 0.3 * np.sin(time), 0.3 * np.cos(time))
    ((episode,), _) = imported(tmp_path, [log], position_map())
    assert len(episode) == 2000


# --- time base -------------------------------------------------------------------------------------------


TIMELESS = map_of({**COMMA, "position": POSITION, "velocity": VELOCITY})


def test_a_missing_time_base_is_asked_for_and_estimated(tmp_path, log):
    message = refused(tmp_path, log, TIMELESS)
    assert "'rate: HZ' in the map, or --rate HZ" in message
    assert "velocities agree with its positions at about 100 Hz" in message
    ((episode,), (done,)) = imported(tmp_path, [log], TIMELESS, rate=100.0)
    assert done.rate_stated and episode.metadata["imported"]["rate"] == 100.0


@pytest.mark.parametrize(
    ("data", "rate", "words"),
    [
        (TIMELESS, 50.0, "the stated rate is 50 Hz, and they would agree at 99.99 Hz"),
        (TIMELESS, 50.0, "--rate 100"),
        ({**TIMELESS, "rate": 100}, 200.0, "says 'rate: 100'"),
        (base_map(), 200.0, "--rate 200 has no effect"),
        (base_map(rate=100), None, "every table has its own time"),
        (TIMELESS, float("nan"), "no sampling rate"),
    ],
)
def test_rates_that_are_wrong_or_contradict_each_other(tmp_path, log, data, rate, words):
    assert words in refused(tmp_path, log, data, rate)


# --- numbers that cannot be meant ------------------------------------------------------------------------

DEGREES = 180.0 / np.pi


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda q, v: (DEGREES * (q - q.min()) + 0.1, v),
            "these look like deg, so say 'unit: deg' for position",
        ),
        (
            lambda q, v: (DEGREES * q / 2, v / 2),
            "the position looks like deg (valid: 'unit: deg' for position)",
        ),
        (lambda q, v: (q, DEGREES * v), "it looks like deg/s (valid: 'unit: deg/s' for velocity)"),
        (lambda q, v: (q, v * [1, -1]), "times the rate of change of position.b: a sign differs"),
        (lambda q, v: (q, v * [1, 5]), "a unit, a gear ratio"),
        (lambda q, v: (q, 0 * v), "velocity is 0 in every sample of every joint"),
    ],
)
def test_units_signs_and_gears_that_were_forgotten(tmp_path, change, words):
    q, v = change(*motion()[1:])
    assert words in refused(tmp_path, table_log(tmp_path / "log.csv", q=q, v=v))


def test_positions_beyond_the_robots_limits(tmp_path):
    time, q, _ = motion(joints=7)
    header = ["t", *(f"q{i}" for i in range(1, 8))]
    log = write_table(tmp_path / "log.csv", header, time, q + 3.0)
    joints = [f"left_{short}" for short in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
    data = position_map(robot="baxter", joints=joints)
    message = refused(tmp_path, log, data)
    assert "position.left_s0 is 2.6 rad, and its range is -1.7017 to 1.7017" in message
    assert "deg" not in message and "'beyond_limits: [left_s0]'" in message
    ((episode,), _) = imported(tmp_path, [log], {**data, "beyond_limits": data["joints"]})
    assert episode.robot == "baxter"
    write_table(tmp_path / "deg.csv", header, time, q * DEGREES)
    message = refused(tmp_path, tmp_path / "deg.csv", data)
    assert "these look like deg" in message


def test_a_command_logged_twice(tmp_path, log):
    data = with_table(position_command={"columns": {"b": "q2"}, "unit": "rad"})
    assert "position.b equals position_command.b in every sample" in refused(tmp_path, log, data)


def test_an_effort_that_was_not_measured(tmp_path):
    time, q, v = motion()
    log = write_table(tmp_path / "log.csv", ["t", "q1", "q2", "v1", "v2", "e1", "e2"], time, q, v, 0 * q)
    data = with_table(effort={"columns": "e{index}", "unit": "N.m"}) | {"effort_source": "motor"}
    assert "leave 'effort' out of the map" in refused(tmp_path, log, data)


# --- maps ------------------------------------------------------------------------------------------------


def without(*path):
    data = base_map()
    inner = data
    for step in path[:-1]:
        inner = inner[step]
    del inner[path[-1]]
    return data


EFFORT = {"columns": "q{index}", "unit": "A"}
MOTOR = {"ratio": [1, 2]}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (without("gravity_compensation"), "missing key 'gravity_compensation'"),
        (without("tables", 0, "position"), "no table has 'position'"),
        (without("tables", 0, "separator"), "'header' goes with 'separator'"),
        (without("tables", 0, "header"), "missing key 'header'"),
        (base_map(joints=["a", "a"]), "a: listed more than once"),
        (base_map(colour="red"), "unknown key 'colour'"),
        (with_table(position={"columns": "q", "unit": "rad"}), "2 joints would share the column 'q'"),
        (with_table(position={"columns": ["q1"], "unit": "rad"}), "1 columns for 2 joints"),
        (with_table(position={"columns": {"c": "q1"}, "unit": "rad"}), "'c' is not among 'joints'"),
        (with_table(position={**POSITION, "unit": "degree"}), "'degree' is no unit here"),
        (with_table(position={**POSITION, "unit": "m"}), "'m' is no unit here: a turns"),
        (with_table(position={**POSITION, "unit": "counts"}), "missing key 'counts_per_rev'"),
        (with_table(position={**POSITION, "counts_per_rev": 3}), "'counts_per_rev' has no effect"),
        (with_table(position={**POSITION, "side": "motor"}), "'side' has no effect without a 'transmission'"),
        (with_table(position={**POSITION, "offset": {"c": 1}}), "'c' is not among its joints"),
        (with_table(effort=EFFORT), "missing key 'gain'"),
        (with_table(effort={**EFFORT, "gain": 1}), "missing key 'effort_source'"),
        (base_map(effort_source="motor"), "no table has 'effort'"),
        (with_table(time={"column": "t"}), "'column' and 'unit' go together"),
        (with_table(time={"clock": "header"}), "log.csv has 'column' and its 'unit'"),
        (with_table(extra={"tank": {"column": "q1"}}), "'tank' has a meaning of its own"),
        (with_table(extra={"more": {}}), "expected at least 1 key"),
        (base_map(transmission=MOTOR), "nothing was measured at the motors"),
        (base_map(transmission={"ratio": [1]}), "there are 2 joints"),
        (base_map(transmission={"matrix": [[1, 1], [1, 1]]}), "R cannot be inverted"),
        (base_map(transmission={**MOTOR, "coupling": {"a": {"a": 1}}}), "that is the ratio"),
        (base_map(transmission={**MOTOR, "matrix": [[1, 0], [0, 1]]}), "either 'ratio' or 'matrix'"),
        (base_map(robot="baxter"), "has no moving joint 'a'"),
        (base_map(prismatic=["c"]), "'c' is not among 'joints'"),
        (with_table(position={"columns": ["q1", "q7"], "unit": "rad"}), "no column 'q7'; did you mean 'q"),
        (with_table(position={"columns": [2, 9], "unit": "rad"}), "no column number 9 (it has 5 columns)"),
        (base_map(effort_source="motor", tables=[{**base_map()["tables"][0], "effort": {**EFFORT, "gain": "k"}}]),
         "no variable 'k' with a single number"),
        (base_map(decimate={"keep_every": 4, "low_pass": 12}), "at most 11.25 Hz fit"),
        (base_map(decimate={"keep_every": 100, "low_pass": 0.4}), "the filter needs"),
    ],
)  # fmt: skip
def test_maps_that_contradict_themselves(tmp_path, log, data, words):
    message = refused(tmp_path, log, data)
    assert words in message and "map.yaml" in message


def test_a_problem_of_a_map_has_its_line(tmp_path, log):
    map_path = write_map(tmp_path / "map.yaml", with_table(velocity={**VELOCITY, "unit": "rads"}))
    with pytest.raises(BadFile) as caught:
        import_sources([log], map_path, None, tmp_path / "out")
    (problem,) = caught.value.problems
    line = map_path.read_text().split("\n")[problem.line - 1]
    assert "rads" in line[problem.column - 1 :] and problem.path == "tables[0].velocity.unit"


def test_uneven_samples_are_not_decimated(tmp_path):
    time = motion()[0].copy()
    time[250:] += 0.05
    log = table_log(tmp_path / "log.csv", time=time)
    decimated = base_map(decimate={"keep_every": 2, "low_pass": 15})
    assert "the samples are not even" in refused(tmp_path, log, decimated)


def test_no_map_where_one_is_needed(tmp_path, log):
    with pytest.raises(BadInput, match="whose columns no map describes") as caught:
        import_sources([log], None, None, tmp_path / "out")
    assert "docs/import.md" in str(caught.value) and "'t,q1,q2,v1,v2'" in str(caught.value)
    np.savez(tmp_path / "log.npz", q=np.zeros(3))
    with pytest.raises(BadInput, match="--map FILE"):
        import_sources([tmp_path / "log.npz"], None, None, tmp_path / "out")


# --- several files ---------------------------------------------------------------------------------------


def two_tables(*, time=(), **more):
    """A table of positions and one of efforts, each in a file of its own."""
    first = {"file": "{episode}-q.csv", **COMMA, **dict(time), "position": POSITION}
    second = {"file": "{episode}-e.csv", **COMMA, **dict(time), "effort": {**POSITION, "unit": "N.m"}}
    return map_of(first, second, effort_source="motor", **more)


def test_files_that_do_not_go_together(tmp_path):
    _, q, _ = motion()
    for name, rows in (("x-q", 400), ("x-e", 400), ("y-q", 400), ("y-e", 399), ("z-q", 400)):
        write_table(tmp_path / f"{name}.csv", ["q1", "q2"], q[:rows])
    paths = [tmp_path / f"{name}.csv" for name in ("x-q", "x-e")]
    data = two_tables(rate=100)
    ((episode,), _) = imported(tmp_path, paths, data)
    assert episode.name == "x" and tuple(episode.effort) == ("a", "b")
    (tmp_path / "other").mkdir()
    for names, words in (
        (("y-q", "y-e"), "y-e.csv: ends after 399 rows"),
        (("z-q",), "lacks z-e.csv"),
        (("x-q", "x-q"), "given twice"),
    ):
        with pytest.raises(BadInput) as caught:
            imported(tmp_path / "other", [tmp_path / f"{name}.csv" for name in names], data)
        assert words in str(caught.value)
    table_log(tmp_path / "stranger.csv")
    with pytest.raises(BadInput, match=r"no table of .* describes it"):
        imported(tmp_path / "other", [tmp_path / "stranger.csv"], data)


def test_times_of_two_files_that_differ(tmp_path):
    time, q, _ = motion()
    write_table(tmp_path / "x-q.csv", ["t", "q1", "q2"], time, q)
    write_table(tmp_path / "x-e.csv", ["t", "q1", "q2"], 2 * time, q)
    assert "in the same row of" in refused(tmp_path, tmp_path, two_tables(time={"time": TIME}))


# --- nothing half-written --------------------------------------------------------------------------------


def test_with_one_bad_source_nothing_is_written(tmp_path):
    good, bad = table_log(tmp_path / "good.csv"), table_log(tmp_path / "bad.csv")
    change_line(bad, 390, lambda line: "nan" + line)
    with pytest.raises(BadInput):
        imported(tmp_path, [good, bad], base_map())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.csv", "good.csv", "map.yaml"]


def test_an_episode_is_never_overwritten(tmp_path, log):
    (_, (done,)) = imported(tmp_path, [log], base_map())
    before = done.path.read_bytes()
    with pytest.raises(BadInput, match="already there"):
        imported(tmp_path, [log], base_map())
    assert done.path.read_bytes() == before
    with pytest.raises(BadInput, match="is a file, and episodes go into a directory"):
        import_sources([log], tmp_path / "map.yaml", None, log)


def test_a_directory_that_cannot_be_made(tmp_path, log):
    with pytest.raises(BadInput, match=r"log.csv is a file"):
        import_sources([log], write_map(tmp_path / "map.yaml", base_map()), None, log / "out")


def test_the_verb_ends_with_two_and_one_sentence(tmp_path):
    words = ["import", "nowhere.csv", "--out", str(tmp_path / "out")]
    command = [sys.executable, "-m", "impedance_modules", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and not done.stdout and not (tmp_path / "out").exists()
    assert done.stderr.startswith("nowhere.csv: no such file") and done.stderr.count("\n") == 1
