# SPDX-License-Identifier: BSD-3-Clause
"""Nonlinear parameters: which are tried, where all recordings count, and that refined ones stay physical."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.regression import shape_refinement
from impedance_modules.diagnosis.regression.candidates import (
    PERIODS_MIN,
    Candidate,
    CandidateRegressor,
    covered,
    shapes_of,
)
from impedance_modules.diagnosis.regression.design_matrix import layout_of
from impedance_modules.diagnosis.regression.shape_refinement import ShapeRefiner
from impedance_modules.effects.bodies import HEAVY
from impedance_modules.effects.catalogue import CATALOGUE
from tests.support.commands import invoke
from tests.support.plant_recordings import patch_text, record, robot_folder

INTERVALS = st.lists(
    st.tuples(st.floats(-3.0, 3.0), st.floats(0.0, 2.0)).map(lambda x: (x[0], x[0] + x[1])),
    min_size=1,
    max_size=6,
)


@settings(max_examples=100, deadline=None)
@given(intervals=INTERVALS)
def test_each_place_is_covered_once(intervals: list[tuple[float, float]]) -> None:
    places = np.linspace(-3.0, 5.0, 80_001)
    inside = np.any([(low <= places) & (places <= high) for low, high in intervals], axis=0)
    assert covered(intervals) == pytest.approx(8.0 * inside.mean(), abs=1e-3 * len(intervals))


def swing(centre: float, travel: float) -> Any:
    time = np.arange(2000) / 200.0
    position = centre + 0.5 * travel * np.sin(1.3 * time)[:, None]
    model = SimpleNamespace(joint_names=("hinge",))
    return SimpleNamespace(position=position, model=model, joint=lambda name: 0)


@pytest.mark.parametrize("order", [16.0, 30.0, 75.0])
def test_a_ripple_is_looked_for_in_all_recordings_together(order: float) -> None:
    """Too few of its periods are in any one recording, enough in all of them, and between them it keeps its phase."""
    travel = 0.9 * 2.0 * np.pi / order
    candidate = Candidate(CATALOGUE["torque_ripple"], "actuator", "hinge", ("hinge",))
    several = [swing(centre, travel) for centre in (-0.5, 0.1, 0.6)]
    assert order * travel / (2.0 * np.pi) < PERIODS_MIN

    def off_phase(recordings: list[Any]) -> float:
        """Of the nearest order that is tried, at either end of what was seen [rad]."""
        tried = [shape["N"] for shape in shapes_of(candidate, recordings)]
        q = np.concatenate([one.position for one in recordings])
        return float(np.min(np.abs(np.array(tried) - order), initial=np.inf) * np.ptp(q) / 2.0)

    assert off_phase(several) < 1.05
    assert off_phase(several[:1]) > 1.05


@pytest.mark.parametrize(("periods", "moves"), [(1.3, True), (1.2, False), (0.5, False)])
def test_a_refined_ripple_still_runs_through_more_than_its_period(
    periods: float, moves: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stretched over the whole travel it would be an offset."""
    travel, order = 0.8, 30.0
    wanted = periods * 2.0 * np.pi / travel
    recording = swing(0.2, travel)
    candidate = Candidate(CATALOGUE["torque_ripple"], "link", "hinge", ("hinge",))
    monkeypatch.setattr(Candidate, "site", lambda self, signals: SimpleNamespace(signals=signals, joint=0))
    shaped = SimpleNamespace(shape={"N": order}, lower=np.full(2, -np.inf), upper=np.full(2, np.inf))
    layout = SimpleNamespace(scale=np.ones(2), unseen=np.zeros(2, dtype=bool))
    term = SimpleNamespace(candidate=candidate, shaped=shaped, layout=layout)
    refiner = ShapeRefiner.__new__(ShapeRefiner)
    refiner.signals, refiner.prepared = (recording,), (SimpleNamespace(signals=recording),)
    monkeypatch.setattr(shape_refinement, "REACH", 1.0)
    monkeypatch.setattr(ShapeRefiner, "_newton", lambda *rest: {"N": wanted})
    monkeypatch.setattr(ShapeRefiner, "term", lambda self, candidate, shape, layout: shape["N"])
    model_fit = SimpleNamespace(model=[term], of=lambda index: np.array([1.0, 0.5]))
    assert refiner._step(model_fit, 1.0) == (pytest.approx(wanted) if moves else None)


