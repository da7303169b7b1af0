# SPDX-License-Identifier: BSD-3-Clause
"""Degenerate, badly scaled, duplicated and contradictory filter problems, every solver against the exact answer.

Run: python -m benchmarks.control.filter_problems [--problems 10000] [--seed 1] [--only FAMILY ...] [--jobs 1]

Two references: decimal numbers of 100 digits (``tests.reference.exact_filter``), which decide, and the interior-point
method Clarabel. Compared are the cycle's own ``active_set`` (which may leave a problem undecided) and each solver that
a robot file can name. Printed per family and solver:

- unsolved: the problem has an answer and the solver gave none; missed: and Clarabel gave a right one;
- wrong: an answer farther than WRONG from the exact one, in parts of the joint's own scale (see ``scale_of``), or any
  answer to what has none;
- worst: the largest such distance, and the largest in N.m where torque limits lie between 1 and 100 N.m.

Exit 1 if anything is wrong or missed, or if a solver left more than one problem in a thousand unsolved.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from decimal import Decimal
from functools import partial

import numpy as np

from impedance_modules.compiled import use_machine_code
from impedance_modules.safety.active_set import UNDECIDED, make_active_set
from impedance_modules.safety.active_set import solve as solve_active_set
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers import make_solver
from tests.reference import exact_filter
from tests.reference.exact_filter import FLAT, OPTIMUM, TOUCHING, Exact
from tests.reference.optimality import residual
from tests.support.degenerate_problems import FAMILIES, spoiled

WRONG = 1e-7
"""Farther from the optimum than this part of a joint's scale is wrong."""

TINY = 1e-30
"""A torque below this is none [N.m]."""

SOLVERS = ("daqp", "proxsuite", "qpsolvers:daqp", "qpsolvers:proxqp")
ACTIVE_SET = "active set"
CLARABEL = "clarabel"


