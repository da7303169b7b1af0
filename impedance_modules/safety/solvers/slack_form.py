# SPDX-License-Identifier: BSD-3-Clause
"""The normal form with one explicit variable per soft row, for solvers without soft constraints.

z = (y, t) with s_r = sqrt(rho_r) t_r: minimise 1/2 |z|^2 subject to
lower <= g_r . y + sqrt(rho_r) t_r <= upper. Its multipliers are those of the normal form.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.safety.problem import Matrix
from impedance_modules.safety.solvers.normal_form import NormalForm


def slack_rows(form: NormalForm) -> Matrix:
    """Constraint matrix over (y, t).

    Returns:
        (N, n + soft), the soft constraints' columns in their order.
    """
    count, n = form.rows.shape
    soft = np.flatnonzero(form.softness > 0.0)
    matrix = np.zeros((count, n + soft.size))
    matrix[:, :n] = form.rows
    matrix[soft, n + np.arange(soft.size)] = np.sqrt(form.softness[soft])
    return matrix
