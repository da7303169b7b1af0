# SPDX-License-Identifier: BSD-3-Clause
"""Maps for the logs of makers' own software, known by their header, whose columns' meaning their makers document.

libfranka's ``franka::logToCSV``: time in ms; tau_J is the torque of the joint sensors, weight included; tau_J_d the
command, without the weight that the robot adds. Universal Robots' RTDE clients (ur_rtde, the maker's own): seconds,
rad, rad/s, currents in A. Neither log names its joints, and a current says no torque without a constant: what is
missing is asked for, in a map that is complete but for it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.episode.imports.import_map import TextLayout
from impedance_modules.episode.imports.lerobot_dataset import feature_columns
from impedance_modules.episode.imports.map_checks import plain_urdf
from impedance_modules.episode.imports.text_table import TextTable
from impedance_modules.errors import BadInput
from impedance_modules.spec.urdf import UrdfFacts

STATE = "STATE"
"""Stands in a map where whoever recorded the log must say something; no such map is read."""


@dataclass(frozen=True)
class MakerMap:
    """A map for one log.

    Attributes:
        text: YAML.
        missing: What it lacks, in sentences; it can be read where there is nothing.
        notes: What the reader should know, in sentences.
    """

    text: str
    missing: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class MappedColumns:
    """Columns of a joint quantity, one for each joint, and its unit as a map writes it."""

    kind: str
    columns: tuple[str, ...]
    unit: str


def maker_map(path: Path, header: str, urdf: Path | None) -> MakerMap | None:
    """Makes the map of a text log by its header; None where the header is none of a known maker.

    Args:
        path: The log.
        header: Its first line.
        urdf: Names the joints; None where none was given.

    Raises:
        BadInput: The description has not exactly one arm with as many joints.
    """
    separator = "comma" if "," in header else "whitespace"
    names = [name.strip() for name in header.split("," if separator == "comma" else None)]
    if "state.q[0]" in names and "state.tau_J[0]" in names:
        return _franka_map(path, names, urdf)
    if "actual_q_0" in names and "timestamp" in names:
        return _rtde_map(names, separator, urdf)
    return None


def dataset_map(dataset: Path, urdf: Path | None) -> MakerMap:
    """Makes the map of a LeRobot dataset, which says neither units nor where torque was measured.

    Raises:
        BadInput: The dataset cannot be read, or has no positions by name.
    """
    columns = feature_columns(dataset)
    state = [name for name in columns if name.startswith("observation.state.")]
    ends = {name.rpartition(".")[2] for name in state}
    suffix = ".pos" if "pos" in ends else ""
    joints = [
        name.removeprefix("observation.state.").removesuffix(suffix)
        for name in state
        if name.endswith(suffix)
    ]
    if not joints:
        raise BadInput(
            f"{dataset}: 'observation.state' names no joints (valid: --map FILE with columns such as"
            f" 'observation.state[1]'; present: {', '.join(columns[:8])})"
        )
    quantities = [
        MappedColumns("position", tuple(f"observation.state.{name}{suffix}" for name in joints), STATE)
    ]
    for kind, names in _dataset_quantities(joints, suffix):
        if all(name in columns for name in names):
            quantities.append(MappedColumns(kind, tuple(names), STATE))
    missing = [
        "units of its numbers (rad, deg, or normalised -100 to 100 with the range of each joint), which a LeRobot"
        " dataset does not hold",
        "'gravity_compensation': what held the arm's weight, robot, command or none",
    ]
    about = {"effort_source": STATE} if any(q.kind == "effort" for q in quantities) else {}
    if about:
        missing.append("'effort_source': was effort measured between gearbox and link, or at the motor?")
    table = ["time: {column: timestamp, unit: s}"]
    text = map_text(
        _robot_name(urdf, dataset.name),
        urdf,
        joints,
        {**about, "gravity_compensation": STATE},
        table,
        quantities,
    )
    return MakerMap(text, tuple(missing), ())


def _dataset_quantities(joints: Sequence[str], suffix: str) -> list[tuple[str, list[str]]]:
    """Names under which datasets hold more than positions."""
    return [
        ("velocity", [f"observation.velocity.{name}" for name in joints]),
        ("velocity", [f"observation.state.{name}.vel" for name in joints]),
        ("effort", [f"observation.effort.{name}" for name in joints]),
        ("position_command", [f"action.{name}{suffix}" for name in joints]),
    ]


def _franka_map(path: Path, names: Sequence[str], urdf: Path | None) -> MakerMap:
    count = sum(name.startswith("state.q[") for name in names)
    joints, missing = _joints(count, urdf)
    quantities = [
        MappedColumns("position", _numbered("state.q[{}]", count), "rad"),
        MappedColumns("velocity", _numbered("state.dq[{}]", count), "rad/s"),
        MappedColumns("effort", _numbered("state.tau_J[{}]", count), "N.m"),
    ]
    notes = ["by its header a log of libfranka: tau_J at the joint sensors, the robot adds its weight"]
    commands = _numbered("cmd.tau_J_d[{}]", count)
    if all(name in names for name in commands):
        if _moves(path, commands):
            quantities.append(MappedColumns("effort_command", commands, "N.m"))
        else:
            notes.append("cmd.tau_J_d is 0 throughout, so torque was not commanded; not imported")
    table = ["separator: comma", "header: true", "time: {column: time, unit: ms}"]
    about = {"effort_source": "joint_sensor", "gravity_compensation": "robot"}
    text = map_text(_robot_name(urdf, "franka"), urdf, joints, about, table, quantities)
    return MakerMap(text, missing, tuple(notes))


def _rtde_map(names: Sequence[str], separator: str, urdf: Path | None) -> MakerMap:
    count = sum(name.startswith("actual_q_") for name in names)
    joints, missing = _joints(count, urdf)
    every = {
        "position": ("actual_q_{}", "rad"),
        "velocity": ("actual_qd_{}", "rad/s"),
        "effort": ("actual_current_as_torque_{}", "N.m"),
        "position_command": ("target_q_{}", "rad"),
    }
    quantities = [
        MappedColumns(kind, columns, unit)
        for kind, (pattern, unit) in every.items()
        if set(columns := _numbered(pattern, count)) <= set(names)
    ]
    kinds = [quantity.kind for quantity in quantities]
    currents = _numbered("actual_current_{}", count)
    if "effort" not in kinds and set(currents) <= set(names):
        quantities.append(MappedColumns("effort", currents, "A"))
        missing = (
            *missing,
            "'gain' of actual_current: the torque at the joint for one ampere, N.m (torque constant times gear ratio)",
        )
    notes = ["by its header a log of Universal Robots' RTDE"]
    if any(name.startswith("target_moment_") for name in names):
        notes.append(
            "target_moment is what the controller's own model asks for, not a measurement; not imported"
        )
    table = [f"separator: {separator}", "header: true", "time: {column: timestamp, unit: s}"]
    about = {"effort_source": "motor"} if any(q.kind == "effort" for q in quantities) else {}
    text = map_text(
        _robot_name(urdf, "ur"), urdf, joints, {**about, "gravity_compensation": "none"}, table, quantities
    )
    return MakerMap(text, missing, tuple(notes))


def arm_joints(facts: UrdfFacts, count: int) -> tuple[str, ...] | None:
    """Returns the joints of a description's only arm; None where there is none, or more than one.

    An arm is a chain whose first joints that turn, from the root outwards, are ``count``; a gripper at its end does
    not matter.
    """
    ends = set(facts.links) - {joint.parent for joint in facts.joints.values()}
    arms = set()
    for end in ends:
        chain = facts.moving_joints(end)
        turning = tuple(name for name in chain if facts.joints[name].type in ("revolute", "continuous"))
        if len(turning) >= count:
            arms.add(turning[:count])
    return arms.pop() if len(arms) == 1 else None


def _joints(count: int, urdf: Path | None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Joint names by the description; without one none, and what is missing."""
    if urdf is None:
        return (), (f"names of its {count} joints, which the log only numbers: --urdf FILE of the robot",)
    facts = plain_urdf(urdf)
    found = arm_joints(facts, count)
    turning = [name for name, joint in facts.joints.items() if joint.type in ("revolute", "continuous")]
    if found is None:
        words = f"'joints': {urdf} has not exactly one arm of {count} joints (it turns about: {', '.join(turning)})"
        return (), (words,)
    return found, ()


