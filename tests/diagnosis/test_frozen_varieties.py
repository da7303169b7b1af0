# SPDX-License-Identifier: BSD-3-Clause
"""The generator of the wide benchmark is the one that was sealed before any frozen variety was asked."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.wide import blocks


def test_no_file_of_the_generator_has_changed_since_it_was_sealed() -> None:
    blocks.check_frozen()


def test_a_changed_file_is_refused_by_its_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    other = tmp_path / "frozen_seals.txt"
    first, *rest = blocks.FROZEN_SEALS.read_text().splitlines()
    other.write_text("\n".join(["0" * 64 + first[64:], *rest]))
    monkeypatch.setattr(blocks, "FROZEN_SEALS", other)
    with pytest.raises(ValueError, match=f"{first.split()[1]}: not the file that was sealed"):
        blocks.check_frozen()
