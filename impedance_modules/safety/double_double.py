# SPDX-License-Identifier: BSD-3-Clause
"""Numbers of 32 digits: the sum of two floats, the second no larger than half a rounding error of the first.

Every operation loses about 1e-32 of its operands, and costs ten to twenty float operations, without which the exact
sum or product of two floats cannot be had (Dekker, "A floating-point technique for extending the available precision",
1971; Knuth, "The Art of Computer Programming", volume 2, 4.2.2). Arrays of such numbers have a first axis of length 2.
Numbers beyond 1e290 are not representable.
"""

from __future__ import annotations

import math

from impedance_modules.compiled import compiled

Long = tuple[float, float]
"""High part, low part."""

_SPLITTER = 134217729.0
"""2^27 + 1: cuts the 53 bits of a float into two halves whose products are exact."""


@compiled
def exact_sum(a: float, b: float) -> Long:
    """Adds two floats without error."""
    high = a + b
    part = high - a
    return high, (a - (high - part)) + (b - part)


@compiled
def exact_product(a: float, b: float) -> Long:
    """Multiplies two floats without error."""
    high = a * b
    shifted = _SPLITTER * a
    a_high = shifted - (shifted - a)
    a_low = a - a_high
    shifted = _SPLITTER * b
    b_high = shifted - (shifted - b)
    b_low = b - b_high
    return high, ((a_high * b_high - high) + a_high * b_low + a_low * b_high) + a_low * b_low


@compiled
def add(a: Long, b: Long) -> Long:
    """Returns a + b."""
    high, low = exact_sum(a[0], b[0])
    low += a[1] + b[1]
    total = high + low
    return total, low - (total - high)


@compiled
def multiply(a: Long, b: Long) -> Long:
    """Returns a b."""
    high, low = exact_product(a[0], b[0])
    low += a[0] * b[1] + a[1] * b[0]
    total = high + low
    return total, low - (total - high)


@compiled
def subtract_product(total: Long, a: Long, b: Long) -> Long:
    """Returns total - a b."""
    high, low = multiply(a, b)
    return add(total, (-high, -low))


@compiled
def divide(a: Long, b: Long) -> Long:
    """Returns a / b."""
    first = a[0] / b[0]
    rest = subtract_product(a, (first, 0.0), b)
    second = rest[0] / b[0]
    rest = subtract_product(rest, (second, 0.0), b)
    return add(exact_sum(first, second), (rest[0] / b[0], 0.0))


@compiled
def square_root(a: Long) -> Long:
    """Returns the root of a positive number."""
    root = math.sqrt(a[0])
    rest = subtract_product(a, (root, 0.0), (root, 0.0))
    return exact_sum(root, rest[0] / (2.0 * root))
