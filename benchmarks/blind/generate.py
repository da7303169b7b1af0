# SPDX-License-Identifier: BSD-3-Clause
"""Makes blocks of cases in parallel, shows their logs and seals their truth."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.blind.blocks import COUNTS, Made, make

CASES, SEALED, SEALS = "cases", "sealed", "seals.txt"


def generate(
    block: str,
    seeds: str,
    count: int | None,
    out: Path,
    jobs: int,
    tell: Callable[[str], None],
    first: int = 0,
) -> Path:
    """Makes ``count`` cases of a block from number ``first`` on (as many as the block has where None).

    Writes out/cases/NAME/{run_*.parquet, case.json}, out/sealed/BLOCK.json and a line of out/seals.txt.

    Returns:
        The sealed file.
    """
    wanted = COUNTS[block] if count is None else count
    cases = out / CASES
    cases.mkdir(parents=True, exist_ok=True)
    made: list[Made] = []
    with ProcessPoolExecutor(jobs) as pool:
        waiting = [pool.submit(make, block, index, seeds, cases) for index in range(first, first + wanted)]
        for i, one in enumerate(waiting):
            made += one.result()
            tell(f"{block} {i + 1}/{wanted}")
    random.Random(f"{seeds}{block}").shuffle(made)
    for case in made:
        (cases / case.name / "case.json").write_text(json.dumps(case.shown, indent=1) + "\n")
    sealed = out / SEALED / f"{block}.json"
    sealed.parent.mkdir(exist_ok=True)
    truth = {"seeds": seeds, "block": block, "cases": {case.name: case.truth for case in made}}
    sealed.write_text(json.dumps(truth, indent=1) + "\n")
    with (out / SEALS).open("a") as file:
        file.write(f"{seal_of(sealed)}  {SEALED}/{block}.json  {seeds}  {len(made)} cases\n")
    return sealed


def seal_of(path: Path) -> str:
    """Returns the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
