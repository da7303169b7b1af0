# SPDX-License-Identifier: BSD-3-Clause
"""`python -m benchmarks.wide calibrate`: the fit finds a known law, and is judged on what it has not seen."""

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.optimize import check_grad

from benchmarks.wide import calibrate
from benchmarks.wide.__main__ import main
from benchmarks.wide.calibrate import VARIETIES, NamedCause, fit, held_out, law_text, named_causes, pooled
from benchmarks.wide.design import DIMENSIONS
from benchmarks.wide.reliability import bins_of, brier_score, draw, table_of
from impedance_modules.diagnosis.model_selection.probability import FEATURES, ProbabilityLaw
from impedance_modules.diagnosis.result import Grounds

TRUE_LAW = ProbabilityLaw(-2.0, {"gain": 0.8, "lead": 0.9, "weight": 0.5, "unexplained": -1.0}, 0.6)


def causes(count: int, seed: int = 7) -> list[NamedCause]:
    """Causes whose truth is drawn with the probability that the law says."""
    rng = np.random.default_rng(seed)
    out = []
    for i in range(count):
        gain, lead = 10.0 ** rng.uniform(0.0, 4.0, 2)
        grounds = Grounds(
            gain=float(gain),
            lead=float(lead),
            weight=float(10.0 ** rng.uniform(-4.0, 0.0)),
            deviations=float(10.0 ** rng.uniform(0.0, 3.0)),
            lack_of_fit=float(rng.uniform(0.1, 3.0)),
            explained=bool(rng.integers(2)),
            motion=int(rng.integers(0, 2)),
            repeats=bool(rng.integers(2)),
            alternatives=int(rng.choice([0, 0, 1, 2])),
            others=int(rng.integers(4)),
        )
        values = {name: str(rng.choice(DIMENSIONS[name])) for name in VARIETIES}
        true = bool(rng.random() < TRUE_LAW(grounds))
        block = str(rng.choice(list("ABCE")))
        out.append(NamedCause(f"case{i}", block, values, "payload", grounds, true, False, True))
    return out


def test_the_fit_finds_the_law_that_the_truth_was_drawn_with() -> None:
    known = causes(4000)
    law = fit(known)
    off = [law(one.grounds) - TRUE_LAW(one.grounds) for one in known]
    assert np.sqrt(np.mean(np.square(off))) < 0.03
    assert law.alternative == pytest.approx(TRUE_LAW.alternative, abs=0.2)


def test_few_causes_give_a_law_with_the_right_signs() -> None:
    for seed in range(5):
        law = fit(causes(60, seed))
        assert all(beta * FEATURES[name] > 0.0 for name, beta in law.coefficients.items())
        assert 0.0 <= law.alternative <= 1.0


def test_the_gradient_is_that_of_the_loss() -> None:
    rng = np.random.default_rng(3)
    Z, k = rng.normal(size=(50, len(FEATURES))), rng.integers(0, 3, 50).astype(float)
    y = rng.integers(0, 2, 50).astype(float)
    for _ in range(5):
        at = np.array([*rng.normal(size=1 + len(FEATURES)), rng.uniform(0.2, 1.0)])
        error = check_grad(
            lambda x: calibrate._loss(x, Z, k, y)[0], lambda x: calibrate._loss(x, Z, k, y)[1], at
        )
        assert error < 1e-4


def test_a_few_causes_that_are_all_true_make_none_certain() -> None:
    """The prior keeps the law finite; without any cause there is none."""
    law = fit([replace(one, true=True, grounds=replace(one.grounds, alternatives=0)) for one in causes(10)])
    assert all(0.7 < law(replace(one.grounds, alternatives=0)) < 0.99 for one in causes(10))
    with pytest.raises(ValueError, match="no cause"):
        fit([])


def test_a_prediction_has_not_seen_the_truth_of_its_own_variety() -> None:
    known = causes(300)
    value = known[0].values["robot"]
    turned = [replace(one, true=not one.true) if one.values["robot"] == value else one for one in known]
    own = np.array([one.values["robot"] == value for one in known])
    first, second = held_out(known, "robot"), held_out(turned, "robot")
    assert np.array_equal(first[own], second[own])
    assert not np.allclose(first[~own], second[~own], atol=1e-3)


def test_several_predictions_are_pooled_by_their_odds() -> None:
    assert pooled({"a": np.array([0.9, 0.5]), "b": np.array([0.1, 0.5])}) == pytest.approx([0.5, 0.5])


def test_bins_count_every_cause_once() -> None:
    rng = np.random.default_rng(4)
    said = [*rng.random(500), 0.0, 1.0]
    true = [bool(rng.random() < p) for p in said]
    bins = bins_of(said, true)
    assert sum(part.rate.total for part in bins) == 502
    assert sum(part.rate.hits for part in bins) == sum(true)
    for part in bins:
        assert part.low <= part.mean <= part.high
    assert len(table_of(said, true)) == 2 + len(bins)


