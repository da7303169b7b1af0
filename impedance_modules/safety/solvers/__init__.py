# SPDX-License-Identifier: BSD-3-Clause
"""Second of the filter's three steps: interchangeable solvers behind one protocol."""

from impedance_modules.safety.solvers.make import make_solver
from impedance_modules.safety.solvers.solution import FilterSolution, Solver

__all__ = ["FilterSolution", "Solver", "make_solver"]
