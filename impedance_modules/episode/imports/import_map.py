# SPDX-License-Identifier: BSD-3-Clause
"""What an import map says, as frozen data: which columns of a log mean what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.columns import JOINT_KINDS
from impedance_modules.spec.document import Document

Reference = str | int
"""A column: its name, or its number counted from 1."""

POSITIONS = ("position", "position_command")
EFFORTS = ("effort", "effort_command")
COMMANDS = ("position_command", "effort_command")


@dataclass(frozen=True)
class Quantity:
    """One joint quantity in one table.

    Attributes:
        kind: One of `JOINT_KINDS`, or the name of an extra quantity.
        columns: Joint -> column.
        scale: Joint -> episode units for one unit of the file: sign, unit, and gain where it is a number.
        gain_variable: Name of a variable of the file that multiplies all of it, or None.
        motor_side: Measured before the transmission.
        offset: Joint -> what is added at the end [rad] ([m] if prismatic).
    """

    kind: str
    columns: Mapping[str, Reference]
    scale: Mapping[str, float]
    gain_variable: str | None
    motor_side: bool
    offset: Mapping[str, float]


@dataclass(frozen=True)
class TextLayout:
    """How a text file is laid out.

    Attributes:
        separator: ``comma``, ``semicolon``, ``tab`` or ``whitespace``.
        header: The first line names the columns.
        skip_rows: Lines before it.
        comment: Sign that begins lines to pass over, or None.
    """

    separator: str
    header: bool
    skip_rows: int
    comment: str | None


@dataclass(frozen=True)
class TimeColumn:
    """The time of each row: a column and the seconds of one of its units, or a bag's clock."""

    column: Reference | None
    seconds: float
    clock: str | None


@dataclass(frozen=True)
class TableMap:
    """What one file holds.

    Attributes:
        index: Place in the map's ``tables``.
        file: Pattern of its name, or None where there is one table.
        text: Layout; None where the map gives none (no text file).
        time: None where rows are evenly spaced at the stated rate (in a bag: the header's stamp).
        quantities: Joint quantities.
        extra: Further columns: name in the episode -> column and factor.
    """

    index: int
    file: str | None
    text: TextLayout | None
    time: TimeColumn | None
    quantities: tuple[Quantity, ...]
    extra: Mapping[str, tuple[Reference, float]]


@dataclass(frozen=True)
class Decimation:
    """Every ``keep_every``-th sample, after a low-pass that leaves what is below ``low_pass`` [Hz]."""

    keep_every: int
    low_pass: float


@dataclass(frozen=True, eq=False)
class ImportMap:
    """A whole import map.

    Attributes:
        document: Where it stands, for located errors; its text travels in the episodes.
        robot: Name for the episodes.
        episode: Name of the recording, where the map gives it.
        joints: In the map's order.
        prismatic: Those in [m] and [N].
        limits: Joint -> lowest and highest position, where known.
        beyond_limits: Joints that may pass them.
        effort_source: ``joint_sensor``, ``motor``, or None where no effort was measured.
        gravity_compensation: ``robot``, ``command`` or ``none``.
        rate: Stated samples per second [Hz], or None.
        transmission: R (joints, joints): motor = R joint, joint torque = R^T motor torque; None: identity.
        decimation: None keeps every sample.
        repeats: Groups of recordings of one motion.
        tables: What each file holds.
        notes: What the reader should know, in sentences.
    """

    document: Document
    robot: str
    episode: str | None
    joints: tuple[str, ...]
    prismatic: frozenset[str]
    limits: Mapping[str, tuple[float, float]]
    beyond_limits: frozenset[str]
    effort_source: str | None
    gravity_compensation: str
    rate: float | None
    transmission: NDArray[np.float64] | None
    decimation: Decimation | None
    repeats: tuple[tuple[str, ...], ...]
    tables: tuple[TableMap, ...]
    notes: tuple[str, ...]

    @property
    def kinds(self) -> tuple[str, ...]:
        """The joint quantities that the map knows, in the order of an episode."""
        found = {quantity.kind for table in self.tables for quantity in table.quantities}
        return tuple(kind for kind in JOINT_KINDS if kind in found)

    def repeat_of(self, episode: str) -> str | None:
        """Returns the first of the recording's group, or None where it is the first or repeats nothing."""
        for group in self.repeats:
            if episode in group[1:]:
                return group[0]
        return None