@pytest.mark.parametrize("whole", [True, False])
def test_where_a_whole_step_leads_out_of_what_a_shape_may_be_a_part_of_it_is_tried(
    whole: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ripple stayed at the order of its grid: a whole step towards its own left less of it than is a ripple."""
    monkeypatch.setattr(
        shape_refinement, "ModelFit", lambda design, folds, model: SimpleNamespace(model=model)
    )
    monkeypatch.setattr(shape_refinement, "_out_of_bounds", lambda fit: False)
    monkeypatch.setattr(shape_refinement, "_loss", lambda fit: abs(fit.model[-1] - 21.0))
    refiner = ShapeRefiner.__new__(ShapeRefiner)
    tried: list[float] = []

    def step(fit: Any, part: float) -> float | None:
        tried.append(part)
        return None if part == 1.0 and not whole else 24.0 - 10.0 / 3.0 * part

    monkeypatch.setattr(refiner, "_step", step)
    start = SimpleNamespace(design=None, folds=None, model=[24.0])
    better = refiner._better(start)
    assert better is not None and better.model == [pytest.approx(24.0 - 10.0 / 3.0 * tried[-1])]
    assert tried == ([1.0] if whole else [1.0, 0.3])
    monkeypatch.setattr(refiner, "_step", lambda fit, part: None)
    assert refiner._better(start) is None


def test_friction_that_fades_slower_than_recordings_last_never_falls_below_zero(tmp_path: Path) -> None:
    """In 8 s of 30 s only the slope is certain, with which any longer time leads to a motor."""
    robot = robot_folder(tmp_path)
    truth = patch_text(
        "friction_drift", "actuator", "port_bend", fv=(3.0, "N.m.s/rad"), k=(0.9, '"1"'), T=(30.0, "s")
    )
    paths, answer = record(tmp_path, robot, truth, seconds=8.0), tmp_path / "answer.json"
    run = invoke("diagnose", *paths, "--robot", robot, "--json", answer)
    found = json.loads(answer.read_text())
    assert found["verdict"] == "explained", run.output
    (cause,) = found["causes"]
    assert (cause["effect"], cause["joints"]) == ("friction_drift", ["port_bend"])
    numbers = cause["parameters"]["port_bend"]
    fv, k, T = (numbers[symbol]["value"] for symbol in ("fv", "k", "T"))
    assert fv == pytest.approx(3.0, rel=0.02)
    assert 0.0 < k < 1.0
    assert fv * k / T == pytest.approx(3.0 * 0.9 / 30.0, rel=0.1)


@pytest.mark.parametrize(
    "order", [88.9, pytest.param(37.3, marks=pytest.mark.long), pytest.param(61.7, marks=pytest.mark.long)]
)
def test_a_ripple_comes_back_with_its_order(tmp_path: Path, order: float) -> None:
    """Whatever order it has between two that are tried, and however little of a large gap the last step closes."""
    robot = robot_folder(tmp_path)
    truth = patch_text("torque_ripple", "actuator", "port_bend", A=(0.4, "N.m"), N=(order, '"1"'))
    paths, answer = record(tmp_path, robot, truth), tmp_path / "answer.json"
    run = invoke("diagnose", *paths, "--robot", robot, "--json", answer)
    found = json.loads(answer.read_text())
    assert found["verdict"] == "explained", run.output
    (cause,) = found["causes"]
    assert (cause["effect"], cause["joints"]) == ("torque_ripple", ["port_bend"])
    assert cause["parameters"]["port_bend"]["N"]["value"] == pytest.approx(order, abs=0.05)
    assert cause["parameters"]["port_bend"]["A"]["value"] == pytest.approx(0.4, rel=0.1)


PLACES = st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3).map(np.array)


@settings(max_examples=50, deadline=None)
@given(place=PLACES, mass=st.floats(0.05, 3.0))
def test_a_mass_that_the_weight_hides_is_looked_for_along_its_moments(place: np.ndarray, mass: float) -> None:
    """Links before it may be as much heavier: the fit then asks for a mass below zero, and its moments are right."""
    payload = CATALOGUE["payload"]
    hidden = np.concatenate([[-0.003], mass * place])
    found = [np.array(list(shape.values())) for shape in payload.shapes_within_bounds(hidden)]
    size = np.linalg.norm(place)
    assert len(found) == (3 if size > 0.0 else 0)
    for one in found:
        np.testing.assert_allclose(one / np.linalg.norm(one), place / size, atol=1e-9)
    assert CATALOGUE["joint_elasticity"].shapes_within_bounds(hidden) == ()


@pytest.mark.parametrize("hides", [True, False])
def test_where_no_shape_of_the_grid_is_physical_those_of_the_fit_are_tried(
    hides: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here only a mass far from the link's origin is one; where the fit is physical nothing else is tried."""
    payload = CATALOGUE["payload"]
    candidate = Candidate(payload, "link", "hand", ())
    monkeypatch.setattr(shape_refinement, "shapes_of", lambda *rest: [{"cx": 0.0, "cy": 0.0, "cz": 0.0}])

    def term(candidate: Any, shape: Any, like: Any) -> Any:
        shaped = SimpleNamespace(shape=shape, lower=np.array([0.0, *3 * [-np.inf]]), upper=np.full(4, np.inf))
        unseen = SimpleNamespace(unseen=np.zeros(4, dtype=bool))
        return SimpleNamespace(candidate=candidate, shaped=shaped, layout=unseen)

    class Fitted:
        def __init__(self, design: Any, folds: Any, model: list[Any]) -> None:
            self.design, self.folds, self.model = design, folds, model
            self.far = float(np.linalg.norm(list(model[-1].shaped.shape.values())))

        def of(self, index: int) -> np.ndarray:
            return np.array([self.far - 0.05 if hides else 1.0, 0.0, 0.0, 0.02])

    monkeypatch.setattr(shape_refinement, "ModelFit", Fitted)
    monkeypatch.setattr(shape_refinement, "_loss", lambda fitted: fitted.far)
    refiner = ShapeRefiner.__new__(ShapeRefiner)
    refiner.signals = ()
    monkeypatch.setattr(ShapeRefiner, "term", lambda self, *rest: term(*rest))
    start = Fitted(None, (), [term(candidate, {"cx": 0.0, "cy": 0.0, "cz": 0.0}, None)])
    found = refiner._within_bounds(start)
    assert found.far == pytest.approx(0.1 if hides else 0.0)


@settings(max_examples=30, deadline=None)
@given(apart=st.floats(1e-9, 1e-7), seed=st.integers(0, 2**32 - 1))
def test_a_mass_and_its_moments_do_not_cancel_at_a_million(apart: float, seed: int) -> None:
    """About a vertical axis the columns of both are one to nine digits; the sum of them is what a rotor would do."""
    dice = np.random.default_rng(seed)
    swing = np.sin(np.linspace(0.0, 30.0, 400))
    columns = np.column_stack([swing, swing + apart * dice.normal(size=400), swing, swing])
    columns[:, 2:] = dice.normal(size=(400, 2))
    candidate = Candidate(CATALOGUE["payload"], "link", "hand", ())
    regressor = CandidateRegressor(candidate, {}, ("payload", "hand", "link"))
    regressor.append(
        SimpleNamespace(
            blocks={("motor", 0): columns},
            lower=np.array([0.0, *3 * [-np.inf]]),
            upper=np.full(4, np.inf),
            fixed=False,
        )
    )
    layout = layout_of(regressor, [("motor", 0)], {}, {0: 0})
    X, target = columns * layout.scale**-1.0, 8.3 * swing + dice.normal(scale=0.1, size=400)
    found = np.linalg.solve(X.T @ X + np.diag(layout.precision), X.T @ target) / layout.scale
    assert np.abs(found).max() < 3.0 * HEAVY
    assert found[0] + found[1] == pytest.approx(8.3, abs=0.1)


@pytest.mark.parametrize("seconds", [3.0, 12.0, 60.0])
@pytest.mark.parametrize("nothing", [None, 0, 1])
def test_a_column_is_none_by_what_it_can_do_and_not_by_its_unit(seconds: float, nothing: int | None) -> None:
    """A clock's rate in millionths beside an age in seconds: the columns differ by a million, what they do does not."""
    time = np.linspace(0.0, seconds, 400)
    rate = np.cos(3.0 * time)
    columns = np.column_stack([1e-6 * time * rate, rate])
    if nothing is not None:
        columns[:, nothing] = 0.0
    clock = CATALOGUE["clock_drift"]
    most = np.array([clock.description.parameter(symbol).upper for symbol in ("ppm", "T")])
    regressor = CandidateRegressor(
        Candidate(clock, "timing", "log", ()), {}, ("clock_drift", "log", "timing")
    )
    regressor.append(SimpleNamespace(blocks={("motor", 0): columns}, lower=-most, upper=most, fixed=False))
    assert (layout_of(regressor, [("motor", 0)], {}, {0: 0}) is None) is (nothing is not None)


@pytest.mark.parametrize("part", [0.06, 0.3, 0.9])
def test_a_limit_is_looked_for_where_little_of_the_motion_is_below_it(part: float) -> None:
    """A motor that is nearly always at its limit of 0.7 N.m, asked for thirty times that: not from there alone."""
    dice = np.random.default_rng(1)
    few = dice.random(2000) < part
    asked = np.where(few, dice.uniform(-0.7, 0.7, 2000), dice.uniform(10.0, 30.0, 2000))
    site = SimpleNamespace(joint=0, signals=SimpleNamespace(drive=asked[:, None]))
    limits = [shape["limit"] for shape in CATALOGUE["torque_saturation"].shapes(site)]
    assert min(limits) < 1.0 and limits == sorted(set(limits))
