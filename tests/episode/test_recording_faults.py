# SPDX-License-Identifier: BSD-3-Clause
"""A full disk, a killed process, a second writer: what was recorded stays, and whoever runs is told."""

import errno
import io
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from benchmarks.runs.killed_recordings import look, record_and_kill
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_folder import EPISODE, LOCK, RECORDING, write_summary
from impedance_modules.episode.viewer import recording_from_episode
from impedance_modules.episode.writer import EpisodeWriter
from impedance_modules.errors import BadInput, NotRecorded
from impedance_modules.plant.playback import JointPath
from impedance_modules.runs.execution import RunOptions
from impedance_modules.runs.playback_run import make_playback, play_back
from tests.support.commands import python
from tests.support.forecast_tasks import assembled
from tests.support.log_metadata import log_metadata
from tests.support.paths import CHECKOUT

METADATA = log_metadata()
COLUMNS = ["time", *(f"position.j{number}" for number in range(10)), "phase"]


class Disk:
    """Files that are written through ``Path.open`` share this many free bytes; none comes back."""

    def __init__(self, free: int) -> None:
        self.free = free

    def open(self, path: Path, mode: str) -> io.BufferedRandom:
        disk = self

        class Limited(io.FileIO):
            def write(self, data) -> int:
                count = min(len(data), disk.free)
                if count == 0:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                disk.free -= count
                return super().write(bytes(data)[:count])

        return io.BufferedRandom(Limited(path, mode))


@pytest.fixture
def full_disk(monkeypatch):
    """Makes every file that is written whole or not at all be on a disk with so many free bytes."""
    opened = Path.open

    def limit(free: int) -> Disk:
        disk = Disk(free)

        def limited(path, mode="r", *rest, **more):
            return disk.open(path, mode) if mode == "w+b" else opened(path, mode, *rest, **more)

        monkeypatch.setattr(Path, "open", limited)
        return disk

    return limit


def record(directory: Path, rows: int) -> EpisodeWriter:
    """Records rows whose every number is their time."""
    out = EpisodeWriter(directory, COLUMNS, METADATA, wait_for_disk=True)
    row = np.zeros(len(COLUMNS) - 1)
    try:
        for index in range(rows):
            row[:] = index * 1e-3
            out.append(row, "press")
        out.close()
    finally:
        out.abandon()
    return out


def hidden(directory: Path) -> list[str]:
    return [path.name for path in directory.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("seed", range(16))
def test_on_a_disk_that_is_full_at_any_byte_the_parts_stay_and_are_read_as_they_are(
    tmp_path, full_disk, seed
):
    disk = full_disk(10**9)
    record(tmp_path / "whole", 4000)
    # How many parts there are, and so how many footers, depends on the machine's speed.
    disk = full_disk(int(np.random.default_rng(seed).uniform(0.0, 0.9) * (10**9 - disk.free)))
    with pytest.raises(NotRecorded, match="cannot be written") as stopped:
        record(tmp_path / "run", 4000)
    assert stopped.value.exit_code == 3
    run = tmp_path / "run"
    assert hidden(run) == []
    paths = sorted(run.glob("*.parquet"))
    stock = [pq.read_table(path)["time"].to_numpy() for path in paths]
    times = np.concatenate([np.zeros(0), *stock])
    assert np.array_equal(times, np.arange(len(times)) * 1e-3)
    if paths:
        for _ in range(2):
            episode = read_episode(run)
            assert np.array_equal(episode.time, times)
            assert np.array_equal(episode.position["j9"], times)
            assert not episode.complete
        assert sorted(run.glob("*.parquet")) == paths and hidden(run) == []
    disk.free = 10**9
    if paths:
        assert np.array_equal(read_episode(run).time, times)
        assert list(run.glob("*.parquet")) == [run / EPISODE]


def test_on_a_disk_with_room_for_the_parts_alone_nothing_recorded_is_lost(tmp_path, full_disk):
    disk = full_disk(10**9)
    record(tmp_path / "first", 4000)
    needed = 10**9 - disk.free
    merged = (tmp_path / "first" / EPISODE).stat().st_size
    for share in (0.1, 0.5, 0.9):
        full_disk(int(needed - share * merged))
        run = tmp_path / f"run-{share}"
        with pytest.raises(NotRecorded, match=f"{EPISODE}: cannot be written"):
            record(run, 4000)
        assert len(read_episode(run)) == 4000 and hidden(run) == []


@pytest.mark.parametrize("free", [0, 1, 30])
def test_a_summary_is_written_whole_or_not_at_all(tmp_path, full_disk, free):
    full_disk(free)
    with pytest.raises(NotRecorded, match=r"summary.json: cannot be written: No space left"):
        write_summary(tmp_path, {"name": "press", "values": list(range(100))})
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_at_the_start_is_no_bad_input(tmp_path, monkeypatch):
    def full(*given, **named):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "mkdir", full)
    with pytest.raises(NotRecorded, match="cannot be written"):
        record(tmp_path / "run", 1)


