# SPDX-License-Identifier: BSD-3-Clause
"""Admission: turns recordings into `Log`s on an even time base, or says why they cannot be used."""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.channel_checks import refuse_faulty_channels, unwrapped
from impedance_modules.diagnosis.data.computed_velocities import computed_joints
from impedance_modules.diagnosis.data.dataset_consistency import (
    group_repeats,
    refuse_copies,
    refuse_mixed_recordings,
)
from impedance_modules.diagnosis.data.encoder_grid import (
    rounding_errors,
    steps_of,
    torque_dither_of,
    torque_steps_of,
)
from impedance_modules.diagnosis.data.log import DataReport, InsufficientData, Log
from impedance_modules.diagnosis.data.long_recordings import segment_note, segment_origin
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.stamps import (
    JITTER_WARNING,
    gaps_of,
    refuse_disorder,
    resampled,
    sampling_times,
    stamp_jitter,
    uniform_time,
)
from impedance_modules.diagnosis.data.task_object import carrying, task_object_of
from impedance_modules.diagnosis.data.task_surfaces import task_surfaces_of
from impedance_modules.diagnosis.data.time_base import (
    common_delay,
    delayed,
    unify_rates,
)
from impedance_modules.diagnosis.data.torque_jumps import jump_notes
from impedance_modules.episode.columns import JOINT_KINDS
from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput
from impedance_modules.spec.task_text import contact_phases

Mask = NDArray[np.bool_]

RATE_MIN = 25.0
"""Lowest sampling rate: below it causes at a joint cannot be told apart [Hz]."""

SAMPLES_MIN = 100
"""Fewest samples of a recording; a joint has a dozen possible causes."""

MOTION_MIN, SLIDE_MIN = 0.02, 0.002
"""A joint with less motion about its mean is reported as weak: revolute [rad rms], prismatic [m rms]."""

CONTACT_WORD = re.compile(r"(^|[^a-z])(in_)?contact([^a-z]|$)")
"""A phase whose name is or contains this word is a phase of contact ..."""

NEGATION = re.compile(r"(^|[^a-z])(no|non|without|before|until|free)([^a-z]|$)")
"""... unless its name also contains one of these words."""

CONTACT_DETECTION_TIME = 0.5
"""In a phase that ends on contact, contact begins this long before the end: detection takes time [s]."""


def admit(episodes: Sequence[Episode], model: NominalModel) -> tuple[tuple[Log, ...], DataReport]:
    """Checks and resamples recordings.

    Raises:
        BadInput: A recording that contradicts itself, its robot or the others.
        InsufficientData: Nothing is wrong, but there is too little to tell a cause.
    """
    warnings = [
        *_note_partial_recordings(episodes),
        *_note_other_robot(episodes, model),
        *_note_unrecorded_joints(model),
        *model.notes,
    ]
    refuse_mixed_recordings(episodes)
    steps = steps_of([episode.position for episode in episodes], model.joints)
    found = [_log(episode, model, steps, warnings) for episode in episodes]
    torques = [episode.effort for episode in episodes]
    torque_steps = torque_steps_of(torques, model.joints)
    dither = torque_dither_of(torques, model.joints, torque_steps)
    found = [(replace(log, effort_steps=torque_steps, effort_dither=dither), jitter) for log, jitter in found]
    logs = [unwrapped(log, model, warnings) for log, _ in found]
    refuse_copies(logs)
    for log in logs:
        refuse_faulty_channels(log, model, warnings)
    if len({log.effort_source for log in logs} - {None}) > 1:
        raise BadInput("the recordings measure torque in different places (valid: one effort_source for all)")
    _note_missing_channels(logs, warnings)
    warnings += jump_notes(logs)
    logs = unify_rates(logs, warnings)
    grouped = group_repeats(logs, [episode.repeat_of for episode in episodes], warnings)
    weak = _weak_joints(grouped, model)
    if len(weak) == model.n:
        raise InsufficientData(
            f"no joint moves more than {MOTION_MIN} rad ({SLIDE_MIN} m) rms in any recording: constant data"
            " (valid: motions that reverse, at several speeds)"
        )
    report = DataReport(
        rates={log.name: log.rate for log, _ in found},
        jitter={log.name: jitter for log, jitter in found},
        weak_joints=weak,
        repeats=_repeats(grouped),
        torque=_torque_semantics(grouped),
        delay=common_delay(grouped, model.tree),
        warnings=tuple(warnings),
    )
    return grouped, report


def _repeats(logs: Sequence[Log]) -> tuple[tuple[str, ...], ...]:
    """Names of the recordings in each group of repeats."""
    groups: dict[str, list[str]] = {}
    for log in logs:
        groups.setdefault(log.group, []).append(log.name)
    return tuple(tuple(names) for names in groups.values() if len(names) > 1)


