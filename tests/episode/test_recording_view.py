# SPDX-License-Identifier: BSD-3-Clause
"""The rerun recording and the picture show what the run was, and never cost the run anything."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from impedance_modules.episode import live_view as view_module
from impedance_modules.episode import view_layout, viewer
from impedance_modules.episode.background import Background
from impedance_modules.episode.columns import joint_columns, pose_columns, target_columns, wrench_columns
from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.live_view import FILE_TIMEOUT, RATE, RecordingView
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.rerun_writer import (
    METRES_PER_NEWTON,
    METRES_PER_NEWTON_METRE,
    RerunRecording,
    new_stream,
    open_stream,
)
from impedance_modules.episode.run_picture import write_picture
from impedance_modules.episode.view_scene import BodyShape, EllipsoidStyle, Scene, SceneBody, ViewSample
from impedance_modules.errors import BadInput
from tests.support.log_metadata import log_metadata
from tests.support.paths import CHECKOUT

ARM = (BodyShape("shell", "capsule", (0.05, 0.2)), BodyShape("cap", "sphere", (0.06,)))
CRATE = (BodyShape("crate", "box", (0.3, 0.2, 0.2)),)
TABLE = (BodyShape("top", "cylinder", (0.5, 0.04)),)
SCENE = Scene(
    bodies=(SceneBody("upper arm", ARM, "robot"), SceneBody("crate", CRATE, "object")),
    surfaces=(SceneBody("table", TABLE, "surface"),),
    springs=("left/hand",),
    wrenches=("left", "right"),
    ellipsoids=(EllipsoidStyle("left/inertia", 0.1), EllipsoidStyle("left/stiffness", 1e-4)),
    limbs={"left": ("l0", "l1"), "right": ("r0",)},
    tracked=("left",),
    constraints=("torque", "power"),
    tank_floor=0.5,
    tank_max=10.0,
)


def sample(index, rng):
    arrays = {name: rng.normal(size=shape) for name, shape in SCENE.shapes_of_sample().items()}
    arrays["half_axes"] = np.abs(arrays["half_axes"])
    if index == 3:
        arrays["half_axes"][1] = np.nan
    messages = ("contact lost",) if index == 5 else ()
    phase = "lower" if index < 4 else "slide"
    return ViewSample(index * 0.02, tank=5.0, phase=phase, messages=messages, **arrays)


def write_recording(path, scene, samples, name):
    """Writes a whole recording at once, from samples that exist already."""
    file = RerunRecording(open_stream(path, name), scene)
    file.write(list(samples))
    file.close(timeout=FILE_TIMEOUT)
    return path


def samples(count, seed=0):
    rng = np.random.default_rng(seed)
    return [sample(index, rng) for index in range(count)]


@contextmanager
def recording(folder, period=0.05, **options):
    """A recording that is written meanwhile, every ``period`` [s]."""
    background = Background(period)
    view = RecordingView(folder, SCENE, background, **{"name": "press", "live": False, **options})
    try:
        yield view
    finally:
        background.stop()
        view.close()


def column(path, entity, component):
    """Returns one component of one entity over time, as the file has it: times [s], lists of numbers."""
    times, values = [], []
    for chunk in RrdReader(str(path)).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                times += (batch["time"].cast(pa.int64()).to_numpy() * 1e-9).tolist()
                values += batch[component].to_pylist()
    return np.array(times), values


def recorded_times(folder):
    return column(folder / "recording.rrd", view_layout.TANK, "Scalars:scalars")[0]


def paths_in(path):
    return set(RrdReader(str(path)).store().schema().entity_paths())


def test_the_file_holds_every_thing_of_the_scene(tmp_path):
    path = write_recording(tmp_path / "run.rrd", SCENE, samples(8), "press")
    found = paths_in(path)
    expected = {
        view_layout.entity("world", "robot", "upper arm", "shell"),
        view_layout.entity("world", "object", "crate", "crate"),
        view_layout.entity("world", "surface", "table", "top"),
        view_layout.spring_path("left/hand"),
        view_layout.wrench_path("right"),
        view_layout.ellipsoid_path("left/stiffness"),
        view_layout.torque_path("left"),
        view_layout.force_path("left"),
        view_layout.TANK,
        view_layout.ACTIVE_ROWS,
        view_layout.POSITION_ERROR,
        view_layout.ANGLE_ERROR,
        view_layout.PHASE,
        view_layout.LOG,
    }
    assert expected <= found
    (blueprint,) = RrdReader(str(path)).blueprints()
    assert blueprint.application_id == view_layout.APPLICATION
    verify = [sys.executable, "-m", "rerun", "rrd", "verify", str(path)]
    verified = subprocess.run(verify, capture_output=True, check=False)
    assert verified.returncode == 0, verified.stderr


THREADS = """
import os, sys, time
from pathlib import Path
from tests.episode.test_recording_view import SCENE, samples, write_recording

def write(count):
    for number in range(count):
        write_recording(Path(sys.argv[1]) / f"{number}.rrd", SCENE, samples(2), "press")

def threads():
    return len(os.listdir("/proc/self/task"))

