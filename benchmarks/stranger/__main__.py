# SPDX-License-Identifier: BSD-3-Clause
"""Generates, runs and scores a stranger's cases.

Usage: python -m benchmarks.stranger generate --out DIR [--block A] [--count N]      (environment with dartpy)
       python -m benchmarks.stranger run --out DIR --answers DIR [--block A] [--count N] [--jobs J]
       python -m benchmarks.stranger score --out DIR --answers DIR

``generate`` needs dartpy, example-robot-data, numpy and scipy; ``run`` and ``score`` this project's own.
All of them leave what is there already. Cases are in DIR/cases, the truth is in DIR/sealed.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.stranger.running import run_cases
from benchmarks.stranger.scoring import report

if TYPE_CHECKING:
    from benchmarks.stranger.plan import Plan


def main() -> None:
    """Reads the arguments and does one of the three."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stranger", description="A stranger's benchmark."
    )
    parser.add_argument("what", choices=["generate", "run", "score"])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--answers", type=Path)
    parser.add_argument("--block", choices=["A", "B", "C", "E"])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--seeds",
        choices=[
            "real",
            "second",
            "third",
            "fourth",
            "fifth",
            "sixth",
            "seventh",
            "eighth",
            "ninth",
            "tenth",
            "eleventh",
            "twelfth",
            "smoke",
        ],
        default="real",
    )
    args = parser.parse_args()
    answers = args.answers or args.out / "answers"
    if args.what == "generate":
        generate(args.out, args.block, args.count, args.seeds)
    elif args.what == "run":
        run_cases(args.out, answers, args.block, args.count, args.jobs)
    else:
        print(report(args.out, answers))


def generate(out: Path, block: str | None, count: int, seeds: str) -> None:
    """Makes the cases that are not there yet, the blocks taking turns."""
    from benchmarks.stranger.plan import plans

    for number, plan in sorted(plans(seeds), key=lambda pair: pair[0]):
        due = number < count and block in (None, plan.block)
        if due and not (out / "sealed" / f"{plan.name}.json").exists():
            begun = time.monotonic()
            said = generate_one(out, number, plan)
            print(f"{plan.block}{number} {said} {time.monotonic() - begun:.1f} s", flush=True)


def generate_one(out: Path, number: int, plan: Plan) -> str:
    """Makes one case, of another user where the first one's machine was none; says what it shows."""
    from benchmarks.stranger.making import make, write_case
    from benchmarks.stranger.plan import one_plan

    made = make(plan)
    for again in range(1, 6):
        if made is None:
            made = make(replace(one_plan(plan.block, number, plan.seed + again), name=plan.name))
    if made is None:
        return f"no machine for {plan.effects}"
    write_case(made, out)
    shown = " ".join(f"{p.effect}:{max(p.shown.values()):.3f}" for p in made.planted)
    off = " ".join(f"{k}={v:.4f}" for k, v in made.clean.items())
    return f"{made.plan.maker.name} {shown or 'clean'} [{off}]"


if __name__ == "__main__":
    main()