def _log(episode: Episode, model: NominalModel, steps: Array, warnings: list[str]) -> tuple[Log, float]:
    """Brings one recording to an even time base; returns it with the jitter of its time stamps."""
    place = episode.source
    if len(episode) < SAMPLES_MIN:
        count = "a single sample" if len(episode) == 1 else f"{len(episode)} samples"
        raise InsufficientData(f"{place}: {count} (valid: {SAMPLES_MIN} or more)")
    episode = _without_copied_rows(episode, warnings)
    refuse_disorder(episode.time, str(place))
    jitter = stamp_jitter(episode.time)
    stamps = _times_of_samples(episode, model, jitter, warnings)
    time, rate = uniform_time(stamps, str(place), warnings)
    _refuse_slow(place, rate)

    def take(kind: str) -> Array | None:
        values = _channel(episode, kind, model.joints, warnings)
        return None if values is None else resampled(values, stamps, time, kind)

    position = take("position")
    if position is None:
        raise BadInput(f"{place}: position is missing for a joint (valid: {', '.join(model.joints)})")
    effort, command = take("effort"), take("effort_command")
    if command is not None:
        command = delayed(command, time - time[0], 0.5 * _hold_time(episode))
    if effort is None and command is None:
        raise InsufficientData(
            f"{place}: no torque was recorded for all joints, measured or commanded: causes cannot be told"
            " (valid: effort.<joint> or effort_command.<joint> of every joint)"
        )
    velocity, computed = _usable_velocity(take("velocity"), position, episode, model.joints, warnings)
    log = Log(
        name=episode.name,
        group=episode.name,
        rate=rate,
        position=position,
        velocity=velocity,
        computed_velocity=computed,
        effort=effort,
        command=command,
        position_command=take("position_command"),
        effort_source=episode.effort_source if effort is not None else None,
        gravity_compensation=episode.gravity_compensation,
        start=float(time[0] - segment_origin(episode)),
        in_contact=in_contact(episode, time),
        rounding=resampled(_rounding(episode, model.joints, steps), stamps, time, "position"),
        surroundings=task_surfaces_of(str(episode.metadata.get("task") or ""), model.hands),
        task_object=task_object_of(episode, model.hands, model.joints),
        carrying=carrying(episode, time, in_contact(episode, time, holding=False)),
        gaps=gaps_of(stamps) - segment_origin(episode),
    )
    return log, jitter


def _without_copied_rows(episode: Episode, warnings: list[str]) -> Episode:
    """Leaves out rows that repeat the row before, stamp and all readings: a logger wrote them twice."""
    columns = [values for kind in JOINT_KINDS for values in getattr(episode, kind).values()]
    copied = np.all([np.diff(values) == 0.0 for values in (episode.time, *columns)], axis=0)
    if not copied.any():
        return episode
    warnings.append(
        f"{episode.source}: {int(copied.sum())} rows repeat the row before, stamp and all; left out"
    )
    return episode.part(np.concatenate([[True], ~copied]))


def _rounding(episode: Episode, joints: Sequence[str], steps: Array) -> Array:
    """Errors (N, n) like those of the encoders' grids, the same each time [rad]."""
    positions = np.column_stack([episode.position[joint] for joint in joints])
    return rounding_errors(positions, steps, zlib.crc32(episode.name.encode()))


def _refuse_slow(place: Path, rate: float) -> None:
    if rate >= RATE_MIN:
        return
    hint = " (or is time in milliseconds? valid: seconds)" if 1e3 * rate >= RATE_MIN and rate < 1.0 else ""
    raise InsufficientData(
        f"{place}: {rate:.3g} Hz is too slow for joint-level causes (valid: {RATE_MIN:g} Hz or more){hint}"
    )


def _channel(episode: Episode, kind: str, joints: Sequence[str], warnings: list[str]) -> Array | None:
    """One recorded quantity of all joints, (N, n); None where it lacks a joint."""
    recorded = getattr(episode, kind)
    missing = [joint for joint in joints if joint not in recorded]
    if not missing:
        return np.column_stack([recorded[joint] for joint in joints])
    if recorded and kind != "velocity":
        warnings.append(f"{episode.name}: {kind} lacks {', '.join(missing)} and is not used")
    return None


def _times_of_samples(episode: Episode, model: NominalModel, jitter: float, warnings: list[str]) -> Array:
    """Gives the times (N,) [s] at which samples were taken; warns where their stamps jitter."""
    joints = [joint for joint in model.joints if joint in episode.position]
    stamps = sampling_times(episode.time, np.column_stack([episode.position[joint] for joint in joints]))
    if jitter > JITTER_WARNING:
        how = "resampled" if stamps is episode.time else "taken as evenly sampled, as the motion is"
        warnings.append(f"{episode.source}: time stamps jitter by {100 * jitter:.0f} % of the step; {how}")
    return stamps