write(2)
before = threads()
write(8)
deadline = time.monotonic() + 20.0
while threads() >= before + 8 and time.monotonic() < deadline:
    time.sleep(0.05)  # a thread that was told to end may still be ending
print(threads() - before)
"""


def test_no_thread_of_a_recording_stays_behind(tmp_path):
    """rerun's own way to send a layout leaves two threads of every recording, and their memory.

    Counted in a process of its own, where no other test starts or ends a thread meanwhile.
    """
    command = [sys.executable, "-c", THREADS, str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    counted = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert int(counted.stdout) < 8  # fewer than one for each recording


SCALE = np.repeat([METRES_PER_NEWTON, METRES_PER_NEWTON_METRE], 3)
DRAWN = [
    # entity, component, what a sample says of it
    (view_layout.wrench_path("right"), "Arrows3D:vectors", lambda s: s.wrenches[1] * SCALE),
    (view_layout.spring_path("left/hand"), "LineStrips3D:strips", lambda s: s.springs[0]),
    (view_layout.body_path("object", "crate"), "Transform3D:translation", lambda s: s.poses[1, :3]),
    # What does not exist, is not drawn.
    (view_layout.ellipsoid_path("left/stiffness"), "Ellipsoids3D:half_sizes",
     lambda s: np.nan_to_num(s.half_axes[1]) * 1e-4),
    (view_layout.torque_path("right"), "Scalars:scalars", lambda s: s.torque_ratio[2]),
    (view_layout.ANGLE_ERROR, "Scalars:scalars", lambda s: np.degrees(s.tracking_error[0, 1])),
    (view_layout.TANK, "Scalars:scalars", lambda s: [5.0, 0.5, 10.0]),
]  # fmt: skip


def test_the_numbers_in_the_file_are_the_sample_s(tmp_path):
    given = samples(8, seed=1)
    path = write_recording(tmp_path / "run.rrd", SCENE, given, "press")
    for entity, component, said in DRAWN:
        times, found = column(path, entity, component)
        assert np.allclose(times, [one.time for one in given], atol=1e-9)
        expected = np.array([said(one) for one in given])
        assert np.allclose(np.reshape(found, expected.shape), expected, rtol=1e-6), entity
    starts, names = column(path, view_layout.PHASE, "StateChange:state")
    assert np.allclose(starts, [0.0, 0.08])
    assert names == [["lower"], ["slide"]]
    _, texts = column(path, view_layout.LOG, "TextLog:text")
    assert texts == [["phase lower"], ["phase slide"], ["contact lost"]]


def test_a_sample_that_does_not_fit_is_refused(tmp_path):
    wrong = replace(samples(1)[0], wrenches=np.zeros((1, 6)))
    refusal = pytest.raises(BadInput, match=r"'wrenches' has shape \(1, 6\) \(valid: \(2, 6\)")
    with recording(tmp_path) as view, refusal:
        view.add(wrong)


@pytest.mark.parametrize("period", [0.001, 0.0025, 0.01])
def test_the_view_takes_25_samples_a_second_and_loses_none(tmp_path, period):
    base, wanted = samples(1)[0], []
    with recording(tmp_path) as view:
        for now in period * np.arange(round(4.0 / period)):
            if view.due(now):
                view.add(replace(base, time=now))
                wanted.append(now)
    assert len(wanted) == pytest.approx(4.0 * RATE, abs=3)
    assert np.allclose(np.sort(recorded_times(tmp_path)), wanted, atol=1e-6)
    assert view.dropped == 0
    assert view.failure is None


def test_adding_a_sample_never_waits_for_rerun(tmp_path, monkeypatch):
    base = samples(1)[0]
    with recording(tmp_path, period=0.01) as view:
        write = view._file.write
        monkeypatch.setattr(view._file, "write", lambda batch: (time.sleep(0.3), write(batch)))
        start = time.perf_counter()
        for index in range(3000):
            view.add(replace(base, time=index * 0.02))
        assert time.perf_counter() - start < 0.5
        assert view.dropped > 0  # memory is bounded, and what was thrown away is counted
    assert len(recorded_times(tmp_path)) + view.dropped == 3000


def start_server(home):
    """Returns a process that receives streams like a viewer's window, and its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "rerun", "--serve-grpc", "--port", str(port)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    environment = {**os.environ, "HOME": str(home)}
    server = subprocess.Popen(command, env=environment, start_new_session=True, **quiet)
    deadline = time.monotonic() + 15
    while time.monotonic() < deadline:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return server, f"rerun+http://127.0.0.1:{port}/proxy"
        time.sleep(0.05)
    raise AssertionError("the server did not start")


def test_a_window_that_is_closed_harms_neither_run_nor_file(tmp_path, monkeypatch):
    server, address = start_server(tmp_path)

    def stream_to_server(name):
        stream = new_stream(name)
        stream.connect_grpc(address)
        return stream

    monkeypatch.setattr(view_module, "open_live_stream", stream_to_server)
    with recording(tmp_path, period=0.02, live=True) as view:
        for one in samples(120):
            view.add(one)
            if one.time == 1.0:
                os.killpg(server.pid, signal.SIGKILL)  # rerun's command starts another process
                server.wait()
        start = time.perf_counter()
    assert server.poll() is not None
    assert time.perf_counter() - start < 5.0
    assert view.failure is None
    assert len(recorded_times(tmp_path)) == 120


