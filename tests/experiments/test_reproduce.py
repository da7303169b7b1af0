# SPDX-License-Identifier: BSD-3-Clause
"""``impedance reproduce``: the list, the pages it writes, and what it refuses."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from impedance_experiments.page_files import AS_PRINTED, PROSE_WIDTH, difference, wrapped
from impedance_experiments.thesis_experiments import EXPERIMENTS, find_experiment
from impedance_modules.cli.reproduce_verb import reproduce_command as command
from impedance_modules.errors import BadInput
from tests.support.paths import CHECKOUT


def test_the_list_has_one_experiment_per_line() -> None:
    lines = CliRunner().invoke(command, ["--list"]).output.splitlines()
    assert [line.split()[0] for line in lines] == list(EXPERIMENTS)


def test_every_experiment_has_a_module_of_its_own() -> None:
    package = CHECKOUT / "impedance_experiments"
    for experiment in EXPERIMENTS.values():
        path = package.joinpath(*experiment.module.split("."))
        assert path.with_suffix(".py").is_file() or (path / "__init__.py").is_file(), experiment


def make_page(*options: str, out: Path) -> None:
    words = ["planar-arms", *options, "--out", str(out)]
    assert CliRunner().invoke(command, words, catch_exceptions=False).exit_code == 0


def test_a_page_has_its_table_its_plots_and_its_command(tmp_path: Path) -> None:
    make_page(out=tmp_path)
    text = (tmp_path / "planar-arms.md").read_text()
    assert "impedance reproduce planar-arms" in text and "eq. 4.30" in text and "18.36" in text
    pictures = re.findall(r"\]\((.*?\.png)\)", text)
    assert pictures and all((tmp_path / picture).stat().st_size > 1000 for picture in pictures)


def test_the_lines_of_a_page_are_filled() -> None:
    item = f"- see `tune a-task --alone`, {'a word ' * 30}- and a dash"
    lines = wrapped(f"{'A word ' * 40}\nand more\n\n{item}\n{item}").splitlines()
    starts = [line[:2] for line in lines]
    assert max(map(len, lines)) <= PROSE_WIDTH and starts.count("- ") == 2 and starts.count("") == 1
    assert wrapped("one\n\ntwo\n\nthree") == "one\n\ntwo\n\nthree"
    assert wrapped("One paragraph.\n\n**Another** one.\n").split("\n\n") == [
        "One paragraph.",
        "**Another** one.",
    ]
    assert sum("`tune a-task --alone`" in line for line in lines) == 2 and " and more" in " ".join(lines)


def test_the_index_keeps_the_rows_of_pages_made_before(tmp_path: Path) -> None:
    made = "Made by `impedance reproduce terrain --full` in 812 s of processor time."
    rows = "|---|---|---|---|---|---|\n| keeps contact | throughout | 99.5 % |  | 1 | springs |\n"
    other = f"# Older\n\n{made}\n\n## Thesis against ours\n\n| quantity | thesis | ours | spread | unit | why |\n{rows}"
    other += "\n| a | table | of | six | more | columns |\n"
    (tmp_path / "terrain.md").write_text(other)
    make_page("--seed", "3", out=tmp_path)
    index = (tmp_path / "README.md").read_text()
    full = "[terrain](terrain.md) | `impedance reproduce terrain --full` |"
    assert f"| 5.1 | keeps contact | throughout | 99.5 % |  | 1 | in words; springs | {full}" in index
    assert "| 812 |" in index
    assert "columns" not in index
    assert index.count("[terrain]") == 2 and index.count("`impedance reproduce planar-arms --seed 3`") == 13
    assert index.index("eq. 4.30, both, Lambda_x,x") < index.index("keeps contact |")


@pytest.mark.parametrize(
    ("thesis", "ours", "expected"),
    [
        ("1.58", "1.51", "-4.4 %"),
        ("9.18", "9.179", "as printed"),
        ("-2.5", "-2.61", "+4.4 %"),
        ("0.60 +- 0.039", "0.61", "+1.7 %, within its spread"),
        ("0.60 +- 0.039", "0.7", "+16.7 %"),
        ("about 90", "28.78", "-68.0 %"),
        ("2.50 (squared)", "2.279", "-8.8 %"),
        ("0", "0.799", "+0.799 from zero"),
        ("0", "0", "as printed"),
        ("-", "3.5", "not in the thesis"),
        ("no", "no", "as printed"),
        ("lost at the bar", "90.6 % of the slide", "in words"),
        ("30", "3e+01", "as printed"),
    ],
)
def test_the_index_says_how_far_ours_is(thesis: str, ours: str, expected: str) -> None:
    assert difference(thesis, ours) == expected


def test_every_number_of_ours_that_differs_has_a_reason() -> None:
    lines = (
        (CHECKOUT / "docs" / "thesis" / "README.md")
        .read_text()
        .split("## Thesis against ours")[1]
        .splitlines()
    )
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")]
    place = rows[0].index("how far, and why")
    silent = [
        row[1] for row in rows[1:] if row[2] != "-" and row[place] != AS_PRINTED and ";" not in row[place]
    ]
    assert len(rows) > 100 and not silent


def test_an_unknown_name_is_refused_with_the_nearest_one(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="did you mean 'planar-arms'"):
        find_experiment("planar-arm")
    result = CliRunner().invoke(command, ["nonsense", "--out", str(tmp_path / "none")])
    assert isinstance(result.exception, BadInput) and not (tmp_path / "none").exists()
