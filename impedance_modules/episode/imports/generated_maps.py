# SPDX-License-Identifier: BSD-3-Clause
"""Maps for logs that need none from the user: a joint recorder's file, and a bag with joint states.

They name their joints themselves. The map is made as text and read like any other, so that the episode keeps what
was assumed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from impedance_modules.episode.columns import TIME
from impedance_modules.episode.imports.log_sources import kind_of, need_bags
from impedance_modules.episode.imports.maker_maps import (
    STATE,
    MakerMap,
    MappedColumns,
    dataset_map,
    maker_map,
    map_text,
)
from impedance_modules.episode.imports.map_checks import facts_of_robot, facts_of_urdf, recognise
from impedance_modules.episode.imports.table import list_names
from impedance_modules.episode.imports.text_table import open_text, read_line
from impedance_modules.errors import BadInput
from impedance_modules.spec.robot_spec import RobotSpec

STATE_TOPIC = "joint_states"
"""What robots call the topic of their measured joints; another topic with the same joints is a reference."""

_UNITS = {"position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "effort": ("N.m", "N")}
"""Joint states in a bag, and their units at turning and at sliding joints."""

_TABLE_UNITS = {**_UNITS, "effort_command": _UNITS["effort"], "position_command": _UNITS["position"]}
"""Quantities of a table whose columns are named as those of an episode."""


def map_for(path: Path, urdf: Path | None) -> MakerMap:
    """Makes the map of a log that says itself what most of its columns mean.

    Args:
        path: A text log of a maker's software, a ROS recording, or a LeRobot dataset.
        urdf: Names the joints of a log that only numbers them, or None.

    Raises:
        BadInput: No log of a known kind.
    """
    kind = kind_of(path)
    if kind in ("dataset", "lerobot"):
        return dataset_map(path if kind == "dataset" else path.parent, urdf)
    if kind == "bag":
        return bag_map(path, urdf)
    if kind == "text":
        return text_map(path, urdf)
    what_it_is = "a folder without a recording" if kind == "folder" else "arrays that no map describes"
    raise BadInput(f"{path}: {what_it_is} (valid: --map FILE, see docs/import.md)")


def text_map(path: Path, urdf: Path | None) -> MakerMap:
    """Makes the map of a text file: a maker's own log, or one in the form of Rethink's joint recorder.

    The joint recorder's header begins with ``time`` and names joints; the values are positions [rad].

    Args:
        path: The log.
        urdf: Names the joints of a log that only numbers them, or None.

    Raises:
        BadInput: Another kind of text; the message says what a map for it would begin with.
    """
    with open_text(path) as stream:
        header = read_line(path, stream, 1).strip()
    if (known := maker_map(path, header, urdf)) is not None:
        return known
    names = [name.strip() for name in header.split(",")]
    if names[0] == TIME and urdf is not None and any(name.startswith("position.") for name in names):
        return _named_map(path, names, urdf)
    robot = recognise(names) if names[0] == TIME else None
    if robot is None:
        raise BadInput(
            f"{path}: a table whose columns no map describes (valid: --map FILE, see docs/import.md; without one, a"
            f" header 'time,JOINT,...' with the joints of a shipped robot, 'time,position.JOINT,effort.JOINT,...' with"
            " those of a description (--urdf), or one of libfranka or RTDE). It begins:"
            f" {header[:120]!r}"
        )
    joints = [joint for joint in robot.joints if joint in names]
    others = [name for name in names[1:] if name not in joints]
    notes = [f"not imported: {', '.join(others)}"] if others else []
    columns = {"position": "{joint}"}
    table = ["separator: comma", "header: true", f"time: {{column: {TIME}, unit: s}}"]
    return MakerMap(_map_text(robot, joints, table, columns, effort_source=None), (), tuple(notes))


def _named_map(path: Path, names: Sequence[str], urdf: Path) -> MakerMap:
    """Makes the map of a table whose columns are named as those of an episode, in SI units.

    Raises:
        BadInput: No position of any joint of the description.
    """
    facts = facts_of_urdf(urdf)
    joints = [joint for joint in facts.joints if f"position.{joint}" in names]
    if not joints:
        raise BadInput(
            f"{path}: no column 'position.JOINT' of a joint of {urdf} (valid: {list_names(list(facts.joints), 8)})"
        )
    quantities = []
    for kind, (turning, sliding) in _TABLE_UNITS.items():
        columns = tuple(f"{kind}.{joint}" for joint in joints)
        if set(columns) <= set(names):
            units = json.dumps({joint: sliding if joint in facts.prismatic else turning for joint in joints})
            quantities.append(MappedColumns(kind, columns, units))
    missing = ["'gravity_compensation': what held the arm's weight, robot, command or none"]
    about = {"gravity_compensation": STATE}
    if any(quantity.kind == "effort" for quantity in quantities):
        about["effort_source"] = STATE
        missing.append("'effort_source': was effort measured between gearbox and link, or at the motor?")
    used = {TIME, *(column for quantity in quantities for column in quantity.columns)}
    notes = tuple(f"not imported: {name}" for name in names if name not in used)
    table = ["separator: comma", "header: true", f"time: {{column: {TIME}, unit: s}}"]
    return MakerMap(map_text(urdf.stem, urdf, joints, about, table, quantities), tuple(missing), notes)


def bag_map(path: Path, urdf: Path | None) -> MakerMap:
    """Makes the map of a recording with the joint states of a shipped robot, or of one whose description is given.

    Raises:
        BadInput: No joint states, of no known robot, or several that could be meant.
    """
    filled, unstamped = _filled_fields(path)
    if urdf is not None:
        return _described_map(path, urdf, filled, unstamped)
    topic, robot, notes = _state_topic(path, filled)
    fields = filled[topic]
    joints = [joint for joint in robot.joints if joint in fields["position"]]
    clock = "received" if topic in unstamped else "header"
    if clock == "received":
        notes.append(f"the messages of {topic} have no stamp: time is when they were received")
    columns = {
        field: f"{topic}.{field}.{{joint}}" for field in _UNITS if fields.get(field, set()).issuperset(joints)
    }
    notes += [
        f"{field} is not filled in for every joint, and not imported"
        for field in _UNITS
        if field not in columns
    ]
    source = _effort_source(path, robot, joints) if "effort" in columns else None
    text = _map_text(robot, joints, [f"time: {{clock: {clock}}}"], columns, effort_source=source)
    return MakerMap(text, (), tuple(notes))


def _described_map(
    path: Path, urdf: Path, filled: Mapping[str, Mapping[str, set[str]]], unstamped: set[str]
) -> MakerMap:
    """Makes the map of the topic that lists most joints of a description."""
    facts = facts_of_urdf(urdf)
    known = {
        topic: [joint for joint in facts.joints if joint in fields.get("position", ())]
        for topic, fields in filled.items()
    }
    most = max(map(len, known.values()), default=0)
    chosen = [topic for topic, joints in known.items() if most and len(joints) == most]
    if len(chosen) != 1:
        listed = [f"{topic}: {', '.join(joints[:8]) or 'none'}" for topic, joints in known.items()]
        raise BadInput(
            f"{path}: not exactly one topic lists most joints of {urdf} (valid: --map FILE that says which; joints of"
            f" the description in it: {list_names(listed, 4)})"
        )
    joints, fields = known[chosen[0]], filled[chosen[0]]
    quantities = []
    for field, (turning, sliding) in _UNITS.items():
        if fields.get(field, set()).issuperset(joints):
            units = json.dumps({j: sliding if j in facts.prismatic else turning for j in joints})
            names = tuple(f"{chosen[0]}.{field}.{joint}" for joint in joints)
            quantities.append(MappedColumns(field, names, units))
    missing = ["'gravity_compensation': what held the arm's weight, robot, command or none"]
    about = {}
    if quantities[-1].kind == "effort":
        about["effort_source"] = STATE
        missing.append("'effort_source': was effort measured between gearbox and link, or at the motor?")
    clock = "received" if chosen[0] in unstamped else "header"
    about["gravity_compensation"] = STATE
    text = map_text(urdf.stem, urdf, joints, about, [f"time: {{clock: {clock}}}"], quantities)
    return MakerMap(text, tuple(missing), ())


def _filled_fields(path: Path) -> tuple[dict[str, dict[str, set[str]]], set[str]]:
    """Returns topic -> field -> joints with finite values in the first messages, and topics without stamps."""
    # The readers of bags are an extra, and take half a second to import: only when a bag is read.
    need_bags(path)
    from impedance_modules.episode.imports.bag_file import open_bag  # noqa: PLC0415
    from impedance_modules.episode.imports.bag_table import column_places, first_messages  # noqa: PLC0415

    filled: dict[str, dict[str, set[str]]] = {}
    unstamped: set[str] = set()
    with open_bag(path) as bag:
        column_places(bag)
        for message in first_messages(bag):
            if not message.stamp:
                unstamped.add(message.topic)
            for field in bag.topics[message.topic].fields:
                values = message.numbers(field)
                if field in _UNITS and len(values) == len(message.names):
                    kept = [
                        joint
                        for joint, value in zip(message.names, values, strict=True)
                        if np.isfinite(value)
                    ]
                    filled.setdefault(message.topic, {}).setdefault(field, set()).update(kept)
    return filled, unstamped


def _state_topic(
    path: Path, filled: Mapping[str, Mapping[str, set[str]]]
) -> tuple[str, RobotSpec, list[str]]:
    """Chooses the topic with measured positions of a known robot."""
    with_position = {topic: fields["position"] for topic, fields in filled.items() if "position" in fields}
    robots = {
        topic: robot for topic, names in with_position.items() if (robot := recognise(names)) is not None
    }
    if not robots:
        listed = [f"{topic}: {', '.join(sorted(names)[:8])}" for topic, names in with_position.items()]
        raise BadInput(
            f"{path}: no joint states of a shipped robot (valid: --map FILE that names robot and joints, with columns"
            f" TOPIC.FIELD.JOINT; present: {list_names(listed, 4)})"
        )
    named = [topic for topic in robots if topic.rpartition("/")[2] == STATE_TOPIC]
    chosen = named if named else list(robots)
    if len(chosen) > 1:
        raise BadInput(
            f"{path}: several topics hold the robot's joints: {', '.join(chosen)} (valid: --map FILE that says which,"
            f' as in columns: "{chosen[0]}.position.{{joint}}")'
        )
    others = sorted(set(filled) - set(chosen))
    notes = [f"topics not imported: {', '.join(others)}"] if others else []
    return chosen[0], robots[chosen[0]], notes


def _effort_source(path: Path, robot: RobotSpec, joints: Sequence[str]) -> str:
    """Says where effort was measured: at the series springs, if every joint has one."""
    if all(robot.joints[joint].spring_stiffness is not None for joint in joints):
        return "joint_sensor"
    raise BadInput(
        f"{path}: the robot file of '{robot.name}' has rigid joints, so it is not known where effort was measured"
        " (valid: --map FILE that says 'effort_source: joint_sensor' or 'motor')"
    )


def _map_text(
    robot: RobotSpec,
    joints: Sequence[str],
    table: Sequence[str],
    columns: Mapping[str, str],
    *,
    effort_source: str | None,
) -> str:
    facts = facts_of_robot(robot.name, Path())
    sliding = facts.prismatic if facts is not None else frozenset[str]()
    lines = ["format: 1", f"robot: {json.dumps(robot.name)}", f"joints: {json.dumps(list(joints))}"]
    if effort_source is not None:
        lines.append(f"effort_source: {effort_source}")
    lines.append(f"gravity_compensation: {robot.gravity_compensation}")
    lines.append("tables:")
    for kind, column in columns.items():
        units = {joint: _UNITS[kind][joint in sliding] for joint in joints}
        same = len(set(units.values())) == 1
        unit = units[joints[0]] if same else json.dumps(units)
        table = [*table, f"{kind}: {{columns: {json.dumps(column)}, unit: {unit}}}"]
    lines += [f"  {'-' if index == 0 else ' '} {line}" for index, line in enumerate(table)]
    return "\n".join(lines) + "\n"
