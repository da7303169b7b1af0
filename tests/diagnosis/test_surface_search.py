# SPDX-License-Identifier: BSD-3-Clause
"""Surfaces that differ from the task's are found in rows in contact, with their numbers; the task's own are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.diagnosis.data.admission import admit
from impedance_modules.diagnosis.data.nominal_model import model_of_urdf
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.data.task_surfaces import task_surfaces_of
from impedance_modules.diagnosis.model_selection.surface_search import ContactResult, matters, search_surfaces
from impedance_modules.diagnosis.regression.contact_rows import (
    ContactRecording,
    SurfaceNumbers,
    contact_recording,
)
from impedance_modules.diagnosis.residuals.band import choose_band
from impedance_modules.diagnosis.residuals.preparation import prepare
from impedance_modules.episode.reader import read_episode
from tests.support.pressed_recordings import JOINTS, URDF, Floor, changed, middle_height, pressed

MAP = Floor(middle_height(), 4000.0, 20.0, 0.3)


def recorded(folder: Path, mapped: Floor, true: Floor, seed: int) -> list[ContactRecording]:
    """Three recordings."""
    paths = [pressed(folder, f"run{i}", 10 * seed + i, mapped, true) for i in range(3)]
    model = model_of_urdf(URDF, JOINTS)
    logs, _ = admit([read_episode(path) for path in paths], model)
    band, rigid = choose_band(logs), BatchedRigidModel.of_tree(URDF, model.tree)
    found = []
    for log in logs:
        item = prepare(log, model, rigid, band)
        around = log.surroundings
        nothing = np.zeros_like(item.residuals["link"])
        found.append(contact_recording(item, around.surfaces, around.hands, nothing, "link"))
    return found


def searched(folder: Path, mapped: Floor, true: Floor, seed: int) -> ContactResult:
    """What two recordings say; the third is not fitted."""
    found = recorded(folder, mapped, true, seed)
    return search_surfaces(found[:2], found[2:])


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("stiffness", [1000.0, 20000.0])
def test_the_task_s_own_floor_leaves_nothing(tmp_path, seed, stiffness) -> None:
    floor = changed(MAP, "k", stiffness)
    found = searched(tmp_path, floor, floor, seed)
    assert not found.gains
    assert found.explained and found.seconds > 5.0


def drawn(symbol: str, seed: int) -> float:
    dice = np.random.default_rng(seed)
    if symbol == "dh":
        return float(dice.choice([-1.0, 1.0]) * dice.uniform(0.004, 0.02))
    low, high = {"k": (1500.0, 9000.0), "mu": (0.0, 0.9)}[symbol]
    value = float(dice.uniform(low, high))
    return value if abs(value - getattr(MAP, symbol)) > 0.1 * high else drawn(symbol, seed + 100)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("symbol", ["dh", "k", "mu"])
def test_a_floor_that_differs_is_found_within_its_interval(tmp_path, symbol, seed) -> None:
    value = drawn(symbol, seed)
    found = searched(tmp_path, MAP, changed(MAP, symbol, value), seed)
    assert list(found.gains) == [(0, symbol)]
    std = found.fit.std((0, symbol)) * np.sqrt(found.scale)
    assert abs(getattr(found.fit.surfaces[0], symbol) - value) < 3.0 * std
    assert found.explained and found.shrink > 0.8


@pytest.mark.parametrize(("symbol", "value", "matter"), [("mu", 0.301, False), ("dh", 0.008, True)])
def test_a_change_within_the_tolerance_does_not_matter(tmp_path, symbol, value, matter) -> None:
    data = recorded(tmp_path, MAP, MAP, 1)[0]
    wrong = replace(SurfaceNumbers(0.0, MAP.k, MAP.mu), **{symbol: value})
    assert matters([data], {0: wrong}, 0.01) is matter
    assert matters([data], {0: wrong}, 0.0)


def test_what_is_no_task_knows_no_surroundings() -> None:
    assert task_surfaces_of("", {}) is None
    assert task_surfaces_of("a: [", {}) is None
    assert task_surfaces_of("format: 1\nname: x\n", {}) is None
    around = task_surfaces_of(MAP.task(), {"right": "palm"})
    assert around.hands == ("palm",) and around.surfaces[0].stiffness == MAP.k and not around.holds
    assert task_surfaces_of(MAP.task(), {}).hands == ("right_hand",)
