# SPDX-License-Identifier: BSD-3-Clause
"""The minimum jerk: the smoothest way from rest to rest in a given time.

Source: T. Flash, N. Hogan, "The coordination of arm movements", J. Neurosci. 5 (1985).
"""

from __future__ import annotations

from impedance_modules.compiled import compiled


@compiled
def minimum_jerk(fraction: float) -> float:
    """Goes smoothly from 0 at 0 to 1 at 1, s = 10 x^3 - 15 x^4 + 6 x^5; stays there outside."""
    x = min(max(fraction, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def minimum_jerk_slope(fraction: float) -> float:
    """Gives ds/dx = 30 x^2 (1 - x)^2 of ``minimum_jerk``; 0 outside [0, 1]."""
    x = min(max(fraction, 0.0), 1.0)
    return 30.0 * x**2 * (1.0 - x) ** 2