def test_the_score_of_what_is_known_is_zero_and_that_of_a_coin_a_quarter() -> None:
    assert brier_score([1.0, 0.0], [True, False]) == 0.0
    assert brier_score([0.5, 0.5], [True, False]) == 0.25


def test_the_diagram_of_the_same_numbers_is_the_same_file(tmp_path: Path) -> None:
    said, true = [0.1, 0.1, 0.5, 0.95], [False, False, True, True]
    draw(said, true, tmp_path / "a.svg")
    draw(said, true, tmp_path / "b.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def answered(folder: Path, known: list[NamedCause]) -> Path:
    """A folder as `generate` and `run` leave it: one cause per case, planted where it is true."""
    truth = {}
    (folder / "sealed").mkdir(parents=True)
    (folder / "answers").mkdir()
    for one in known:
        planted = {
            "effect": one.effect if one.true else "base_tilt",
            "also": [],
            "joints": [],
            "parameters": {},
        }
        truth[one.case] = {"block": one.block, "frozen": None, "values": one.values, "effects": [planted]}
        cause = {"effect": one.effect, "joints": [], "grounds": asdict(one.grounds)}
        (folder / "answers" / f"{one.case}.json").write_text(json.dumps({"causes": [cause], "small": []}))
    sealed = folder / "sealed" / "A.json"
    sealed.write_text(json.dumps({"block": "A", "cases": truth}))
    (folder / "seals.txt").write_text(f"{hashlib.sha256(sealed.read_bytes()).hexdigest()}  sealed/A.json\n")
    return folder


def test_the_command_prints_the_law_its_figures_and_draws_them(tmp_path: Path, monkeypatch) -> None:
    """Also: what it writes into the source is what it prints, and the same law."""
    known = sorted(causes(200), key=lambda one: one.case)
    out, diagram, source = answered(tmp_path / "out", known), tmp_path / "a.svg", tmp_path / "probability.py"
    assert named_causes(out, out / "answers") == known
    source.write_text(calibrate.SOURCE.read_text())
    monkeypatch.setattr(calibrate, "SOURCE", source)
    shown = CliRunner().invoke(main, ["calibrate", str(out), "--write", "--diagram", str(diagram)])
    assert shown.exit_code == 0, shown.output
    assert "Brier score" in shown.output and "| left out |" in shown.output
    assert diagram.read_text().count("<svg") == 1
    law = fit(known)
    assert law_text(law) in shown.output and source.read_text().count(law_text(law)) == 1
    written: dict[str, ProbabilityLaw] = {}
    exec(law_text(law), {"ProbabilityLaw": ProbabilityLaw}, written)
    for one in known:
        assert written["LAW"](one.grounds) == pytest.approx(law(one.grounds), abs=2e-3)


def test_several_folders_are_fitted_together(tmp_path: Path) -> None:
    """Answers lie beside the cases, or in a folder of folders with their names."""
    every = sorted(causes(200), key=lambda one: one.case)
    first, second = answered(tmp_path / "first", every[:90]), answered(tmp_path / "second", every[90:])
    law = law_text(fit(every))
    shown = CliRunner().invoke(main, ["calibrate", str(first), str(second)])
    assert shown.exit_code == 0 and law in shown.output
    for out in (first, second):
        (tmp_path / "elsewhere").mkdir(exist_ok=True)
        (out / "answers").rename(tmp_path / "elsewhere" / out.name)
    elsewhere = ["--answers", str(tmp_path / "elsewhere")]
    shown = CliRunner().invoke(main, ["calibrate", str(first), str(second), *elsewhere])
    assert shown.exit_code == 0 and law in shown.output


def test_a_folder_without_cases_or_answers_is_refused(tmp_path: Path) -> None:
    """Beside one that has both: the law would rest on fewer causes than were asked for."""
    every = causes(30)
    whole, mute = answered(tmp_path / "whole", every), answered(tmp_path / "mute", every)
    (mute / "answers").rename(tmp_path / "elsewhere")
    (tmp_path / "bare").mkdir()
    for other, words in (
        ("bare", "no cases (valid: OUT of `generate`"),
        ("mute", "no answers to the cases in"),
    ):
        shown = CliRunner().invoke(main, ["calibrate", str(whole), str(tmp_path / other)])
        assert shown.exit_code == 2 and words in shown.output and other in shown.output


def test_answers_without_grounds_are_refused(tmp_path: Path) -> None:
    out = answered(tmp_path / "out", causes(30))
    (out / "answers" / "case3.json").write_text('{"causes": [{"effect": "payload"}]}')
    shown = CliRunner().invoke(main, ["calibrate", str(out)])
    assert shown.exit_code == 2 and "case3.json: a cause without 'grounds'" in shown.output
