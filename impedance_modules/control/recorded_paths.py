# SPDX-License-Identifier: BSD-3-Clause
r"""Reads the paths that targets take from recordings, and keeps them for the recording of the run itself.

A recorded path is a list of poses at times u_j. It becomes a uniform cubic B-spline c(u) (``modules.recorded_path``)
with a control point every \Delta at most (``smoothing``), the least-squares solution of

    sum_j |c(u_j) - (p_j, q_j)|^2 = min

for position and quaternion, whose sign is chosen for the quaternion to be continuous. Noise of sensors and whatever
changes within \Delta are smoothed away; how far the path leaves the recorded places is stated. Where a frame's pose was
not recorded it follows from the recorded joints by the kinematics of the robot, if the recording is one of it.

A run's own recording carries the control points, so its torques can be computed again without the other file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadFile, BadInput, Problem, nearest
from impedance_modules.modules.recorded_path import path_motion
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import write_quaternion
from impedance_modules.spec.path_spec import PATH, TARGET, PathCourse, PathSpec, episode_path
from impedance_modules.spec.task import PhaseSpec, TaskSpec

if TYPE_CHECKING:
    from impedance_modules.episode.data import Episode

METADATA = "paths"
"""Key in a recording's metadata."""

FARTHEST_OFF = 0.01
"""A recorded place that the smooth path leaves by more than this is a jump, not a motion [m]."""

MOST_POINTS = 5000
"""Control points of one path."""

UNIT = 1e-3
"""How far from 1 the length of a recorded quaternion may be."""

Kept = Mapping[tuple[str, str], PathCourse]
"""(phase, target) -> path."""


class _Unusable(Exception):  # noqa: N818 - it is what is wrong with a path
    """A path that cannot be taken: the key at fault, what is wrong, and what would be valid."""

    def __init__(self, key: str, message: str, valid: Sequence[str] = ()) -> None:
        self.key, self.message, self.valid = key, message, tuple(valid)
        super().__init__(message)


def with_recorded_paths(task: TaskSpec, model: RobotModel, kept: Kept | None = None) -> TaskSpec:
    """Returns a task whose paths have been read; one without paths as it is.

    Args:
        task: To complete.
        model: The robot, for recordings without poses.
        kept: Paths that a recording of this task carries, instead of the files; None to read these.

    Raises:
        BadFile: Recordings that are missing or cannot be used, each with its line.
    """
    if not any(phase.paths for phase in task.phases):
        return task
    phases, problems = [], list[Problem]()
    for index, phase in enumerate(task.phases):
        paths = {}
        for target, path in phase.paths.items():
            try:
                course = _kept(kept, phase, target) or _read(task, model, target, path)
                paths[target] = _fitting(phase, replace(path, course=course))
            except _Unusable as fault:
                at = ("phases", index, "equilibrium", target, PATH, fault.key)
                problems.append(task.document.problem(at, fault.message, fault.valid))
        phases.append(replace(phase, paths=paths))
    if problems:
        raise BadFile(problems)
    return replace(task, phases=tuple(phases))


def paths_as_metadata(task: TaskSpec) -> dict[str, Any]:
    """Gives the paths of a task as a recording keeps them; nothing for a task without paths."""
    found = [
        {
            "phase": phase.name,
            "target": target,
            "spacing": course.spacing,
            "length": course.length,
            "deviation": course.deviation,
            "control": course.control.tolist(),
        }
        for phase in task.phases
        for target, path in phase.paths.items()
        if (course := path.course) is not None
    ]
    return {METADATA: found} if found else {}


