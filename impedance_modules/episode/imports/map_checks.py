# SPDX-License-Identifier: BSD-3-Clause
"""The meaning of an import map, checked once its shape is right: every problem, each with its line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from impedance_modules.episode.columns import JOINT_KINDS
from impedance_modules.episode.imports.quantity_checks import extra_problems, quantity_problems, strangers
from impedance_modules.episode.imports.robot_facts import RobotFacts
from impedance_modules.episode.imports.transmission import transmission_matrix
from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.document import Document

_TEXT_ONLY = ("header", "skip_rows", "comment")
_SINGULAR = 1e12
"""Condition number from which a transmission counts as impossible to turn back."""

Path = tuple[str | int, ...]


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


def _joint_problems(document: Document, facts: RobotFacts | None) -> Iterator[Problem]:
    data = document.data
    for index, joint in enumerate(data["joints"]):
        if facts is not None and joint not in facts.joints:
            message = f"{facts.source} has no moving joint '{joint}'{nearest(joint, facts.joints)}"
            yield document.problem(("joints", index), message, facts.joints)
    for key in ("prismatic", "beyond_limits"):
        yield from strangers(document, (key,), data.get(key, ()), data["joints"], "'joints'")


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
    strange = [*strangers(document, coupling, entry.get("coupling", {}), joints, "'joints'")]
    for motor, others in entry.get("coupling", {}).items():
        strange += strangers(document, (*coupling, motor), others, joints, "'joints'")
        if motor in others:
            message = f"'{motor}' and its own motor: that is the ratio"
            strange.append(document.problem((*coupling, motor, motor), message, at="key"))
    yield from strange
    if not strange and np.linalg.cond(transmission_matrix(entry, joints)) > _SINGULAR:
        yield document.problem(
            path, "R cannot be turned back: different joint motions look alike at the motors"
        )
    quantities = [table[kind] for table in document.data["tables"] for kind in JOINT_KINDS if kind in table]
    if all(quantity.get("side") != "motor" for quantity in quantities):
        message = "nothing was measured at the motors, so it has no effect; say 'side: motor' where it was"
        yield document.problem(path, message, at="key")


def _table_problems(document: Document, prismatic: frozenset[str]) -> Iterator[Problem]:
    tables = document.data["tables"]
    for index, table in enumerate(tables):
        path: Path = ("tables", index)
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


def _time_problems(document: Document, path: Path, time: Mapping[str, Any] | None) -> Iterator[Problem]:
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
