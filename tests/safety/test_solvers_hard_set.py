# SPDX-License-Identifier: BSD-3-Clause
"""Problems that break solvers: every one is solvable, every answer is compared with an exact one."""

import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers import make_solver
from tests.reference import filter_reference
from tests.support import filter_problems as fp
from tests.support.both_ways import machine_code  # noqa: F401
from tests.support.paths import CHECKOUT

pytestmark = pytest.mark.usefixtures("machine_code")

TOLERANCE = dict.fromkeys(("daqp", "proxsuite", "qpsolvers:daqp"), 1e-9)
MOST_ITERATIONS = 2000
"""The usual is below a hundred; a solver that needs more than this goes round in circles."""


def ordinary(rng: np.random.Generator) -> FilterProblem:
    return fp.problem(rng, 0.8, 0.5)


def standing_still(rng: np.random.Generator) -> FilterProblem:
    return fp.problem(rng, 0.9, 1.5, moving=False)


def barely_moving(rng: np.random.Generator) -> FilterProblem:
    p = fp.problem(rng, 0.9, 1.5)
    matrix, upper = p.matrix.copy(), p.upper.copy()
    matrix[0] *= 10.0 ** rng.uniform(-9, -3)
    upper[0] = 0.0
    return fp.changed(p, matrix=matrix, upper=upper)


def duplicated_rows(rng: np.random.Generator) -> FilterProblem:
    p = fp.problem(rng, 1.2, 1.5)
    arrays = {name: getattr(p, name).copy() for name in ("matrix", "lower", "upper", "penalty")}
    rows = rng.choice(np.arange(1, fp.LAYOUT.m), 12, replace=False)
    for array in arrays.values():
        array[rows[:6]] = array[rows[6:]]
    return fp.changed(p, **arrays)


def parallel_rows(rng: np.random.Generator) -> FilterProblem:
    """The same direction again and again, differently long and nearly so; power along one joint."""
    p = fp.problem(rng, 1.2, 1.5)
    matrix = p.matrix.copy()
    for row in fp.LAYOUT.labels.index("distance pair0") + np.arange(8):
        matrix[row] = (
            matrix[fp.LAYOUT.position.start] * rng.uniform(-2, 2) + rng.choice([0.0, 1e-9]) * matrix[row]
        )
    matrix[0] = np.eye(fp.N)[rng.integers(fp.N)]
    return fp.changed(p, matrix=matrix)


def outside_both_ways(rng: np.random.Generator) -> FilterProblem:
    """Every joint beyond its range and too fast, pairs inside the margin, and contradictory rows."""
    p = fp.problem(rng, 1.6, 1.0)
    lower, upper = p.lower.copy(), p.upper.copy()
    where = fp.LAYOUT.position
    shift = rng.choice([-50.0, 50.0], fp.N)
    lower[where] += shift
    upper[where] += shift
    return fp.changed(p, lower=lower, upper=upper)


def closed_intervals(rng: np.random.Generator) -> FilterProblem:
    """Rows whose two bounds are one number, hard to tell from equalities."""
    p = fp.problem(rng, 1.2, 1.0)
    lower = p.lower.copy()
    rows = rng.choice(1 + np.flatnonzero(np.isfinite(p.upper[1:])), 10, replace=False)
    lower[rows] = p.upper[rows]
    return fp.changed(p, lower=lower)


def huge_demand(rng: np.random.Generator) -> FilterProblem:
    return fp.problem(rng, 1.0, 10.0 ** rng.uniform(1, 3))


def starved_tank(rng: np.random.Generator) -> FilterProblem:
    """No energy left, and the last torque far from anything allowed now."""
    p = fp.problem(rng, 0.9, 3.0)
    upper, lower = p.upper.copy(), p.lower.copy()
    upper[0] = 0.0
    push = np.sign(p.matrix[0]) * p.effort_max
    lower[fp.LAYOUT.rate], upper[fp.LAYOUT.rate] = push - 1.0, push + 1.0
    return fp.changed(p, lower=lower, upper=upper)


def tight_box(rng: np.random.Generator) -> FilterProblem:
    """Some joints may give no torque at all."""
    p = fp.problem(rng, 1.0, 1.0)
    return fp.changed(p, effort_max=p.effort_max * rng.choice([0.0, 1e-6, 1.0], fp.N))


KINDS = (
    ordinary, standing_still, barely_moving, duplicated_rows, parallel_rows, outside_both_ways,
    closed_intervals, huge_demand, starved_tank, tight_box,
)  # fmt: skip
EACH = 42


@pytest.fixture(scope="module")
def answered() -> list[tuple[str, FilterProblem, np.ndarray]]:
    """The set in random order, so that each problem is a jump from the last, with exact answers."""
    rng = np.random.default_rng(20)
    problems = [(kind.__name__, kind(rng)) for kind in KINDS for _ in range(EACH)]
    order = rng.permutation(len(problems))
    return [(*problems[i], filter_reference.solve(problems[i][1])) for i in order]


def answers(name: str, problems: list) -> Iterator[tuple[str, int, np.ndarray, np.ndarray]]:
    solver = make_solver(name)
    for _, problem, _ in problems[:5]:
        solver.solve(problem)
    for kind, problem, exact in problems:
        solution = solver.solve(problem)
        assert solution.solved, f"{kind}: {solution.status}"
        yield kind, solution.iterations, solution.effort, exact


@pytest.mark.parametrize("name", TOLERANCE)
def test_hard_set_is_solved_right_in_few_iterations(name: str, answered: list) -> None:
    assert len(answered) >= 400
    worst: dict[str, float] = {}
    for kind, iterations, effort, exact in answers(name, answered):
        assert iterations <= MOST_ITERATIONS, kind
        worst[kind] = max(worst.get(kind, 0.0), float(np.abs(effort - exact).max()))
    assert max(worst.values()) < TOLERANCE[name], worst


def test_set_is_hard(answered: list) -> None:
    """Most of it must change the torque, a good part with many rows at once."""
    solver = make_solver("daqp")
    counts = np.array([solver.solve(problem).active.sum() for _, problem, _ in answered])
    assert (counts >= 1).mean() > 0.8
    assert (counts >= 8).mean() > 0.4


@pytest.mark.parametrize("name", ["daqp", "proxsuite"])
def test_fresh_solver_survives_its_first_solves(name: str) -> None:
    """In a process of its own: a crash of the library would end it with a signal."""
    code = (
        "import numpy as np\nfrom tests.support import filter_problems as fp\n"
        "from impedance_modules.safety.solvers import make_solver\n"
        "rng = np.random.default_rng(0)\n"
        "for _ in range(5):\n"
        f"    solver = make_solver({name!r})\n"
        "    for _ in range(3):\n"
        "        assert solver.solve(fp.problem(rng, 1.3, 3.0)).solved\n"
    )
    paths = os.pathsep.join([str(CHECKOUT), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PYTHONPATH": paths},
        check=False,
    )
    assert done.returncode == 0, done.stderr
