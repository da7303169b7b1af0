# SPDX-License-Identifier: BSD-3-Clause
"""A task file on its way to a TaskSpec: which parts are sound, and the robot they are checked against.

A file may have one fault in one corner; all other corners are still checked, so that every fault is reported
at once. A part is *clean* when neither the YAML nor the schema found anything wrong in it or around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from impedance_modules.errors import Problem
from impedance_modules.spec.robot_spec import LimbSpec, RobotSpec
from impedance_modules.spec.document import Document
from impedance_modules.spec.urdf import UrdfFacts
from impedance_modules.spec.yaml_tree import Path


@dataclass(frozen=True)
class Draft:
    """A task file, its faults so far, and its robot.

    Attributes:
        document: The file.
        broken: Paths at which the YAML or the schema found something wrong.
        robot: None where the robot itself could not be read; what needs it is then left unchecked.
        urdf: Of that robot.
    """

    document: Document
    broken: tuple[Path, ...]
    robot: RobotSpec | None
    urdf: UrdfFacts | None

    def has(self, *path: str | int) -> bool:
        """Whether the file gives a value at a path."""
        return self._find(path) is not _ABSENT

    def clean(self, *path: str | int) -> bool:
        """Whether a value is given and nothing is wrong with it."""
        touching = (broken[: len(path)] == path[: len(broken)] for broken in self.broken)
        return self.has(*path) and not any(touching)

    def value(self, *path: str | int) -> Any:
        """The value at a path; None where there is none."""
        found = self._find(path)
        return None if found is _ABSENT else found

    def keys(self, *path: str | int) -> tuple[str, ...]:
        """Keys of the mapping at a path; none where there is no mapping."""
        found = self._find(path)
        return tuple(found) if isinstance(found, dict) else ()

    def count(self, *path: str | int) -> range:
        """Positions of the list at a path; none where there is no list."""
        found = self._find(path)
        return range(len(found)) if isinstance(found, list) else range(0)

    def limb(self, arm: str) -> LimbSpec | None:
        """The limb of an arm; None where it is unknown."""
        return None if self.robot is None else self.robot.limbs.get(arm)

    def problem(
        self, path: Sequence[str | int], message: str, valid: Sequence[str] = (), at: str = "value"
    ) -> Problem:
        """Locates a problem in the file, as ``Document.problem`` does."""
        return self.document.problem(path, message, valid, at)

    def _find(self, path: Path) -> Any:
        found: Any = self.document.data
        for step in path:
            in_list = isinstance(found, list) and isinstance(step, int) and step < len(found)
            if not in_list and not (isinstance(found, dict) and step in found):
                return _ABSENT
            found = found[step]
        return found


class _Absent:
    """Stands for a value that is not given; None would be one that is given as nothing."""


_ABSENT = _Absent()
