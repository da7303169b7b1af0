# SPDX-License-Identifier: BSD-3-Clause
"""``make verify`` goes on where it was stopped, and begins anew on another tree."""

import subprocess
import sys
from pathlib import Path

from tests.support.paths import CHECKOUT
from tests.verify import Job, all_jobs, digest, kept_in, run_all

COUNT = "import sys; open(sys.argv[1], 'a').write('x'); sys.exit(int(sys.argv[2]))"


def job(name: str, counted: Path, code: int, *, alone: bool = False) -> Job:
    counted.touch()
    return Job(name, (sys.executable, "-c", COUNT, str(counted), str(code)), alone, passes=(0, 5))


def test_what_passed_is_not_run_again_and_what_failed_is(tmp_path: Path) -> None:
    good, empty, bad = tmp_path / "good", tmp_path / "empty", tmp_path / "bad"
    jobs = [job("alone", bad, 1, alone=True), job("a/good.py", good, 0), job("empty", empty, 5)]
    for tries in (1, 2):
        outcomes = run_all(jobs, tmp_path / "results", 2, lambda _: None)
        passed = [(outcome.name, outcome.passed) for outcome in outcomes]
        assert passed == [("a/good.py", True), ("empty", True), ("alone", False)]
        assert outcomes[-1].tries == tries
    assert (good.read_text(), empty.read_text(), bad.read_text()) == ("x", "x", "xx")


def test_a_tree_is_named_by_what_is_in_its_files(tmp_path: Path) -> None:
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    (tmp_path / ".gitignore").write_text("ignored\n")
    first = digest(tmp_path)
    (tmp_path / "ignored").write_text("1")
    assert digest(tmp_path) == first
    (tmp_path / "law.py").write_text("1")
    second = digest(tmp_path)
    (tmp_path / "law.py").write_text("2")
    assert len({first, second, digest(tmp_path)}) == 3


def test_everything_is_listed_once(tmp_path: Path) -> None:
    names = [each.name for each in all_jobs(tmp_path)]
    assert len({kept_in(tmp_path, name) for name in names}) == len(names)
    files = {str(path.relative_to(CHECKOUT)) for path in (CHECKOUT / "tests").rglob("test_*.py")}
    assert files | {"ruff check", "ruff format", "mypy", "reference", "reproduce terrain"} <= set(names)
