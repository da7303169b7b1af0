# SPDX-License-Identifier: BSD-3-Clause
"""Writes view samples as a rerun recording, many instants with one call for each entity."""

from __future__ import annotations

import atexit
import errno
import os
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

from impedance_modules.arrays import Array
from impedance_modules.episode import view_layout
from impedance_modules.episode.view_layout import run_layout
from impedance_modules.episode.view_scene import (
    ARRAYS,
    BODY,
    FORCE,
    LIMIT,
    SPRING,
    TORQUE,
    BodyShape,
    Scene,
    SceneBody,
    ViewSample,
    check_sample,
    series_colour,
)
from impedance_modules.errors import BadInput, NotRecorded

METRES_PER_NEWTON = 0.015
METRES_PER_NEWTON_METRE = 0.1

LEAST_FREE = 4_000_000
"""What a disk must have left for a recording to go on [bytes]: more than a batch and what rerun holds back."""

LETTING_GO = 1.0
"""How long the end of a recording waits for rerun to forget it [s]."""


class RerunRecording:
    """A recording that grows: the arms in 3D with their springs, wrenches and ellipsoids, and curves."""

    def __init__(
        self, stream: rr.RecordingStream, scene: Scene, pause: Callable[[], None] = lambda: None
    ) -> None:
        """Writes what does not change.

        Args:
            stream: Open, from `open_stream` or a live viewer's.
            scene: What is shown.
            pause: Called before every piece of work, for a thread that must not do all at once.
        """
        self._stream, self._pause = stream, pause
        self._scene = scene
        self._phase: str | None = None
        send_layout(self._stream, run_layout(scene))
        self._write_solids()
        self._write_styles()

    def write(self, samples: Sequence[ViewSample]) -> None:
        """Appends samples in the order of their time.

        Raises:
            BadInput: A sample that does not fit the scene.
        """
        if not samples:
            return
        for sample in samples:
            self._pause()
            check_sample(self._scene, sample)
        stacked = {name: np.stack([getattr(sample, name) for sample in samples]) for name in ARRAYS}
        index = time_index(np.array([sample.time for sample in samples]))
        self._write_poses(index, stacked)
        self._write_springs(index, stacked)
        self._write_wrenches(index, stacked)
        self._write_ellipsoids(index, stacked)
        self._write_curves(index, stacked, np.array([sample.tank for sample in samples]))
        self._write_texts(samples)

    def close(self, timeout: float) -> None:
        """Sends what is buffered and, to a file, its table of contents.

        In a thread of its own: on a disk that became full rerun waits for ever, whatever the time-out, and once more
        when the process ends.

        Args:
            timeout: How long to wait for the other end [s].

        Raises:
            RuntimeError: The other end did not take it all.
        """
        failures: list[RuntimeError] = []
        held = [self._stream]
        del self._stream
        if not _done_within(timeout + 1.0, _finish, held, timeout, failures):
            failures.append(RuntimeError(f"the recording is not finished after {timeout:g} s"))
        if failures:
            raise failures[0]
        _done_within(LETTING_GO, _let_go)

    def _write_solids(self) -> None:
        world = rr.ViewCoordinates.RIGHT_HAND_Z_UP
        self._stream.log(view_layout.WORLD, world, static=True)
        for body in (*self._scene.bodies, *self._scene.surfaces):
            path = view_layout.body_path(body.role, body.name)
            for shape in body.shapes:
                self._stream.log(f"{path}{view_layout.entity(shape.name)}", solid(shape, body), static=True)

    def _write_styles(self) -> None:
        scene = self._scene
        for style in scene.ellipsoids:
            look = rr.Ellipsoids3D.from_fields(fill_mode="transparentfillmajorwireframe")
            self._stream.log(view_layout.ellipsoid_path(style.name), look, static=True)
        for limb, joints in scene.limbs.items():
            self._style(view_layout.torque_path(limb), joints)
        for name in scene.wrenches:
            self._style(view_layout.force_path(name), ("x", "y", "z"))
        self._style(view_layout.POSITION_ERROR, scene.tracked)
        self._style(view_layout.ANGLE_ERROR, scene.tracked)
        self._style(view_layout.ACTIVE_ROWS, scene.constraints)
        colours = [series_colour(2), LIMIT, LIMIT]
        tank = rr.SeriesLines(names=["tank", "floor", "max"], colors=colours, widths=[2.0, 1.0, 1.0])
        self._stream.log(view_layout.TANK, tank, static=True)

    def _style(self, path: str, names: Sequence[str]) -> None:
        colours = [series_colour(index) for index in range(len(names))]
        self._stream.log(path, rr.SeriesLines(names=list(names), colors=colours), static=True)

    def _write_poses(self, index: rr.TimeColumn, stacked: dict[str, Array]) -> None:
        for number, body in enumerate(self._scene.bodies):
            pose = stacked["poses"][:, number]
            columns = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, 3:])
            self._send(view_layout.body_path(body.role, body.name), index, columns)

    def _write_springs(self, index: rr.TimeColumn, stacked: dict[str, Array]) -> None:
        for number, name in enumerate(self._scene.springs):
            ends = stacked["springs"][:, number]
            path = view_layout.spring_path(name)
            columns = rr.LineStrips3D.columns(
                strips=list(ends), colors=_repeat(SPRING, ends), radii=_thin(ends)
            )
            self._send(path, index, columns)
            columns = rr.Points3D.columns(
                positions=ends[:, 1], colors=_repeat(SPRING, ends), radii=np.full(len(ends), 0.012)
            )
            self._send(f"{path}/equilibrium", index, columns)

    def _write_wrenches(self, index: rr.TimeColumn, stacked: dict[str, Array]) -> None:
        scale = np.repeat([METRES_PER_NEWTON, METRES_PER_NEWTON_METRE], 3)
        for number, name in enumerate(self._scene.wrenches):
            wrench = stacked["wrenches"][:, number]
            vectors = (wrench * scale).reshape(-1, 3)
            points = np.repeat(stacked["wrench_points"][:, number], 2, axis=0)
            colours = np.tile([FORCE, TORQUE], (len(wrench), 1))
            columns = rr.Arrows3D.columns(
                vectors=vectors, origins=points, colors=colours, radii=_thin(vectors)
            )
            self._send(view_layout.wrench_path(name), index, columns.partition([2] * len(wrench)))
            self._send_curves(view_layout.force_path(name), index, wrench[:, :3])

    def _write_ellipsoids(self, index: rr.TimeColumn, stacked: dict[str, Array]) -> None:
        for number, style in enumerate(self._scene.ellipsoids):
            pose = stacked["ellipsoid_poses"][:, number]
            # What is not finite (a folding arm, a singular hand) has no ellipsoid: draw none.
            half = np.nan_to_num(stacked["half_axes"][:, number], nan=0.0, posinf=0.0, neginf=0.0)
            columns = rr.Ellipsoids3D.columns(
                half_sizes=half * style.scale,
                centers=pose[:, :3],
                quaternions=pose[:, 3:],
                colors=_repeat((*series_colour(number)[:3], 120), half),
            )
            self._send(view_layout.ellipsoid_path(style.name), index, columns)

    def _write_curves(self, index: rr.TimeColumn, stacked: dict[str, Array], tank: Array) -> None:
        scene, first = self._scene, 0
        for limb, joints in scene.limbs.items():
            ratio = stacked["torque_ratio"][:, first : first + len(joints)]
            self._send_curves(view_layout.torque_path(limb), index, ratio)
            first += len(joints)
        bounds = np.tile([scene.tank_floor, scene.tank_max], (len(tank), 1))
        self._send_curves(view_layout.TANK, index, np.column_stack([tank, bounds]))
        self._send_curves(view_layout.POSITION_ERROR, index, 1000 * stacked["tracking_error"][:, :, 0])
        self._send_curves(view_layout.ANGLE_ERROR, index, np.degrees(stacked["tracking_error"][:, :, 1]))
        self._send_curves(view_layout.ACTIVE_ROWS, index, stacked["active_rows"].astype(float))

    def _write_texts(self, samples: Sequence[ViewSample]) -> None:
        for sample in samples:
            self._pause()
            self._stream.set_time(view_layout.TIMELINE, duration=sample.time)
            if sample.phase != self._phase:
                self._phase = sample.phase
                self._stream.log(view_layout.PHASE, rr.StateChange(state=sample.phase))
                self._stream.log(view_layout.LOG, rr.TextLog(f"phase {sample.phase}", level="INFO"))
            for message in sample.messages:
                self._stream.log(view_layout.LOG, rr.TextLog(message, level="WARN"))

    def _send(self, path: str, index: rr.TimeColumn, columns: Any) -> None:
        self._pause()
        self._stream.send_columns(path, indexes=[index], columns=columns)
        self._pause()

    def _send_curves(self, path: str, index: rr.TimeColumn, values: Array) -> None:
        self._pause()
        send_curves(self._stream, path, index, values)