@dataclass
class Tally:
    """What one solver did in one family.

    Attributes:
        answerable: Problems that have an answer.
        answered: Of these, with an answer.
        missed: Without one though Clarabel gives a right one.
        refused: Problems without an answer, rightly refused.
        wrong: Wrong answers.
        worst: Largest distance from the optimum, in parts of a joint's scale.
        newton_metres: The same where torque limits are ordinary [N.m].
        slowest: [us]
        notes: Seeds of problems to look at.
    """

    answerable: int = 0
    answered: int = 0
    missed: int = 0
    refused: int = 0
    wrong: int = 0
    worst: float = 0.0
    newton_metres: float = 0.0
    slowest: float = 0.0
    notes: list[str] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Takes in what another process counted."""
        for name in ("answerable", "answered", "missed", "refused", "wrong"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("worst", "newton_metres", "slowest"):
            setattr(self, name, max(getattr(self, name), getattr(other, name)))
        self.notes += other.notes


def problems(count: int, seed: int, only: list[str]) -> Iterator[tuple[str, int, FilterProblem]]:
    """Every problem has a seed of its own: (family, its number, problem)."""
    chosen = [family for family in FAMILIES if not only or family.__name__ in only]
    for number in range(count):
        family = chosen[number % len(chosen)]
        yield family.__name__, number, spoiled(np.random.default_rng([seed, number]), family)


def scale_of(problem: FilterProblem, exact: Exact) -> np.ndarray:
    """A joint's own scale: its torque limit, or its torque in the answer if that has none or is far inside.

    (n,) [N.m]. The change of torque counts as far as it is no larger than the limit: a demand of 1e8 N.m is not
    answered to parts of 1e8.
    """
    torque = np.abs(np.asarray(exact.effort, dtype=float))
    change = exact.cost / np.sqrt(np.diagonal(problem.metric))
    return np.maximum(torque, np.minimum(problem.effort_max, np.maximum(change, np.abs(problem.desired))))


def judge(tally: Tally, problem: FilterProblem, exact: Exact, effort: np.ndarray | None, where: str) -> None:
    """Counts one answer."""
    if exact.outcome == TOUCHING:
        return
    if exact.outcome not in (OPTIMUM, FLAT):
        tally.refused += effort is None
        if effort is not None:
            tally.wrong += 1
            tally.notes.append(f"{where}: answers what is {exact.outcome}")
        return
    tally.answerable += 1
    if effort is None:
        tally.notes.append(f"{where}: unsolved")
        return
    tally.answered += 1
    if exact.outcome == FLAT:
        return
    missing = np.array(
        [abs(Decimal(float(a)) - b) for a, b in zip(effort, exact.effort, strict=True)], dtype=float
    )
    scale = scale_of(problem, exact)
    part = float(np.max(missing / np.maximum(scale, TINY)))
    tally.worst = max(tally.worst, part)
    ordinary = (problem.effort_max >= 1.0) & (problem.effort_max <= 100.0)
    tally.newton_metres = max(tally.newton_metres, float(missing[ordinary].max(initial=0.0)))
    if not part <= WRONG:
        tally.wrong += 1
        tally.notes.append(f"{where}: {part:.1e} of the scale, {missing.max():.1e} N.m")


class Answerers:
    """All solvers, each a function from a problem to a torque or None and its multipliers."""

    def __init__(self) -> None:
        self.solvers = {name: make_solver(name) for name in SOLVERS}

    def answers(
        self, problem: FilterProblem
    ) -> Iterator[tuple[str, np.ndarray | None, np.ndarray | None, float]]:
        """(solver, torque, multipliers of torque limits and rows, microseconds)."""
        active = make_active_set(problem.desired.size, problem.lower.size)
        began = time.perf_counter()
        status, _ = solve_active_set(problem, active)
        taken = 1e6 * (time.perf_counter() - began)
        decided = status != UNDECIDED
        yield ACTIVE_SET, active.effort if decided else None, active.duals if decided else None, taken
        for name, solver in self.solvers.items():
            began = time.perf_counter()
            solution = solver.solve(problem)
            taken = 1e6 * (time.perf_counter() - began)
            duals = np.concatenate([solution.box_duals, solution.row_duals]) if solution.solved else None
            yield name, solution.effort if solution.solved else None, duals, taken


def clarabel(problem: FilterProblem) -> np.ndarray | None:
    """Clarabel's answer; None where it gives none. It scales the problem itself."""
    import clarabel
    from scipy import sparse

    if exact_filter.kind(problem) not in (OPTIMUM, FLAT):
        return None
    n = problem.desired.size
    soft = np.flatnonzero(np.isfinite(problem.penalty))
    stacked = np.vstack([np.eye(n), problem.matrix])
    slack = np.zeros((len(stacked), soft.size))
    slack[n + soft, np.arange(soft.size)] = 1.0 / np.sqrt(problem.penalty[soft])
    value = stacked @ problem.desired
    upper = np.concatenate([problem.effort_max, problem.upper]) - value
    lower = np.concatenate([-problem.effort_max, problem.lower]) - value
    wide = np.hstack([stacked, slack])
    above, below = np.isfinite(upper), np.isfinite(lower)
    rows, right = np.vstack([wide[above], -wide[below]]), np.concatenate([upper[above], -lower[below]])
    cost = sparse.block_diag([sparse.csc_matrix(problem.metric), sparse.eye(soft.size)], format="csc")
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_iter = False, 500
    try:
        answer = clarabel.DefaultSolver(
            sparse.triu(cost, format="csc"), np.zeros(n + soft.size), sparse.csc_matrix(rows), right,
            [clarabel.NonnegativeConeT(len(right))], settings,
        ).solve()  # fmt: skip
    except BaseException as failure:
        # A panic of the library is not an Exception.
        if type(failure).__name__ != "PanicException":
            raise
        return None
    return problem.desired + np.array(answer.x)[:n] if str(answer.status) == "Solved" else None


