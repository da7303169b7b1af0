# SPDX-License-Identifier: BSD-3-Clause
"""Time of one filter solve per solver, as ratios within one run (14 joints, 53 rows).

Run: python -m benchmarks.control.filter_solvers [problems]. Cases alternate in random order in blocks of 25, so
that a busy machine slows all of them alike; use the ratios, the microseconds are for orientation.
"""

from __future__ import annotations

import gc
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from impedance_modules.compiled import use_machine_code
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers import make_solver
from tests.support import filter_problems

BLOCK = 25
ARRAYS = ("desired", "metric", "effort_max", "matrix", "lower", "upper", "penalty")


def calm(rng: np.random.Generator, active: int) -> FilterProblem:
    """A state well inside all limits, with ``active`` joints asked to pass their speed limit."""
    state = filter_problems.state(rng, spread=0.3)
    state.available, state.distance[:], state.previous[:] = 100.0, 0.3, 0.0
    limits = filter_problems.limits(rng)
    limits.effort_rate_max[:], limits.deceleration[:] = 1e5, 1e3
    desired = state.bias + rng.normal(size=filter_problems.N) * 0.01
    problem = filter_problems.build(filter_problems.blank(), limits, state, desired)
    where = filter_problems.LAYOUT.velocity
    for row in rng.choice(np.arange(where.start, where.stop), active, replace=False):
        problem.upper[row] = problem.matrix[row] @ desired - 1.0
    problem.lower[:] = np.minimum(problem.lower, problem.upper)
    return problem


def main() -> None:
    """Prints median, p99 and largest time of each solver and case, and ratios to DAQP's."""
    use_machine_code()
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    rng = np.random.default_rng(0)
    cases = {
        "inside": [calm(rng, 0) for _ in range(count)],
        "one row": [calm(rng, 1) for _ in range(count)],
        "four rows": [calm(rng, 4) for _ in range(count)],
        "hard push": [filter_problems.problem(rng, 0.9, 1.0) for _ in range(count)],
    }
    solvers = {
        name: make_solver(name) for name in ("daqp", "proxsuite", "qpsolvers:daqp", "qpsolvers:proxqp")
    }
    times: dict[tuple[str, str], list[float]] = {(s, c): [] for s in solvers for c in cases}
    jobs = [(s, c, start) for s in solvers for c in cases for start in range(0, count, BLOCK)]
    hot = filter_problems.blank()
    for solver in solvers.values():
        for problems in cases.values():
            solver.solve(problems[0])
    gc.freeze()
    gc.disable()
    for place in rng.permutation(len(jobs)):
        solver, case, start = jobs[place]
        for problem in cases[case][start : start + BLOCK]:
            for array in ARRAYS:
                np.copyto(getattr(hot, array), getattr(problem, array))
            before = time.perf_counter()
            solution = solvers[solver].solve(hot)
            times[solver, case].append(1e6 * (time.perf_counter() - before))
            if not solution.solved:
                print(f"{solver}, {case}: {solution.status}")
    print(f"{'solver':18}{'case':12}{'median us':>10}{'p99':>9}{'max':>9}{'x daqp':>8}")
    for (solver, case), values in times.items():
        base = np.median(times["daqp", case])
        p50, p99, top = np.median(values), np.percentile(values, 99), max(values)
        print(f"{solver:18}{case:12}{p50:10.1f}{p99:9.1f}{top:9.1f}{p50 / base:8.1f}")


if __name__ == "__main__":
    main()
