# SPDX-License-Identifier: BSD-3-Clause
"""A stop calms: from states inside the limits, at every rate, on plants that differ from the model.

``python -m benchmarks.control.stops`` prints the same over many more stops.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly
from impedance_modules.effects.apply import apply_to_plant
from impedance_modules.spec.patch_file import read_patch
from tests.support.stops import (
    CALM_TIME,
    STOP_BUDGET,
    assembly_at,
    plant_of,
    stop_from_random_state,
    write_patch,
)

CASES = {
    "none": (),
    "delay": ("delay",),
    "lag": ("lag",),
    "backlash": ("backlash",),
    "motor gain": ("motor gain",),
    "sensor gain": ("sensor gain",),
    "delay, gain, play": ("delay", "motor gain", "backlash"),
}


@cache
def assembly(folder: Path, rate: float) -> Assembly:
    return assembly_at(folder, rate)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("stops")


@pytest.mark.parametrize("rate", [1000.0, 500.0, 200.0, 100.0])
@pytest.mark.parametrize("case", CASES)
def test_energy_never_rises_and_falls_below_one_percent(folder: Path, rate: float, case: str) -> None:
    used, names = assembly(folder, rate), CASES[case]
    random = np.random.default_rng(sum(map(ord, case)) + int(rate))
    effects = None
    if names:
        patch = write_patch(folder, used.model.joint_names, names, random)
        effects = apply_to_plant(used.model, read_patch(patch))
    stop = stop_from_random_state(used, plant_of(used, effects, int(rate)), random)
    assert stop.start > 0.5
    assert stop.rise <= STOP_BUDGET
    assert stop.left <= 0.01
    assert stop.seconds <= CALM_TIME
    assert "interrupt (a test asks for it)" in stop.reason
