# SPDX-License-Identifier: BSD-3-Clause
"""Types of numpy arrays, for annotations; a docstring says what shape and unit one has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers of any shape."""

Indices = NDArray[np.intp]
"""Places in another array."""
