# SPDX-License-Identifier: BSD-3-Clause
"""`python -m benchmarks.wide ablate`: every rule can be left out, what mattered is seen, and the table counts it."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from benchmarks.wide import ablation
from benchmarks.wide.__main__ import main
from benchmarks.wide.ablation import MATTERED, WITH_ALL, Place, left_out, shown, watched
from benchmarks.wide.ablation import main as run_program
from benchmarks.wide.ablation_table import ablation_table
from benchmarks.wide.rules import RULES, Rule, rules_named
from impedance_modules.diagnosis.model_selection import acceptance, conclusion, tolerance
from impedance_modules.diagnosis.result import Cause, Remainder, Rival, Standing

PASSED = Remainder(1.0, True, "", 1.0, frozenset())


def cause(weight: float, *equivalent: str) -> Cause:
    return Cause(
        effect="payload",
        joints=("elbow",),
        port="link",
        parameters={},
        weight=weight,
        shrink=None,
        equivalent=tuple(Rival(name, ("elbow",), "") for name in equivalent),
        rivals=(),
        position_range={},
        velocity_range={},
        standing=Standing(1.0, 1.0),
    )


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_each_rule_can_be_left_out_and_comes_back(rule: Rule) -> None:
    place = Place.of(rule.place)
    before = getattr(place.holder, place.name)
    for text in rule.shows_in:
        assert callable(getattr(Place.of(text).holder, Place.of(text).name))
    with left_out(rule):
        assert getattr(place.holder, place.name) is rule.without
    assert getattr(place.holder, place.name) is before


def test_a_function_is_left_out_wherever_it_was_taken() -> None:
    before = conclusion.verdict_of
    rule = Rule("verdict", "", "model_selection.conclusion:verdict_of", lambda *_, **__: "left out")
    with left_out(rule):
        assert tolerance.verdict_of([], PASSED, near=True) == "left out"
    assert tolerance.verdict_of is before


@pytest.mark.parametrize(("weight", "mattered"), [(0.1, {"quarter"}), (0.9, set())])
def test_a_rule_matters_where_the_verdict_differs_without_it(weight: float, mattered: set[str]) -> None:
    before = conclusion.verdict_of
    with watched(rules_named(["quarter"])[0].rules) as found:
        assert conclusion.verdict_of([cause(weight)], PASSED, near=True) != ""
    assert found == mattered
    assert conclusion.verdict_of is before and conclusion.EXPLAINED_MIN > 0.0


def test_results_are_compared_by_names_and_verdicts() -> None:
    assert shown(cause(0.1)) == shown(cause(0.2)) != shown(cause(0.1, "payload"))
    assert shown((None, "one reason")) == shown([None, "another one"]) != shown((None, None))


def test_a_rule_of_no_name_is_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        main, ["ablate", str(tmp_path), "--answers", str(tmp_path), "--rule", "no-such"]
    )
    assert done.exit_code == 2
    assert "no rule has the name no-such (valid: harm," in done.output


def test_a_folder_without_cases_is_not_scored(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["score", str(tmp_path)])
    assert done.exit_code == 2
    assert "no cases with a sealed truth (valid: a folder that `generate` made)" in done.output


def case(block: str) -> dict[str, Any]:
    effect = {"effect": "payload", "also": [], "joints": [], "parameters": {}, "size": 2.0}
    return {"block": block, "frozen": None, "values": {}, "effects": [] if block == "B" else [effect]}


def write_answer(folder: Path, name: str, verdict: str, causes: Sequence[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    said = [{"effect": one, "joints": [], "parameters": {}, "equivalent": []} for one in causes]
    (folder / f"{name}.json").write_text(json.dumps({"verdict": verdict, "causes": said}))
    run = {"seconds": 1.0, "processor_seconds": 1.0, "memory_mb": 1.0, "errors": ""}
    (folder / f"{name}.run.json").write_text(json.dumps(run))


def watched_cases(folder: Path) -> Path:
    """Two clean cases and one payload; without `harm` the first raises an alarm and the payload is explained."""
    (folder / "sealed").mkdir(parents=True)
    for block, names in {"B": ["one", "two"], "A": ["three"]}.items():
        cases = {name: case(block) for name in names}
        (folder / "sealed" / f"{block}.json").write_text(json.dumps({"block": block, "cases": cases}))
    answers = folder / "answers"
    for name, verdict in {"one": "no_gap", "two": "no_gap", "three": "unexplained"}.items():
        write_answer(answers / WITH_ALL, name, verdict, [])
        mattered = ["harm"] if name != "two" else []
        (answers / WITH_ALL / f"{name}{MATTERED}").write_text(json.dumps(mattered))
    write_answer(answers / "harm", "one", "explained", ["torque_gain"])
    write_answer(answers / "harm", "three", "explained", ["payload"])
    return answers


def test_the_table_counts_what_becomes_right_and_wrong_without_a_rule(tmp_path: Path) -> None:
    answers = watched_cases(tmp_path)
    head, _, every, harm, narrow = ablation_table(
        {tmp_path: answers}, rules_named(["harm", "narrow"])
    ).splitlines()
    titles = [cell.strip() for cell in head.split("|")]
    assert titles[1:6] == ["left out", "what it does", "mattered in", *titles[4:6]]
    cells = dict(zip(titles, (cell.strip() for cell in harm.split("|")), strict=True))
    assert cells["mattered in"] == "2"
    assert cells["clean without alarm (B)"] == "-1"
    assert cells["explained, by it alone (A)"] == "+1"
    assert "100.0 % (2/2" in every and "0.0 % (0/1" in every
    assert set(narrow.replace(" ", "").split("|")[4:-1]) == {"-"}


def test_rules_left_out_at_once_are_asked_in_every_case(tmp_path: Path) -> None:
    answers, both = watched_cases(tmp_path), rules_named(["harm,quarter"])
    assert [rule.name for rule in both[0].rules] == ["harm", "quarter"]
    with pytest.raises(ValueError, match="was not asked without harm,quarter"):
        ablation_table({tmp_path: answers}, both)
    for name, verdict in {"one": "no_gap", "two": "explained", "three": "unexplained"}.items():
        write_answer(answers / "harm,quarter", name, verdict, [])
    row = ablation_table({tmp_path: answers}, both).splitlines()[-1]
    assert row.startswith("| harm, quarter | all of these at once | 3 | -1 |")


def test_cases_that_were_asked_but_not_watched_are_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else no rule would seem to matter in them."""
    answers = watched_cases(tmp_path)
    (answers / WITH_ALL / f"two{MATTERED}").unlink()
    asked: list[tuple[str, Sequence[str]]] = []

    def run(case: Path, _: object, answer: Path, program: Sequence[str]) -> dict[str, Any]:
        asked.append((case.name, program))
        return {"exit": 0, "processor_seconds": 1.0}

    monkeypatch.setattr(ablation, "run_case", run)
    ablation.watch_all(tmp_path, answers, (), 1, lambda _: None)
    assert [name for name, _ in asked] == ["two"] and asked[0][1][1] == "watch"


