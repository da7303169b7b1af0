# SPDX-License-Identifier: BSD-3-Clause
r"""The net stiffness of the 2016 thesis, recomputed: ``python -m impedance_modules.superposition.examples``.

Of one arm (eq. 5.1), which the thesis computes with the end springs' wrench instead of the one that the joint springs
carry. Its planar arms (eq. 4.28-4.30) are the task ``planar-arms``.

Source: L. A. Hosford, Development and Testing of an Impedance Controller on an Anthropomorphic Robot for
Extreme Environment Operations, MIT, 2016.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.superposition.net_stiffness import NetStiffness, net_stiffness

DISTANCE = (0.27035, 0.0, 0.36435, 0.0, 0.37429, 0.0, 0.229525)
LENGTH = (0.069, 0.0, 0.069, 0.0, 0.01, 0.0, 0.0)
TWIST = (-1, 1, -1, 1, -1, 1, 0)
"""Denavit-Hartenberg d [m], a [m] and alpha [quarter turns] of the thesis's arm (2.2-2.7)."""

SECOND_OFFSET = math.pi / 2
BASE_YAW = -math.pi / 4


def thesis_jacobian(q: Array) -> Array:
    """Computes the hand's Jacobian of the thesis's arm from its Denavit-Hartenberg table.

    Args:
        q: (7,) [rad].

    Returns:
        (6, 7), linear then angular, base axes, at the hand.
    """
    turn, origin = _rotation_z(BASE_YAW), np.zeros(3)
    axes, origins = [], []
    offsets = np.array([0.0, SECOND_OFFSET, 0.0, 0.0, 0.0, 0.0, 0.0])
    for angle, d, a, quarter in zip(q + offsets, DISTANCE, LENGTH, TWIST, strict=True):
        axes.append(turn[:, 2])
        origins.append(origin)
        turn = turn @ _rotation_z(angle)
        origin = origin + turn @ np.array([a, 0.0, d])
        turn = turn @ _rotation_x(0.5 * math.pi * quarter)
    linear = [np.cross(axis, origin - at) for axis, at in zip(axes, origins, strict=True)]
    return np.vstack([np.array(linear).T, np.array(axes).T])


POSTURE = np.array([0.9407, 0.080917, -0.10316, 1.102548, -3.0434, -0.3482, 1.451529])
JOINT_STIFFNESS = np.array([0.005, 5.0, 5.0, 0.005, 0.005, 5.0, 5.0])
END_STIFFNESS = np.diag([300.0, 300.0, 50.0, 0.0, 0.0, 0.0])
ACTUAL = np.array([0.653, -0.2252, -0.2622])
DESIRED = np.array([0.66686, -0.224838, -0.55648])
"""Of eq. 5.1: q [rad], K_joints [N.m/rad], K_end [N/m], printed x_act and x_d [m]."""


def thesis_net_stiffness() -> NetStiffness:
    """Computes eq. 5.1 with the thesis's own wrench, F = -K_end (x_d - x_act), the end springs' force.

    It is not what the joint springs carry, so the result is not a stiffness that could be measured: its
    smallest eigenvalue is negative, and ``folds`` says so. The matrix is ``at_hand``.
    """
    wrench = np.zeros(6)
    wrench[:3] = -END_STIFFNESS[:3, :3] @ (DESIRED - ACTUAL)
    return net_stiffness(thesis_jacobian(POSTURE), JOINT_STIFFNESS, END_STIFFNESS, wrench)


def relaxed_net_stiffness() -> NetStiffness:
    """Computes the stiffness at the same posture with relaxed joint springs, which displacements confirm."""
    return net_stiffness(thesis_jacobian(POSTURE), JOINT_STIFFNESS, END_STIFFNESS, np.zeros(6))


def _rotation_z(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _rotation_x(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def print_examples() -> None:
    """Prints the thesis's matrix and the law's, in SI units."""
    loaded, relaxed = thesis_net_stiffness(), relaxed_net_stiffness()
    with np.printoptions(precision=3, suppress=True):
        print("eq. 5.1, net stiffness with the end springs' wrench:", loaded.at_hand, sep="\n")
        print(f"the arm folds under that wrench: {loaded.folds}")
        print("net stiffness with relaxed joint springs, which can be measured:", relaxed.at_hand, sep="\n")


if __name__ == "__main__":
    print_examples()
