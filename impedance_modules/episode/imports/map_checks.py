# SPDX-License-Identifier: BSD-3-Clause
"""The meaning of an import map, checked once its shape is right: every problem, each with its line.

A map is checked against itself and against what is known of the robot: its joints, which of them slide, and how far
they go.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.episode.columns import FRAME_KINDS, JOINT_KINDS, PHASE, TANK, TIME
from impedance_modules.episode.imports.import_map import (
    COUNTS,
    EFFORTS,
    GAIN_UNITS,
    POSITIONS,
    RANGE_UNITS,
    transmission_matrix,
    unit_factors,
)
from impedance_modules.errors import BadInput, Problem, nearest
from impedance_modules.spec.document import Document
from impedance_modules.spec.locate import find_robot, list_robots
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.urdf import UrdfFacts, read_urdf
from impedance_modules.spec.yaml_tree import KeyPath

Limits = Mapping[str, tuple[float, float]]
_TEXT_ONLY = ("header", "skip_rows", "comment")

_SINGULAR = 1e12
"""Condition number above which a transmission counts as singular."""

_TAKEN = (*JOINT_KINDS, *FRAME_KINDS, TIME, PHASE, TANK)

_BY_JOINT = ("unit", "sign", "offset", "gain", "counts_per_rev", "range")
"""Keys that may hold one value for each joint."""


def map_problems(document: Document, facts: RobotFacts | None, prismatic: frozenset[str]) -> list[Problem]:
    """Returns everything that contradicts itself or the robot.

    Args:
        document: A map that its schema accepts.
        facts: What is known of the robot; None where nothing is.
        prismatic: Joints in metres and newtons.
    """
    return [
        *_joint_problems(document, facts),
        *_transmission_problems(document),
        *_table_problems(document, prismatic),
        *_whole_problems(document),
    ]


def quantity_problems(
    document: Document, path: KeyPath, kind: str, prismatic: frozenset[str]
) -> Iterator[Problem]:
    """Yields what is wrong with one joint quantity.

    Args:
        document: The map.
        path: Of the quantity in it.
        kind: One of `JOINT_KINDS`.
        prismatic: Prismatic joints.
    """
    yield from _Checks(document, path, kind, prismatic).problems()


def extra_problems(
    document: Document, path: KeyPath, name: str, entry: Mapping[str, Any]
) -> Iterator[Problem]:
    """Yields what is wrong with an extra quantity."""
    if name in _TAKEN:
        message = f"'{name}' has a meaning of its own in an episode; use another name"
        yield document.problem(path, message, at="key")
    if ("column" in entry) == ("columns" in entry):
        yield document.problem(path, "either 'column' or 'columns', and one of them", at="key")
    elif "columns" in entry:
        yield from _column_problems(document, (*path, "columns"), entry["columns"])


def unknown_names(
    document: Document,
    path: KeyPath,
    names: Sequence[str] | Mapping[str, Any],
    joints: Sequence[str],
    where: str,
) -> Iterator[Problem]:
    """Yields a problem for each name that is none of ``joints``, which stand ``where``."""
    for index, name in enumerate(names):
        if name not in joints:
            step = name if isinstance(names, Mapping) else index
            message = f"'{name}' is not among {where}{nearest(name, joints)}"
            yield document.problem((*path, step), message, joints, at="key")


@dataclass(frozen=True)
class RobotFacts:
    """Joints of a robot.

    Attributes:
        source: File or folder they come from, for messages.
        joints: Names of all that move.
        prismatic: Those that slide.
        limits: Joint -> lowest and highest position [rad] ([m] if prismatic), where known.
    """

    source: Path
    joints: tuple[str, ...]
    prismatic: frozenset[str]
    limits: Limits


def facts_of_urdf(path: Path) -> RobotFacts:
    """Reads the facts from a URDF or a MuJoCo model.

    Raises:
        BadInput: No such file, or no description of a robot.
    """
    urdf = plain_urdf(path)
    moving = {name: joint for name, joint in urdf.joints.items() if joint.moves}
    limits = {name: (j.limits.lower, j.limits.upper) for name, j in moving.items() if j.limits is not None}
    return RobotFacts(path, tuple(moving), _sliding(urdf), limits)


def plain_urdf(path: Path) -> UrdfFacts:
    """Reads a URDF, or the links of a MuJoCo model as one.

    Raises:
        BadInput: No such file, or no description of a robot.
    """
    # Rotations and effects take long to import: only when a description is read.
    from impedance_modules.export.mujoco_as_urdf import as_urdf  # noqa: PLC0415

    with as_urdf(path) as (plain, _):
        return read_urdf(plain)


def facts_of_robot(name: str, beside: Path) -> RobotFacts | None:
    """Reads the facts from a robot folder; None where there is none of that name.

    Raises:
        BadInput: The folder is there, but something in it is wrong.
    """
    try:
        folder = find_robot(name, beside)
    except BadInput:
        return None
    spec = read_robot(folder)
    urdf = read_urdf(spec.urdf)
    limits = {joint: (row.position_min, row.position_max) for joint, row in spec.joints.items()}
    joints = tuple(joint for joint, entry in urdf.joints.items() if entry.moves)
    return RobotFacts(folder, joints, _sliding(urdf), limits)


def unknown_robot_note(name: str) -> str:
    """Returns the sentence for a robot that has no folder."""
    near = nearest(name, list_robots())
    return f"there is no robot folder '{name}'{near}: joint names and limits were not checked"


def recognise(names: Iterable[str]) -> RobotSpec | None:
    """Returns the shipped robot to which these joint names belong: one with a whole limb among them, or None."""
    present = frozenset(names)
    for name in list_robots():
        spec = read_robot(name)
        if any(present.issuperset(limb.joints.values()) for limb in spec.limbs.values()):
            return spec
    return None


def _joint_problems(document: Document, facts: RobotFacts | None) -> Iterator[Problem]:
    data = document.data
    for index, joint in enumerate(data["joints"]):
        if facts is not None and joint not in facts.joints:
            message = f"{facts.source} has no moving joint '{joint}'{nearest(joint, facts.joints)}"
            yield document.problem(("joints", index), message, facts.joints)
    for key in ("prismatic", "beyond_limits"):
        yield from unknown_names(document, (key,), data.get(key, ()), data["joints"], "'joints'")


def _transmission_problems(document: Document) -> Iterator[Problem]:
    entry = document.data.get("transmission")
    if entry is None:
        return
    joints, path = document.data["joints"], ("transmission",)
    if ("ratio" in entry) == ("matrix" in entry):
        yield document.problem(path, "either 'ratio' or 'matrix', and one of them", at="key")
        return
    if "matrix" in entry and "coupling" in entry:
        yield document.problem((*path, "coupling"), "'matrix' holds the couplings already", at="key")
        return
    rows = entry["matrix"] if "matrix" in entry else [entry["ratio"]]
    if any(len(row) != len(joints) for row in rows) or ("matrix" in entry and len(rows) != len(joints)):
        yield document.problem(path, f"there are {len(joints)} joints, so as many numbers (or rows of them)")
        return
    coupling = (*path, "coupling")
    unknown = [*unknown_names(document, coupling, entry.get("coupling", {}), joints, "'joints'")]
    for motor, others in entry.get("coupling", {}).items():
        unknown += unknown_names(document, (*coupling, motor), others, joints, "'joints'")
        if motor in others:
            message = f"'{motor}' and its own motor: that is the ratio"
            unknown.append(document.problem((*coupling, motor, motor), message, at="key"))
    yield from unknown
    if not unknown and np.linalg.cond(transmission_matrix(entry, joints)) > _SINGULAR:
        yield document.problem(
            path, "R cannot be inverted: different joint motions give the same motor motion"
        )
    quantities = [table[kind] for table in document.data["tables"] for kind in JOINT_KINDS if kind in table]
    if all(quantity.get("side") != "motor" for quantity in quantities):
        message = "nothing was measured at the motors, so it has no effect; say 'side: motor' where it was"
        yield document.problem(path, message, at="key")


def _table_problems(document: Document, prismatic: frozenset[str]) -> Iterator[Problem]:
    tables = document.data["tables"]
    for index, table in enumerate(tables):
        path: KeyPath = ("tables", index)
        if len(tables) > 1 and "file" not in table:
            yield document.problem((*path, "file"), "missing key 'file': which of the files is this table?")
        if "separator" in table and "header" not in table:
            message = "missing key 'header': does the first line name the columns, true or false?"
            yield document.problem((*path, "header"), message)
        for key in _TEXT_ONLY:
            if key in table and "separator" not in table:
                yield document.problem(
                    (*path, key), f"'{key}' goes with 'separator', for text files", at="key"
                )
        yield from _time_problems(document, path, table.get("time"))
        for kind in JOINT_KINDS:
            if kind in table:
                yield from quantity_problems(document, (*path, kind), kind, prismatic)
        for name, entry in table.get("extra", {}).items():
            yield from extra_problems(document, (*path, "extra", name), name, entry)
        if not any(kind in table for kind in (*JOINT_KINDS, "extra")):
            yield document.problem(path, "nothing is taken from this table", JOINT_KINDS)


def _time_problems(document: Document, path: KeyPath, time: Mapping[str, Any] | None) -> Iterator[Problem]:
    if time is not None and ("clock" in time) == ("column" in time):
        yield document.problem(
            (*path, "time"), "either 'column' with its 'unit', or, in a bag, 'clock'", at="key"
        )
    elif time is not None and ("column" in time) != ("unit" in time):
        yield document.problem((*path, "time"), "'column' and 'unit' go together", at="key")


def _whole_problems(document: Document) -> Iterator[Problem]:
    data = document.data
    tables = data["tables"]
    for kind in JOINT_KINDS:
        holders = [index for index, table in enumerate(tables) if kind in table]
        for index in holders[1:]:
            yield document.problem(("tables", index, kind), f"'{kind}' stands in another table too", at="key")
    if not any("position" in table for table in tables):
        yield document.problem(("tables",), "no table has 'position', which every episode needs", at="key")
    has_effort = any("effort" in table for table in tables)
    if has_effort and "effort_source" not in data:
        message = "missing key 'effort_source': measured between gearbox and link, or at the motor?"
        yield document.problem(("effort_source",), message, ("joint_sensor", "motor"))
    if not has_effort and "effort_source" in data:
        yield document.problem(("effort_source",), "no table has 'effort', so nothing was measured", at="key")
    if "rate" in data and all("time" in table for table in tables):
        yield document.problem(("rate",), "every table has its own time, so 'rate' has no effect", at="key")
    names = [name for table in tables for name in table.get("extra", {})]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield document.problem(("tables",), f"extra '{name}' stands in two tables", at="key")


def _sliding(urdf: UrdfFacts) -> frozenset[str]:
    return frozenset(name for name, joint in urdf.joints.items() if joint.type == "prismatic")


def _column_problems(document: Document, path: KeyPath, columns: Any) -> Iterator[Problem]:
    joints = document.data["joints"]
    if isinstance(columns, str):
        if len(joints) > 1 and "{joint}" not in columns and "{index}" not in columns:
            message = f"{len(joints)} joints would share the column '{columns}'; say where they differ"
            yield document.problem(path, message, ("{joint}", "{index}"))
    elif isinstance(columns, Mapping):
        yield from unknown_names(document, path, columns, joints, "'joints'")
    elif len(columns) != len(joints):
        yield document.problem(path, f"{len(columns)} columns for {len(joints)} joints (one for each)")


class _Checks:
    """The checks of one joint quantity."""

    def __init__(self, document: Document, path: KeyPath, kind: str, prismatic: frozenset[str]) -> None:
        self._document = document
        self._path = path
        self._kind = kind
        self._prismatic = prismatic
        self._entry = document.data["tables"][path[1]][kind]
        columns = self._entry["columns"]
        listed = isinstance(columns, Mapping)
        self._joints = [j for j in document.data["joints"] if not listed or j in columns]
        self._motor = self._entry.get("side") == "motor"

    def problems(self) -> Iterator[Problem]:
        yield from _column_problems(self._document, (*self._path, "columns"), self._entry["columns"])
        for key in _BY_JOINT:
            if isinstance(self._entry.get(key), Mapping):
                path = (*self._path, key)
                yield from unknown_names(self._document, path, self._entry[key], self._joints, "its joints")
        yield from self._units()
        yield from self._sides()

    def _problem(self, key: str, message: str, valid: Sequence[str] = (), at: str = "value") -> Problem:
        return self._document.problem((*self._path, key), message, valid, at)

    def _units(self) -> Iterator[Problem]:
        unit = self._entry["unit"]
        named = unit if isinstance(unit, Mapping) else dict.fromkeys(self._joints, unit)
        yield from self._without("unit", named)
        wrong: set[str] = set()
        for joint, name in named.items():
            sliding = joint in self._prismatic and not self._motor
            valid = tuple(unit_factors(self._kind, sliding=sliding))
            if name not in valid and name not in wrong:
                wrong.add(name)
                moves = "slides" if sliding else "turns"
                yield self._problem(
                    "unit", f"'{name}' is no unit here: {joint} {moves}{nearest(name, valid)}", valid
                )
        used = set(named.values())
        if self._kind in POSITIONS:
            yield from self._companion("counts_per_rev", needed=COUNTS in used)
            yield from self._ranges(named)
        if self._kind in EFFORTS:
            yield from self._companion("gain", needed=not used.isdisjoint(GAIN_UNITS))

    def _ranges(self, named: Mapping[str, str]) -> Iterator[Problem]:
        """Parts of a range need the range of each such joint, and joints without them need none."""
        found = self._entry.get("range", {})
        partial = [joint for joint, unit in named.items() if unit in RANGE_UNITS]
        missing = [joint for joint in partial if joint not in found]
        if missing:
            message = (
                f"missing the range of {', '.join(missing)}: positions at both ends, rad (m if it slides)"
            )
            yield self._problem("range", message, ("range: {JOINT: [-1.9, 1.9]}",))
        for joint in found:
            if joint not in partial:
                yield self._problem("range", f"'{joint}' is not given in parts of a range", at="key")
            elif found[joint][0] == found[joint][1]:
                yield self._problem("range", f"the range of '{joint}' has no width")
        if partial and self._motor:
            yield self._problem("side", "parts of a range are at the joints", ("joint",))
        if partial and set(partial) & set(self._entry.get("sign", {})):
            yield self._problem("sign", "a range that counts the other way has its ends exchanged", at="key")

    def _companion(self, key: str, *, needed: bool) -> Iterator[Problem]:
        """A key that some units need, and that has no effect with the others."""
        if needed and key not in self._entry:
            yield self._problem(key, f"missing key '{key}', which this unit needs")
        elif not needed and key in self._entry:
            yield self._problem(key, f"'{key}' has no effect with this unit", at="key")
        elif needed and isinstance(self._entry[key], Mapping):
            yield from self._without(key, self._entry[key])

    def _without(self, key: str, named: Iterable[str]) -> Iterator[Problem]:
        missing = [joint for joint in self._joints if joint not in named]
        if missing:
            yield self._problem(key, f"nothing for {', '.join(missing)}")

    def _sides(self) -> Iterator[Problem]:
        transmission = "transmission" in self._document.data
        if transmission and "side" not in self._entry:
            message = "missing key 'side': was it measured at the joints or at the motors?"
            yield self._problem("side", message, ("joint", "motor"))
        if not transmission and "side" in self._entry:
            yield self._problem("side", "'side' has no effect without a 'transmission'", at="key")
        missing = [joint for joint in self._document.data["joints"] if joint not in self._joints]
        if self._motor and missing:
            message = f"every motor is needed to know the joints; missing: {', '.join(missing)}"
            yield self._problem("columns", message)