def test_a_program_without_two_rules_has_neither(monkeypatch: pytest.MonkeyPatch) -> None:
    before = conclusion.EXPLAINED_MIN, acceptance.HARM_MAX
    seen: list[tuple[float, float]] = []
    monkeypatch.setattr(
        "impedance_modules.cli.main.main",
        lambda: seen.append((conclusion.EXPLAINED_MIN, acceptance.HARM_MAX)),
    )
    monkeypatch.setattr(sys, "argv", ["ablation", "without", "quarter,harm", "--", "diagnose"])
    run_program()
    assert seen == [(0.0, float("inf"))]
    assert before == (conclusion.EXPLAINED_MIN, acceptance.HARM_MAX) and 0.0 not in before


def test_a_table_without_answers_is_refused(tmp_path: Path) -> None:
    answers = watched_cases(tmp_path)
    (answers / "harm" / "one.run.json").unlink()
    with pytest.raises(ValueError, match="one was not asked without harm"):
        ablation_table({tmp_path: answers}, rules_named(["harm"]))
    with pytest.raises(ValueError, match="no case was asked"):
        ablation_table({tmp_path: tmp_path / "none"})


def test_the_speed_of_a_diagnosis_is_measured_stage_by_stage(tmp_path: Path) -> None:
    words = [
        "-m",
        "benchmarks.diagnosis.diagnose_speed",
        "one-joint-20",
        "--runs",
        "1",
        "--sets",
        str(tmp_path),
    ]
    done = subprocess.run(
        [sys.executable, *words],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    stages = {line.split()[0]: float(line.split()[1]) for line in done.stdout.splitlines()[1:]}
    assert {name for name, seconds in stages.items() if seconds > 0.0} >= {"columns", "search", "rollouts"}
