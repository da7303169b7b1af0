# SPDX-License-Identifier: BSD-3-Clause
"""Blind benchmark of the diagnosis: logs of a Baxter arm in MuJoCo whose cause is known to the scorer only."""

import os

for _pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_pool, "1")  # cases run side by side: small matrices gain nothing from threads
