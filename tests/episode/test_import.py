# SPDX-License-Identifier: BSD-3-Clause
"""Foreign logs become episodes: what was written comes back, in SI units, at the joints."""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
import yaml
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.cli.main import impedance
from impedance_modules.episode.imports import convert, table, text_table
from impedance_modules.episode.imports.map_reader import parse_map, read_map
from impedance_modules.episode.imports.pipeline import import_sources
from impedance_modules.episode.reader import read_episode
from tests.support.import_logs import (
    COMMA,
    POSITION,
    TIME,
    base_map,
    imported,
    map_of,
    motion,
    position_map,
    table_log,
    write_map,
    write_table,
)
from tests.support.paths import CHECKOUT, TESTS

MAPS = TESTS / "maps"
DATA = CHECKOUT.parent / "shared" / "data"
DOCUMENT = CHECKOUT / "docs" / "import.md"

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no ../shared/data beside the checkout")


def real_data(test):
    return pytest.mark.real_data(needs_data(test))


# --- the three real sets ---------------------------------------------------------------------------------


@real_data
def test_the_real_baxter_runs_at_the_stated_hundred_hertz(tmp_path):
    sources = sorted((DATA / "baxter-left-arm").glob("*.csv"))
    done = import_sources(sources, MAPS / "baxter-left-arm.yaml", None, tmp_path)
    assert len(done) == 12 and all(entry.rate_stated for entry in done)
    episode, raw = read_episode(done[0].path), np.loadtxt(sources[0], skiprows=1)
    np.testing.assert_array_equal(episode.matrix("position"), raw[:, :7])
    np.testing.assert_array_equal(episode.matrix("velocity"), raw[:, 7:14])
    np.testing.assert_array_equal(episode.matrix("effort"), raw[:, 14:])
    assert (episode.robot, episode.effort_source) == ("baxter", "joint_sensor")
    assert episode.joints[0] == "left_s0" and not episode.effort_command
    for entry in done:
        episode = read_episode(entry.path)
        moved = np.gradient(episode.matrix("position"), axis=0)
        speed = episode.matrix("velocity")
        both, said = (moved * speed).sum(axis=0), (speed * speed).sum(axis=0)
        step = both / said
        excited = both**2 > 0.97 * said * (moved * moved).sum(axis=0)  # noise hides the slower joints' motion
        assert excited.sum() >= 3
        assert np.all((step[excited] > 0.0098) & (step[excited] < 0.0102)), step


@real_data
def test_the_real_baxter_without_a_rate_is_refused_with_the_rate_it_seems_to_have(tmp_path):
    data = yaml.safe_load((MAPS / "baxter-left-arm.yaml").read_text())
    del data["rate"]
    with pytest.raises(Exception, match="no time base") as caught:
        imported(tmp_path, [DATA / "baxter-left-arm" / "Random_ang_vel_torq.csv"], data)
    seems = re.search(r"agree with its positions at about ([0-9.e+]+) Hz", str(caught.value))
    assert seems and abs(float(seems[1]) - 100.0) < 2.0


@real_data
@pytest.mark.parametrize(("name", "map_name"), [("DATA_EMPS", "emps"), ("DATA_EMPS_PULSES", "emps-pulses")])
def test_the_real_emps_carries_force_in_newtons(tmp_path, name, map_name):
    source = DATA / "emps" / f"{name}.mat"
    (done,) = import_sources([source], MAPS / f"{map_name}.yaml", None, tmp_path)
    episode, raw = read_episode(done.path), scipy.io.loadmat(source)
    np.testing.assert_array_equal(episode.position["carriage"], raw["qm"][:, 0])
    np.testing.assert_array_equal(episode.position_command["carriage"], raw["qg"][:, 0])
    force = raw["gtau"].item() * raw["vir"][:, 0]
    np.testing.assert_allclose(episode.effort["carriage"], force, rtol=1e-15)
    np.testing.assert_array_equal(episode.time, raw["t"][:, 0])
    assert episode.effort_source == "motor" and done.rate == pytest.approx(1000, rel=1e-3)
    if "pulses_N" in raw:
        np.testing.assert_array_equal(episode.extra["pulse_force"], raw["pulses_N"][:, 0])


