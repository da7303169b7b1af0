# SPDX-License-Identifier: BSD-3-Clause
"""Reads an import map: a YAML file that says what the columns of a foreign log mean."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from impedance_modules.episode.columns import JOINT_KINDS
from impedance_modules.episode.imports.import_map import (
    COUNTS,
    RANGE_UNITS,
    TIME_UNITS,
    Decimation,
    ImportMap,
    MappedQuantity,
    Reference,
    TableMap,
    TextLayout,
    TimeColumn,
    range_line,
    transmission_matrix,
    unit_factors,
)
from impedance_modules.episode.imports.map_checks import (
    RobotFacts,
    facts_of_robot,
    facts_of_urdf,
    map_problems,
    unknown_robot_note,
)
from impedance_modules.errors import BadFile
from impedance_modules.spec.document import Document, parse_document, scan_document
from impedance_modules.spec.schema import schema_problems

SCHEMA = "import-map"


def read_map(path: Path) -> ImportMap:
    """Reads an import map.

    Raises:
        BadInput: The map, or the URDF it names, cannot be read.
        BadFile: It says something wrong; all problems, each with its line.
    """
    return build_map(scan_document(path))


def parse_map(path: Path, text: str) -> ImportMap:
    """Makes an import map of text that was made for a log; ``path`` is only its name in messages.

    Raises:
        BadFile: The text is no import map.
    """
    return build_map(parse_document(path, text))


def build_map(document: Document) -> ImportMap:
    """Checks a document against schema and meaning, and turns it into frozen data.

    Raises:
        BadFile: All that is wrong, each with its line.
    """
    problems = [*document.yaml_problems, *schema_problems(document, SCHEMA)]
    if problems:
        raise BadFile(problems)
    data = document.data
    facts = _facts(document)
    prismatic = frozenset(data.get("prismatic", facts.prismatic if facts else ())) & frozenset(data["joints"])
    problems = map_problems(document, facts, prismatic)
    if problems:
        raise BadFile(problems)
    decimation = data.get("decimate")
    return ImportMap(
        document=document,
        robot=data["robot"],
        episode=data.get("episode"),
        joints=tuple(data["joints"]),
        prismatic=prismatic,
        limits={joint: facts.limits[joint] for joint in data["joints"] if joint in facts.limits}
        if facts
        else {},
        beyond_limits=frozenset(data.get("beyond_limits", ())),
        effort_source=data.get("effort_source"),
        gravity_compensation=data["gravity_compensation"],
        rate=None if "rate" not in data else float(data["rate"]),
        transmission=transmission_matrix(data["transmission"], data["joints"])
        if "transmission" in data
        else None,
        decimation=None
        if decimation is None
        else Decimation(decimation["keep_every"], float(decimation["low_pass"])),
        repeats=tuple(tuple(group) for group in data.get("repeats", ())),
        tables=tuple(_table(index, table, data, prismatic) for index, table in enumerate(data["tables"])),
        notes=() if facts else (unknown_robot_note(data["robot"]),),
    )


def _facts(document: Document) -> RobotFacts | None:
    """What the URDF or the robot folder knows; None where there is neither."""
    if "urdf" in document.data:
        return facts_of_urdf(document.path.parent / document.data["urdf"])
    return facts_of_robot(document.data["robot"], document.path)


def _table(
    index: int, table: Mapping[str, Any], data: Mapping[str, Any], prismatic: frozenset[str]
) -> TableMap:
    joints = data["joints"]
    quantities = [_quantity(kind, table[kind], joints, prismatic) for kind in JOINT_KINDS if kind in table]
    extra: dict[str, tuple[Reference, float]] = {}
    for name, entry in table.get("extra", {}).items():
        scale = float(entry.get("scale", 1.0))
        if "column" in entry:
            extra[name] = (entry["column"], scale)
        else:
            named = expand_columns(entry["columns"], joints)
            extra.update({f"{name}.{joint}": (column, scale) for joint, column in named.items()})
    return TableMap(
        index, table.get("file"), _text(table), _time(table.get("time")), tuple(quantities), extra
    )


def _text(table: Mapping[str, Any]) -> TextLayout | None:
    if "separator" not in table:
        return None
    return TextLayout(table["separator"], table["header"], table.get("skip_rows", 0), table.get("comment"))


def _time(time: Mapping[str, Any] | None) -> TimeColumn | None:
    if time is None:
        return None
    return TimeColumn(time.get("column"), TIME_UNITS[time.get("unit", "s")], time.get("clock"))


def _quantity(
    kind: str, entry: Mapping[str, Any], joints: list[str], prismatic: frozenset[str]
) -> MappedQuantity:
    columns = expand_columns(entry["columns"], joints)
    motor = entry.get("side") == "motor"
    gain = entry.get("gain", 1.0)
    scale = {}
    offset = {joint: float(value) for joint, value in entry.get("offset", {}).items()}
    for joint in columns:
        unit = _of(entry["unit"], joint)
        factor = unit_factors(kind, sliding=joint in prismatic and not motor)[unit]
        if unit == COUNTS:
            factor /= float(_of(entry["counts_per_rev"], joint))
        if unit in RANGE_UNITS:
            factor, start = range_line(unit, entry["range"][joint])
            offset[joint] = offset.get(joint, 0.0) + start
        if not isinstance(gain, str):
            factor *= float(_of(gain, joint))
        scale[joint] = factor * entry.get("sign", {}).get(joint, 1)
    return MappedQuantity(kind, columns, scale, gain if isinstance(gain, str) else None, motor, offset)


def _of(value: Any, joint: str) -> Any:
    """One joint's value of a key that may hold one for all."""
    return value[joint] if isinstance(value, Mapping) else value


def expand_columns(columns: Any, joints: list[str]) -> dict[str, Reference]:
    """Returns joint -> column for a pattern, a list or a mapping, in the order of ``joints``."""
    if isinstance(columns, str):
        return {
            joint: columns.replace("{joint}", joint).replace("{index}", str(index))
            for index, joint in enumerate(joints, start=1)
        }
    if isinstance(columns, Mapping):
        return {joint: columns[joint] for joint in joints if joint in columns}
    return dict(zip(joints, columns, strict=True))
