# SPDX-License-Identifier: BSD-3-Clause
"""Changes the laws at random, one place at a time, and looks whether the tests notice.

    python -m tests.random_mutants [--count 400] [--seed 1] [--folder FOLDER ...] [--out FILE]

Mutants are drawn over the statements of the folders below, all statements alike. Each is applied in a copy of the
checkout, and the tests that call the changed function run there, the fastest first, until one fails. FILE gets a line
of JSON for every mutant; started again with the same FILE, seed and laws, it goes on where it was stopped, and tries
survivors again if tests have changed. Survivors are judged one by one in ``survivors.yaml`` and then not tried again:
"equivalent" changes nothing that a user could see, "left" does and stays a survivor, for the reason that stands there.
Exit 1 if fewer than 75 % of those that are not equivalent were killed.

Which test calls which function is found first, by running the tests of the folders once; that takes some minutes and
is kept beside FILE, for each file of tests by itself.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path

import yaml

from tests.mutants.__main__ import copy_checkout
from tests.random_mutants.covering import Covering, Watcher
from tests.random_mutants.drawing import Mutant, draw
from tests.random_mutants.trial import as_child, load_libraries, run_pytest, trial
from tests.support.paths import CHECKOUT


@dataclass(frozen=True)
class Area:
    """The tests that must notice a change in a folder, and whether they need machine code to be fast enough.

    No law stands in the changed folder where machine code is asked for, so mutants can share what is kept of it.
    """

    tests: tuple[str, ...]
    machine_code: bool = False


AREAS = {
    "impedance_modules/safety": Area(("tests/safety", "tests/control/test_cycle_laws.py")),
    "impedance_modules/modules": Area(
        (
            "tests/modules",
            "tests/robot/test_rotation.py",
            "tests/superposition",
            "tests/control/test_cycle_laws.py",
        )
    ),
    "impedance_modules/superposition": Area(
        (
            "tests/superposition",
            "tests/prediction/test_analysis.py",
            "tests/prediction/test_check.py",
            "tests/experiments/test_elastic_joint_model.py",
        )
    ),
    "impedance_modules/diagnosis/model_selection": Area(("tests/diagnosis",), machine_code=True),
}
SHARE = 0.75
"""Of the mutants that are not judged to be equivalent, at least this part is killed."""

MAPPING_PATIENCE = 90.0
"""Longest time for the tests of one file while it is found out what they call; later ones of it are left out [s]."""

FIRST_TESTS = 25.0
"""The first tests of a mutant are the fastest, and take this long together; the others follow if these pass [s]."""

PATIENCE = 240.0
"""Tests of one mutant that take longer have noticed: something became endless [s]."""

WIDEST = 8
"""Tests that are run to compile what a folder's tests need."""

NOTICED = ("killed", "timed out")

JUDGED = Path(__file__).parent / "survivors.yaml"


def area_of(file: str) -> tuple[str, Area]:
    """Folder and area of a file."""
    return next((folder, area) for folder, area in AREAS.items() if file.startswith(f"{folder}/"))


def digest(paths: Iterable[Path]) -> str:
    """Names the text of files, and the version of Python."""
    summed = hashlib.sha256(sys.version.encode())
    for path in paths:
        summed.update(str(path.relative_to(CHECKOUT)).encode() + b"\0" + path.read_bytes())
    return summed.hexdigest()[:16]


def sources(*folders: str) -> list[Path]:
    """All Python files of folders."""
    return [path for folder in folders for path in sorted((CHECKOUT / folder).rglob("*.py"))]


def files_of_tests(area: Area) -> list[str]:
    """The files of an area's tests."""
    paths = [
        path
        for each in area.tests
        for path in (sorted((CHECKOUT / each).rglob("test_*.py")) or [CHECKOUT / each])
    ]
    return [str(path.relative_to(CHECKOUT)) for path in paths]