KILLED = """
import sys, time
from dataclasses import replace
from pathlib import Path
from tests.episode.test_recording_view import recording, samples
base = samples(1)[0]
with recording(Path(sys.argv[1])) as view:
    for index in range(500):
        view.add(replace(base, time=index * 0.02))
    time.sleep(1.0)
    print("ready", flush=True)
    time.sleep(60)
"""


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_killed_run_leaves_a_recording_that_opens(tmp_path):
    command = [sys.executable, "-c", KILLED, str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment)
    assert process.stdout.readline() == b"ready\n"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert len(recorded_times(tmp_path)) >= 400


def log_columns(count=500):
    time_axis = np.arange(count) * 0.01
    wave = np.sin(time_axis)
    joints = (*joint_columns("position", "xyz"), *joint_columns("effort", "xyz"), "odd")
    frames = (*pose_columns("tip"), *target_columns("tip"), *wrench_columns("tip"))
    phases = ["a"] * 200 + ["b"] * (count - 200)
    return {"time": time_axis, "phase": phases, "tank": 5 + wave} | dict.fromkeys((*joints, *frames), wave)


def test_a_foreign_log_becomes_curves(tmp_path):
    path = write_episode(tmp_path / "log.parquet", log_columns(), log_metadata())
    made = viewer.recording_from_episode(read_episode(path), tmp_path / "log.rrd")
    found = paths_in(made)
    assert {view_layout.column_path("joints", kind) for kind in ("position", "effort")} <= found
    assert view_layout.column_path("joints", "velocity") not in found
    assert view_layout.column_path("wrench", "tip") in found
    _, values = column(made, view_layout.column_path("joints", "effort"), "Scalars:scalars")
    assert np.array_equal(values, np.tile(np.sin(np.arange(500) * 0.01)[:, None], 3))


def test_what_is_opened(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(viewer, "open_viewer", opened.append)
    log = write_episode(tmp_path / "log.parquet", log_columns(), log_metadata())
    assert viewer.view_episode(log) == tmp_path / "log.rrd"
    run = tmp_path / "run"
    run.mkdir()
    write_episode(run / "episode.parquet", log_columns(), log_metadata())
    write_recording(run / "recording.rrd", SCENE, samples(3), "press")
    before = (run / "recording.rrd").read_bytes()
    assert viewer.view_episode(run) == viewer.view_episode(run / "episode.parquet") == run / "recording.rrd"
    assert (run / "recording.rrd").read_bytes() == before
    with pytest.raises(BadInput, match="no such recording"):
        viewer.view_episode(tmp_path / "missing.rrd")
    assert opened == [tmp_path / "log.rrd", run / "recording.rrd", run / "recording.rrd"]


@pytest.mark.skipif(sys.platform != "linux", reason="how a missing display shows itself differs")
def test_without_a_display_the_viewer_says_so(tmp_path, monkeypatch):
    for name in viewer.DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(BadInput, match="no display"):
        viewer.open_viewer(tmp_path / "any.rrd")
    with pytest.raises(BadInput, match="no display"):
        viewer.open_live_stream("press")


@pytest.mark.parametrize("keep", ["time position", "time position effort phase", "all", "known limits"])
def test_every_episode_has_a_picture(tmp_path, keep):
    columns = log_columns()
    more = {}
    if keep == "known limits":
        limits = {"effort_max": dict.fromkeys("xyz", 2.0), "tank": {"floor": 1, "max": 8}}
        more = {"limbs": {"arm": list("xyz")}, **limits}
    elif keep != "all":
        columns = {name: values for name, values in columns.items() if name.partition(".")[0] in keep.split()}
    episode = read_episode(write_episode(tmp_path / "log.parquet", columns, log_metadata(**more)))
    picture = write_picture(episode, tmp_path / "picture.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 20_000


def test_reading_an_episode_imports_neither_rerun_nor_matplotlib():
    code = (
        "import sys, impedance_modules.episode.writer, impedance_modules.episode.reader\n"
        "print(sorted({'rerun', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, cwd=CHECKOUT)
    assert done.stdout == b"[]\n"


def test_a_long_recording_is_written_in_larger_pieces(tmp_path, monkeypatch):
    written, base = [], samples(1)[0]
    with recording(tmp_path, period=100.0, rate=5.0) as view:
        monkeypatch.setattr(view._file, "write", lambda batch: written.append(batch[-1].time - batch[0].time))
        for index in range(round(400.0 * 5.0)):
            view.add(replace(base, time=index / 5.0))
            view._drain(False)
        assert written[0] == pytest.approx(1.0)
        assert np.diff(written).min() > -0.25
        assert written[-1] == pytest.approx(5.0, abs=0.25)
        assert len(written) < 200  # 400 pieces of one second would be
