# SPDX-License-Identifier: BSD-3-Clause
"""Wrong arithmetic, forms and searches of the filter's solvers; their tests need machine code."""

from __future__ import annotations

MACHINE_CODE = True

SAFETY = "impedance_modules/safety/"
LONG, FORM = SAFETY + "double_double.py", SAFETY + "solvers/exact_form.py"
SEARCH, STIFF = SAFETY + "solvers/exact_search.py", SAFETY + "solvers/stiff_rows.py"
ACTING = SAFETY + "solvers/acting_set.py"
PROVING = SAFETY + "solvers/proving.py"

DEGENERATE = "tests/safety/test_degenerate_problems.py"
TESTS = {
    LONG: ("tests/safety/test_double_double.py",),
    FORM: (DEGENERATE,),
    SEARCH: (DEGENERATE,),
    ACTING: ("tests/safety/test_exact_search_steps.py", DEGENERATE),
    STIFF: (DEGENERATE,),
    PROVING: (DEGENERATE,),
}

MUTANTS = (
    (LONG, "return high, (a - (high - part)) + (b - part)", "return high, b - part"),
    (LONG, "+ a_low * b_low", "+ 0.0 * b_low"),
    (LONG, "low += a[0] * b[1] + a[1] * b[0]", "low += a[0] * b[1]"),
    (LONG, "return add(exact_sum(first, second), (rest[0] / b[0], 0.0))", "return first, 0.0"),
    (LONG, "return exact_sum(root, rest[0] / (2.0 * root))", "return exact_sum(root, rest[0] / root)"),
    (FORM, "            if not abs(metric[i, j]) < np.inf:\n                return False\n", "            pass\n"),
    (FORM, "            if not abs(matrix[r, j]) < np.inf:\n                return False\n", "            pass\n"),
    (FORM, "and problem.kappa[r] > 0.0):", "and True):"),
    (FORM, "form.metric[i, j] = problem.metric[i, j] * form.unit[i] * form.unit[j]",
     "form.metric[i, j] = problem.metric[i, j] * form.unit[i]"),
    (FORM, "return form.regular or _factor(form, ROUNDING)", "return form.regular"),
    (FORM, "elif total[0] > _PIVOT:", "elif total[0] > 1e-12:"),
    (FORM, "form.give[0, c], form.give[1, c] = give[0] / unit, give[1] / unit",
     "form.give[0, c], form.give[1, c] = give[0], give[1]"),
    (FORM, "rest = subtract_product((bound, 0.0), value, (1.0, 0.0))", "rest = (bound - value[0], 0.0)"),
    (SEARCH, "            return CONTRADICTORY\n", "            break\n"),
    (ACTING, "        exact.count = k + 1\n        extend(exact, project(exact))\n", "        exact.count = k + 1\n"),
    (ACTING, "if square[0] > min(_DEPENDENT, 0.1 * others * others)", "if square[0] > 1e-9"),
    (SEARCH, "if leaving == last or whole[0] <= step[0]:", "if True:"),
    (SEARCH, "breach = subtract_product(breach, step, square)", "breach = subtract_product(breach, step, (0.0, 0.0))"),
    (SEARCH, "            if until[0] < step[0]:", "            if until[0] > step[0]:"),
    (ACTING, "if exact.noise > _CANCELLING * size:", "if False:"),
    (SEARCH, "duals[c] = side * exact.multiplier[0, k] / exact.form.row_unit[c]",
     "duals[c] = side * exact.multiplier[0, k]"),
    (STIFF, "if stiff.taken[k] == 0 and give[0, k] < least:", "if stiff.taken[k] == 0 and least == np.inf:"),
    (STIFF, "total = subtract_product(total, (system[0, j, c], system[1, j, c]), (point[0, c], point[1, c]))",
     "total = (total[0], 0.0)"),
    (PROVING, "if problem.matrix.shape != self._shape:", "if self._shape == (-1, -1):"),
)  # fmt: skip