def _hold_time(episode: Episode) -> float:
    """Time for which the robot held each command [s]; 0 where the recording does not say.

    A command acts from ``command_delay`` after its row until the next one does: on average half a period later.
    """
    rate = episode.metadata.get("rate")
    return 1.0 / rate if isinstance(rate, int | float) and rate > 0.0 else 0.0


def _usable_velocity(
    velocity: Array | None, position: Array, episode: Episode, joints: Sequence[str], warnings: list[str]
) -> tuple[Array | None, Mask | None]:
    """Returns the reported velocities, and the joints (n,) of which they say nothing of their own.

    There are none where one is constant although its joint moves, or where all were computed from the positions.
    """
    if velocity is None:
        return None, None
    name = episode.name
    if np.any((np.ptp(velocity, axis=0) == 0.0) & (np.ptp(position, axis=0) > 0.0)):
        warnings.append(f"{name}: a velocity is constant while its joint moves; velocities are not used")
        return None, None
    computed = computed_joints(
        episode.matrix("velocity", joints), episode.matrix("position", joints), episode.time
    )
    if not computed.any():
        return velocity, None
    which = "" if computed.all() else f" of {', '.join(np.array(joints)[computed])}"
    warnings.append(
        f"{name}: velocities{which} are differences of the recorded positions, and say nothing of their own; not used"
    )
    return (None, None) if computed.all() else (velocity, computed)


def in_contact(episode: Episode, time: Array, *, holding: bool = True) -> Mask | None:
    """Marks the times (N,) that fall into a phase of contact, by its name or by the task; None where none says so.

    Args:
        episode: The recording.
        time: Of the samples [s].
        holding: Whether to hold an object is contact as well.
    """
    if episode.phase is None:
        return None
    by_task = contact_phases(str(episode.metadata.get("task") or ""), holding=holding)
    phases = {phase for phase in set(episode.phase) if phase is not None}
    named = {phase for phase in phases if by_task.get(phase) == "throughout" or _is_contact(phase)}
    marks = np.array([phase in named for phase in episode.phase])
    for phase in phases - named:
        if phase in by_task:
            inside = episode.phase == phase
            marks |= inside & (episode.time > episode.time[inside][-1] - CONTACT_DETECTION_TIME)
    if not marks.any():
        return None
    nearest = np.searchsorted(episode.time, time - 1e-9).clip(0, len(marks) - 1)
    return np.asarray(marks[nearest])


def _is_contact(phase: str) -> bool:
    name = phase.lower()
    return CONTACT_WORD.search(name) is not None and NEGATION.search(name) is None


def _note_partial_recordings(episodes: Sequence[Episode]) -> list[str]:
    """Says which recordings are used in part only, and which did not end cleanly."""
    said = list(dict.fromkeys(note for episode in episodes if (note := segment_note(episode))))
    return said + [
        f"{e.name}: the run was killed; the samples written until then are used"
        for e in episodes
        if not e.complete
    ]


def _note_other_robot(episodes: Sequence[Episode], model: NominalModel) -> list[str]:
    robot = episodes[0].robot
    if robot in model.robot or model.robot in robot:
        return []
    return [
        f"the recordings say that the robot is '{robot}'; they are compared with the model '{model.robot}'"
    ]


def _note_unrecorded_joints(model: NominalModel) -> list[str]:
    """Says which joints of the kinematic chain were not recorded; they are assumed to stay at 0."""
    fixed = model.tree.standing
    return [f"not recorded, assumed fixed at 0: {', '.join(fixed)}"] if fixed else []


def _note_missing_channels(logs: Sequence[Log], warnings: list[str]) -> None:
    for what, name in (("effort", "effort"), ("command", "effort_command"), ("velocity", "velocity")):
        lacking = [log.name for log in logs if getattr(log, what) is None]
        if 0 < len(lacking) < len(logs):
            warnings.append(
                f"{name} is missing in {', '.join(lacking[:3])}: it is used in no recording, because only channels"
                " that all of them have are compared"
            )


def _weak_joints(logs: Sequence[Log], model: NominalModel) -> tuple[str, ...]:
    motion = np.max([log.position.std(axis=0) for log in logs], axis=0)
    least = [SLIDE_MIN if body.prismatic else MOTION_MIN for body in model.tree.bodies]
    return tuple(joint for joint, size, low in zip(model.joints, motion, least, strict=True) if size < low)


def _torque_semantics(logs: Sequence[Log]) -> str:
    log = logs[0]
    words = {
        "joint_sensor": "effort is the torque between gearbox and link",
        "motor": "effort is the motor's torque, before rotor inertia and friction",
    }
    parts = [words[log.effort_source]] if log.effort_source is not None else ["no effort was measured"]
    if log.command is not None:
        by = {
            "robot": "the robot adds gravity to it",
            "command": "gravity is part of it",
            "none": "nothing adds gravity",
        }
        parts.append(f"effort_command was recorded; {by[log.gravity_compensation]}")
    return "; ".join(parts)
