# SPDX-License-Identifier: BSD-3-Clause
"""Task 1 of the thesis in short form: who keeps contact, and what the hand learns of the sheet."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_experiments.terrain_shapes import (
    HIGHEST,
    draw_heights,
    draw_sheets,
    height_over,
    shaped_sheet,
    steepness,
    support_places,
)
from impedance_experiments.terrain_slides import Slide, deviation_along_y
from impedance_experiments.terrain_variations import (
    CLEARANCE,
    MIDDLE,
    draw_errors,
    draw_maps,
    stopped_at,
    wrong_table,
)
from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.contact_geometry import place_surface, surface_distance
from impedance_modules.spec.task import SurfaceSpec


def test_springs_keep_contact_and_position_playback_gives_up_at_the_bar(facts_of) -> None:
    facts = facts_of("terrain")
    assert facts["contact, impedance"] == 1.0 and facts["stopped, impedance"] == 0.0
    assert facts["deviation, impedance"] < 0.024
    # The bar's flank begins at y = -0.35 m, its top at -0.233 m.
    assert facts["stopped, position"] == 1.0 and -0.35 < facts["stopped at y, position"] < -0.23
    assert facts["peak, position"] > 1.5 * facts["peak, impedance"]


def test_strokes_at_two_forces_tell_shape_and_stiffness(facts_of) -> None:
    facts = facts_of("surface-map")
    assert facts["shape"] < 0.0006 and facts["shape"] < 0.5 * facts["pressed"]
    assert facts["stiffness"] < 0.12 and facts["cells"] >= 10


def test_a_wrong_table_is_off_by_what_was_drawn() -> None:
    table = SurfaceSpec("plane", -0.3, None, (0.0, 0.0, 0.0), None, 2e4, 100.0, 0.2)
    for row in draw_errors(np.random.default_rng(0), 20):
        wrong = wrong_table(table, row)
        over_middle = np.array([*MIDDLE, -0.3 + row[0]])
        distance, normal = surface_distance(place_surface(wrong), over_middle)
        assert distance == pytest.approx(0.0, abs=1e-12)
        assert np.arccos(normal[2]) == pytest.approx(np.hypot(row[1], row[2]), abs=1e-9)
        assert wrong.stiffness == row[3]


def test_no_hand_starts_inside_a_table() -> None:
    table = SurfaceSpec("plane", -0.3, None, (0.0, 0.0, 0.0), None, 2e4, 100.0, 0.2)
    hand = np.array([0.634, -0.38, -0.285])
    maps, redrawn = draw_maps(np.random.default_rng(1), 60, table, hand)
    heights = [surface_distance(place_surface(wrong_table(table, row)), hand)[0] for row in maps]
    assert maps.shape == (60, 4) and redrawn > 5 and min(heights) >= CLEARANCE
    assert np.ptp(maps[:, 0]) > 0.04


def test_springs_keep_contact_with_shapes_that_playback_does_not_follow(facts_of) -> None:
    facts = facts_of("terrain-shapes")
    assert facts["kept contact, impedance"] > facts["kept contact, velocity"]
    assert facts["deviation, impedance"] < facts["deviation, velocity"]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_shaped_sheet_passes_through_what_was_drawn(seed: int) -> None:
    places = support_places()
    heights = draw_heights(np.random.default_rng(seed), places)
    assert heights.shape == places.shape == (17,) and np.abs(heights).max() <= HIGHEST + 1e-12
    task = assemble("slide-over", effects=None, rate=None, scale=1.0, arm=None).task
    sheet = next(surface for surface in task.environment if surface.sheet is not None)
    placed = place_surface(shaped_sheet(sheet, places, heights))
    for place, height in zip(places, heights, strict=True):
        over = placed.origin + placed.rotation @ np.array([place, 0.0, height + 0.01])
        assert height_over(placed, over) == pytest.approx(0.01, abs=1e-9)
    between = placed.origin + placed.rotation @ np.array([-0.01, 0.0, 0.0])
    assert height_over(placed, between) == np.inf
    flat = np.abs(np.diff(heights)).max() / np.diff(places)[0]
    assert steepness(heights[None])[0] == pytest.approx(flat)


def test_no_hand_starts_inside_a_sheet() -> None:
    hand = np.array([0.634, -0.38, -0.285])
    sheets = draw_sheets(np.random.default_rng(1), 40, hand)
    clear = [height_over(place_surface(sheet), hand) for _, sheet in sheets.maps]
    assert min(clear) >= CLEARANCE and sheets.redrawn > 2
    for (floor, _), heights in zip(sheets.maps, sheets.heights, strict=True):
        assert floor.height < -0.3 + heights.min()


def test_deviation_and_thresholds_are_read_from_the_slides() -> None:
    time = np.arange(0.0, 12.0, 0.01)
    place = np.column_stack([np.zeros((time.size, 2)), np.zeros(time.size)])
    still = Slide(time, place, np.zeros((time.size, 3)), 0.02 * time, np.zeros((time.size, 1)), "", ())
    moved = place + np.array([0.0, 0.03, 0.0])
    other = Slide(time[:900], moved[:900], still.force[:900], still.away[:900], still.path[:900], "", ())
    assert deviation_along_y(still, other) == pytest.approx(0.03)
    assert stopped_at(still, 0.1) == 500 and stopped_at(still, 0.5) is None
    assert still.contact == 0.0
