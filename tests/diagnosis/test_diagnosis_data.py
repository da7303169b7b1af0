# SPDX-License-Identifier: BSD-3-Clause
"""What `diagnose` says of recordings that nobody should believe: a teaching sentence and exit 2 or 7, no more.

The recordings are those of `test_diagnosis`: two joints, equations written out by hand, spoiled here one way each.
"""

import json
import shutil
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from impedance_modules.diagnosis.data.admission import admit
from impedance_modules.diagnosis.data.dataset_consistency import refuse_copies
from impedance_modules.diagnosis.data.folds import RUN_IN, assign_folds
from impedance_modules.diagnosis.data.log import InsufficientData, Log
from impedance_modules.diagnosis.data.long_recordings import read_recordings
from impedance_modules.diagnosis.data.nominal_model import model_of_spec, model_of_urdf
from impedance_modules.diagnosis.data.rigid_dynamics import inverse_dynamics
from impedance_modules.diagnosis.data.torque_sign import CoarseComparison, _flipped
from impedance_modules.errors import BadInput, ImpedanceError
from impedance_modules.spec.robot_reader import read_robot
from tests.diagnosis.test_diagnosis import JOINTS, RATE, URDF, motion, torque
from tests.support.commands import invoke, python
from tests.support.recordings import columns_of, save

DEGREES = 180.0 / np.pi
WITH_FIXTURES = {"deadline": None, "suppress_health_check": [HealthCheck.function_scoped_fixture]}


def columns(kind=0, seconds=12.0, seed=0, rate=RATE):
    """One good recording: time, positions, velocities, efforts, with noise."""
    dice, stretch = np.random.default_rng(1000 * seed + kind), RATE / rate
    t, q, v, a = motion(kind, seconds * stretch)
    t, v, a = t * stretch, v / stretch, a / stretch**2
    tau = torque(q, v, a, mass=1.0) + dice.normal(scale=0.05, size=q.shape)
    q = q + dice.normal(scale=1e-5, size=q.shape)
    v = v + dice.normal(scale=1e-3, size=q.shape)
    return columns_of(t, JOINTS, position=q, velocity=v, effort=tau)


def good(folder, count=3, **more):
    return [save(folder, f"run{kind}", columns(kind, **more)) for kind in range(count)]


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "pendulum.urdf"
    path.write_text(URDF)
    return path


def diagnose(urdf, *arguments):
    """Exit code and everything that was said; an exception that is no answer fails the test."""
    try:
        result = invoke("diagnose", *arguments, "--urdf", urdf)
    except ImpedanceError as error:
        return error.exit_code, str(error)
    return result.return_value, " ".join(result.output.split())


def admitted(urdf, *paths):
    """The logs of recordings and the report on them."""
    episodes = [episode for found in read_recordings(paths) for episode in found]
    return admit(episodes, model_of_urdf(urdf, JOINTS))


def refused(urdf, paths, words, code=2):
    found, said = diagnose(urdf, *paths)
    assert found == code, said
    assert words in said, said
    assert "valid:" in said, said


# --- files -----------------------------------------------------------------------------------------------


