# SPDX-License-Identifier: BSD-3-Clause
"""Second of the filter's three steps: interchangeable solvers behind one protocol."""

from impedance_modules.safety.solvers.solution import FilterSolution, Solver, make_solver

__all__ = ["FilterSolution", "Solver", "make_solver"]
