# SPDX-License-Identifier: BSD-3-Clause
"""Wide benchmark of the diagnosis: recordings of many arms, controllers, clocks and sensors, made by two engines."""

import os

for _pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_pool, "1")  # matrices are small, and cases run side by side
