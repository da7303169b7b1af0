# SPDX-License-Identifier: BSD-3-Clause
"""Random mutants are what they say: one change each, in code alone; and the judged survivors are still there."""

from __future__ import annotations

import ast
import json
import tempfile
from pathlib import Path

import pytest

from tests.random_mutants.__main__ import AREAS, earlier, files_of_tests, judged, parts, table
from tests.random_mutants.changes import Text, changes_of
from tests.random_mutants.covering import Covering
from tests.random_mutants.drawing import Mutant, draw
from tests.support.paths import CHECKOUT

FOLDERS = list(AREAS)


def changed(source: str) -> set[str]:
    """All texts that one statement can become."""
    (statement,) = ast.parse(source).body
    text = Text(source)
    return {
        ast.unparse(ast.parse(source[: change.start] + change.new + source[change.end :]))
        for change in changes_of(statement, text)
    }


@pytest.mark.parametrize(
    ("source", "some"),
    [
        ("x = a + b", {"x = a - b", "x = a", "x = b"}),
        ("x = a - b", {"x = a + b", "x = a", "x = -b"}),
        ("x = a * b", {"x = a / b", "x = -(a * b)"}),
        ("x = A @ B", {"x = B @ A", "x = -(A @ B)"}),
        ("x = -a", {"x = a"}),
        ("x = 2.0", {"x = 4.0", "x = 1.0"}),
        ("x = 0.0", {"x = 1.0"}),
        ("x = a < b", {"x = a <= b", "x = a > b"}),
        ("x = a and b", {"x = a or b", "x = a", "x = b"}),
        ("x = v[i]", {"x = v[i - 1]"}),
        ("x = f(a, b)", {"x = f(b, a)"}),
        ("x = a if b else c", {"x = a if not b else c"}),
        ("x += a", {"pass", "x -= a"}),
        ("v[i] = a", {"pass", "v[i - 1] = a"}),
        ("f(a)", {"pass"}),
        ("x = [a for a in b if c]", {"x = [a for a in b if not c]"}),
    ],
)
def test_a_statement_has_these_changes_and_no_others(source: str, some: set[str]) -> None:
    assert changed(source) == some


@pytest.mark.parametrize(
    "source",
    [
        '"""A text."""',
        "raise Error(a + 1)",
        "x = f'{a + 1}'",
        "x: int",
        "import a",
        "x = 'a' + b",
        "x = max(a, b)",
    ],
)
def test_texts_annotations_and_refusals_are_left_alone(source: str) -> None:
    assert not changed(source) if not source.startswith("raise") else not draws(source)


def draws(source: str, folder: str = "laws") -> list[Mutant]:
    with tempfile.TemporaryDirectory() as top:
        root = Path(top)
        (root / folder).mkdir()
        (root / folder / "law.py").write_text(source)
        return draw(root, [folder], 50, 1)


def test_a_mutant_knows_its_function_and_its_place() -> None:
    lines = [
        "# 10 \N{DEGREE SIGN}C",
        "class A:",
        "    def b(self, x):",
        '        """T."""',
        "        def c(y):",
    ]
    source = "\n".join([*lines, "            return y + 1", "        return c(x)", ""])
    found = draws(source)
    assert {mutant.function for mutant in found} == {"A.b"}
    assert {mutant.line for mutant in found} == {6, 7}
    assert all(ast.parse(mutant.applied(source)) for mutant in found)


def test_the_seed_fixes_the_mutants_and_their_order() -> None:
    many, few, others = (draw(CHECKOUT, FOLDERS, count, seed) for count, seed in ((60, 1), (20, 1), (20, 2)))
    assert many[:20] == few and len(set(many)) == 60
    assert not set(others) & set(few)


def test_every_mutant_is_python_and_another_program() -> None:
    for mutant in draw(CHECKOUT, FOLDERS, 200, 3):
        text = (CHECKOUT / mutant.file).read_text()
        assert ast.dump(ast.parse(mutant.applied(text))) != ast.dump(ast.parse(text))


def test_a_change_of_another_text_is_refused() -> None:
    with pytest.raises(ValueError, match=r"law\.py:3"):
        Mutant("law.py", "", 3, "", "", "a", "b", 5).applied("x = 1")


def test_tests_of_a_function_are_those_that_call_it_the_fastest_first(tmp_path: Path) -> None:
    lines = [("slow", 9.0, True, ["f.py::A.b"]), ("fast", 1.0, True, ["f.py::A.b", "f.py::c"])]
    lines += [("failed", 0.1, False, ["f.py::c"]), ("other", 2.0, True, ["g.py::c"])]
    path = tmp_path / "calls.jsonl"
    keys = ("test", "seconds", "passed", "functions")
    path.write_text("".join(json.dumps(dict(zip(keys, line, strict=True))) + "\n" for line in lines))
    calls = Covering()
    calls.read(path)
    assert calls.tests_of("f.py", "A.b") == ["fast", "slow"]
    assert calls.tests_of("f.py", "c") == ["fast"]
    assert calls.tests_of("f.py", "") == ["fast", "slow"]
    assert calls.tests_of("f.py", "d") == []
    assert list(parts(["a", "b", "c"], {"a": 1.0, "b": 2.0, "c": 1e3})) == [["a", "b"], ["c"]]
    assert list(parts([], {})) == []


def test_what_was_killed_stays_so_and_what_survived_is_tried_again_with_other_tests(tmp_path: Path) -> None:
    out, head = tmp_path / "new" / "results.jsonl", {"laws": "a", "tests": "x", "seed": 1}
    assert earlier(out, head) == []
    results = [{"outcome": outcome} for outcome in ("killed", "survived", "timed out", "not covered")]
    with out.open("a") as lines:
        lines.writelines(json.dumps(result) + "\n" for result in results)
    assert earlier(out, head) == results
    assert earlier(out, head | {"tests": "y"}) == results[::2]
    assert earlier(out, head | {"tests": "y"}) == results[::2]
    with pytest.raises(SystemExit, match="another --out"):
        earlier(out, head | {"laws": "b"})


def test_the_table_counts_what_was_killed() -> None:
    one = {"file": f"{FOLDERS[0]}/tank.py", "function": "f", "statement": "a", "old": "a", "new": "b"}
    results = [{**one, "outcome": outcome} for outcome in ("killed", "timed out", "survived", "not covered")]
    assert table(results).splitlines()[-1] == "all | 4 | 1 | 1 | 2 | 0 | 50.0 %"


def test_all_test_files_of_the_areas_exist() -> None:
    for area in AREAS.values():
        assert files_of_tests(area) and all((CHECKOUT / file).is_file() for file in files_of_tests(area))


def test_judged_survivors_stand_in_the_code_and_have_a_reason() -> None:
    for entry in judged():
        assert set(entry) == {"file", "function", "statement", "old", "new", "judgement", "why"}
        assert entry["judgement"] in ("equivalent", "left") and len(entry["why"]) > 20
        text = (CHECKOUT / entry["file"]).read_text()
        assert entry["statement"] in text, f"{entry['file']} no longer has {entry['statement']!r}: judge anew"
        assert entry["old"] in text
