# SPDX-License-Identifier: BSD-3-Clause
"""Makes the cases of a block one after the other, resumably, and seals their truth."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from pathlib import Path

from benchmarks.wide.cases import Made, make
from benchmarks.wide.drake_process import DrakeProcess
from benchmarks.wide.pair_cases import make_pair
from benchmarks.wide.plan import Plan, RawLog
from benchmarks.wide.run import CASES, SEALED
from benchmarks.wide.simulation import simulate as simulate_here

SEALS = "seals.txt"
FOLDER = Path(__file__).resolve().parent
FROZEN_SEALS = FOLDER / "frozen_seals.txt"


@lru_cache(maxsize=1)
def second_engine() -> DrakeProcess:
    """Returns this process's Drake, which is started when it is first needed."""
    return DrakeProcess()


def simulate(plan: Plan) -> RawLog:
    """Simulates a plan on the engine that it names."""
    return second_engine().simulate(plan) if plan.engine == "drake" else simulate_here(plan)


def label_of(block: str, frozen: str | None) -> str:
    """Returns the name of a block's sealed file."""
    return block if frozen is None else f"{block}_{frozen}"


def generate(
    block: str, seeds: str, first: int, count: int, out: Path, jobs: int, tell: Callable[[str], None],
    frozen: str | None = None,
) -> Path:  # fmt: skip
    """Makes cases ``first`` to ``first + count - 1`` of a block that are not there yet; returns the sealed file.

    Writes out/cases/NAME/{run_*.parquet, robot/, case.json}, out/sealed/LABEL.json and a line of out/seals.txt.

    Raises:
        ValueError: Frozen varieties are asked for, and their code is not what was sealed.
    """
    if frozen is not None:
        check_frozen()
    label, cases = label_of(block, frozen), out / CASES
    cases.mkdir(parents=True, exist_ok=True)
    sealed = out / SEALED / f"{label}.json"
    sealed.parent.mkdir(exist_ok=True)
    known = json.loads(sealed.read_text())["cases"] if sealed.exists() else {}
    there = {truth["index"] for truth in known.values()}
    waiting = [index for index in range(first, first + count) if index not in there]
    with ProcessPoolExecutor(jobs) as pool:
        asked = [pool.submit(_make, block, index, seeds, frozen, cases) for index in waiting]
        for i, one in enumerate(asked):
            made = one.result()
            known |= {case.name: case.truth for case in made}
            _seal(sealed, known, block, seeds, out)
            tell(f"{label} {i + 1}/{len(waiting)} {' '.join(case.name for case in made)}")
    return sealed


def _make(block: str, index: int, seeds: str, frozen: str | None, cases: Path) -> list[Made]:
    made = (
        make_pair(index, seeds, frozen, cases, simulate)
        if block == "D"
        else [make(block, index, seeds, frozen, cases, simulate)]
    )
    for case in made:
        (cases / case.name / "case.json").write_text(json.dumps(case.shown, indent=1) + "\n")
    return made


def _seal(sealed: Path, known: dict[str, object], block: str, seeds: str, out: Path) -> None:
    names = sorted(known)
    random.Random(sealed.stem).shuffle(names)
    truth = {"seeds": seeds, "block": block, "cases": {name: known[name] for name in names}}
    sealed.write_text(json.dumps(truth, indent=1) + "\n")
    lines = (out / SEALS).read_text().splitlines() if (out / SEALS).exists() else []
    lines = [line for line in lines if f"{SEALED}/{sealed.name} " not in line]
    lines.append(f"{seal_of(sealed)}  {SEALED}/{sealed.name}  {seeds}  {len(names)} cases")
    (out / SEALS).write_text("\n".join(lines) + "\n")


def seal_of(path: Path) -> str:
    """Returns the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def check_seals(out: Path) -> None:
    """Compares every sealed truth with the hash that was written for it.

    Raises:
        ValueError: They differ.
    """
    seals = {line.split()[1]: line.split()[0] for line in (out / SEALS).read_text().splitlines()}
    for path in sorted((out / SEALED).glob("*.json")):
        if seals.get(f"{SEALED}/{path.name}") != seal_of(path):
            raise ValueError(f"{path}: not the truth that was sealed (its SHA-256 is {seal_of(path)})")


def check_frozen() -> None:
    """Compares the generator's files with the hashes of `frozen_seals.txt`.

    Raises:
        ValueError: A file has changed since the frozen varieties were sealed.
    """
    for line in FROZEN_SEALS.read_text().splitlines():
        seal, name = line.split()
        if seal_of(FOLDER / name) != seal:
            raise ValueError(f"{name}: not the file that was sealed in {FROZEN_SEALS.name}")
