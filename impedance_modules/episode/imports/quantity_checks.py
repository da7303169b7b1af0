# SPDX-License-Identifier: BSD-3-Clause
"""The meaning of one quantity in an import map: its columns, its unit, and the keys that its unit needs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from impedance_modules.episode.columns import FRAME_KINDS, JOINT_KINDS, PHASE, TANK, TIME
from impedance_modules.episode.imports.import_map import EFFORTS, POSITIONS
from impedance_modules.episode.imports.units import COUNTS, GAIN_UNITS, unit_factors
from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.document import Document

_TAKEN = (*JOINT_KINDS, *FRAME_KINDS, TIME, PHASE, TANK)
_BY_JOINT = ("unit", "sign", "offset", "gain", "counts_per_rev")
"""Keys that may hold one value for each joint."""

Path = tuple[str | int, ...]


def strangers(
    document: Document,
    path: Path,
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


def extra_problems(document: Document, path: Path, name: str, entry: Mapping[str, Any]) -> Iterator[Problem]:
    """Yields what is wrong with an extra quantity."""
    if name in _TAKEN:
        message = f"'{name}' has a meaning of its own in an episode; use another name"
        yield document.problem(path, message, at="key")
    if ("column" in entry) == ("columns" in entry):
        yield document.problem(path, "either 'column' or 'columns', and one of them", at="key")
    elif "columns" in entry:
        yield from _column_problems(document, (*path, "columns"), entry["columns"])


def quantity_problems(
    document: Document, path: Path, kind: str, prismatic: frozenset[str]
) -> Iterator[Problem]:
    """Yields what is wrong with one joint quantity.

    Args:
        document: The map.
        path: Of the quantity in it.
        kind: One of `JOINT_KINDS`.
        prismatic: Joints that slide.
    """
    yield from _Checks(document, path, kind, prismatic).problems()


def _column_problems(document: Document, path: Path, columns: Any) -> Iterator[Problem]:
    joints = document.data["joints"]
    if isinstance(columns, str):
        if len(joints) > 1 and "{joint}" not in columns and "{index}" not in columns:
            message = f"{len(joints)} joints would share the column '{columns}'; say where they differ"
            yield document.problem(path, message, ("{joint}", "{index}"))
    elif isinstance(columns, Mapping):
        yield from strangers(document, path, columns, joints, "'joints'")
    elif len(columns) != len(joints):
        yield document.problem(path, f"{len(columns)} columns for {len(joints)} joints (one for each)")


class _Checks:
    """The checks of one joint quantity."""

    def __init__(self, document: Document, path: Path, kind: str, prismatic: frozenset[str]) -> None:
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
                yield from strangers(self._document, path, self._entry[key], self._joints, "its joints")
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
        if self._kind in EFFORTS:
            yield from self._companion("gain", needed=not used.isdisjoint(GAIN_UNITS))

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
