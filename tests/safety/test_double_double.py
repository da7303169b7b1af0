# SPDX-License-Identifier: BSD-3-Clause
"""Arithmetic of 32 digits against exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from impedance_modules.safety import double_double as dd
from tests.support.both_ways import ways  # noqa: F401

pytestmark = pytest.mark.usefixtures("ways")

LOST = Fraction(1, 10**31)


def random_number(random: np.random.Generator) -> tuple[float, float]:
    high = float(random.normal() * 10.0 ** random.uniform(-8.0, 8.0))
    return high, high * 2.0**-54 * float(random.uniform(-1.0, 1.0))


def value(number: tuple[float, float]) -> Fraction:
    return Fraction(number[0]) + Fraction(number[1])


def test_sums_and_products_of_floats_are_exact() -> None:
    random = np.random.default_rng(0)
    for _ in range(500):
        a, b = random_number(random)[0], random_number(random)[0]
        assert value(dd.exact_sum(a, b)) == Fraction(a) + Fraction(b)
        assert value(dd.exact_product(a, b)) == Fraction(a) * Fraction(b)


def test_every_operation_keeps_31_digits_of_its_operands() -> None:
    random = np.random.default_rng(1)
    for _ in range(500):
        a, b, c = (random_number(random) for _ in range(3))
        x, y, z = value(a), value(b), value(c)
        assert abs(value(dd.add(a, b)) - (x + y)) <= LOST * (abs(x) + abs(y))
        assert abs(value(dd.multiply(a, b)) - x * y) <= LOST * abs(x * y)
        assert abs(value(dd.subtract_product(a, b, c)) - (x - y * z)) <= LOST * (abs(x) + abs(y * z))
        assert abs(value(dd.divide(a, b)) - x / y) <= LOST * abs(x / y)
        positive = a if a[0] > 0.0 else (-a[0], -a[1])
        root = value(dd.square_root(positive))
        assert abs(root * root - abs(x)) <= 4 * LOST * abs(x)


def test_low_parts_stay_below_half_a_rounding_of_high_parts() -> None:
    random = np.random.default_rng(2)
    for _ in range(300):
        a, b = random_number(random), random_number(random)
        for high, low in (dd.add(a, b), dd.multiply(a, b), dd.divide(a, b)):
            assert high + low == high
