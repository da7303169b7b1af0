# SPDX-License-Identifier: BSD-3-Clause
"""ROS recordings become episodes: every container, joints by name, several publishers, one clock."""

import bz2
import tracemalloc

import lz4.frame
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import get_types_from_msg

from impedance_modules.episode.imports import packed_chunks
from impedance_modules.episode.imports.bag_file import BagFile
from impedance_modules.episode.imports.message_types import are_plain, is_type_name
from impedance_modules.errors import BadInput
from tests.support.import_logs import EPOCH, SEA_DEFINITION, Bag, imported, map_of, motion

# Alphabetic, as published, and from the base outwards.
JOINTS = [f"right_{short}" for short in ("e0", "e1", "s0", "s1", "w0", "w1", "w2")]
ORDER = [f"right_{short}" for short in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
KINDS = ["bag", "bag-lz4", "bag-bz2", "db3", "mcap", "mcap-zstd"]
STATES = "/robot/joint_states"


def imported_bag(folder, bag, kind="bag", data=None):
    """The one episode of a recording, and what the import says of it."""
    ((episode,), (done,)) = imported(folder, [bag.write(folder / "log", kind)], data)
    return episode, done


def arm_motion(samples=300):
    time, q, v = motion(samples, 7)
    return time, 0.3 * q + [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.3 * v


def arm_bag(samples=300, stamp=True):
    """States of an arm and a head, and a second publisher's gripper on the same topic."""
    bag = Bag()
    for t, q, v in zip(*arm_motion(samples), strict=True):
        names, pad = ["head_pan", *JOINTS], np.zeros(1)
        fields = {"position": [*pad, *q], "velocity": [*pad, *v], "effort": [*pad, *(3.0 * q + 1.0)]}
        bag.state(STATES, t if stamp else None, names, received=t + 0.002, **fields)
        gripper = {"position": [0.1], "velocity": [0.0], "effort": [0.0]}
        bag.state(STATES, t + 0.004, ["right_gripper"], **gripper)
    return bag


@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_of_a_shipped_robot_needs_no_map(tmp_path, kind):
    episode, done = imported_bag(tmp_path, arm_bag(), kind)
    time, q, v = arm_motion()
    np.testing.assert_allclose(episode.time, time, atol=1e-9)
    assert episode.joints == tuple(ORDER)
    np.testing.assert_array_equal(episode.matrix("position", JOINTS), q)
    np.testing.assert_array_equal(episode.matrix("velocity", JOINTS), v)
    np.testing.assert_array_equal(episode.matrix("effort", JOINTS), 3.0 * q + 1.0)
    assert (episode.robot, episode.effort_source) == ("baxter", "joint_sensor")
    assert episode.metadata["imported"]["start_ns"] == EPOCH and not done.rate_stated


def test_a_storage_file_alone_is_enough(tmp_path):
    for kind in ("db3", "mcap"):
        folder = arm_bag(50).write(tmp_path / kind, kind)
        ((episode,), _) = imported(folder, [folder / f"{kind}.{kind}"])
        assert len(episode) == 50


def test_reordered_names_are_matched_by_name(tmp_path):
    bag = Bag()
    time, q, _ = arm_motion()
    for index, t in enumerate(time):
        order = np.roll(np.arange(7), index % 3)
        bag.state(STATES, t, [JOINTS[i] for i in order], position=q[index][order])
    episode, done = imported_bag(tmp_path, bag)
    np.testing.assert_array_equal(episode.matrix("position", JOINTS), q)
    assert done.kinds == ("position",)  # empty velocity and effort arrays are absent


def test_messages_without_a_stamp_take_the_time_of_reception(tmp_path):
    episode, done = imported_bag(tmp_path, arm_bag(stamp=False), "mcap")
    np.testing.assert_allclose(np.diff(episode.time), 0.01, atol=1e-8)
    assert any("received" in note for note in done.notes)


def test_unfilled_effort_is_absent(tmp_path):
    bag = Bag()
    for t, q, v in zip(*arm_motion(), strict=True):
        bag.state(STATES, t, JOINTS, position=q, velocity=v, effort=np.full(7, np.nan))
    episode, done = imported_bag(tmp_path, bag, "db3")
    assert not episode.effort and episode.effort_source is None and episode.velocity
    assert any("effort" in note for note in done.notes)


def bag_map_data(**more):
    springs = "/limb/springs"
    table = {
        "position": {"columns": "/states.position.{joint}", "unit": "rad"},
        "velocity": {"columns": "/states.velocity.{joint}", "unit": "rad/s"},
        "effort_command": {"columns": f"{springs}.commanded_effort.{{joint}}", "unit": "N.m"},
        "extra": {"hysteresis": {"columns": f"{springs}.hysteresis_model_effort.{{joint}}"}},
    }
    return map_of(table | more, gravity_compensation="robot")


def two_rates(gap=False):
    """States at 100 Hz in two messages, a maker's own type at 25 Hz that begins later."""
    bag = Bag()
    time, q, v = motion(400)
    for t, row, speed in zip(time, q, v, strict=True):
        bag.state("/states", t, ["a"], position=row[:1], velocity=speed[:1])
        bag.state("/states", t + 0.003, ["b"], position=row[1:], velocity=speed[1:])
    for step in (*range(10, 40 if gap else 60), *range(60, 80)):
        t = 0.04 * step
        fields = {"commanded_effort": [-step, step], "hysteresis_model_effort": [2 * t, t]}
        bag.springs("/limb/springs", t, ["b", "a"], **fields)
    return bag


def test_streams_are_brought_to_one_clock(tmp_path):
    episode, done = imported_bag(tmp_path, two_rates(), data=bag_map_data())
    start = np.array(episode.metadata["imported"]["start_ns"] - EPOCH) * 1e-9
    time = episode.time + start
    assert time[0] >= 0.4 and time[-1] <= 0.04 * 79 + 1e-9  # where every stream has spoken
    pulse = 2 * np.pi * np.array([0.3, 0.5])
    lag = [0.0, 0.003]  # the second joint is stamped 3 ms later with the same phase
    for joint, (rate, late) in enumerate(zip(pulse, lag, strict=True)):
        expected = 0.4 * np.sin(rate * (time - late))
        np.testing.assert_allclose(episode.matrix("position")[:, joint], expected, atol=2e-4)
    held = np.floor(time / 0.04 + 1e-6)  # a command stands until the next
    np.testing.assert_array_equal(episode.effort_command["a"], held)
    np.testing.assert_array_equal(episode.effort_command["b"], -held)
    np.testing.assert_allclose(episode.extra["hysteresis.b"], 2 * time, atol=1e-9)  # measured: interpolated
    assert any("/limb/springs" in note for note in done.notes)


def test_no_value_is_made_up_across_a_gap(tmp_path):
    episode, done = imported_bag(tmp_path, two_rates(gap=True), "mcap", bag_map_data())
    steps = np.diff(episode.time)
    assert steps.max() == pytest.approx(0.84, abs=0.02) and np.sort(steps)[-2] < 0.011
    assert any("left out" in note for note in done.notes)


@pytest.mark.parametrize(
    ("bag", "data", "words"),
    [
        ("silent", None, "no message about joints"),
        ("strange", None, "no joint states of a shipped robot"),
        ("twice", None, "several topics hold the robot's joints: /a/measured, /b/desired"),
        ("unstamped", bag_map_data(), "clock: received"),
        ("strange", bag_map_data(), "no column '/limb/springs.commanded_effort.a'"),
        ("strange", bag_map_data(separator="comma", header=True), "'separator' is for text files"),
        ("strange", bag_map_data(time={"column": "t", "unit": "s"}), "log.bag has 'clock: header'"),
        ("backwards", None, "time runs backwards"),
        ("still", None, "time repeats"),
        ("zeros", None, "effort is 0 in every sample"),
        ("ragged", None, "'velocity' of /robot/joint_states has 6 values for 7 joints"),
    ],
)
def test_bags_that_would_mislead(tmp_path, bag, data, words):
    source = BAD[bag]().write(tmp_path / "log", "bag")
    with pytest.raises(BadInput) as caught:
        imported(tmp_path, [source], data)
    assert words in str(caught.value) and "log.bag" in str(caught.value)
    assert not (tmp_path / "out").exists()


def silent():
    bag = Bag()
    bag.state("/nobody", 0.0, [])
    return bag


def states(stamps, topics=(STATES,), names=JOINTS, **fixed):
    _, q, v = arm_motion(len(stamps))
    bag, n = Bag(), len(names)
    for k, (topic, i) in enumerate((topic, i) for i in range(len(stamps)) for topic in topics):
        fields = {"position": q[i, :n], "velocity": v[i, :n], **fixed}
        bag.state(topic, stamps[i], names, received=0.01 * k, **fields)
    return bag


def unstamped():
    bag = two_rates()
    bag.messages = [(topic, kind, moment, None, *rest) for topic, kind, moment, _, *rest in bag.messages]
    return bag


def ragged():
    bag = states(0.01 * np.arange(50))
    _, q, v = arm_motion(1)
    bag.state(STATES, 0.6, JOINTS, received=9.0, position=q[0], velocity=v[0][:6])
    return bag


STEADY = 0.01 * np.arange(50)
BAD = {
    "silent": silent,
    "strange": lambda: states(STEADY, topics=("/states",), names=["a", "b"]),
    "twice": lambda: states(STEADY, topics=("/a/measured", "/b/desired")),
    "unstamped": unstamped,
    "backwards": lambda: states([*STEADY[:20], 0.05, *STEADY[20:]]),
    "still": lambda: states([0.0, 0.01, 0.01, 0.02]),
    "zeros": lambda: states(STEADY, effort=np.zeros(7)),
    "ragged": ragged,
}


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap", "mcap-zstd"])
def test_damaged_recordings_are_refused_in_a_sentence(tmp_path, kind):
    source = arm_bag(60).write(tmp_path / "log", kind)
    file = source if source.is_file() else next(p for p in source.iterdir() if p.suffix != ".yaml")
    whole = file.read_bytes()
    random = np.random.default_rng(3)
    refused = 0
    for attempt in range(12):
        damaged = bytearray(whole[: random.integers(1, len(whole))] if attempt % 2 else whole)
        for place in random.integers(0, len(damaged), 20):
            damaged[place] ^= int(random.integers(1, 256))
        broken = tmp_path / f"broken-{attempt}{file.suffix}"
        broken.write_bytes(damaged)
        try:
            imported(tmp_path / kind / str(attempt), [broken])
        except BadInput as error:
            assert broken.name in str(error)
            refused += 1
    assert refused >= 6


@pytest.mark.parametrize(
    "name",
    ["a/msg/X:\n    import os", 'a/msg/X", 1, "', "a/msg/class", "a/../X", "a/b/c/X", "X", "a/msg/3x", ""],
)
def test_type_names_of_which_no_class_can_be_made_are_left_out(tmp_path, monkeypatch, name):
    """The library makes Python code of the definitions in a recording, with the names that stand there."""
    assert not is_type_name(name) and not are_plain({name: ([], [])})
    path, real = arm_bag(5).write(tmp_path / "log", "mcap"), BagFile._learn
    monkeypatch.setattr(
        BagFile, "_register", lambda self, connection: pytest.fail("it was given to the library")
    )
    monkeypatch.setattr(BagFile, "_learn", lambda self, one: real(self, one._replace(msgtype=name)))
    with pytest.raises(BadInput, match="no message about joints"):
        imported(tmp_path, [path / "log.mcap"])


@pytest.mark.parametrize(
    "definition",
    [
        "string[] name\nfloat64[99999999] x\n",
        "string[] name\n" + "float64 x\n" * 3000,
        "string[] name\nint8 A=[\n",
    ],
)
def test_definitions_that_would_become_endless_code_are_left_out(definition):
    types = get_types_from_msg(definition, "a/msg/X") if "=[" not in definition else {"a/msg/X'": ([], [])}
    assert not are_plain(types)
    assert are_plain(get_types_from_msg(SEA_DEFINITION.replace("std_msgs/Header", "string"), "a/msg/X"))


PACK = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": packed_chunks.zstd.compress}


@given(st.sampled_from(sorted(PACK)), st.binary(max_size=2000), st.binary(min_size=1, max_size=2000))
def test_a_packed_chunk_is_what_was_packed(kind, first, second):
    packed = PACK[kind](first) + PACK[kind](second)
    assert packed_chunks.unpack(kind, packed) == first + second
    with pytest.raises(ValueError, match="ends early"):
        packed_chunks.unpack(kind, packed[:-1])


@pytest.mark.parametrize("kind", sorted(PACK))
def test_a_chunk_that_unpacks_to_too_much_is_refused_before_it_does(kind, monkeypatch):
    packed = PACK[kind](bytes(50_000_000))
    monkeypatch.setattr(packed_chunks, "LARGEST_CHUNK", 1_000_000)
    tracemalloc.start()
    with pytest.raises(ValueError, match="larger than 1 MB"):
        packed_chunks.unpack(kind, packed)
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()
    assert packed_chunks.unpack(kind, PACK[kind](bytes(1_000_000))) == bytes(1_000_000)


@pytest.mark.parametrize("kind", ["bag-lz4", "bag-bz2", "mcap-zstd"])
def test_a_recording_with_such_a_chunk_is_refused(tmp_path, kind, monkeypatch):
    monkeypatch.setattr(packed_chunks, "LARGEST_CHUNK", 10_000)
    with pytest.raises(BadInput, match="a packed chunk is larger"):
        imported_bag(tmp_path, arm_bag(200), kind)
