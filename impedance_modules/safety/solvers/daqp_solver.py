# SPDX-License-Identifier: BSD-3-Clause
"""DAQP: a dual active-set method in plain floats, the default.

Its soft constraints with individual weights are the filter's: rho = 1 / penalty, set anew every cycle because penalties
follow the inertia. All rows are passed every cycle: leaving out far ones would save 2 us and cost more to decide.

Every solve starts cold. That costs an iteration per active row, makes the answer a function of the problem alone (a
replay is bit-equal wherever it starts), and overwrites the marks by which DAQP remembers a row as absent (a row that
was zero) or as an equality.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Matrix, Record, Vector
from impedance_modules.safety.solvers.exact_form import ExactForm
from impedance_modules.safety.solvers.proving import INFINITE, Guess, ProvingSolver, largest_demand

_SETTINGS = {
    "primal_tol": 1e-11,  # in parts of the largest demand
    "dual_tol": 1e-12,
    "eps_prox": 0.0,
    "iter_limit": 1000,
    "eq_reduction": -1,
}
_SOFT = 8

_MEANING = {
    1: "optimal",
    2: "optimal, a soft row gave way",
    -1: "the hard limits contradict each other",
    -2: "cycling",
    -3: "unbounded",
    -4: "iteration limit",
    -5: "the metric is not positive definite",
    -6: "too many rows active at the start",
}


class PlainProblem(Record):
    """What DAQP is given; it keeps pointers to it.

    Attributes:
        metric: (n, n).
        matrix: (m, n).
        lower, upper: (n + m,) bounds of the change; torque limits first, -INFINITE and INFINITE where absent.
        softness: (n + m,) 1 / penalty; 0 for hard ones.
    """

    metric: Matrix
    matrix: Matrix
    lower: Vector
    upper: Vector
    softness: Vector


@compiled
def write_plain(form: ExactForm, size: float, plain: PlainProblem) -> None:
    """Writes a problem in plain floats, bounds in parts of ``size``."""
    n = form.joints
    for i in range(n):
        for j in range(n):
            plain.metric[i, j] = form.metric[i, j]
    for c in range(plain.lower.size):
        # A torque limit stands in the joint's own units, other bounds in those of their row.
        scale = size * form.rows[c, c] if c < n else size
        plain.lower[c] = max(form.low[0, c] / scale, -INFINITE)
        plain.upper[c] = min(form.high[0, c] / scale, INFINITE)
        plain.softness[c] = form.give[0, c] * form.give[0, c]
        for j in range(n):
            if c >= n:
                plain.matrix[c - n, j] = form.rows[c, j]


class DaqpSolver(ProvingSolver):
    """Keeps one DAQP model and its memory.

    Args:
        model_type: ``daqp.Model``, handed in so that only `make_solver` imports the solver.
    """

    name = "daqp"

    def __init__(self, model_type: Any) -> None:
        super().__init__()
        self._model_type = model_type
        self._model: Any = None

    def _forget(self) -> None:
        m, n = self._shape
        self._model = None
        self._zero = np.zeros(n)
        self._sense = np.zeros(n + m, dtype=np.intc)
        self._plain = PlainProblem(
            metric=np.zeros((n, n)),
            matrix=np.zeros((m, n)),
            lower=np.zeros(n + m),
            upper=np.zeros(n + m),
            softness=np.zeros(n + m),
        )

    def _guess(self, form: ExactForm) -> Guess:
        plain = self._plain
        write_plain(form, largest_demand(form), plain)
        self._sense[form.joints :] = np.where(form.give[0, form.joints :] > 0.0, _SOFT, 0)
        data = (plain.metric, self._zero, plain.matrix, plain.upper, plain.lower, self._sense)
        flag = self._load(data)
        if flag < 0:
            self._model = None
            return Guess(None, 0, _MEANING.get(flag, f"exit flag {flag}"))
        self._model.soft_weights(rho_l=plain.softness, rho_u=plain.softness)
        _, _, flag, info = self._model.solve()
        status = _MEANING.get(flag, f"exit flag {flag}")
        multipliers = np.array(info["lam"]) if flag in (1, 2) else None
        return Guess(multipliers, int(info["iterations"]), status)

    def _load(self, data: tuple[np.ndarray, ...]) -> int:
        if self._model is not None:
            return int(self._model.update(*data))
        self._model = self._model_type()
        self._model.settings = _SETTINGS
        flag, _ = self._model.setup(*data)
        return int(flag)
