# SPDX-License-Identifier: BSD-3-Clause
"""The lists of mutants fit the code: every change still has its place. ``python -m tests.mutants`` runs them."""

from __future__ import annotations

import ast

import pytest

from tests.mutants.__main__ import areas, mutants_of, mutated
from tests.support.paths import CHECKOUT


@pytest.mark.parametrize("area", areas())
def test_every_mutant_changes_one_place_of_the_code(area: str) -> None:
    for mutant in mutants_of(area):
        ast.parse(mutated(mutant))
        assert mutant.tests
        assert all((CHECKOUT / test).exists() for test in mutant.tests)
