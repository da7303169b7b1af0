# SPDX-License-Identifier: BSD-3-Clause
"""Recomputes every torque of a recording and compares it, bit for bit, with the one that left."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.backends.replay_backend import LONGEST_GAP, ReplayBackend
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.gripper_watch import grippers_of
from impedance_modules.control.recorded_paths import paths_of_metadata
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.data import Episode
from impedance_modules.episode.metadata import library_versions
from impedance_modules.errors import BadInput, EndOfRecording, ReplayMismatch
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.recorded_set_points import recorded_set_points
from impedance_modules.runs.recorder import MISSED
from impedance_modules.runs.run_backends import acting_in
from impedance_modules.spec.robot_spec import JointOrigin
from impedance_modules.spec.task_text import beside_another


@dataclass(frozen=True)
class Verification:
    """What a replay found.

    Attributes:
        samples: Recomputed.
        joints: Per sample.
        other_versions: Library -> (then, now) where they differ; bits may then differ without anything being wrong.
    """

    samples: int
    joints: int
    other_versions: dict[str, tuple[str, str]]


def reassemble(episode: Episode) -> Assembly:
    """Assembles the task that a recording carries, as it was run.

    Raises:
        BadInput: The recording has no task, e.g. because another program made it.
        BadFile: The task does not fit the robot as it is described today.
    """
    metadata = episode.metadata
    saved = metadata.get("saved")
    if isinstance(saved, Mapping) and saved.get("first_row") != 0:
        raise BadInput(
            f"{episode.name}: saved from the middle of a damaged recording; its torques depend on what came before"
            " and cannot be recomputed (valid: the stretch that begins with row 0)"
        )
    text = metadata.get("task")
    if not isinstance(text, str):
        raise BadInput(f"{episode.name}: the recording carries no task, so its torques cannot be recomputed")
    if metadata.get("own_modules"):
        named = ", ".join(map(str, metadata["own_modules"]))
        raise BadInput(
            f"{episode.name}: run with modules of one's own ({named}), which no recording carries; its torques cannot"
            " be recomputed"
        )
    for key in ("rate", "scale"):
        if key not in metadata:
            raise BadInput(
                f"{episode.name}: metadata '{key}' is missing (valid: a recording of 'impedance run')"
            )
    with tempfile.TemporaryDirectory() as folder:
        task = _beside_original(Path(folder), episode, text)
        return assemble(
            str(task),
            effects=_patch_of(metadata, "effects", Path(folder)),
            compensate=_patch_of(metadata, "compensate", Path(folder)),
            rate=float(metadata["rate"]),
            scale=float(metadata["scale"]),
            arm=metadata.get("arm"),
            calibrate=lambda robot: replace(robot, joint_origins=_origins(metadata)),
            paths=paths_of_metadata(metadata, str(episode.source)),
        )


def _patch_of(metadata: Mapping[str, Any], key: str, folder: Path) -> Path | None:
    """Writes the text of a patch that a recording carries into a folder; None where it carries none."""
    if metadata.get(key) is None:
        return None
    patch = folder / f"{key}.yaml"
    patch.write_text(metadata[key], encoding="utf-8", errors="replace")
    return patch


def _origins(metadata: Mapping[str, object]) -> dict[str, JointOrigin]:
    """Reads where the robot that was run had its calibrated joints."""
    said = metadata.get("joint_origins", {})
    if not isinstance(said, Mapping):
        raise BadInput(f"the recording's joint_origins are {said!r} (valid: joint -> [[x, y, z], [r, p, y]])")
    return {name: JointOrigin(tuple(translation), tuple(turn)) for name, (translation, turn) in said.items()}


def _beside_original(folder: Path, episode: Episode, text: str) -> Path:
    """Writes the task's text where its robot is found: beside the original when that is still there.

    Else in the folders above the recording: the original may have been named from another working folder.
    """
    original = Path(str(episode.metadata.get("task_path", "")))
    around = [place / "robots" for place in (*original.parents, *episode.source.resolve().parents)]
    own = [robots for robots in around if _is_folder(robots / episode.robot)]
    robots = next(iter([*own, *filter(_is_folder, around)]), None)
    if robots is not None:
        (folder / "robots").symlink_to(robots.resolve(), target_is_directory=True)
    task = folder / "task.yaml"
    task.write_text(beside_another(text, original), encoding="utf-8", errors="replace")
    return task


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:
        return False  # a name that no folder can have


def verify(episode: Episode, on_progress: Callable[[float], None]) -> Verification:
    """Recomputes every torque from the recorded states.

    Args:
        episode: A recording of a run of this package.
        on_progress: Called now and then with the part done, 0 to 1.

    Raises:
        BadInput: Not such a recording.
        ReplayMismatch: A torque differs; says where, which joint and by how much.
    """
    assembly = reassemble(episode)
    names = assembly.model.joint_names
    backend = ReplayBackend(episode, names, acting_in(episode, assembly.model.n))
    recorded = episode.matrix("effort_command", names)
    late, asked = (_marks(episode, name) for name in ("late", "interrupt"))
    dropped = np.append(late[1:], False)
    missed = _missed_cycles(episode, assembly.rate)
    grippers = grippers_of(backend, assembly, episode.name)
    supervisor = Supervisor(assembly, recorded_set_points(episode, assembly.task.set_points), grippers)
    first = backend.start()
    supervisor.start(first)
    state: RobotState | None = first.state
    done = 0
    nothing = np.zeros(len(names))
    last = nothing.copy()
    try:
        while supervisor.ending is None:
            k = backend.sample
            for _ in range(missed[k]):
                blind = supervisor.step(None, late=False, stop_request=None)
                np.copyto(last, last if blind is None else blind)
                supervisor.look()
            request = "asked to stop" if asked[k] else None
            effort = supervisor.step(state, late=bool(late[k]), stop_request=request)
            supervisor.look()
            if effort is not None and not dropped[k]:
                np.copyto(last, effort)
            left = nothing if effort is None else last
            if not np.array_equal(left, recorded[k]):
                raise ReplayMismatch(_difference(episode, names, k, left, recorded[k]))
            done += 1
            if done % 1000 == 0:
                on_progress(done / len(recorded))
            state = backend.read()
    except EndOfRecording:
        pass
    if done < len(recorded):
        raise ReplayMismatch(
            f"{episode.name}: the replay ends after {done} of {len(recorded)} samples:"
            f" {supervisor.reason or 'the task is done'}"
        )
    return Verification(done, len(names), _other_versions(episode))


def _marks(episode: Episode, name: str) -> NDArray[np.bool_]:
    """Reads a column of marks, (N,)."""
    if name not in episode.extra:
        raise BadInput(f"{episode.name}: no column '{name}' (valid: a recording of 'impedance run')")
    return np.asarray(episode.extra[name] > 0.0)


def _missed_cycles(episode: Episode, rate: float) -> NDArray[np.int64]:
    """Reads how many cycles without a state came before each sample, (N,); none where nothing is said of it."""
    said = np.asarray(episode.extra.get(MISSED, np.zeros(len(episode))))
    most = LONGEST_GAP * rate
    wrong = ~((said >= 0.0) & (said <= most))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise BadInput(
            f"{episode.name}: column '{MISSED}' is {said[row]} in row {row} (valid: 0 to {most:g})"
        )
    return said.astype(np.int64)


def _difference(episode: Episode, names: tuple[str, ...], k: int, now: Array, then: Array) -> str:
    worst = int(np.argmax(np.abs(now - then)))
    versions = ", ".join(f"{n} {a} -> {b}" for n, (a, b) in _other_versions(episode).items())
    why = f"; other versions: {versions}" if versions else ""
    return (
        f"{episode.name}: at {episode.time[k]:.4f} s (sample {k}) {names[worst]} is {now[worst]!r} N.m,"
        f" recorded {then[worst]!r} N.m{why}"
    )


def _other_versions(episode: Episode) -> dict[str, tuple[str, str]]:
    then = episode.metadata.get("versions", {})
    return {name: (then[name], now) for name, now in library_versions().items() if then.get(name, now) != now}