def paths_of_metadata(metadata: Mapping[str, Any], place: str) -> Kept:
    """Reads the paths that a recording keeps; none where it keeps none.

    Args:
        metadata: Of the recording.
        place: The recording, for messages.

    Raises:
        BadInput: They are not as ``paths_as_metadata`` writes them.
    """
    found = {}
    for kept in metadata.get(METADATA, []):
        try:
            control = np.array(kept["control"], dtype=np.float64)
            course = PathCourse(control, *(float(kept[key]) for key in ("spacing", "length", "deviation")))
            found[str(kept["phase"]), str(kept["target"])] = course
        except (KeyError, TypeError, ValueError) as error:
            raise BadInput(f"{place}: metadata '{METADATA}' cannot be read: {error}") from None
        sound = control.ndim == 2 and control.shape[1] == 7 and 4 <= len(control) <= MOST_POINTS + 3
        if not (sound and np.isfinite(control).all() and course.spacing > 0.0 and course.length > 0.0):
            raise BadInput(
                f"{place}: metadata '{METADATA}' holds no path (valid: control points of 7 numbers each)"
            )
    return found


def _kept(kept: Kept | None, phase: PhaseSpec, target: str) -> PathCourse | None:
    if kept is None:
        return None
    if (phase.name, target) not in kept:
        raise _Unusable("episode", f"the recording does not carry the path of '{target}'")
    return kept[phase.name, target]


def _read(task: TaskSpec, model: RobotModel, target: str, path: PathSpec) -> PathCourse:
    """Reads one path from its file."""
    # Not every task has a path, and Arrow takes long to import.
    from impedance_modules.episode.reader import read_episode  # noqa: PLC0415

    frame = _frame_of(task, target) if path.frame is None else path.frame
    try:
        episode = read_episode(episode_path(task.path, path.episode), kinds=("pose", "target", "position"))
        time, poses = _stretch(episode, path, _poses(episode, path, frame, model))
    except BadInput as error:
        raise _Unusable("episode", str(error)) from None
    return fit_course(time, poses, path.smoothing)


def _frame_of(task: TaskSpec, target: str) -> str:
    arm, _, name = target.partition(".")
    return next(spring.frame for spring in task.arms[arm].springs if spring.name == name)


def _poses(episode: Episode, path: PathSpec, frame: str, model: RobotModel) -> Array:
    """Gives the recorded poses (N, 7) of a frame: as recorded, or from the recorded joints."""
    recorded = episode.target if path.of == TARGET else episode.pose
    if frame in recorded:
        return np.array(recorded[frame])
    if path.of == TARGET:
        message = (
            f"{episode.source}: no equilibrium of '{frame}' was recorded{nearest(frame, tuple(recorded))}"
        )
        raise _Unusable("frame", message, tuple(recorded) or ("of: pose",))
    if frame not in model.frames:
        message = (
            f"{episode.source}: neither its recorded poses nor the robot '{model.spec.name}' have a frame"
            f" '{frame}'{nearest(frame, (*recorded, *model.frames))}"
        )
        raise _Unusable("frame", message, tuple(recorded))
    if episode.robot != model.spec.name:
        message = (
            f"{episode.source}: no poses of '{frame}' were recorded, and its joints are those of the robot"
            f" '{episode.robot}', not of '{model.spec.name}'"
        )
        raise _Unusable(
            "episode", message, ("a recording with poses of this frame", "a recording of this robot")
        )
    return _poses_by_kinematics(episode, frame, model)


def _poses_by_kinematics(episode: Episode, frame: str, model: RobotModel) -> Array:
    limb = model.limb_of(frame)
    joints = episode.matrix("position", limb.joint_names)
    found, q = np.empty((len(joints), 7)), model.position({})
    for row, angles in zip(found, joints, strict=True):
        q[limb.joints] = angles
        pose = model.pose(q, frame)
        row[:3] = pose.translation
        write_quaternion(pose.rotation, row[3:])
    return found


