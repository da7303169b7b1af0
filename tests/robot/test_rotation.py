# SPDX-License-Identifier: BSD-3-Clause
"""Rotations against pinocchio and scipy, from nothing to half a turn, as Python and as machine code."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from impedance_modules.robot.rotation import (
    add_cross,
    add_rotation_rate,
    compose,
    dot,
    exp3,
    log3,
    log_curvature,
    log_jacobian,
    rotation_angle,
    turn,
    turn_back,
    write_quaternion,
)

ANGLES = (0.0, 1e-9, 9e-5, 1.1e-4, 0.3, 1.0, 2.9, 3.02, 3.1, np.pi - 1e-6)


def vectors(angle: float, count: int = 8):
    random = np.random.default_rng(int(1e3 * angle))
    for axis in random.normal(size=(count, 3)):
        yield angle * axis / np.linalg.norm(axis)


@pytest.mark.parametrize("angle", ANGLES)
def test_exponential_and_logarithm_are_those_of_pinocchio_and_undo_each_other(ways, angle: float) -> None:
    for vector in vectors(angle):
        rotation = exp3(vector)
        np.testing.assert_allclose(rotation, pin.exp3(vector), atol=1e-14)
        np.testing.assert_allclose(log3(rotation), vector, rtol=1e-9, atol=2e-9)
        np.testing.assert_allclose(rotation_angle(rotation), angle, rtol=1e-9, atol=2e-9)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_a_turn_has_one_of_its_two_signs(ways, axis) -> None:
    found = log3(exp3(np.pi * axis))
    assert abs(abs(float(found @ axis)) - np.pi) < 1e-7


@pytest.mark.parametrize("angle", [angle for angle in ANGLES if 0.0 < angle < 3.1])
def test_jacobian_is_the_derivative_of_the_logarithm(ways, angle: float) -> None:
    step = 1e-6
    for vector in vectors(angle, 3):
        rotation = exp3(vector)
        there, back = ([log3(exp3(s * unit) @ rotation) for unit in np.eye(3)] for s in (step, -step))
        columns = np.subtract(there, back) / (2.0 * step)
        np.testing.assert_allclose(log_jacobian(vector), columns.T, atol=2e-7)


def test_curvature_of_the_logarithm_is_continuous_at_small_angles(ways) -> None:
    for angle in (0.0, 1e-6, 9.9e-5, 1.01e-4, 1e-3):
        assert log_curvature(angle * angle) == pytest.approx(1.0 / 12.0, rel=1e-6)


def test_small_products(ways) -> None:
    random = np.random.default_rng(1)
    for _ in range(5):
        a, b, out = random.normal(size=3), random.normal(size=3), random.normal(size=3)
        rotation, other, matrix = exp3(a), exp3(b), np.empty((3, 3))
        expected = out + np.cross(a, b)
        add_cross(a, b, out)
        np.testing.assert_allclose(out, expected, atol=1e-15)
        assert dot(a, b) == pytest.approx(float(a @ b), rel=1e-14)
        turn(rotation, b, out)
        np.testing.assert_allclose(out, rotation @ b, atol=1e-15)
        turn_back(rotation, b, out)
        np.testing.assert_allclose(out, rotation.T @ b, atol=1e-15)
        compose(rotation, other, matrix)
        np.testing.assert_allclose(matrix, rotation @ other, atol=1e-15)


def test_rate_of_a_rotation_vector_is_the_jacobian_to_fourth_order(ways) -> None:
    for vector in vectors(0.02):
        velocity, rate = np.array([0.3, -1.0, 0.5]), np.zeros(3)
        add_rotation_rate(vector, velocity, rate)
        np.testing.assert_allclose(rate, log_jacobian(vector) @ velocity, atol=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_quaternion_is_scipys_with_a_positive_real_part(ways, angle: float) -> None:
    found = np.empty(4)
    for vector in vectors(angle):
        write_quaternion(exp3(vector), found)
        expected = Rotation.from_rotvec(vector).as_quat(canonical=True)
        np.testing.assert_allclose(found, expected, atol=1e-12)
        assert found[3] >= 0.0