def _numbered(pattern: str, count: int) -> tuple[str, ...]:
    return tuple(pattern.format(index) for index in range(count))


def _moves(path: Path, columns: Sequence[str]) -> bool:
    """Says whether a column is anywhere not zero."""
    table = TextTable(path, TextLayout("comma", True, 0, None))
    return any(values.any() for chunk in table.chunks(columns) for values in chunk.columns.values())


def _robot_name(urdf: Path | None, otherwise: str) -> str:
    return otherwise if urdf is None else urdf.stem


def map_text(
    robot: str,
    urdf: Path | None,
    joints: Sequence[str],
    about: Mapping[str, str],
    table: Sequence[str],
    quantities: Sequence[MappedColumns],
) -> str:
    """Writes a map.

    Args:
        robot: Its name.
        urdf: Its description, or None.
        joints: In the order of the columns; none where they are to be stated.
        about: Further keys and values.
        table: Rows of the table before its quantities.
        quantities: Of several of one kind the first counts.
    """
    lines = ["format: 1", f"robot: {json.dumps(robot)}"]
    if urdf is not None:
        lines.append(f"urdf: {json.dumps(str(urdf.resolve()))}")
    lines.append(f"joints: {json.dumps(list(joints)) if joints else STATE}")
    lines += [f"{key}: {value}" for key, value in about.items()]
    lines.append("tables:")
    rows = list(table)
    first = {quantity.kind: quantity for quantity in reversed(quantities)}
    for quantity in reversed(first.values()):
        gains = json.dumps(dict.fromkeys(joints, STATE)) if joints else "null"
        gain = f", gain: {gains}" if quantity.unit == "A" else ""
        rows.append(
            f"{quantity.kind}: {{columns: {json.dumps(list(quantity.columns))}, unit: {quantity.unit}{gain}}}"
        )
    lines += [f"  {'-' if index == 0 else ' '} {row}" for index, row in enumerate(rows)]
    return "\n".join(lines) + "\n"
