# SPDX-License-Identifier: BSD-3-Clause
"""Runs a test of laws twice: on laws as plain Python, and on the same laws as machine code."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from impedance_modules.compiled import Law, use_machine_code

WAYS = tuple(os.environ.get("LAWS_RUN_AS", "python,machine code").split(","))
"""``python -m tests.mutants`` runs laws as Python only."""

if WAYS == ("python",):
    use_machine_code(False)


@pytest.fixture(params=WAYS)
def ways(request: pytest.FixtureRequest) -> Iterator[str]:
    """Switches all laws of the process; afterwards they run as they did before."""
    before = Law.in_machine_code
    use_machine_code(request.param == "machine code")
    yield request.param
    Law.in_machine_code = before


@pytest.fixture
def machine_code() -> Iterator[None]:
    """Runs laws as machine code, where a test needs their speed and another one runs them both ways."""
    before = Law.in_machine_code
    use_machine_code("machine code" in WAYS)
    yield
    use_machine_code(before)
