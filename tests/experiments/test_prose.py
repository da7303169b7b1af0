# SPDX-License-Identifier: BSD-3-Clause
"""No page of the thesis has a result written into its prose: numbers of sentences are formatted from values.

A number counts where it has a decimal point or a unit behind it, in any string of an experiment that has a space (a
sentence, a reason, a caption, a heading of a column). What the thesis prints stands in constants ``PRINTED...``.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.paths import CHECKOUT

FILES = sorted((CHECKOUT / "impedance_experiments").glob("*.py"))
UNITS = (
    "%|per cent|times|cycles|minutes?|pieces|samples|degrees|deg|N\\.m\\.s/rad|N\\.m/rad|N\\.s/m|N\\.m|kN/m|N/mm|N/m|N|"
    "m/s|mm|cm|um|m|mrad|rad/s|rad|ms|s|kHz|Hz|kg\\.m\\^2|kg|g|mJ|J|dB|inch(?:es)?"
)
NUMBER = re.compile(rf"(?<![\w.^])(?<!\^[-+])[-+]?\d+(?:\.\d+|(?=\s?(?:{UNITS})(?![\w/])))")
REFERENCES = (
    re.compile(
        r"(?:\b[Ee]qs?\.|[Ff]ig\.|\bfigures?|[Tt]ables?|\bsections?)\s+\d[\d.]*\d(?:(?:,| and| to)\s+\d[\d.]*\d)*"
    ),
    re.compile(r"\(\d\.\d+(?:\.\d+)?\)|\b\d\.\d\.\d\b"),
)
"""Equations, figures, tables and sections of the thesis."""
REVIEWED = {
    "impedance_controller.py": (
        "example of 4.1 (page",
        "thesis's 5.1 uses",
        "inertia, 0.1 m =",
        "mobility, 0.1 m =",
    ),
    "one_joint.py": ("from 4.7 it follows",),
}
"""Numbers that are no results: sections named without the word, and scales of drawings."""


def sentences(tree: ast.AST) -> Iterator[ast.Constant]:
    """Yields all strings with a space but docstrings, and those of constants that hold what the thesis prints."""
    left_out: set[int] = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        for part in body if isinstance(body, list) else ():
            if isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant):
                left_out.add(id(part.value))
        if isinstance(node, ast.Assign) and any(
            isinstance(name, ast.Name) and name.id.startswith("PRINTED")
            for target in node.targets
            for name in ast.walk(target)
        ):
            left_out |= {id(part) for part in ast.walk(node.value)}
    for node in ast.walk(tree):
        text = isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in left_out
        if text and " " in node.value:
            yield node


def numbers_in(text: str, reviewed: tuple[str, ...]) -> list[str]:
    """Returns the numbers of a string that look like results."""
    for fragment in reviewed:
        text = text.replace(fragment, " ")
    for pattern in REFERENCES:
        text = pattern.sub(" ", text)
    return [] if re.fullmatch(r"[\d., to]+", text) else NUMBER.findall(text)


def literal_results(source: str, reviewed: tuple[str, ...] = ()) -> list[str]:
    """Lists where a source has such numbers: in its strings, or as constants that it formats."""
    tree = ast.parse(source)
    found = [
        f"line {node.lineno}: {', '.join(numbers)} in {node.value!r}"
        for node in sentences(tree)
        if (numbers := numbers_in(node.value, reviewed))
    ]
    return found + [
        f"line {node.lineno}: a constant is formatted"
        for node in ast.walk(tree)
        if isinstance(node, ast.FormattedValue)
        and isinstance(node.value, ast.Constant)
        and not isinstance(node.value.value, str)
    ]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_result_stands_in_prose(path: Path) -> None:
    found = literal_results(path.read_text(), REVIEWED.get(path.name, ()))
    assert not found, f"{path.name}: compute these numbers, or drop the sentence:\n" + "\n".join(found)


def constant_rows(source: str) -> list[int]:
    """Lists the lines of comparisons whose own number is written down instead of computed."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "ThesisValue"
        for ours in (*node.args[2:3], *(word.value for word in node.keywords if word.arg == "ours"))
        if isinstance(ours, ast.Constant)
    ]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_comparison_has_a_constant_for_ours(path: Path) -> None:
    assert not constant_rows(path.read_text())


def test_a_constant_for_ours_is_found() -> None:
    assert (
        constant_rows('ThesisValue("a", 1.0, 2.0, "m", "b")')
        == constant_rows('ThesisValue("a", ours="no")')
        == [1]
    )
    assert not constant_rows('ThesisValue("a", 1.0, round(x, 2), "m", "b")')


def test_every_reviewed_exception_is_still_there() -> None:
    for name, fragments in REVIEWED.items():
        text = " ".join(
            part.value
            for part in sentences(ast.parse((CHECKOUT / "impedance_experiments" / name).read_text()))
        )
        assert all(fragment in text for fragment in fragments), name


@pytest.mark.parametrize(
    "sentence",
    [
        "ours is 2.28 here",
        "it presses with 11 N on it",
        "of 25 % less",
        "f'{x} of 0.106 rad'",
        "in 0.07 s",
        "-3 mm off",
    ],
)
def test_a_result_in_prose_is_found(sentence: str) -> None:
    source = f"TEXT = {sentence}" if sentence.startswith("f'") else f"TEXT = {sentence!r}"
    assert literal_results(source)


@pytest.mark.parametrize(
    "source",
    [
        'TEXT = f"ours is {ratio:.2f} and {100 * share:.0f} % here"',
        'TEXT = "eq. 5.1, as in Tables 5.1 and 5.2 (6.2.1), fig. 3-2"',
        'PRINTED = "0.044 +- 0.003 kg"',
        'def f():\n    """Gives 3.5 N."""',
    ],
)
def test_a_formatted_number_a_reference_and_what_is_printed_are_no_results(source: str) -> None:
    assert not literal_results(source)


def test_a_formatted_constant_is_found() -> None:
    assert literal_results('TEXT = f"ours is {2.28:.2f} here"')
