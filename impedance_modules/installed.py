# SPDX-License-Identifier: BSD-3-Clause
"""What other installed packages add: effects and backends, by the entry points of their distributions."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from impedance_modules.errors import BadInput

EFFECTS = "impedance_modules.effects"
"""Group of entry points: effect id = package.module:EffectClass."""

BACKENDS = "impedance_modules.backends"
"""Group of entry points: name = package.module:function (assembly, seed) -> Backend."""


@cache
def installed(group: str) -> dict[str, EntryPoint]:
    """Finds the entry points of a group by name; nothing of them is imported.

    Raises:
        BadInput: Two packages use one name.
    """
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        if point.name in found and found[point.name].value != point.value:
            raise BadInput(
                f"two installed packages add '{point.name}' to {group}: {found[point.name].value} and {point.value}"
                " (valid: one of them)"
            )
        found[point.name] = point
    return found


def loaded(group: str, name: str) -> Any:
    """Imports what an entry point names.

    Raises:
        BadInput: That fails, with the package's own words.
    """
    point = installed(group)[name]
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise BadInput(
            f"'{name}' of {group} cannot be loaded from {point.value}: {error} (valid: mend or uninstall that package)"
        ) from error
