# SPDX-License-Identifier: BSD-3-Clause
"""What repeats the catalogue of effects (the patch schema, the docs) is in step with it."""

from __future__ import annotations

from docs import effects_tables
from tests.support.paths import CHECKOUT


def test_schema_and_docs_are_in_step_with_the_catalogue() -> None:
    behind = [str(path.relative_to(CHECKOUT)) for path in effects_tables.stale()]
    assert not behind, f"{behind} not up to date: run python -m docs.effects_tables"


def test_schema_and_docs_have_the_places_to_write_to() -> None:
    effects = (CHECKOUT / "docs" / "effects.md").read_text()
    assert effects_tables.TABLE.search(effects)
    assert effects_tables.COUNT.search(effects)
    assert effects_tables.ENUM.search((CHECKOUT / "schemas" / "patch.schema.json").read_text())
