# SPDX-License-Identifier: BSD-3-Clause
"""Records a robot that another program moves: states, and the torques that it reports to add; commands nothing."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.robot_link import SeaColumns
from impedance_modules.backends.baxter.ros.messages import UInt16
from impedance_modules.backends.baxter.session import LISTENING, Session
from impedance_modules.episode.columns import joint_columns
from impedance_modules.episode.metadata import episode_metadata, library_versions
from impedance_modules.episode.writer import EpisodeWriter
from impedance_modules.errors import RobotRefused

PATIENCE = 1.0
"""After this time without a state the recording ends [s]."""


@dataclass(frozen=True)
class RecordOptions:
    """What is recorded.

    Attributes:
        directory: Of the new episode.
        duration: [s]; None until ``stop``.
        rate: Asks the robot for its states at this rate [Hz]; None takes what comes and sends nothing.
        repeat_of: Name of the episode that this one repeats, or None.
    """

    directory: Path
    duration: float | None
    rate: int | None
    repeat_of: str | None


def record_episode(
    session: Session,
    options: RecordOptions,
    on_progress: Callable[[float], None],
    stop: Callable[[], bool],
) -> Path:
    """Writes an episode that ``diagnose`` reads: positions, velocities, efforts, and the robot's own models.

    Args:
        session: Open; its preflight checks have passed.
        options: What and where.
        on_progress: Called with the recorded time about ten times a second [s].
        stop: True ends the recording.

    Returns:
        The episode's file.

    Raises:
        RobotRefused: The states stop coming.
        BadInput: The directory holds an episode.
    """
    request = session.transport.advertise(topics.STATE_RATE_REQUEST, UInt16, latch=True)
    try:
        if options.rate is not None:
            request.send(UInt16(options.rate))
        time.sleep(LISTENING)
        return _write(session, options, on_progress, stop)
    finally:
        if options.rate is not None:
            request.send(UInt16(topics.DEFAULT_STATE_RATE))
        request.close()


def _write(
    session: Session, options: RecordOptions, on_progress: Callable[[float], None], stop: Callable[[], bool]
) -> Path:
    link, names = session.link, session.model.joint_names
    extra = SeaColumns(link.sea)
    columns = ["time"]
    for kind in ("position", "velocity", "effort"):
        columns += joint_columns(kind, names)
    columns += extra.names
    row, n = np.zeros(len(columns)), len(names)
    with EpisodeWriter(
        options.directory, columns, _metadata(session, options), wait_for_disk=False
    ) as writer:
        number, zero, shown = 0, None, 0.0
        while not stop():
            sample = link.wait(number, PATIENCE)
            if sample is None:
                raise RobotRefused(
                    f"no state for {PATIENCE:g} s: the robot has gone; the rows so far are kept"
                )
            zero = sample.state.time if zero is None else zero
            number, row[0] = sample.number, sample.state.time - zero
            row[1 : n + 1], row[n + 1 : 2 * n + 1] = sample.state.position, sample.state.velocity
            row[2 * n + 1 : 3 * n + 1], row[3 * n + 1 :] = sample.state.effort, extra.values()
            writer.append(row)
            if options.duration is not None and row[0] >= options.duration:
                break
            if row[0] - shown >= 0.1:
                shown = float(row[0])
                on_progress(shown)
        return writer.close()


def _metadata(session: Session, options: RecordOptions) -> dict[str, object]:
    origins = session.spec.joint_origins
    return episode_metadata(
        robot=session.spec.name,
        episode=options.directory.resolve().name,
        effort_source="joint_sensor",
        gravity_compensation="robot",
        repeat_of=options.repeat_of,
        task=None,
        backend="recorder",
        limbs={name: list(limb.joint_names) for name, limb in session.model.limbs.items()},
        joint_origins={name: [list(o.translation), list(o.roll_pitch_yaw)] for name, o in origins.items()},
        versions=library_versions(),
    )