def _done_within(seconds: float, work: Callable[..., None], *given: Any) -> bool:
    """Does rerun's work in a thread, and tells whether it came to an end; if not, the process ends without rerun."""
    thread = threading.Thread(target=work, args=given, daemon=True)
    thread.start()
    thread.join(seconds)
    if thread.is_alive():
        atexit.unregister(rr.rerun_shutdown)
    return not thread.is_alive()


def _finish(held: list[rr.RecordingStream], timeout: float, failures: list[RuntimeError]) -> None:
    """Closes a stream that nobody else holds; what goes wrong is added to ``failures``."""
    stream = held.pop()
    try:
        stream.flush(timeout_sec=timeout)
        stream.disconnect()
    except RuntimeError as failure:
        failures.append(failure)


def _let_go() -> None:
    """Makes rerun forget the streams that nobody holds any more; until then it keeps what it wrote.

    It waits for all of them, a window that somebody closed included, and complains about those.
    """
    with suppress(RuntimeError):
        rerun_bindings.flush_and_cleanup_orphaned_recordings()


def new_stream(name: str) -> rr.RecordingStream:
    """Returns a stream without a destination yet, with episode time as its only clock.

    Args:
        name: Of the recording, as the viewer lists it.
    """
    stream = rr.RecordingStream(view_layout.APPLICATION)
    stream.disable_timeline("log_time")
    stream.disable_timeline("log_tick")
    stream.send_recording_name(name)
    return stream


