# SPDX-License-Identifier: BSD-3-Clause
"""One thread for linear algebra: the matrices here are small, and waiting threads cost more than they help."""

from __future__ import annotations

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Keeps numpy's libraries to one thread; must come before numpy is imported.

    On a busy machine their idle threads spin: eigenvalues of a 130x130 loop then take seconds instead of
    milliseconds. A variable that the user has set is left alone.
    """
    for name in VARIABLES:
        os.environ.setdefault(name, "1")
