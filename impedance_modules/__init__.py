# SPDX-License-Identifier: BSD-3-Clause
"""Modular multi-arm impedance control with config-driven tasks.

The names of ``impedance_modules.api`` can be taken from here; they are imported when one is first used.
"""

from __future__ import annotations

from typing import Any

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Finds a name of the Python API."""
    from importlib import import_module  # noqa: PLC0415 - the command line imports this package without the API

    if name.startswith("_") or name not in (api := import_module("impedance_modules.api")).__all__:
        raise AttributeError(f"module 'impedance_modules' has no attribute '{name}'")
    return getattr(api, name)
