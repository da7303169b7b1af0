# SPDX-License-Identifier: BSD-3-Clause
"""What docs say of the tree is true: links, cited files and modules, pictures; and their lines are short enough."""

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from docs import imports_picture
from tests.house.test_imports import RANK
from tests.support.paths import CHECKOUT

PROSE_WIDTH = 118
FOLDERS = ("impedance_modules", "impedance_experiments", "tests", "benchmarks", "docs", "examples", ".ci")
"""Where the source files lie that docs cite."""

DOCUMENTS = sorted(
    [*CHECKOUT.glob("*.md"), *(CHECKOUT / "docs").rglob("*.md"), *(CHECKOUT / "robots").rglob("*.md")]
)
SOURCES = {
    f"/{path.relative_to(CHECKOUT)}"
    for folder in FOLDERS
    for path in (CHECKOUT / folder).rglob("*")
    if path.suffix in (".py", ".yaml", ".urdf", ".txt", "") and path.is_file()
}

CITED = re.compile(r"(?<![\w/.-])(?:[\w.-]+/)*\w+\.py\b")
MODULE = re.compile(r"python -m ((?:benchmarks|docs|tests|impedance_modules|impedance_experiments)[\w.]*)")
LINK = re.compile(r"!?\[[^\]]*\]\((?P<target>[^)\s]+)\)")
OF_OTHERS = {"joint_recorder.py"}
"""Files of other projects."""

each_document = pytest.mark.parametrize(
    "document", DOCUMENTS, ids=lambda path: str(path.relative_to(CHECKOUT))
)


def prose(text: str) -> Iterator[tuple[int, str]]:
    """Yields number and text of all lines but code blocks, tables, and lines that are one link or picture."""
    fenced = block = in_list = False
    for number, (before, line) in enumerate(pairwise(["", *text.split("\n")]), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
            continue
        if line.strip() and not line.startswith(" "):
            in_list = re.match(r"[-*+] |\d+[.)] ", line) is not None or (in_list and bool(before.strip()))
        if line.strip() and not before.strip() and not block:
            block = line.startswith("    ") and not in_list
        block = block and (line.startswith("    ") or not line.strip())
        if not (fenced or block or line.lstrip().startswith("|") or LINK.fullmatch(line.strip())):
            yield number, line


@each_document
def test_lines_of_prose_are_short_enough(document: Path) -> None:
    long = [number for number, line in prose(document.read_text()) if len(line) > PROSE_WIDTH]
    assert not long, f"{document.relative_to(CHECKOUT)}: over {PROSE_WIDTH} columns in lines {long}"


@each_document
def test_links_lead_somewhere(document: Path) -> None:
    for match in LINK.finditer(document.read_text()):
        target = match["target"].split("#")[0]
        if target and "://" not in target:
            assert (document.parent / target).exists(), f"{document.relative_to(CHECKOUT)}: {match[0]}"


@each_document
def test_cited_source_files_exist(document: Path) -> None:
    """``safety/rows.py``, ``rows.py`` and ``impedance_modules/safety/rows.py`` all name the same file."""
    cited = set(CITED.findall(document.read_text())) - OF_OTHERS
    missing = sorted(name for name in cited if not any(path.endswith(f"/{name}") for path in SOURCES))
    assert not missing, f"{document.relative_to(CHECKOUT)} cites {missing}"


@each_document
def test_modules_that_readers_shall_run_exist(document: Path) -> None:
    for name in MODULE.findall(document.read_text()):
        path = CHECKOUT.joinpath(*name.rstrip(".").split("."))
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), f"python -m {name}"


def test_the_pictures_show_todays_imports() -> None:
    behind = imports_picture.text() != imports_picture.DOCUMENT.read_text()
    assert not behind, "run: python -m docs.imports_picture"


def test_the_order_of_the_packages_is_the_one_that_is_kept() -> None:
    ranks = sorted(set(RANK.values()))
    order = " < ".join(", ".join(name for name, rank in RANK.items() if rank == each) for each in ranks)
    assert order in " ".join(imports_picture.DOCUMENT.read_text().split())


def test_a_picture_leaves_out_what_a_longer_way_says() -> None:
    graph = {"a": {"b", "c"}, "b": {"c"}, "c": set()}
    assert imports_picture.without_detours(graph) == {"a": {"b"}, "b": {"c"}, "c": set()}


def test_prose_is_told_from_code_and_tables() -> None:
    text = "A\n\n    code\n\n- item\n\n  | of it\n\n    more of it\n\nB\n\n    code\n| t |"
    assert [line for _, line in prose(text) if line] == ["A", "- item", "    more of it", "B"]
