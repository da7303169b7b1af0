# SPDX-License-Identifier: BSD-3-Clause
"""A map of what a hand touched: what was put in comes out, friction or not; what is missing is said."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from impedance_modules.episode.columns import pose_columns, wrench_columns
from impedance_modules.plain_figures import plain_figure, plain_powers
from impedance_modules.spec.task import SheetSpec, SurfaceSpec
from impedance_modules.tools.surface_fit import Touches, map_surface
from impedance_modules.tools.surface_truth import map_errors, true_surface
from tests.support.commands import invoke, refusal
from tests.support.recordings import save

HAND = "right_hand"


def hill(s: np.ndarray) -> np.ndarray:
    return 0.02 * np.sin(9.0 * s)


def give(s: np.ndarray) -> np.ndarray:
    return 1e-4 * (1.2 + np.cos(20.0 * s))


def direction_of(way: float) -> np.ndarray:
    return np.array([np.cos(way), np.sin(way), 0.0])


MIDDLE = np.array([0.6, -0.2, 0.0])


def along(found, way: float) -> np.ndarray:
    """How far along the strokes the cells of a map lie."""
    place = np.column_stack([found.place, np.zeros(found.along.size)])
    return (place - MIDDLE) @ direction_of(way)


def strokes(
    random: np.random.Generator,
    forces: tuple[float, ...],
    friction: float,
    noise: float = 0.0,
    way: float = 0.4,
) -> Touches:
    """Strokes to and fro over the hill, each at its upward force; friction against the motion, along the path."""
    step, direction, place, force = 0.004, direction_of(way), [], []
    for number, lift in enumerate(forces):
        heading = 1.0 if number % 2 == 0 else -1.0
        for s in heading * np.arange(-0.15, 0.15, step):

            def z(x: float, lift: float = lift) -> float:
                return float(hill(np.array(x)) - give(np.array(x)) * lift)

            slope = (z(s + 1e-5) - z(s - 1e-5)) / 2e-5
            normal = np.array([0.0, 0.0, 1.0]) - slope * direction
            normal /= np.linalg.norm(normal)
            tangent = direction * normal[2] + np.array([0.0, 0.0, slope * normal[2]])
            pressed = lift / normal[2]
            force.append(pressed * normal - friction * pressed * heading * tangent)
            place.append(MIDDLE + s * direction + np.array([0.0, 0.0, z(float(s))]))
    points, pushes = np.array(place), np.array(force)
    points += noise * 1e-4 * random.normal(size=points.shape)
    pushes += noise * 0.2 * random.normal(size=pushes.shape)
    return Touches(HAND, 0.05 * np.arange(len(points)), points, pushes, 2.0)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_shape_and_compliance_come_out_as_they_went_in_whatever_the_friction(friction: float) -> None:
    for seed in range(5):
        random = np.random.default_rng(seed)
        way = float(random.uniform(0.0, np.pi))
        forces = tuple(random.uniform(5.0, 30.0, 5) + np.array([0.0, 8.0, 0.0, 8.0, 0.0]))
        touches = strokes(random, forces, friction, way=way)
        found = map_surface(touches, 0.01)
        s = along(found, way)
        inner = np.isfinite(found.rest) & (np.abs(s) < 0.14)
        assert np.count_nonzero(inner) > 20
        assert np.abs(found.rest - hill(s))[inner].max() < 4e-4
        assert np.median(np.abs(found.compliance / give(s) - 1.0)[inner]) < 0.05


def test_standard_errors_tell_the_scatter() -> None:
    random = np.random.default_rng(3)
    away = []
    for _ in range(10):
        found = map_surface(strokes(random, (8.0, 16.0, 24.0, 30.0), 0.2, noise=3.0), 0.01)
        away.append(
            ((found.compliance - give(along(found, 0.4))) / found.compliance_error)[
                np.isfinite(found.compliance)
            ]
        )
    spread = np.sqrt(np.mean(np.concatenate(away) ** 2))
    assert 0.6 < spread < 2.0


def test_one_force_shows_the_pressed_shape_and_no_stiffness() -> None:
    found = map_surface(strokes(np.random.default_rng(0), (10.0,), 0.2), 0.01)
    assert np.isnan(found.stiffness).all() and np.isnan(found.rest).all()
    assert np.isfinite(found.pressed).all()


def test_a_logarithmic_axis_of_names_has_numbers_and_no_formulas() -> None:
    figure = plain_figure()
    axes = figure.subplots()
    axes.semilogy([0.0, 1.0], [3e3, 4e4])
    plain_powers(axes.yaxis)
    FigureCanvasAgg(figure).draw()
    marks = [text.get_text() for text in axes.yaxis.get_ticklabels(which="both") if text.get_text()]
    assert "5000" in marks and "10000" in marks and not any("$" in mark for mark in marks)


def test_the_truth_of_a_tilted_sheet_over_a_table() -> None:
    """Seen from above; where the hand reaches both, their stiffnesses add."""
    sheet = SurfaceSpec(
        "sheet", None, (0.6, -0.2, 0.0), (0.0, -0.1, 0.0), None, 2e4, 0.0, 0.0,
        sheet=SheetSpec(((-0.3, 0.0), (0.3, 0.0)), 0.4, 1.0),
    )  # fmt: skip
    table = SurfaceSpec("plane", -0.001, None, (0.0, 0.0, 0.0), None, 1e4, 0.0, 0.0)
    found = map_surface(strokes(np.random.default_rng(0), (10.0, 20.0), 0.0, way=0.0), 0.01)
    truth = true_surface((sheet, table), found)
    x = found.place[:, 0] - 0.6
    above = np.tan(0.1) * x > -0.001
    np.testing.assert_allclose(truth.height[above], np.tan(0.1) * x[above], atol=1e-9)
    np.testing.assert_allclose(truth.height[~above], -0.001)
    middle = int(np.argmin(np.abs(x)))
    alone = 1.0 / (1.0 / 2e4 + 0.6**3 / 48.0)
    carried = alone + (1e4 if found.pressed[middle] < -0.001 else 0.0)
    assert 1.0 / truth.compliance[middle] == pytest.approx(carried, rel=0.02)
    assert map_errors(found, truth).shape_cells == np.count_nonzero(np.isfinite(found.rest))


def recording(folder: Path, touches: Touches, *, force: bool = True, pose: bool = True) -> Path:
    """An episode of another program's: a hand's pose and force at 20 Hz, and a joint that is of no use."""
    zero = np.zeros(len(touches.time))
    columns = {"time": touches.time, "position.joint": zero}
    if pose:
        columns |= zip(pose_columns(HAND), [*touches.place.T, zero, zero, zero, zero + 1.0], strict=True)
    if force:
        columns |= zip(wrench_columns(HAND), [*touches.force.T, zero, zero, zero], strict=True)
    return save(folder, "touched", columns, robot="some", effort_source=None)


def test_a_recording_becomes_a_map(tmp_path: Path) -> None:
    touches = strokes(np.random.default_rng(0), (8.0, 16.0, 24.0), 0.2, noise=1.0)
    episode, out = recording(tmp_path, touches), tmp_path / "map"
    assert "with a stiffness" in invoke("map", episode, "--out", out).output
    with (out / "map.csv").open() as file:
        rows = list(csv.DictReader(file))
    said = json.loads((out / "map.json").read_text())
    assert said["cells"] == len(rows) > 25 and said["cells_with_stiffness"] > 20
    assert (out / "map.png").stat().st_size > 5000
    soft = max(rows, key=lambda row: float(row["compliance"] or 0.0))
    assert 1.0 / float(soft["stiffness"]) == pytest.approx(2.2e-4, rel=0.1)
    assert "already" in refusal("map", episode, "--out", out)


@pytest.mark.parametrize(
    ("made", "options", "words"),
    [
        ({"force": False}, [], "no force was recorded"),
        ({"pose": False}, [], "no pose was recorded"),
        ({}, ["--force", "80"], "presses on nothing: 0.00 s with 80 N or more"),
        ({}, ["--hand", "right_hnd"], "did you mean 'right_hand'"),
        ({}, ["--cell", "0.5"], "is no stroke for cells of 500 mm"),
        ({}, ["--cell", "0"], "--cell 0"),
        ({}, ["--truth"], "needs a simulated run"),
    ],
)
def test_what_is_missing_is_said_and_nothing_is_written(tmp_path: Path, made, options, words) -> None:
    touches, out = strokes(np.random.default_rng(0), (8.0, 16.0), 0.0), tmp_path / "map"
    assert words in refusal("map", recording(tmp_path, touches, **made), "--out", out, *options)
    assert not out.exists()