def _stretch(episode: Episode, path: PathSpec, poses: Array) -> tuple[Array, Array]:
    """Cuts the part of a recording that is the path: its times (k,) from 0 on [s], and its poses (k, 7)."""
    time = episode.time
    first = time[0] if path.first is None else path.first
    last = time[-1] if path.last is None else path.last
    for key, stated in (("from", path.first), ("to", path.last)):
        if stated is not None and not time[0] <= stated <= time[-1]:
            message = f"{episode.source}: {stated:g} s is not within the recording"
            raise _Unusable(key, message, (f"{time[0]:g} to {time[-1]:g} s",))
    inside = (time >= first) & (time <= last)
    cut, poses = time[inside], poses[inside]
    if len(cut) < 2 or np.any(np.diff(cut) <= 0.0):
        raise _Unusable("episode", f"{episode.source}: its times do not ascend from sample to sample there")
    if not np.isfinite(poses).all():
        row = int(np.argmax(~np.isfinite(poses).all(axis=1)))
        raise _Unusable("episode", f"{episode.source}: a pose at {cut[row]:g} s is missing or not finite")
    off = np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0)
    if off.max() > UNIT:
        at = cut[int(np.argmax(off))]
        raise _Unusable("episode", f"{episode.source}: the quaternion at {at:g} s is not of length 1")
    return cut - cut[0], poses


def fit_course(time: Array, poses: Array, smoothing: float) -> PathCourse:
    """Fits the smooth path through recorded poses (the module's equation).

    Args:
        time: (k,) ascending, from 0 on [s].
        poses: (k, 7) positions [m] and unit quaternions (x, y, z, w).
        smoothing: Time between control points at most [s].
    """
    # Slow to import, and not every task has a path.
    from scipy.interpolate import make_lsq_spline  # noqa: PLC0415

    length, degree = float(time[-1]), 3
    segments = max(2, int(np.ceil(length / smoothing - 1e-9)))
    spacing = length / segments
    gap = float(np.diff(time).max())
    if gap > 0.5 * spacing:
        at = float(time[int(np.argmax(np.diff(time)))])
        message = f"no sample for {gap:g} s at {at:g} s into the path, more than half of its smoothing, {spacing:g} s"
        raise _Unusable(
            "smoothing", message, (f"smoothing: {2.0 * gap:.3g} or more", "a recording without gaps")
        )
    if segments > MOST_POINTS:
        message = f"{length:g} s in steps of {smoothing:g} s are more than {MOST_POINTS} control points"
        raise _Unusable(
            "smoothing", message, (f"smoothing: {length / MOST_POINTS:.3g} or more", "a shorter part")
        )
    knots = spacing * np.arange(-degree, segments + degree + 1)
    # The last sample must lie on the last knot, to the bit.
    knots[segments + degree] = length
    values = poses.copy()
    values[:, 3:] *= np.cumprod([1.0, *_signs(poses[:, 3:])])[:, None]
    spline = make_lsq_spline(time, values, knots, k=degree)
    apart = np.linalg.norm(spline(time)[:, :3] - values[:, :3], axis=1)
    if apart.max() > FARTHEST_OFF:
        message = (
            f"at {time[int(np.argmax(apart))]:g} s into the path the recorded place jumps:"
            f" {1e3 * apart.max():.0f} mm from the smooth path"
        )
        raise _Unusable("smoothing", message, ("a part without jumps", "a smaller smoothing"))
    return PathCourse(np.ascontiguousarray(spline.c), spacing, length, float(apart.max()))


def _signs(quaternions: Array) -> Array:
    """Gives -1 where a quaternion lies opposite to the one before, 1 elsewhere, (k - 1,)."""
    return np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0, -1.0, 1.0)


def _fitting(phase: PhaseSpec, path: PathSpec) -> PathSpec:
    """Makes sure that a path ends within its phase."""
    motion = path_motion(path)
    if motion.end <= phase.duration + 1e-9:
        return path
    left = phase.duration - motion.approach - motion.ramp
    valid = [f"duration: {motion.end + 0.005:.2f} or more"]
    if left > 0.0:
        valid.append(f"speed: {motion.course.length / left + 0.005:.2f} or more")
    raise _Unusable(
        "speed",
        f"the path takes {motion.end:.2f} s, {motion.approach:g} s of them to its beginning, the phase lasts"
        f" {phase.duration:g} s",
        valid,
    )