def test_files_that_are_no_recordings(tmp_path, urdf):
    first, *rest = good(tmp_path)
    missing = tmp_path / "nowhere.parquet"
    refused(urdf, [missing, *rest], "nowhere.parquet: no such file")
    (tmp_path / "empty.parquet").write_bytes(b"")
    refused(urdf, [tmp_path / "empty.parquet", *rest], "the file is empty")
    whole = first.read_bytes()
    for length in (3, len(whole) // 2, len(whole) - 5):
        (tmp_path / "cut.parquet").write_bytes(whole[:length])
        refused(urdf, [tmp_path / "cut.parquet", *rest], "not a whole Parquet file")
    (tmp_path / "binary.bin").write_bytes(bytes(range(256)) * 40)
    refused(urdf, [tmp_path / "binary.bin", *rest], "binary.bin")
    (tmp_path / "folder").mkdir()
    refused(urdf, [tmp_path / "folder", *rest], "folder: no episode here")
    refused(tmp_path / "no.urdf", rest, "no such file")
    (tmp_path / "robot.urdf").write_bytes(b"\x00\x01" * 50)
    assert diagnose(tmp_path / "robot.urdf", *rest)[0] == 2


# --- single channels -------------------------------------------------------------------------------------


def put(name, rows, value):
    def change(data):
        data[name][rows] = value

    return change


def times(factor, *names):
    def change(data):
        for name in names:
            data[name] = data[name] * factor

    return change


def rename(old, new):
    def change(data):
        for name in [name for name in data if name.endswith(f".{old}")]:
            data[name.replace(old, new)] = data.pop(name)

    return change


def add(name, source):
    return lambda data: data.update({f"{name}.{joint}": data[f"{source}.{joint}"].copy() for joint in JOINTS})


def constant(data):
    for name in data.keys() - {"time"}:
        data[name][:] = data[name][0]


def jump(data):
    data["position.elbow"][700:] += 2.0


def swap_rate(data):
    data["time"] = np.concatenate([data["time"][:600], data["time"][600] + 0.02 * np.arange(600)])


def first(count):
    return lambda data: data.update({name: values[:count] for name, values in data.items()})


POSITIONS, VELOCITIES, EFFORTS = (
    tuple(f"{kind}.{joint}" for joint in JOINTS) for kind in ("position", "velocity", "effort")
)
SPOILED = {
    "not finite": (put("effort.elbow", 500, np.nan), 2, "column 'effort.elbow' is missing or NaN in row 500"),
    "infinite": (put("position.elbow", 7, np.inf), 2, "column 'position.elbow' is inf in row 7"),
    "constant": (constant, 7, "no joint moves more than 0.02 rad"),
    "time repeats": (put("time", 300, 2.99), 2, "time repeats itself in row 300"),
    "time runs back": (put("time", 300, 1.0), 2, "time runs backwards in row 300"),
    "a gap": (lambda d: d.update(time=d["time"] + 5.0 * (np.arange(1200) > 600)), 2, "a gap of 5.01 s"),
    "two rates in one": (swap_rate, 2, "the rate changes from 100 to 50 Hz"),
    "1 Hz": (times(100.0, "time"), 7, "1 Hz is too slow for joint-level causes"),
    "milliseconds": (times(1000.0, "time"), 7, "is time in milliseconds?"),
    "a single sample": (first(1), 7, "a single sample"),
    "few samples": (first(60), 7, "60 samples"),
    "wrong joint name": (rename("elbow", "elbwo"), 2, "no moving joint 'elbwo'; did you mean 'elbow'?"),
    "degrees": (times(DEGREES, *POSITIONS, *VELOCITIES), 2, "which looks like degrees"),
    "positions in degrees": (times(DEGREES, *POSITIONS), 2, "which looks like degrees"),
    "velocities in degrees": (times(DEGREES, *VELOCITIES), 2, "deg/s for rad/s?"),
    "velocities in rpm": (times(30.0 / np.pi, "velocity.elbow"), 2, "rev/min for rad/s?"),
    "velocity reversed": (times(-1.0, "velocity.elbow"), 2, "velocity.elbow is -1 times"),
    "torque in mN.m": (times(1000.0, *EFFORTS), 2, "looks like mN.m"),
    "a glitch": (put("effort.elbow", 500, 1e5), 2, "effort.elbow is 1e+05 in sample 500, 1 such samples"),
    "torque reversed": (times(-1.0, "effort.elbow"), 2, "the sign of effort.elbow is flipped"),
    "all reversed": (times(-1.0, *EFFORTS), 2, "effort.shoulder, effort.elbow is flipped on every joint"),
    "torque stuck": (put("effort.elbow", slice(None), 0.0), 2, "effort.elbow is 0 in every sample"),
    "position is command": (add("position_command", "position"), 2, "position.shoulder equals position_command"),
    "effort is command": (add("effort_command", "effort"), 2, "effort.shoulder equals effort_command.shoulder"),
    "encoder jump": (jump, 2, "position.elbow jumps by 2.01 rad at row 700"),
    "no torque": (lambda d: [d.pop(name) for name in EFFORTS], 7, "no torque was recorded"),
}  # fmt: skip


@pytest.mark.parametrize("case", SPOILED)
def test_spoiled_recordings_are_refused_with_the_reason(tmp_path, urdf, case):
    change, code, words = SPOILED[case]
    data = columns(0)
    change(data)
    about = {} if any(name.startswith("effort.") for name in data) else {"effort_source": None}
    beside = () if case in ("wrong joint name", "constant") else (1, 2)
    others = [save(tmp_path, f"run{kind}", columns(kind)) for kind in beside]
    refused(urdf, [save(tmp_path, "run0", data, **about), *others], words, code)


def test_radians_beyond_a_model_s_narrow_limits_are_taken_where_the_torques_agree_with_them(tmp_path, urdf):
    """A tenth of the range is stated; beside torques that do not fit, the same numbers may be degrees."""
    urdf.write_text(URDF.replace('lower="-3" upper="3"', 'lower="-0.3" upper="0.3"'))
    paths = good(tmp_path)
    _, report = admitted(urdf, *paths)
    told = [line for line in report.warnings if "position.elbow reaches" in line]
    assert len(told) == 3
    assert all("in the model: taken as it is" in line for line in told)
    heavier = {**columns(0)}
    for name in EFFORTS:
        heavier[name] = 2.5 * heavier[name]  # a payload that is not in the model: 36 % of the power is left
    _, report = admitted(urdf, save(tmp_path, "heavier", heavier), *paths[1:])
    assert any("heavier: position.elbow reaches" in line for line in report.warnings)
    data = columns(0)
    for name in EFFORTS:
        data[name] = np.random.default_rng(0).normal(size=len(data["time"]))
    refused(urdf, [save(tmp_path, "noise", data), *paths[1:]], "Is it in degrees?")


def test_rows_that_were_written_twice_are_left_out(tmp_path, urdf):
    """The same stamp and the same readings are one row; the same stamp with other readings is a fault."""
    once = columns(0)
    rows = np.repeat(np.arange(1200), 1 + (np.random.default_rng(0).random(1200) < 0.01))
    twice = {name: values[rows] for name, values in once.items()}
    (one,), _ = admitted(urdf, save(tmp_path, "a", once))
    (other,), report = admitted(urdf, save(tmp_path, "a", twice))
    for name in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert any(f"{len(rows) - 1200} rows repeat the row before" in said for said in report.warnings)
    twice["effort.elbow"][np.flatnonzero(np.diff(rows) == 0)[0] + 1] += 0.1
    refused(urdf, [save(tmp_path, "b", twice)], "time repeats itself")


def test_differences_of_the_positions_are_no_velocities(tmp_path, urdf):
    data = columns(0)
    for joint in JOINTS:
        data[f"velocity.{joint}"] = np.gradient(data[f"position.{joint}"], data["time"])
    (log,), report = admitted(urdf, save(tmp_path, "a", data))
    assert log.velocity is None and any("differences of the recorded positions" in w for w in report.warnings)
    assert admitted(urdf, save(tmp_path, "b", columns(1)))[0][0].velocity is not None


def test_positions_in_degrees_within_the_range_are_refused(tmp_path, urdf):
    """Small motions, degrees or not, fit any range; the weight they carry tells."""
    t, q, v, a = motion(0, 12.0)
    tau = torque(0.04 * q, 0.04 * v, 0.04 * a, mass=1.0)
    assert 0.04 * DEGREES * np.abs(q).max() < 3.0
    data = columns_of(t, JOINTS, position=0.04 * DEGREES * q, velocity=0.04 * DEGREES * v, effort=tau)
    refused(urdf, [save(tmp_path, "run0", data)], "if the positions are degrees")


# --- physics that is no mistake --------------------------------------------------------------------------


@settings(max_examples=25, **WITH_FIXTURES)
@given(
    spring=st.floats(-30.0, 30.0),
    preload=st.floats(-30.0, 30.0),
    viscous=st.floats(0.0, 4.0),
    coulomb=st.floats(0.0, 5.0),
    gain=st.floats(0.6, 1.5),
    late=st.integers(0, 8),
)
def test_strong_effects_are_physics_and_not_mistakes(
    tmp_path, urdf, spring, preload, viscous, coulomb, gain, late
):
    data = columns(0)
    for joint in JOINTS:
        q, v, tau = (data[f"{kind}.{joint}"] for kind in ("position", "velocity", "effort"))
        tau = gain * tau + spring * q + preload + viscous * v + coulomb * np.tanh(v / 0.05)
        data[f"effort.{joint}"] = np.roll(tau, late)
    admitted(urdf, save(tmp_path, "run0", data))


def test_a_wrapped_angle_is_unwrapped_with_a_warning(tmp_path, urdf):
    data = columns(0)
    turned = data["position.shoulder"] + np.pi
    data["position.shoulder"] = np.mod(turned + np.pi, 2 * np.pi) - np.pi
    assert np.abs(np.diff(data["position.shoulder"])).max() > 6.0
    urdf.write_text(URDF.replace('type="revolute"', 'type="continuous"'))
    logs, report = admitted(urdf, save(tmp_path, "run0", data))
    assert any("wraps around" in note for note in report.warnings)
    shift = logs[0].position[:, 0] - turned
    np.testing.assert_allclose(shift, shift[0], atol=1e-9)


def test_a_constant_velocity_of_a_moving_joint_is_not_used(tmp_path, urdf):
    data = columns(0)
    data["velocity.elbow"][:] = 0.0
    (log,), report = admitted(urdf, save(tmp_path, "run0", data))
    assert log.velocity is None and any("velocities are not used" in note for note in report.warnings)


# --- recordings beside each other ------------------------------------------------------------------------


def test_holdout_that_was_fitted_and_copies(tmp_path, urdf):
    first, second, third = good(tmp_path)
    code, said = diagnose(urdf, first, second, "--holdout", first)
    assert code == 2 and "is given twice: a recording that was fitted cannot test the fit" in said
    copy = tmp_path / "other" / "run0.parquet"
    copy.parent.mkdir()
    shutil.copy(first, copy)
    refused(urdf, [first, copy], "two recordings are called 'run0'")
    renamed = save(tmp_path, "renamed", columns(0))
    code, said = diagnose(urdf, first, second, "--holdout", renamed)
    assert code == 2 and "hold the same numbers in 1200 samples" in said
    part = {name: values[300:] for name, values in columns(0).items()}
    refused(urdf, [first, third, save(tmp_path, "part", part)], "hold the same numbers in 900 samples")


def on_coarse_grids(seed: int) -> Log:
    """A joint that swings, and its torque: an encoder of 5 mrad, readings in steps of 0.2 N.m."""
    random, time = np.random.default_rng(seed), np.arange(1000) / 50.0
    q = 5e-3 * np.round(0.1 / 5e-3 * np.sin(0.7 * time + seed))[:, None]
    u = 0.2 * np.round((3.0 * np.sin(0.7 * time + seed) + 0.1 * random.standard_normal(1000)) / 0.2)[:, None]
    return Log(f"run_{seed}", f"run_{seed}", 50.0, q, None, u, None, None, "motor", "none")


def test_recordings_on_coarse_grids_share_samples_and_are_no_copies():
    one, other = on_coarse_grids(1), on_coarse_grids(2)
    pairs = [
        {(float(q[0]), float(u[0])) for q, u in zip(log.position, log.effort, strict=True)}
        for log in (one, other)
    ]
    assert len(pairs[0] & pairs[1]) > 0.5 * min(map(len, pairs)) and min(map(len, pairs)) > 100
    refuse_copies([one, other])
    with pytest.raises(BadInput, match="part and run_1 hold the same numbers in "):
        refuse_copies([one, replace(one.part(150, 850), name="part")])


def test_recordings_of_other_robots_and_joints(tmp_path, urdf):
    first, second, _ = good(tmp_path)
    stranger = save(tmp_path, "strange", columns(3), robot="crane")
    refused(urdf, [first, stranger], "its robot is 'crane'")
    lacking = {name: values for name, values in columns(4).items() if not name.endswith(".elbow")}
    refused(urdf, [first, save(tmp_path, "one_joint", lacking)], "no position.elbow")
    motor = save(tmp_path, "motor", columns(5), effort_source="motor")
    refused(urdf, [first, second, motor], "measure torque in different places")
    patch = tmp_path / "patch.yaml"
    patch.write_text(
        "format: 1\nrobot: crane\nprovenance: {}\neffects:\n"
        "  - {effect: viscous_friction, joints: [elbow], port: link,"
        " parameters: {elbow: {fv: {value: 0.3, unit: N.m.s/rad}}}}\n"
    )
    assert diagnose(urdf, first, second, "--effects", patch)[0] == 2


def test_mixed_rates_are_brought_to_the_lowest(tmp_path, urdf):
    paths = [*good(tmp_path, 2), save(tmp_path, "fast", columns(2, rate=250.0, seconds=20.0))]
    logs, report = admitted(urdf, *paths)
    assert [log.rate for log in logs] == pytest.approx([100.0] * 3)
    assert report.rates["fast"] == pytest.approx(250.0)
    assert any("fast 250 Hz brought to 100 Hz" in note for note in report.warnings)
    ((fast,),) = read_recordings(paths[2:])
    expected = CubicSpline(fast.time, fast.position["elbow"])(np.arange(logs[2].samples) / 100.0)
    np.testing.assert_allclose(logs[2].position[20:-20, 1], expected[20:-20], atol=2e-4)


@settings(max_examples=8, **WITH_FIXTURES)
@given(late=st.integers(-80, 80))
def test_repeats_are_aligned_however_late_they_were_started(tmp_path, urdf, late):
    whole, again = columns(0, seconds=14.0), columns(0, seconds=14.0, seed=1)
    first = {name: values[100:1300] for name, values in whole.items()}
    second = {name: values[100 - late : 1300 - late] for name, values in again.items()}
    second["time"] = second["time"] - second["time"][0]
    named = {"run0": first, "again": second, "other": columns(1)}
    logs, report = admitted(urdf, *(save(tmp_path, name, data) for name, data in named.items()))
    assert report.repeats == (("run0", "again"),)
    assert logs[0].samples == logs[1].samples == 1200 - abs(late)
    assert np.abs(logs[0].position - logs[1].position).max() < 1e-3


def test_a_stated_repeat_with_another_motion_is_no_repeat(tmp_path, urdf):
    paths = [save(tmp_path, "run0", columns(0)), save(tmp_path, "run1", columns(1), repeat_of="run0")]
    _, report = admitted(urdf, *paths)
    assert report.repeats == ()
    assert any("says it repeats run0, but its motion differs" in note for note in report.warnings)


@settings(max_examples=12, **WITH_FIXTURES)
@given(late=st.integers(0, 12), carried=st.booleans())
def test_the_delay_of_effort_behind_command_is_found(tmp_path, urdf, late, carried):
    """Also where the robot adds the weight, which no command shows, and never a negative one."""
    data = columns(0)
    q, v, a = motion(0, 12.0)[1:]
    weight = carried * torque(q, 0 * v, 0 * a, mass=1.0)
    asked = torque(q, v, a, mass=1.0) - weight
    for i, joint in enumerate(JOINTS):
        data[f"effort_command.{joint}"] = asked[:, i]
        data[f"effort.{joint}"] = np.roll(asked[:, i], late) + weight[:, i] + 1e-3 * np.sin(data["time"] * 37)
    about = {"gravity_compensation": "robot"} if carried else {}
    _, report = admitted(urdf, save(tmp_path, "run0", data, **about))
    assert report.delay == pytest.approx(0.01 * late, abs=0.012)


# --- segments --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [None, RATE, 2.0 * RATE])
def test_a_command_that_was_held_acts_half_a_period_later(tmp_path, urdf, rate):
    paths = []
    for kind in range(3):
        data = columns(kind)
        for joint in JOINTS:
            data[f"effort_command.{joint}"] = np.sin(4.0 * data["time"])
        paths.append(save(tmp_path, f"run{kind}", data, **({} if rate is None else {"rate": rate})))
    logs, _ = admitted(urdf, *paths)
    late = 0.0 if rate is None else 0.5 / rate
    for log in logs:
        time = np.arange(log.samples) / log.rate
        assert np.allclose(log.command[5:-5, 0], np.sin(4.0 * (time - late))[5:-5], atol=1e-5)


def test_one_motion_is_cut_without_losing_a_sample(tmp_path, urdf):
    logs, _ = admitted(urdf, save(tmp_path, "run0", columns(0, seconds=30.0)))
    found = assign_folds(logs, ())
    assert sorted([*found.fitted, *found.heldout]) == list(range(len(found.logs))) and len(found.folds) >= 3
    margin = int(RUN_IN * 100)
    kept = np.zeros(logs[0].samples, dtype=int)
    for log in found.logs:
        first = round(log.start * log.rate)
        inner = slice(first + (margin if first else 0), first + log.samples)
        np.testing.assert_array_equal(log.position, logs[0].position[first : first + log.samples])
        stop = inner.stop if inner.stop == logs[0].samples else inner.stop - margin
        kept[inner.start : stop] += 1
    assert np.all(kept == 1)


def test_a_short_motion_makes_three_parts_where_the_filter_leaves_too_little_for_four(tmp_path, urdf):
    """Two folds and a part to test on are enough; four parts are better where they are long enough."""
    logs, _ = admitted(urdf, save(tmp_path, "run0", columns(0, seconds=8.0)))
    assert len(assign_folds(logs, (), 1.5).logs) == 4
    found = assign_folds(logs, (), 2.1)
    assert len(found.logs) == 3 and len(found.folds) == 2 and len(found.heldout) == 1
    with pytest.raises(InsufficientData, match=r"valid: 9\.\d+ s, or several motions"):
        assign_folds(logs, (), 3.0)


TELL_MEMORY = """
import atexit, resource, sys
from impedance_modules.cli.main import main
largest = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
atexit.register(lambda: print("largest resident kB", largest(), file=sys.stderr))
main()
"""


@pytest.mark.long
def test_ten_hours_are_diagnosed_from_segments(tmp_path, urdf):
    """Bounded in memory (a process of its own, to measure it) and in time; what was used is said."""
    hour = np.arange(360_000) / 100.0  # the same hour ten times: what is not looked at may be anything
    q = np.column_stack([0.4 * np.sin(2 * np.pi * f * hour + np.sin(hour / 150.0)) for f in (0.31, 0.47)])
    v = np.gradient(q, 0.01, axis=0)
    tau = torque(q, v, np.gradient(v, 0.01, axis=0), mass=1.0) + 0.3 * v * [0.0, 1.0]
    dice = np.random.default_rng(0)
    noise = dice.normal(scale=0.05, size=(2, 3_600_000)).T
    ten = columns_of(
        np.arange(3_600_000) / 100.0,
        JOINTS,
        position=np.tile(q, (10, 1)),
        effort=np.tile(tau, (10, 1)) + noise,
    )
    path, answer = save(tmp_path, "day", ten), tmp_path / "answer.json"
    done = python("-c", TELL_MEMORY, "diagnose", str(path), "--urdf", str(urdf), "--json", str(answer))
    memory = int(done.stderr.rsplit("largest resident kB ", 1)[1].split()[0])
    assert done.returncode in (0, 5, 6), done.stderr
    found = json.loads(answer.read_text())
    assert any("36000 s are more than is used" in note for note in found["data"]["warnings"])
    assert found["causes"][0]["effect"] == "viscous_friction" and found["causes"][0]["joints"] == ["elbow"]
    assert memory < 1_400_000  # kB; 1 GB, and what compiling the plant takes where nothing is kept yet


# --- anything at all -------------------------------------------------------------------------------------

CHANGES = {
    "set": lambda part, value, seed: np.full_like(part, value),
    "scale": lambda part, value, seed: part * value,
    "shift": lambda part, value, seed: part + value,
    "swap": lambda part, value, seed: part[::-1].copy(),
    "drop": None,
    "cut": None,
    "noise": lambda part, value, seed: part + np.random.default_rng(seed).normal(size=len(part)) * value,
    "hold": lambda part, value, seed: np.repeat(part[:1], len(part)),
    "quantise": lambda part, value, seed: np.round(part / value) * value if value > 0.0 else part,
}
CORRUPTIONS = st.tuples(
    st.sampled_from(tuple(CHANGES)),
    st.sampled_from(("time", *POSITIONS, *VELOCITIES, *EFFORTS)),
    st.sampled_from((0.0, -1.0, 1e-12, 1e-3, 0.5, 2.0, 57.3, 1e3, 1e9, 1e300, float("nan"), float("inf"))),
    st.integers(0, 799),
    st.integers(1, 800),
)


def corrupt(data, how, name, value, first, length):
    rows = slice(None) if how == "quantise" else slice(first, first + length)
    if name not in data:
        return
    if how == "drop":
        data.pop(name)
    elif how == "cut":
        data.update({other: x[rows] if len(x[rows]) else x[:1] for other, x in data.items()})
    else:
        data[name] = data[name].copy()
        with np.errstate(all="ignore"):
            data[name][rows] = CHANGES[how](data[name][rows], value, first)


@pytest.mark.long
@settings(max_examples=25, derandomize=True, **WITH_FIXTURES)
@given(spoiled=st.lists(CORRUPTIONS, min_size=1, max_size=3), alone=st.booleans())
def test_corrupt_recordings_give_no_traceback(tmp_path, urdf, spoiled, alone):
    """Whatever is done to a good recording, `diagnose` ends with one of the contract's codes and a sentence."""
    data = columns(0, seconds=8.0)
    for change in spoiled:
        corrupt(data, *change)
    has_effort = any(name.startswith("effort.") for name in data)
    try:
        path = save(tmp_path, "run0", data, effort_source="joint_sensor" if has_effort else None)
    except ImpedanceError:
        return  # the writer itself refuses it
    others = [] if alone else [save(tmp_path, "run1", columns(1, seconds=8.0))]
    code, said = diagnose(urdf, path, *others)
    assert code in (0, 2, 5, 6, 7)
    assert len(said) > 20


def test_a_pushed_hand_is_no_flipped_sign(tmp_path, urdf):
    """A push turns the links' torque round; the reading still follows what was asked of the motor."""
    data, still = columns(0), np.zeros((1200, 2))
    q = np.column_stack([data[name] for name in POSITIONS])
    weight = torque(q, still, still, mass=1.0)
    turned = -data["effort.elbow"]
    flipped = pytest.raises(ImpedanceError, match=r"the sign of effort\.elbow is flipped")
    for name, asked, found in (("pushed", turned, nullcontext()), ("flipped", -turned, flipped)):
        commands = {
            "effort_command.shoulder": data["effort.shoulder"] - weight[:, 0],
            "effort_command.elbow": asked - weight[:, 1],
        }
        spoiled = {**data, "effort.elbow": turned, **commands}
        path = save(tmp_path, name, spoiled, gravity_compensation="robot")
        with found:
            admitted(urdf, path)


@pytest.mark.parametrize("lean", [-2.0, -0.5, 0.5, 2.0])
def test_a_base_that_leans_flips_no_sign_of_a_slow_motion(lean):
    """What it adds follows the speed by chance, and against friction; the torque is the links' all the same."""
    time = np.linspace(0.0, 14.0, 600)
    q = 0.4 * np.sin(0.9 * time)[:, None]
    v, a = 0.36 * np.cos(0.9 * time)[:, None], -0.324 * np.sin(0.9 * time)[:, None]
    model = -25.0 + 40.0 * np.sin(q) + 0.4 * np.sin(3.0 * time)[:, None]
    effort = model + lean * v / 0.36 + 0.5 * np.cos(3.3 * time)[:, None]
    assert not _flipped(CoarseComparison(q, v, a, effort, model, None), 0)


def test_a_tool_on_a_joint_without_load_is_no_flipped_sign(tmp_path):
    """Baxter's last joint needs a few mN.m for itself; what a light tool asks of it may well oppose that."""
    joints = [f"right_{name}" for name in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
    model = model_of_spec(read_robot("baxter"), joints)
    time = np.arange(1200) / 100.0
    middle = np.array([0.2, -0.4, 0.8, 1.4, -0.9, 0.9, -1.0])
    w = 2.0 * np.pi * np.array([0.11, 0.17, 0.23, 0.29, 0.31, 0.37, 0.43])
    q = middle + 0.3 * np.sin(w * time[:, None])
    v, a = 0.3 * w * np.cos(w * time[:, None]), -0.3 * w**2 * np.sin(w * time[:, None])
    needed = inverse_dynamics(model.tree, q, v, a)
    flipped = pytest.raises(ImpedanceError, match=r"the sign of effort\.right_w1 is flipped")
    for turned, found in (("right_w2", nullcontext()), ("right_w1", flipped)):
        effort = needed * np.where(np.array(joints) == turned, -1.0, 1.0)
        path = save(tmp_path, turned, columns_of(time, joints, position=q, effort=effort), robot="baxter")
        with found:
            admit(read_recordings([path])[0], model)


def test_a_segment_that_is_too_short_is_left_out(tmp_path, urdf):
    logs, _ = admitted(urdf, save(tmp_path, "run0", columns(0, seconds=30.0)))
    whole = assign_folds(logs, ())
    (first, *others), (held,) = whole.folds, whole.heldout
    rest = whole.without([*first, held], "too short")
    names = [whole.logs[i].name for fold in others for i in fold]
    assert [rest.logs[i].name for i in (*rest.fitted, *rest.heldout)] == names
    assert len(rest.folds) == len(others) - 1 and rest.heldout and rest.warnings[-1] == "too short"
    with pytest.raises(InsufficientData, match="too short; what remains"):
        whole.without([i for fold in others for i in fold], "too short")
