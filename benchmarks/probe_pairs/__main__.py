# SPDX-License-Identifier: BSD-3-Clause
"""Takes confusable pairs of the catalogue from ambiguous to right, one direction after the other.

Usage: python -m benchmarks.probe_pairs [--out DIR] [--minutes M] [--seed N] [NAME ...]
       python -m benchmarks.probe_pairs --table [--out DIR]
       python -m benchmarks.probe_pairs --list

A NAME is TRUTH--PARTNER, or an effect: all of its pairs. Without one all pairs are taken, in an order drawn from the
seed, so that those that are done when it is stopped are a fair sample. A finished case is kept in DIR and not run
again. No case begins after ``--minutes``. About a minute of processor time per case.
"""

from __future__ import annotations

import argparse
import json
import random
import time
from pathlib import Path
from typing import Any

from benchmarks.probe_pairs.course import run_case
from benchmarks.probe_pairs.pairs import OTHER_RECORDINGS, PairCase, pair_cases
from benchmarks.probe_pairs.robot import write_robot
from benchmarks.probe_pairs.table import finished, table


def main() -> None:
    """Runs the cases that are not there yet, or prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--out", type=Path, default=Path("out/probe-pairs"))
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    if options.list:
        print("\n".join(case.name for case in pair_cases()))
    elif options.table:
        print(table(finished(options.out)))
    else:
        _run(chosen(options.names, parser, options.seed), options.out, options.minutes)


def chosen(names: list[str], parser: argparse.ArgumentParser, seed: int) -> list[PairCase]:
    """Returns the named cases, or all, in an order drawn from the seed."""
    every = list(pair_cases())
    known = {case.name for case in every} | {case.truth.effect for case in every}
    unknown = [name for name in names if name not in known]
    if unknown:
        parser.error(f"no pair or effect {', '.join(unknown)} (valid: see --list)")
    picked = [case for case in every if not names or {case.name, case.truth.effect} & set(names)]
    random.Random(seed).shuffle(picked)
    return picked


def _run(cases: list[PairCase], out: Path, minutes: float) -> None:
    out.mkdir(parents=True, exist_ok=True)
    robot, began = write_robot(out).resolve(), time.monotonic()
    for case in cases:
        kept = out / case.name / "case.json"
        if kept.is_file():
            continue
        if time.monotonic() - began > 60.0 * minutes:
            return
        done = left_out(case) or run_case(case, robot, kept.parent.resolve())
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(done, indent=1) + "\n")
        told = {key: done.get(key) for key in ("before", "motion", "after", "left_out", "processor_seconds")}
        print(case.name, json.dumps(told), flush=True)


def left_out(case: PairCase) -> dict[str, Any] | None:
    """Says why a case is not recorded; None where it is."""
    for effect in (case.truth.effect, case.partner):
        if effect in OTHER_RECORDINGS:
            return {
                "truth": case.truth.effect,
                "partner": case.partner,
                "left_out": f"`{effect}`: {OTHER_RECORDINGS[effect]}",
            }
    return None


if __name__ == "__main__":
    main()