def refuse_short_disk(path: Path) -> None:
    """Raises before rerun can meet a full disk, which stops its threads for ever.

    Raises:
        OSError: Less than `LEAST_FREE` is left where a file is written.
    """
    disk = os.statvfs(path.parent)
    free = disk.f_bavail * disk.f_frsize
    if free < LEAST_FREE:
        raise OSError(
            errno.ENOSPC, f"only {free / 1e6:.1f} MB are free, less than {LEAST_FREE / 1e6:g} MB", str(path)
        )


def open_stream(path: Path, name: str) -> rr.RecordingStream:
    """Opens a stream into a file, which is replaced if there; what was written survives a kill.

    Raises:
        NotRecorded: The file cannot be opened.
    """
    try:
        refuse_short_disk(path)
        stream = new_stream(name)
        stream.save(str(path))
    except (OSError, RuntimeError) as error:
        raise NotRecorded(f"{path}: cannot be written: {error}") from error
    return stream


def send_layout(stream: rr.RecordingStream, layout: rrb.Blueprint) -> None:
    """Sends how the window is laid out, as ``stream.send_blueprint`` does, and leaves nothing behind in the process.

    rerun 0.41 writes a layout into a recording of its own in memory. That one and its memory hold each other, so two
    threads and 0.5 MB of each layout stay until the process ends, unless somebody disconnects it.
    """
    own = rerun_bindings.new_blueprint(
        application_id=view_layout.APPLICATION,
        make_default=False,
        make_thread_default=False,
        default_enabled=True,
    )
    written = rr.RecordingStream._from_native(own)
    written.set_time("blueprint", sequence=0)
    layout._log_to_stream(written)
    kept = written.memory_recording()
    rerun_bindings.send_blueprint(kept.storage, True, True, recording=stream.to_native())
    written.disconnect()


