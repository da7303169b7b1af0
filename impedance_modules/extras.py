# SPDX-License-Identifier: BSD-3-Clause
"""Packages that only some commands need: imported where they are used, asked for by the extra that installs them."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

from impedance_modules.errors import BadInput

EXTRAS = {"matplotlib": "plots", "rosbags": "bags", "apsw": "bags", "lz4": "bags", "mujoco": "mujoco"}
"""Package as it is imported -> extra of this package that installs it."""


def how_to_install(package: str) -> str:
    """Gives the command that installs a package's extra."""
    return f"pip install 'impedance-modules[{EXTRAS[package]}]'"


def installed(package: str) -> bool:
    """Says whether a package can be imported; it is not imported for that."""
    try:
        return find_spec(package) is not None
    except (ImportError, ValueError):
        return False


def need(package: str, what: str) -> None:
    """Refuses what cannot be done without a package.

    Args:
        package: As it is imported.
        what: Who needs it, e.g. an option.

    Raises:
        BadInput: It is not installed; names the extra.
    """
    try:
        import_module(package)
    except ImportError:
        raise BadInput(
            f"{what} needs {package}, which is not installed (valid: {how_to_install(package)})"
        ) from None