def covering(folder: str, copy: Path, kept: Path) -> Covering:
    """What the tests of an area call, from earlier runs of the same files or from one now."""
    area, kept = AREAS[folder], kept.absolute()
    kept.mkdir(parents=True, exist_ok=True)
    found = Covering()
    for file in files_of_tests(area):
        shared = sources(folder, "tests/support", "tests/reference")
        lines = kept / f"{Path(file).stem}-{digest([*shared, CHECKOUT / file])}.jsonl"
        if not lines.exists():
            _watch(file, area, Watcher(copy, (f"{folder}/",), lines.with_suffix(".part")), copy)
            lines.with_suffix(".part").touch()
            lines.with_suffix(".part").replace(lines)
        found.read(lines)
    if area.machine_code:
        _compile(area, found, copy)
    return found


def _compile(area: Area, found: Covering, copy: Path) -> None:
    """Runs the tests that call most of a folder once without any change, so that no mutant's time is compiling.

    Raises:
        SystemExit: They fail.
    """
    widest = sorted(found.functions, key=lambda test: -len(found.functions[test]))[:WIDEST]
    verdict = trial(copy, widest, 10.0 * PATIENCE, machine_code=area.machine_code)
    if verdict.outcome != "survived":
        raise SystemExit(f"without any change: {verdict.outcome} by {verdict.by}")


def _watch(file: str, area: Area, watcher: Watcher, copy: Path) -> None:
    """Runs a file of tests and writes down what they call."""
    watcher.lines.unlink(missing_ok=True)
    began = time.perf_counter()
    work = partial(run_pytest, [file, "-m", "not long and not ros"], watcher)
    patience = MAPPING_PATIENCE * (3.0 if area.machine_code else 1.0)
    code = as_child(copy, work, patience, machine_code=area.machine_code)
    print(f"{time.perf_counter() - began:7.1f} s  exit {code}  {file}", flush=True)


def try_mutant(mutant: Mutant, copy: Path, calls: Covering) -> dict[str, object]:
    """Applies a mutant, runs its tests and takes it back; returns the line of the result."""
    if judgement_of(asdict(mutant)) is not None:
        return {**asdict(mutant), "outcome": "survived", "by": "judged", "tests": 0, "seconds": 0.0}
    path, began = copy / mutant.file, time.perf_counter()
    tests = calls.tests_of(mutant.file, mutant.function)
    outcome, by = ("survived", "") if tests else ("not covered", "")
    original = path.read_text(encoding="utf-8")
    path.write_text(mutant.applied(original), encoding="utf-8")
    try:
        for part in parts(tests, calls.seconds):
            verdict = trial(copy, part, PATIENCE, machine_code=area_of(mutant.file)[1].machine_code)
            outcome, by = verdict.outcome, verdict.by
            if outcome != "survived":
                break
    finally:
        path.write_text(original, encoding="utf-8")
    seconds = round(time.perf_counter() - began, 1)
    return {**asdict(mutant), "outcome": outcome, "by": by, "tests": len(tests), "seconds": seconds}


def parts(tests: Sequence[str], seconds: dict[str, float]) -> Iterator[list[str]]:
    """The tests in two parts: those that are over soon, and the others."""
    total, first = 0.0, 0
    for test in tests:
        total += seconds[test]
        if total > FIRST_TESTS:
            break
        first += 1
    yield from (part for part in (list(tests[:first]), list(tests[first:])) if part)


@cache
def judged() -> list[dict[str, str]]:
    """Survivors that somebody has looked at."""
    return list(yaml.safe_load(JUDGED.read_text(encoding="utf-8")) or [])


def judgement_of(place: Mapping[str, object]) -> str | None:
    """What was judged of a mutant, or of a result's; None where nobody has looked at it."""
    keys = ("file", "function", "statement", "old", "new")
    return next((one["judgement"] for one in judged() if all(place[key] == one[key] for key in keys)), None)


def is_equivalent(result: Mapping[str, object]) -> bool:
    """Whether a result's mutant was judged to change nothing that a user could see."""
    return judgement_of(result) == "equivalent"


