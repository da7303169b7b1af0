# SPDX-License-Identifier: BSD-3-Clause
"""Whatever ends a run, at most its last second is lost, and a stock Parquet reader reads the rest."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pyarrow.parquet as pq
import pytest

from impedance_modules.episode import background as ring
from impedance_modules.episode import writer
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_folder import RunLock, part_paths, whole_file
from impedance_modules.episode.writer import EpisodeWriter
from impedance_modules.errors import BadInput, SafetyStop
from tests.support.log_metadata import log_metadata
from tests.support.paths import CHECKOUT

METADATA = log_metadata()
ATTEMPTS = 4
"""A run in real time does not wait for the disk, which other tests may hold up for longer than it lives."""

COLUMNS = ["time", *(f"position.j{index}" for index in range(40)), "phase"]

RUN = """
import sys, time
from pathlib import Path
import numpy as np
from impedance_modules.episode.writer import EpisodeWriter
from tests_crash_data import COLUMNS, METADATA
directory, real_time = Path(sys.argv[1]), sys.argv[2] == "real"
last = np.memmap(directory.with_suffix(".last"), dtype=float, mode="r+", shape=(1,))
out = EpisodeWriter(directory, COLUMNS, METADATA, wait_for_disk=not real_time)
row, start, index = np.empty(41), time.perf_counter(), 0
while True:
    row[:] = index * 1e-3
    out.append(row, "a" if index < 700 else "b")
    last[0] = row[0]
    index += 1
    while real_time and time.perf_counter() - start < index * 1e-3:
        time.sleep(2e-4)