def work(
    part: tuple[int, int], count: int, seed: int, only: list[str]
) -> tuple[dict[tuple[str, str], Tally], int]:
    """One process's share of the problems; (tallies by family and solver, problems the reference gave up)."""
    use_machine_code()
    answerers, tallies, given_up = Answerers(), defaultdict(Tally), 0
    for family, number, problem in problems(count, seed, only):
        if number % part[1] != part[0]:
            continue
        try:
            exact = exact_filter.solve(problem)
        except ArithmeticError:
            given_up += 1
            continue
        with np.errstate(all="ignore"):
            second = clarabel(problem)
            right = Tally()
            judge(right, problem, exact, second, CLARABEL)
            tallies[family, CLARABEL].add(right)
            for solver, effort, duals, taken in answerers.answers(problem):
                tally = tallies[family, solver]
                where = f"{family} {number} {solver}"
                judge(tally, problem, exact, effort, where)
                tally.missed += effort is None and right.answered > right.wrong
                tally.slowest = max(tally.slowest, taken)
                if (
                    exact.outcome == FLAT
                    and duals is not None
                    and (missing := residual(problem, effort, duals)) > WRONG
                ):
                    tally.wrong += 1
                    tally.notes.append(f"{where}: optimality conditions missed by {missing:.1e}")
    return dict(tallies), given_up


def report(tallies: dict[tuple[str, str], Tally], notes: int) -> None:
    """Prints the table and the first notes."""
    print(
        f"{'family':20}{'solver':18}{'answerable':>11}{'unsolved':>9}{'missed':>7}{'wrong':>6}{'refused':>8}{'worst':>9}{'N.m':>9}"
    )
    total: dict[str, Tally] = defaultdict(Tally)
    for (family, solver), tally in tallies.items():
        total[solver].add(tally)
        _line(family, solver, tally)
    for solver, tally in total.items():
        _line("all", solver, tally)
        print(f"{'':20}{'':18}slowest {tally.slowest:.0f} us")
    for solver, tally in total.items():
        if solver not in (ACTIVE_SET, CLARABEL):
            print(*tally.notes[:notes], sep="\n")
        else:
            print(
                *[note for note in tally.notes if "unsolved" not in note][
                    : notes if solver == ACTIVE_SET else 0
                ],
                sep="\n",
            )


def _line(family: str, solver: str, t: Tally) -> None:
    print(
        f"{family:20}{solver:18}{t.answerable:11}{t.answerable - t.answered:9}{t.missed:7}{t.wrong:6}{t.refused:8}"
        f"{t.worst:9.0e}{t.newton_metres:9.0e}"
    )


def main() -> int:
    """Runs all problems and prints what came of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--problems", type=int, default=10000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", default=[], choices=sorted({f.__name__ for f in FAMILIES}))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--notes", type=int, default=10, help="how many failures to name per solver")
    options = parser.parse_args()
    share = partial(work, count=options.problems, seed=options.seed, only=options.only)
    parts = [(k, options.jobs) for k in range(options.jobs)]
    if options.jobs == 1:
        results = [share(parts[0])]
    else:
        with ProcessPoolExecutor(options.jobs) as pool:
            results = list(pool.map(share, parts))
    tallies: dict[tuple[str, str], Tally] = defaultdict(Tally)
    for found, _ in results:
        for key, tally in found.items():
            tallies[key].add(tally)
    report(tallies, options.notes)
    print(
        f"{options.problems} problems, seed {options.seed}; beyond the reference: {sum(given for _, given in results)}"
    )
    ours = [t for (_, solver), t in tallies.items() if solver != CLARABEL]
    solvers = [t for (_, solver), t in tallies.items() if solver not in (CLARABEL, ACTIVE_SET)]
    unsolved, answerable = sum(t.answerable - t.answered for t in solvers), sum(t.answerable for t in solvers)
    return int(any(t.wrong for t in ours) or any(t.missed for t in solvers) or 1000 * unsolved > answerable)


if __name__ == "__main__":
    sys.exit(main())