SMALL_FILES = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
from impedance_modules.cli.main import main
sys.argv = ["impedance", *sys.argv[2:]]
main()
"""


@pytest.mark.parametrize(("largest", "some"), [(1_000_000, True), (20_000, False)])
def test_a_run_whose_files_cannot_grow_ends_with_exit_3_and_its_parts(tmp_path, largest, some):
    run = tmp_path / "run"
    words = ["run", "soft-hold", "--duration", "3", "--out", str(run)]
    ended = python("-c", SMALL_FILES, str(largest), *words)
    assert ended.returncode == 3, ended.stderr
    assert "cannot be written" in ended.stderr and "Traceback" not in ended.stderr
    assert hidden(run) == []
    summary = json.loads((run / "summary.json").read_text())
    if some:
        assert len(read_episode(run)) >= 500
    else:
        # Not even a part: nothing was recorded, and the summary says why.
        assert list(run.glob("*.parquet")) == []
        assert summary["ending"] == "stopped" and "cannot be written" in summary["reason"]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_a_playback_on_a_full_disk_stops_and_keeps_its_parts(tmp_path, full_disk, share):
    task = assembled(CHECKOUT / "tasks" / "thesis" / "slide-over-position.yaml")
    path = JointPath(np.array([0.0, 1.0]), np.tile(task.modules.posture, (2, 1)))
    disk = full_disk(10**9)
    for run, free in (("first", None), ("second", share)):
        if free is not None:
            disk = full_disk(int(free * (10**9 - disk.free)))
        options = RunOptions(tmp_path / run, 0, None, live=False, read_only=False, backend="sim")
        playback = make_playback(task, path, 0)
        if free is None:
            assert play_back(task, playback, options, lambda *_: None).summary["ending"] == "done"
            continue
        with pytest.raises(NotRecorded, match="cannot be written"):
            play_back(task, playback, options, lambda *_: None)
        assert hidden(tmp_path / run) == []
        if any((tmp_path / run).glob("*.parquet")):
            assert np.all(np.diff(read_episode(tmp_path / run).time) > 0.0)


ON_A_SMALL_DISK = """
mount -t tmpfs -o size="$1" disk "$2" || exit 99
"$3" -m impedance_modules run soft-hold --duration 6 --out "$2/run"
ended=$?
cp -a "$2/run" "$4"
exit $ended
"""


def small_disk(size: str, place: Path, copy: Path) -> subprocess.CompletedProcess[str]:
    place.mkdir()
    words = ["unshare", "-rm", "sh", "-c", ON_A_SMALL_DISK, "sh", size, str(place), sys.executable, str(copy)]
    return subprocess.run(words, cwd=CHECKOUT, capture_output=True, text=True, check=False, timeout=300)


@pytest.mark.parametrize("size", ["160k", "4300k", "5m"])
def test_a_run_on_a_small_disk(tmp_path, size):
    try:
        ended = small_disk(size, tmp_path / "disk", tmp_path / "copy")
    except FileNotFoundError:
        pytest.skip("no command 'unshare' here")
    if ended.returncode in (1, 99) and "Traceback" not in ended.stderr:
        pytest.skip("this machine lets nobody mount a disk of their own")
    assert ended.returncode == 3, ended.stderr
    assert "cannot be written" in ended.stderr and "Traceback" not in ended.stderr
    copy = tmp_path / "copy"
    assert hidden(copy) == []
    stock = [pq.read_table(path)["time"].to_numpy() for path in sorted(copy.glob("*.parquet"))]
    if stock:
        times = np.concatenate(stock)
        assert np.allclose(np.diff(times), 0.002, atol=0.0015)
        assert np.array_equal(read_episode(copy).time, times)


def test_a_recording_made_for_the_viewer_is_whole_or_not_there(tmp_path):
    out = record(tmp_path / "run", 3000)
    path = out.directory / RECORDING
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        with pytest.raises(BadInput, match=r"recording.rrd: cannot be written"):
            recording_from_episode(read_episode(out.directory), path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not path.exists()


HOLD = """
import sys
from pathlib import Path
import numpy as np
from impedance_modules.episode.writer import EpisodeWriter
from tests.episode.test_recording_faults import COLUMNS, METADATA
out = EpisodeWriter(Path(sys.argv[1]), COLUMNS, METADATA, wait_for_disk=True)
print("ready", flush=True)
sys.stdin.readline()
out.append(np.zeros(len(COLUMNS) - 1))
out.close()
"""


def holding(directory: Path) -> subprocess.Popen[bytes]:
    """A process that has opened the directory and waits."""
    command = [sys.executable, "-c", HOLD, str(directory)]
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
    assert process.stdout.readline() == b"ready\n"
    return process


def test_two_processes_cannot_record_into_one_folder(tmp_path):
    first = holding(tmp_path / "run")
    ended = python("-m", "impedance_modules", "run", "soft-hold", "--out", str(tmp_path / "run"))
    assert ended.returncode == 2 and "another run is writing here" in ended.stderr
    first.communicate(b"\n")
    assert first.returncode == 0
    assert len(read_episode(tmp_path / "run")) == 1


def test_the_lock_of_a_dead_process_is_no_obstacle(tmp_path):
    first = holding(tmp_path / "run")
    first.kill()
    first.communicate()
    assert (tmp_path / "run" / LOCK).exists()
    record(tmp_path / "run", 10)
    assert len(read_episode(tmp_path / "run")) == 10 and hidden(tmp_path / "run") == []


ATTEMPTS = 4
"""A process in real time does not wait for the disk, which other tests may hold up for longer than a second."""


@pytest.mark.parametrize("kind", ["robot", "simulation"])
@pytest.mark.parametrize("seed", range(3))
def test_killed_at_a_random_moment_a_recording_lacks_at_most_its_last_second(tmp_path, kind, seed):
    rng = np.random.default_rng(seed)
    for attempt in range(ATTEMPTS if kind == "robot" else 1):
        assert record_and_kill(kind, tmp_path / f"{attempt}" / "run", rng.uniform(0.0, 3.0))
        lost = look(tmp_path / f"{attempt}" / "run").lost
        if lost <= 1.0:
            break
    assert lost <= 1.0


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_a_killed_run_is_opened_by_pyarrow_and_rerun(tmp_path, seed):
    after = np.random.default_rng(seed).uniform(0.0, 2.0)
    if not record_and_kill("run", tmp_path / "run", after):
        pytest.skip("the run was over before it was killed")
    assert look(tmp_path / "run").lost <= 1.0