@real_data
def test_the_real_tx40_is_carried_from_its_motors_to_its_joints(tmp_path):
    folder = DATA / "tx40"
    text = (MAPS / "tx40.yaml").read_text().replace("episode: tx40", f"urdf: {folder}/tx40_mdh_modified.urdf")
    map_path = tmp_path / "map.yaml"
    map_path.write_text(text)
    (done,) = import_sources([folder], map_path, None, tmp_path / "out")  # a folder: the files the map names
    episode = read_episode(done.path)
    motor = np.loadtxt(folder / "pos_read_data.csv", delimiter=",", skiprows=1)
    torque = np.loadtxt(folder / "curr_data.csv", delimiter=",", skiprows=1)
    ratio = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
    expected = motor / ratio
    expected[:, 5] = (motor[:, 5] - 32.0 * expected[:, 4]) / 32.0  # motor 6 has turned with joint 5 too
    expected += [0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(episode.matrix("position"), expected, atol=1e-12)
    at_joints = torque * ratio
    at_joints[:, 4] += 32.0 * torque[:, 5]
    np.testing.assert_allclose(episode.matrix("effort"), at_joints, rtol=1e-12, atol=1e-12)
    assert len(episode) == 45000 and done.rate == pytest.approx(5000) and not done.notes


# --- units, sides, layouts -------------------------------------------------------------------------------


@settings(max_examples=20, deadline=None)
@given(
    ratios=st.lists(st.floats(1.0, 200.0) | st.floats(-200.0, -1.0), min_size=3, max_size=3),
    coupling=st.floats(-50.0, 50.0),
    turn=st.sampled_from([("rad", 1.0, "rad/s", 1.0), ("deg", 180 / np.pi, "rpm", 30 / np.pi)]),
    sign=st.sampled_from([1, -1]),
    whole=st.booleans(),
)
def test_motors_and_joints_carry_the_same_power(tmp_path_factory, ratios, coupling, turn, sign, whole):
    folder = tmp_path_factory.mktemp("power")
    _, q, v = motion(joints=3)
    tau = np.cos(7.0 * q)
    matrix = np.diag(ratios)
    matrix[2, 1] = coupling
    torque = np.linalg.solve(matrix.T, tau.T).T  # tau = R^T tau_motor
    unit, per_rad, speed_unit, per_speed = turn
    at_motors = ((q - 0.25) @ matrix.T * per_rad, v @ matrix.T * per_speed, torque * 1e3)
    header = [f"{kind}{i}" for kind in "qvt" for i in (1, 2, 3)]
    columns = [values * [1, 1, sign] for values in at_motors]
    source = write_table(folder / "log.csv", header, *columns, form="%.17g")
    side = {"side": "motor", **({"sign": {"c": -1}} if sign < 0 else {})}
    transmission = {"ratio": ratios, "coupling": {"c": {"b": coupling}}}
    table = {
        "position": {"columns": "q{index}", "unit": unit, "offset": dict.fromkeys("abc", 0.25), **side},
        "velocity": {"columns": "v{index}", "unit": speed_unit, **side},
        "effort": {"columns": "t{index}", "unit": "mN.m", **side},
    }
    about = {"joints": ["a", "b", "c"], "rate": 100, "effort_source": "motor"}
    transmission = {"matrix": matrix.tolist()} if whole else transmission
    data = map_of({**COMMA, **table}, **about, transmission=transmission)
    ((episode,), _) = imported(folder, [source], data)
    np.testing.assert_allclose(episode.matrix("position"), q, atol=1e-9)
    np.testing.assert_allclose(episode.matrix("velocity"), v, atol=1e-9)
    np.testing.assert_allclose(episode.matrix("effort"), tau, atol=1e-9)
    power_at_motors = ((v @ matrix.T) * torque).sum(axis=1)
    power_at_joints = (episode.matrix("velocity") * episode.matrix("effort")).sum(axis=1)
    np.testing.assert_allclose(power_at_joints, power_at_motors, atol=1e-8)


SEPARATORS = [(",", "comma"), (";", "semicolon"), ("\t", "tab"), ("  ", "whitespace")]


@pytest.mark.parametrize(("separator", "name"), SEPARATORS)
def test_text_layouts(tmp_path, separator, name):
    time, q, v = motion()
    log = write_table(tmp_path / "log.txt", [], time * 1e3, q, v, separator=separator)
    lines = log.read_text().split("\n")
    noisy = ["made by hand", "# t q q v v", *lines[:200], "# a remark", "", *lines[200:]]
    log.write_text("\ufeff" + "\r\n".join(noisy))
    table = {
        **{"separator": name, "header": False, "skip_rows": 1, "comment": "#"},
        "time": {"column": 1, "unit": "ms"},
        "position": {"columns": [2, 3], "unit": "rad"},
        "velocity": {"columns": {"b": 5}, "unit": "rad/s"},
        "extra": {"copy": {"columns": [2, 3], "scale": 2}, "speed": {"column": 4}},
    }
    ((episode,), (done,)) = imported(tmp_path, [log], map_of(table))
    np.testing.assert_allclose(episode.time, time, atol=1e-9)
    np.testing.assert_allclose(episode.matrix("position"), q, atol=1e-8)
    np.testing.assert_allclose(episode.extra["copy.b"], 2 * q[:, 1], atol=1e-8)
    np.testing.assert_allclose(episode.extra["speed"], v[:, 0], atol=1e-8)
    assert tuple(episode.velocity) == ("b",)  # what a log lacks is absent, not zero
    assert done.kinds == ("position", "velocity") and not episode.effort


def test_gains_counts_and_groups(tmp_path):
    time, q, _ = motion()
    header = ["t", "n1", "n2", "i1", "i2", "c1", "c2"]
    columns = (q * 4096 / (2 * np.pi), q + 1.0, q + 0.001)
    for name in ("run-1", "run-2", "other"):
        write_table(tmp_path / f"{name}.csv", header, time, *columns)
    table = {
        **{"file": "{episode}.csv", "time": TIME, **COMMA},
        "position": {"columns": "n{index}", "unit": "counts", "counts_per_rev": {"a": 4096, "b": 8192}},
        "effort": {"columns": "i{index}", "unit": {"a": "A", "b": "N.m"}, "gain": {"a": 0.5, "b": 1}},
        "position_command": {"columns": "c{index}", "unit": "deg", "sign": {"a": -1}},
    }
    data = map_of(table, effort_source="motor", repeats=[["run-1", "run-2"]])
    episodes, _ = imported(tmp_path, [tmp_path], data)
    first = episodes[1]
    np.testing.assert_allclose(first.matrix("position"), q * [1.0, 0.5], atol=1e-8)
    np.testing.assert_allclose(first.matrix("effort"), (q + 1.0) * [0.5, 1.0], atol=1e-8)
    command = (q + 0.001) * np.array([-1.0, 1.0]) * np.pi / 180
    np.testing.assert_allclose(first.matrix("position_command"), command, atol=1e-8)
    assert {e.name: e.repeat_of for e in episodes} == {"other": None, "run-1": None, "run-2": "run-1"}


@pytest.mark.parametrize("suffix", [".mat", ".npz", ".parquet"])
def test_arrays_and_structs(tmp_path, suffix):
    time, q, v = motion()
    path = tmp_path / f"log{suffix}"
    arrays, gain = {"q": q, "v": v, "s.tau": q}, "s.k"
    if suffix == ".mat":
        scipy.io.savemat(path, {"t": time, "q": q.T, "v": v, "s": {"tau": q, "k": 3.0, "name": "x"}})
    elif suffix == ".npz":
        np.savez(path, **{"t": time, **arrays, "s.k": 3.0})
    else:
        columns = {f"{name}[{i + 1}]": values[:, i] for name, values in arrays.items() for i in (0, 1)}
        pq.write_table(pa.table({"t": time, **columns}), path)
        gain = 3.0
    table = {
        "time": TIME,
        "position": {"columns": "q[{index}]", "unit": "rad"},
        "velocity": {"columns": ["v[1]", "v[2]"], "unit": "rad/s"},
        "effort": {"columns": "s.tau[{index}]", "unit": "other", "gain": gain},
    }
    ((episode,), _) = imported(tmp_path, [path], map_of(table, effort_source="motor"))
    np.testing.assert_array_equal(episode.matrix("position"), q)
    np.testing.assert_allclose(episode.matrix("effort"), 3.0 * q, rtol=1e-15)


@pytest.mark.parametrize("more", [{}, {"decimate": {"keep_every": 3, "low_pass": 8}}])
def test_memory_does_not_matter_to_the_result(tmp_path, monkeypatch, more):
    """However small the pieces, the episode is the same, filtered or not."""
    log = table_log(tmp_path / "log.csv")
    ((whole,), _) = imported(tmp_path, [log], base_map(**more))
    for module in (table, text_table, convert):
        monkeypatch.setattr(module, "CHUNK_ROWS", 61)
    (tmp_path / "small").mkdir()
    ((pieces,), _) = imported(tmp_path / "small", [log], base_map(**more))
    np.testing.assert_array_equal(pieces.time, whole.time)
    np.testing.assert_allclose(pieces.matrix("position"), whole.matrix("position"), atol=1e-12)


@settings(max_examples=15, deadline=None)
@given(slow=st.floats(0.2, 18.0), fast=st.floats(51.0, 240.0), every=st.integers(2, 5))
def test_decimation_keeps_what_is_slow_and_nothing_else(tmp_path_factory, slow, fast, every):
    folder = tmp_path_factory.mktemp("thin")
    time = np.arange(3000) / 500.0
    line = 0.1 + 0.02 * time
    wave = 0.1 * np.sin(2 * np.pi * slow * time)
    noise = 0.1 * np.sin(2 * np.pi * (250.0 / every + fast * (250.0 - 250.0 / every) / 250.0) * time)
    columns = (time, line + noise, wave + noise)
    source = write_table(folder / "log.csv", ["t", "q1", "q2"], *columns, form="%.17g")
    data = position_map(decimate={"keep_every": every, "low_pass": 20})
    ((episode,), (done,)) = imported(folder, [source], data)
    np.testing.assert_array_equal(episode.time, time[::every])
    inside = slice(300 // every, -300 // every)  # the ends depend on the continuation
    assert np.abs(episode.position["a"] - line[::every])[inside].max() < 3e-4
    assert np.abs(episode.position["b"] - wave[::every])[inside].max() < 3e-4
    assert done.rate == pytest.approx(500 / every)
    assert episode.metadata["imported"]["decimate"] == {"keep_every": every, "low_pass": 20}


def test_a_prismatic_joint_of_the_urdf_is_in_metres(tmp_path):
    limit = "<limit lower='-1' upper='1' velocity='1' effort='1'/>"
    (tmp_path / "two.urdf").write_text(
        "<robot name='two'><link name='w'/><link name='x'/><link name='y'/>"
        f"<joint name='a' type='revolute'><parent link='w'/><child link='x'/>{limit}</joint>"
        f"<joint name='b' type='prismatic'><parent link='x'/><child link='y'/>{limit}</joint></robot>"
    )
    time, q, _ = motion()
    source = write_table(tmp_path / "log.csv", ["t", "q1", "q2"], time, q * [1, 1000])
    position = {**POSITION, "unit": {"a": "rad", "b": "mm"}}
    data = map_of({**COMMA, "time": TIME, "position": position}, urdf="two.urdf")
    ((episode,), (done,)) = imported(tmp_path, [source], data)
    np.testing.assert_allclose(episode.matrix("position"), q, atol=1e-8)
    assert done.notes == ()


# --- without a map ---------------------------------------------------------------------------------------


def test_a_joint_recorders_file_needs_no_map(tmp_path):
    shorts = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
    joints = [f"{side}_{short}" for side in ("left", "right") for short in shorts]
    time, q, _ = motion(joints=14)
    q = 0.2 * q + [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] * 2
    rows = [["time", *joints[:7], "left_gripper", *joints[7:], "right_gripper"]]
    for t, row in zip(time, q, strict=True):
        rows.append([f"{t:.6f}", *map(str, row[:7]), "None", *map(str, row[7:]), "100.0"])
    source = tmp_path / "wave"
    source.write_text("\n".join(map(",".join, rows)) + "\n")
    ((episode,), (done,)) = imported(tmp_path, [source])
    np.testing.assert_array_equal(episode.matrix("position", joints), q)
    assert (episode.robot, episode.name, episode.gravity_compensation) == ("baxter", "wave", "robot")
    assert episode.effort_source is None and not episode.velocity
    assert done.notes == ("not imported: left_gripper, right_gripper",)
    assert parse_map(Path("own"), episode.metadata["imported"]["map"]).kinds == ("position",)


def test_an_episode_is_checked_and_copied(tmp_path):
    table_log(tmp_path / "log.csv")
    (_, (done,)) = imported(tmp_path, [tmp_path / "log.csv"], base_map())
    (again,) = import_sources([done.path], None, None, tmp_path / "copy")
    assert again.path.read_bytes() == done.path.read_bytes()
    assert (again.samples, again.kinds) == (400, ("position", "velocity"))


def test_one_name_for_two_recordings_gets_its_folder(tmp_path):
    for folder in ("mon", "tue"):
        (tmp_path / folder).mkdir()
        table_log(tmp_path / folder / "log.csv")
    episodes, _ = imported(tmp_path, [tmp_path / "mon" / "log.csv", tmp_path / "tue" / "log.csv"], base_map())
    assert [episode.name for episode in episodes] == ["mon-log", "tue-log"]


# --- command line, schema, documents ---------------------------------------------------------------------


def test_the_verb_tells_what_became_of_a_log(tmp_path):
    log, data = table_log(tmp_path / "log.csv"), write_map(tmp_path / "map.yaml", base_map())
    out = tmp_path / "out"
    result = CliRunner().invoke(impedance, ["import", str(log), "--map", str(data), "--out", str(out)])
    assert result.exit_code == 0, result.output
    told = "400 samples of 2 joints, 3.99 s at 100 Hz: position, velocity"
    assert f"{out / 'log.parquet'}: {told}" in result.output
    assert [path.name for path in out.iterdir()] == ["log.parquet"]


@pytest.mark.parametrize("path", sorted(MAPS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_maps_of_the_real_sets_are_sound(path):
    assert read_map(path).kinds[0] == "position"


def test_the_maps_in_the_document_are_sound():
    blocks = re.findall(r"```yaml\n(.*?)```", DOCUMENT.read_text(), re.S)
    found = [block for block in blocks if block.startswith("format: 1")]
    assert len(found) >= 3
    for block in found:
        parse_map(DOCUMENT, block.replace("urdf: tx40.urdf", "#"))