def time_index(seconds: Array) -> rr.TimeColumn:
    """Returns the instants [s] of a batch."""
    return rr.TimeColumn(view_layout.TIMELINE, duration=seconds)


def send_curves(stream: rr.RecordingStream, path: str, index: rr.TimeColumn, values: Array) -> None:
    """Appends (instants, curves) to one entity; nothing if there are no curves."""
    instants, curves = values.shape
    if curves:
        columns = rr.Scalars.columns(scalars=values.ravel()).partition([curves] * instants)
        stream.send_columns(path, indexes=[index], columns=columns)


def solid(shape: BodyShape, body: SceneBody) -> Any:
    """Returns a shape as rerun draws it, in its body's frame and colour."""
    # What the hands touch is see-through, so that springs and ellipsoids inside it stay visible.
    fill = "solid" if body.role == "robot" else "transparentfillmajorwireframe"
    return _SOLIDS[shape.kind](shape, {"colors": [BODY[body.role]], "fill_mode": fill})


def _repeat(colour: tuple[int, ...], like: Array) -> Any:
    """Returns one colour per instant."""
    return np.tile(np.array(colour, np.uint8), (len(like), 1))


def _thin(like: Array) -> Array:
    """Returns one line radius [m] per entry."""
    return np.full(len(like), 0.006)


def _capsule(shape: BodyShape, look: dict[str, Any]) -> Any:
    radius, length = shape.size
    x, y, z, w = shape.pose[3:]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    # rerun measures a capsule from the centre of its lower cap.
    start = np.array(shape.pose[:3]) - axis * length / 2
    return rr.Capsules3D(
        lengths=[length],
        radii=[radius],
        translations=[start],
        quaternions=[shape.pose[3:]],
        **look,
    )


def _box(shape: BodyShape, look: dict[str, Any]) -> Any:
    return rr.Boxes3D(sizes=[shape.size], **_placed(shape), **look)


def _cylinder(shape: BodyShape, look: dict[str, Any]) -> Any:
    radius, length = shape.size
    return rr.Cylinders3D(radii=[radius], lengths=[length], **_placed(shape), **look)


def _sphere(shape: BodyShape, look: dict[str, Any]) -> Any:
    return rr.Ellipsoids3D(radii=[shape.size[0]], **_placed(shape), **look)


def _triangles(shape: BodyShape, look: dict[str, Any]) -> Any:
    drawn, pose = shape.drawn, shape.pose
    if drawn is None:
        raise BadInput(f"shape '{shape.name}' has no triangles to be drawn")
    x, y, z, w = pose[3:]
    turn = np.array([x, y, z])
    # v + 2 w (u x v) + 2 u x (u x v) turns v by the unit quaternion (u, w).
    across = np.cross(turn, drawn.vertices)
    places = drawn.vertices + 2.0 * (w * across + np.cross(turn, across)) + np.array(pose[:3])
    return rr.Mesh3D(
        vertex_positions=places, triangle_indices=drawn.triangles, albedo_factor=look["colors"][0]
    )


def _placed(shape: BodyShape) -> dict[str, Any]:
    return {"centers": [shape.pose[:3]], "quaternions": [shape.pose[3:]]}


_SOLIDS: dict[str, Callable[[BodyShape, dict[str, Any]], Any]] = {
    "capsule": _capsule,
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "triangles": _triangles,
}
