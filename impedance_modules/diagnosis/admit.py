# SPDX-License-Identifier: BSD-3-Clause
"""Stage 1: turns recordings into logs that can be compared, or says why they cannot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.log import DataReport, InsufficientData, Log
from impedance_modules.diagnosis.mistakes import refuse_mistakes
from impedance_modules.diagnosis.model import NominalModel
from impedance_modules.diagnosis.repeats import group_repeats
from impedance_modules.diagnosis.timing import common_delay, even_time
from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

RATE_MIN = 25.0
"""Below it joint-level causes blur into each other [Hz]."""

SAMPLES_MIN = 100
"""Fewer say nothing about a joint with a dozen possible causes."""

DURATION_MAX = 1200.0
"""Longest recording that is used whole [s]; of a longer one the first part is."""

MOTION_MIN = 0.02
"""A joint that moves less than this about its mean is called weak [rad rms]."""


def admit(episodes: Sequence[Episode], model: NominalModel) -> tuple[tuple[Log, ...], DataReport]:
    """Checks and resamples recordings.

    Raises:
        BadInput: A recording that contradicts itself, its robot or the others.
        InsufficientData: Nothing is wrong, but there is too little to tell a cause.
    """
    warnings: list[str] = []
    _refuse_same_names(episodes)
    found = [_log(episode, model, warnings) for episode in episodes]
    logs = group_repeats([log for log, _ in found], [episode.repeat_of for episode in episodes])
    for log in logs:
        refuse_mistakes(log, model)
    if len({log.effort_source for log in logs}) > 1:
        raise BadInput("the recordings measure torque in different places (valid: one effort_source for all)")
    weak = _weak_joints(logs, model)
    if len(weak) == model.n:
        raise InsufficientData(
            f"no joint moves more than {MOTION_MIN} rad rms in any recording: constant data"
            " (valid: motions that reverse, at several speeds)"
        )
    groups: dict[str, list[str]] = {}
    for log in logs:
        groups.setdefault(log.group, []).append(log.name)
    report = DataReport(
        rates={log.name: log.rate for log in logs},
        jitter={log.name: jitter for log, (_, jitter) in zip(logs, found, strict=True)},
        weak_joints=weak,
        repeats=tuple(tuple(names) for names in groups.values() if len(names) > 1),
        torque=_torque_semantics(logs),
        delay=common_delay(logs),
        warnings=tuple(warnings),
    )
    return logs, report


def _refuse_same_names(episodes: Sequence[Episode]) -> None:
    names = [episode.name for episode in episodes]
    for name in names:
        if names.count(name) > 1:
            places = ", ".join(str(episode.source) for episode in episodes if episode.name == name)
            raise BadInput(f"two recordings are called '{name}' ({places}); valid: each recording once")


def _log(episode: Episode, model: NominalModel, warnings: list[str]) -> tuple[Log, float]:
    place = episode.source
    if len(episode) < SAMPLES_MIN:
        raise InsufficientData(f"{place}: {len(episode)} samples (valid: {SAMPLES_MIN} or more)")
    time, rate, jitter = even_time(episode.time, str(place), warnings)
    if rate < RATE_MIN:
        raise InsufficientData(
            f"{place}: {rate:.3g} Hz is too slow for joint-level causes (valid: {RATE_MIN:g} Hz)"
        )
    keep = time[:, None][:, 0] <= time[0] + DURATION_MAX
    if not keep.all():
        warnings.append(f"{episode.name}: only its first {DURATION_MAX:g} s are used")

    def take(kind: str) -> Array | None:
        recorded = getattr(episode, kind)
        if not all(joint in recorded for joint in model.joints):
            if recorded and kind != "velocity":
                missing = [joint for joint in model.joints if joint not in recorded]
                warnings.append(f"{episode.name}: {kind} lacks {', '.join(missing)} and is left aside")
            return None
        values = np.column_stack([np.interp(time[keep], episode.time, recorded[j]) for j in model.joints])
        return values if np.isfinite(values).all() else None

    position = take("position")
    if position is None:
        raise BadInput(f"{place}: position is missing for a joint (valid: {', '.join(model.joints)})")
    effort, command = take("effort"), take("effort_command")
    if effort is None and command is None:
        raise InsufficientData(
            f"{place}: no torque was recorded for all joints, measured or commanded: causes cannot be told"
        )
    log = Log(
        name=episode.name,
        group=episode.name,
        rate=rate,
        position=position,
        velocity=take("velocity"),
        effort=effort,
        command=command,
        position_command=take("position_command"),
        effort_source=episode.effort_source if effort is not None else None,
        gravity_compensation=episode.gravity_compensation,
    )
    return log, jitter


def _weak_joints(logs: Sequence[Log], model: NominalModel) -> tuple[str, ...]:
    motion = np.max([log.position.std(axis=0) for log in logs], axis=0)
    return tuple(joint for joint, size in zip(model.joints, motion, strict=True) if size < MOTION_MIN)


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