def earlier(out: Path, head: dict[str, object]) -> list[dict[str, object]]:
    """Results of an earlier run that still hold; writes the head of the file.

    What was killed stays killed when there are more tests; what survived is tried again if they have changed.

    Raises:
        SystemExit: The file is of other laws or another seed.
    """
    results = []
    if out.exists():
        first, *results = [json.loads(line) for line in out.read_text().splitlines()]
        if first | {"tests": ""} != head | {"tests": ""}:
            raise SystemExit(
                f"{out} is of {first}, this is {head} (valid: another --out, or the laws as they were)"
            )
        if first != head:
            results = [result for result in results if result["outcome"] in NOTICED]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text("".join(json.dumps(line) + "\n" for line in (head, *results)))
    return results


def table(results: Sequence[dict[str, object]]) -> str:
    """Outcomes per folder, and the survivors."""
    rows = ["folder | mutants | killed | timed out | survived | equivalent | killed of the others"]
    for folder in (*AREAS, ""):
        chosen = [result for result in results if str(result["file"]).startswith(folder)]
        if not chosen:
            continue
        count = Counter(str(result["outcome"]) for result in chosen)
        equal = sum(is_equivalent(result) for result in survivors(chosen))
        others = len(chosen) - equal
        killed = count["killed"] + count["timed out"]
        rows.append(
            f"{folder or 'all'} | {len(chosen)} | {count['killed']} | {count['timed out']} | {len(chosen) - killed} | "
            f"{equal} | {100.0 * killed / max(others, 1):.1f} %"
        )
    return "\n".join(rows)


def survivors(results: Sequence[dict[str, object]]) -> list[dict[str, object]]:
    """Results whose mutants no test noticed."""
    return [result for result in results if result["outcome"] not in NOTICED]


def line_of(result: dict[str, object]) -> str:
    """Writes a result in a line."""
    old, new = (" ".join(str(result[key]).split())[:90] for key in ("old", "new"))
    place = f"{result['file']}:{result['line']} {result['function']}"
    return f"{result['outcome']!s:<11} {result['seconds']:6} s  {place}: {result['kind']}: {old} -> {new}"


def run(drawn: Sequence[Mutant], out: Path, done: Sequence[dict[str, object]]) -> list[dict[str, object]]:
    """Tries the mutants that are missing, in the order in which they were drawn; returns all results in that order."""
    covered: dict[str, Covering] = {}
    found = {(result["file"], result["start"], result["old"], result["new"]): result for result in done}
    with tempfile.TemporaryDirectory() as top:
        copy = Path(top)
        copy_checkout(copy)
        for number, mutant in enumerate(drawn, 1):
            place = (mutant.file, mutant.start, mutant.old, mutant.new)
            if place in found:
                continue
            folder = area_of(mutant.file)[0]
            if folder not in covered:
                covered[folder] = covering(folder, copy, out.with_name("calls"))
            found[place] = try_mutant(mutant, copy, covered[folder])
            with out.open("a") as lines:
                lines.write(json.dumps(found[place]) + "\n")
            print(f"{number:4} {line_of(found[place])}", flush=True)
    return [found[mutant.file, mutant.start, mutant.old, mutant.new] for mutant in drawn]


def main() -> int:
    """Draws, tries and prints."""
    parser = argparse.ArgumentParser(prog="python -m tests.random_mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", nargs="+", choices=tuple(AREAS), default=list(AREAS), metavar="FOLDER")
    parser.add_argument("--out", type=Path, default=None, help="out/random-mutants/LAWS-SEED.jsonl")
    options = parser.parse_args()
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    laws, tests = digest(sources(*options.folder)), digest(sources("tests"))
    out = options.out or CHECKOUT / "out" / "random-mutants" / f"{laws}-{options.seed}.jsonl"
    done = earlier(out, {"laws": laws, "tests": tests, "seed": options.seed, "folders": options.folder})
    load_libraries()
    results = run(draw(CHECKOUT, options.folder, options.count, options.seed), out, done)
    for result in survivors(results):
        print(f"{'equivalent' if is_equivalent(result) else 'SURVIVED'}: {line_of(result)}")
    print(table(results))
    left = [result for result in results if not (result in survivors(results) and is_equivalent(result))]
    return 0 if len(left) - len(survivors(left)) >= SHARE * len(left) else 1


if __name__ == "__main__":
    sys.exit(main())