"""


def run_and_kill(directory, pace, after):
    """Kills an endless run after this much episode time; returns the last time it recorded."""
    (directory.parent / "tests_crash_data.py").write_text(f"COLUMNS = {COLUMNS!r}\nMETADATA = {METADATA!r}\n")
    np.zeros(1).tofile(directory.with_suffix(".last"))
    last = np.memmap(directory.with_suffix(".last"), dtype=float, mode="r")
    path = os.pathsep.join([str(CHECKOUT), str(directory.parent)])
    command = [sys.executable, "-c", RUN, str(directory), pace]
    process = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path})
    deadline = time.monotonic() + 20
    while last[0] < after and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.001)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert last[0] >= after
    return float(last[0])


@pytest.mark.parametrize(("pace", "after"), [("real", 1.73), ("fast", 3.31), ("fast", 17.0)])
def test_kill_minus_nine_loses_at_most_the_last_second(tmp_path, pace, after):
    for attempt in range(ATTEMPTS):
        directory = tmp_path / f"run-{attempt}"
        end = run_and_kill(directory, pace, after)
        assert not (directory / "episode.parquet").exists()
        stock = [pq.read_table(path) for path in sorted(directory.glob("*.parquet"))]
        times = np.concatenate([part["time"].to_numpy() for part in stock])
        assert np.array_equal(times, np.arange(len(times)) * 1e-3)
        if times[-1] >= end - 1.0:
            break
    assert times[-1] >= end - 1.0

    episode = read_episode(directory)
    assert [path.name for path in directory.glob("*.parquet")] == ["episode.parquet"]
    assert np.array_equal(episode.time, times)
    assert np.array_equal(episode.position["j39"], times)
    assert episode.phase_intervals() == (("a", 0, 700), ("b", 700, len(times)))
    assert not episode.complete
    again = read_episode(directory / "episode.parquet")
    assert np.array_equal(again.time, times)


def new_writer(directory, wait_for_disk=True):
    return EpisodeWriter(directory, ["time", "position.a"], METADATA, wait_for_disk=wait_for_disk)


def fill(out, rows, period=1e-3):
    for index in range(rows):
        out.append(np.array([index * period, index]))


@pytest.fixture
def crashed(tmp_path):
    """A directory as a kill leaves it, and the rows in it."""
    live, dead = tmp_path / "live", tmp_path / "dead"
    with new_writer(live) as out:
        fill(out, 3000)
        shutil.copytree(live, dead, ignore=shutil.ignore_patterns(".*"))
    assert len(part_paths(dead)) >= 2
    return dead, sum(pq.read_metadata(path).num_rows for path in part_paths(dead))


def test_a_run_that_is_going_on_is_read_but_not_merged(tmp_path):
    with new_writer(tmp_path) as out:
        fill(out, 2500)
        before = part_paths(tmp_path)
        rows = read_episode(tmp_path).position["a"]
        assert len(rows) >= 1500
        assert np.array_equal(rows, np.arange(len(rows)))
        assert set(before) <= set(part_paths(tmp_path))
    assert len(read_episode(tmp_path)) == 2500


def test_a_new_run_does_not_mix_with_what_a_crash_left(crashed):
    dead, rows = crashed
    with pytest.raises(BadInput, match="already holds"):
        new_writer(dead)
    assert len(read_episode(dead)) == rows


def test_a_half_written_part_is_ignored(crashed):
    dead, rows = crashed
    (dead / ".episode.part-00099.parquet.tmp").write_bytes(b"PAR1 half")
    assert len(read_episode(dead)) == rows


def test_what_a_kill_left_of_a_picture_goes_and_what_is_being_written_stays(crashed):
    dead, rows = crashed
    assert len(read_episode(dead)) == rows
    left = dead / ".picture.png.tmp"
    left.write_bytes(b"half")
    read_episode(dead)
    assert not left.exists()
    with whole_file(dead / "picture.png") as stream:
        stream.write(b"whole")
        read_episode(dead)
    assert (dead / "picture.png").read_bytes() == b"whole"


def test_a_kill_while_the_merged_parts_are_removed_loses_and_doubles_nothing(crashed):
    dead, rows = crashed
    newest = part_paths(dead)[-1]
    content = newest.read_bytes()
    read_episode(dead)
    newest.write_bytes(content)
    assert len(read_episode(dead)) == rows
    assert part_paths(dead) == ()


def test_a_damaged_part_is_named(crashed):
    dead, _ = crashed
    bad = part_paths(dead)[1]
    bad.write_bytes(bad.read_bytes()[:-20])
    with pytest.raises(BadInput, match=f"is damaged: {bad.name}: "):
        read_episode(dead)
    assert len(part_paths(dead)) >= 2  # nothing was thrown away


def test_the_lock_is_free_once_the_run_is_over(tmp_path):
    with new_writer(tmp_path) as out:
        assert RunLock.try_acquire(tmp_path) is None
        out.append(np.zeros(2))
    lock = RunLock.try_acquire(tmp_path)
    assert lock is not None
    lock.release()


def test_a_simulation_waits_for_a_slow_disk(tmp_path, monkeypatch):
    def slow_write(path, table, write=writer.write_part):
        time.sleep(0.03)
        write(path, table)

    monkeypatch.setattr(writer, "write_part", slow_write)
    lag = 0.0
    with new_writer(tmp_path) as out:
        for index in range(6000):
            out.append(np.array([index * 1e-3, 0.0]))
            lag = max(lag, (index - out._ring.released) * 1e-3)
    assert 0.4 < lag < 0.9
    assert len(read_episode(tmp_path)) == 6000


def test_a_robot_never_waits_for_a_stuck_disk_and_stops_when_its_memory_is_full(tmp_path, monkeypatch):
    stuck, write = threading.Event(), writer.write_part
    monkeypatch.setattr(ring, "RING_BYTES", 0)
    monkeypatch.setattr(writer, "write_part", lambda *part: (stuck.wait(), write(*part)))
    out = new_writer(tmp_path, wait_for_disk=False)
    with pytest.raises(SafetyStop, match="the disk has not taken a row"):
        fill(out, 5000, period=0.1)
    assert 1000 < out.rows < 2000
    stuck.set()
    assert len(read_episode(out.close())) == out.rows
