# SPDX-License-Identifier: BSD-3-Clause
"""The thesis's chapter 3 in short form: the numbers behind the pages."""

from __future__ import annotations

from pathlib import Path

from impedance_modules.experiments.catalogue import find_experiment
from impedance_modules.experiments.settings import Settings, Size


def short(tmp_path: Path) -> Settings:
    return Settings(size=Size.SHORT, seed=0, work=tmp_path, on_progress=lambda _share, _doing: None)


def test_springs_hide_in_slow_motion_and_show_in_a_blow(tmp_path: Path) -> None:
    facts = find_experiment("series-elastic").run(short(tmp_path)).facts
    assert facts["lowest rigid limit"] < 90.0 < facts["highest rigid limit"]
    assert facts["least real part, collocated"] >= 0.0 > facts["least real part, non-collocated"]
    assert facts["departure of the angle"] < 0.02 and facts["departure of the velocity"] > 0.3
