# SPDX-License-Identifier: BSD-3-Clause
"""What an import map says, as frozen data: which columns of a log mean what, their units, and the transmission.

Units are factors to those of an episode: rad, rad/s, N.m; m, m/s, N if prismatic.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.columns import JOINT_KINDS
from impedance_modules.spec.document import Document

Reference = str | int
"""A column: its name, or its number counted from 1."""

POSITIONS = ("position", "position_command")
EFFORTS = ("effort", "effort_command")
COMMANDS = ("position_command", "effort_command")
TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
COUNTS = "counts"

RANGE_UNITS: Mapping[str, tuple[float, float]] = {"normalised": (-100.0, 100.0), "percent": (0.0, 100.0)}
"""Units of position that mean parts of a range, with the numbers at its ends."""

GAIN_UNITS = ("A", "V", "other")
"""Units of torque that mean nothing without a gain."""

Matrix = NDArray[np.float64]
_TURNING: Mapping[str, Mapping[str, float]] = {
    "position": {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi, COUNTS: 2 * math.pi}
    | dict.fromkeys(RANGE_UNITS, 1.0),
    "velocity": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180,
        "rev/s": 2 * math.pi,
        "rpm": 2 * math.pi / 60,
    },
    "effort": {"N.m": 1.0, "mN.m": 1e-3, "A": 1.0, "V": 1.0, "other": 1.0},
}
_SLIDING: Mapping[str, Mapping[str, float]] = {
    "position": {"m": 1.0, "mm": 1e-3} | dict.fromkeys(RANGE_UNITS, 1.0),
    "velocity": {"m/s": 1.0, "mm/s": 1e-3},
    "effort": {"N": 1.0, "A": 1.0, "V": 1.0, "other": 1.0},
}


@dataclass(frozen=True)
class MappedQuantity:
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
    quantities: tuple[MappedQuantity, ...]
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


def unit_factors(kind: str, *, sliding: bool) -> Mapping[str, float]:
    """Returns the units of a quantity with the factor to the episode's.

    Counts are turns here, still to be divided by the counts of a turn; parts of a range still lack the range, and A, V
    and 'other' their gain.

    Args:
        kind: ``position``, ``velocity``, ``effort``, ``effort_command`` or ``position_command``.
        sliding: Of a prismatic joint, on the joint's side of the transmission.
    """
    family = "position" if kind in POSITIONS else "effort" if kind in EFFORTS else "velocity"
    return (_SLIDING if sliding else _TURNING)[family]


def range_line(unit: str, ends: Sequence[float]) -> tuple[float, float]:
    """Returns scale and offset of a position that is given as a part of a range.

    q = q_1 + (x - x_1) (q_2 - q_1) / (x_2 - x_1), x_1 and x_2 the unit's numbers at the ends.

    Args:
        unit: One of `RANGE_UNITS`.
        ends: q_1 and q_2 [rad] ([m] if prismatic).
    """
    first, second = RANGE_UNITS[unit]
    scale = (ends[1] - ends[0]) / (second - first)
    return scale, ends[0] - first * scale


def transmission_matrix(entry: Mapping[str, Any], joints: Sequence[str]) -> Matrix:
    """Returns R: how far each motor turns for each joint.

    theta = R q, so that q = R^-1 theta, and, because the power is the same on both sides, tau = R^T tau_motor.

    Args:
        entry: ``matrix``, or ``ratio`` with or without ``coupling``; checked already.
        joints: Order of rows (motors) and columns (joints).

    Returns:
        (joints, joints), motor units for one joint unit.
    """
    if "matrix" in entry:
        return np.array(entry["matrix"], dtype=np.float64)
    place = {joint: index for index, joint in enumerate(joints)}
    matrix = np.diag(np.array(entry["ratio"], dtype=np.float64))
    for motor, others in entry.get("coupling", {}).items():
        for other, turns in others.items():
            matrix[place[motor], place[other]] = turns
    return matrix


def positions_at_joints(matrix: Matrix, motor: Matrix) -> Matrix:
    """Returns q = R^-1 theta for each row; velocities alike.

    Args:
        matrix: R (joints, joints).
        motor: (samples, joints) [rad] or [rad/s] at the motors.
    """
    return np.asarray(np.linalg.solve(matrix, motor.T).T, dtype=np.float64)


def efforts_at_joints(matrix: Matrix, motor: Matrix) -> Matrix:
    """Returns tau = R^T tau_motor for each row, (samples, joints) [N.m]."""
    return motor @ matrix
