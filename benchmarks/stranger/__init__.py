# SPDX-License-Identifier: BSD-3-Clause
"""A stranger's benchmark of `impedance diagnose`: makers' URDFs, another engine, other habits."""

import os

for _pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_pool, "1")  # matrices are small
